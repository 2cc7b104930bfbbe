//! How a client recognises a server: by the fingerprint of its certificate, given or remembered.

use std::{
    fs, io,
    io::Write,
    net::SocketAddr,
    path::{Path, PathBuf},
    sync::Arc,
};

use quinn::{Connection, crypto::rustls::QuicClientConfig};
use rustls::{
    DigitallySignedStruct, SignatureScheme,
    client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier},
    crypto::{CryptoProvider, verify_tls12_signature, verify_tls13_signature},
    pki_types::{CertificateDer, ServerName, UnixTime},
};
use sightline_cli::identity::Identity;
use sightline_protocol::{ALPN, fingerprint::Fingerprint};

/// Which servers are trusted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trust {
    /// The server with this fingerprint.
    Pinned(Fingerprint),
    /// For each address, the server first met there (trust on first use). The file has lines of an
    /// address and a fingerprint.
    FirstUse(PathBuf),
}

/// Why a server is not trusted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrustError {
    /// The server is not the pinned one.
    #[error("the server's fingerprint is {found}, not {expected}")]
    Pinned {
        /// The pinned fingerprint.
        expected: Fingerprint,
        /// The fingerprint of the server.
        found: Fingerprint,
    },
    /// The server is not the one first met at this address.
    #[error(
        "the server at {address} has changed: its fingerprint is {found}, and was {expected}; if \
         you expect that, remove its line from {}", path.display()
    )]
    Changed {
        /// The address.
        address: SocketAddr,
        /// The remembered fingerprint.
        expected: Fingerprint,
        /// The fingerprint of the server.
        found: Fingerprint,
        /// The file of known servers.
        path: PathBuf,
    },
    /// The file of known servers cannot be read or written.
    #[error("cannot keep known servers in {}: {source}", path.display())]
    Io {
        /// The file of known servers.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The server showed no certificate.
    #[error("the server has no certificate")]
    NoCertificate,
}

impl Trust {
    /// The servers that the programs of this user have met; `None` when there is no home folder.
    pub fn of_user() -> Option<Self> {
        let folders = user_folders()?;
        Some(Self::FirstUse(folders.config_dir().join("known-servers")))
    }

    /// Checks that the server is a trusted one. Must be called before anything is sent.
    ///
    /// # Errors
    /// When it is another server, or the file of known servers cannot be read or written.
    pub fn check(&self, connection: &Connection, address: SocketAddr) -> Result<(), TrustError> {
        let found = fingerprint(connection).ok_or(TrustError::NoCertificate)?;
        match self {
            Self::Pinned(expected) if *expected == found => Ok(()),
            Self::Pinned(expected) => Err(TrustError::Pinned { expected: *expected, found }),
            Self::FirstUse(path) => check_known(path, address, found),
        }
    }
}

/// The folders of this user's programs.
pub(super) fn user_folders() -> Option<directories::ProjectDirs> {
    directories::ProjectDirs::from("", "", "sightline")
}

fn fingerprint(connection: &Connection) -> Option<Fingerprint> {
    let identity = connection.peer_identity()?;
    let certificates = identity.downcast::<Vec<CertificateDer<'static>>>().ok()?;
    certificates.first().map(|certificate| Fingerprint::of(certificate))
}

fn check_known(path: &Path, address: SocketAddr, found: Fingerprint) -> Result<(), TrustError> {
    let failed = |source| TrustError::Io { path: path.to_owned(), source };
    let known = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(failed(error)),
    };
    match find(&known, address) {
        Some(expected) if expected == found => Ok(()),
        Some(expected) => {
            let path = path.to_owned();
            Err(TrustError::Changed { address, expected, found, path })
        }
        None => remember(path, address, found).map_err(failed),
    }
}

fn find(known: &str, address: SocketAddr) -> Option<Fingerprint> {
    known.lines().find_map(|line| {
        let (at, fingerprint) = line.split_once(' ')?;
        let is_it = at.parse() == Ok(address);
        is_it.then(|| fingerprint.parse().ok()).flatten()
    })
}

fn remember(path: &Path, address: SocketAddr, fingerprint: Fingerprint) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    let mut file = fs::OpenOptions::new().append(true).create(true).open(path)?;
    // One write: two clients that start at the same time do not mix their lines.
    file.write_all(format!("{address} {fingerprint}\n").as_bytes())
}

/// TLS 1.3 that accepts any certificate whose key the server proves to hold. [`Trust::check`]
/// decides whether it is the right one. The client shows a certificate of its own.
pub(super) fn crypto(identity: &Identity) -> Result<QuicClientConfig, rustls::Error> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let verifier = Arc::new(AnyCertificate(provider.clone()));
    let mut tls = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous()
        .with_custom_certificate_verifier(verifier)
        .with_client_auth_cert(vec![identity.certificate.clone()], identity.key.clone_key())?;
    tls.alpn_protocols = vec![ALPN.to_vec()];
    // A resumed session shows no certificate to check.
    tls.resumption = rustls::client::Resumption::disabled();
    QuicClientConfig::try_from(tls).map_err(|error| rustls::Error::General(error.to_string()))
}

#[derive(Debug)]
struct AnyCertificate(Arc<CryptoProvider>);

impl ServerCertVerifier for AnyCertificate {
    fn verify_server_cert(
        &self,
        _end_entity: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _server_name: &ServerName<'_>,
        _ocsp_response: &[u8],
        _now: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = &self.0.signature_verification_algorithms;
        verify_tls12_signature(message, certificate, signed, algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = &self.0.signature_verification_algorithms;
        verify_tls13_signature(message, certificate, signed, algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.signature_verification_algorithms.supported_schemes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_remembered_and_a_changed_one_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/known-servers");
        let address: SocketAddr = "203.0.113.7:4777".parse().unwrap();
        let other: SocketAddr = "203.0.113.7:4778".parse().unwrap();
        let (first, second) = (Fingerprint::of(b"first"), Fingerprint::of(b"second"));
        check_known(&path, address, first).unwrap();
        check_known(&path, address, first).unwrap();
        check_known(&path, other, second).unwrap();
        let error = check_known(&path, address, second).unwrap_err();
        assert!(matches!(error, TrustError::Changed { expected, found, .. }
            if expected == first && found == second));
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 2);
    }

    #[test]
    fn malformed_lines_are_skipped() {
        let fingerprint = Fingerprint::of(b"x");
        let known = format!("\nnonsense\n1.2.3.4:5 zz\n1.2.3.4:6 {fingerprint}");
        assert_eq!(find(&known, "1.2.3.4:6".parse().unwrap()), Some(fingerprint));
        assert_eq!(find(&known, "1.2.3.4:5".parse().unwrap()), None);
    }
}
