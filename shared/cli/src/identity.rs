//! A self-signed certificate and its key: made once, kept in a file. Clients know a server by the
//! fingerprint of its certificate, and a server knows visitors by those of their keys.

use std::{
    fs, io,
    io::Write,
    path::{Path, PathBuf},
};

use rustls::{
    pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer, pem::PemObject},
    server::ParsedCertificate,
};
use sightline_protocol::fingerprint::{Fingerprint, KeyFingerprint};

/// A self-signed certificate and its key.
#[derive(Debug)]
pub struct Identity {
    /// The certificate, which the other end is shown.
    pub certificate: CertificateDer<'static>,
    /// The private key, which proves that the certificate is the owner's.
    pub key: PrivateKeyDer<'static>,
}

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentityError {
    /// The file cannot be read or written.
    #[error("cannot keep the certificate in {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file holds something else. It is left alone, since others know the old fingerprint.
    #[error(
        "{path} holds no certificate and key; restore it, or remove it to have new ones made \
         (others will then see another fingerprint)"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
    },
    /// No certificate could be made.
    #[error("cannot make a certificate: {0}")]
    Make(#[from] rcgen::Error),
}

impl Identity {
    /// Makes a certificate that is not kept.
    ///
    /// # Errors
    /// When the system gives no randomness.
    pub fn generate() -> Result<Self, IdentityError> {
        Ok(Self::generate_pem()?.0)
    }

    /// The certificate in a server's data folder, which is made now if the folder has none.
    ///
    /// # Errors
    /// When the file cannot be read or written, or holds something else.
    pub fn keep(folder: &Path) -> Result<Self, IdentityError> {
        Self::keep_in(&folder.join("identity.pem"))
    }

    /// The certificate in a file, which is made now if there is none. One file holds the
    /// certificate and its key, so that neither can be lost without the other. Only its owner may
    /// read it.
    ///
    /// # Errors
    /// When the file cannot be read or written, or holds something else.
    pub fn keep_in(path: &Path) -> Result<Self, IdentityError> {
        let failed = |source| IdentityError::Io { path: path.to_owned(), source };
        match fs::read(path) {
            Ok(pem) => {
                Self::parse(&pem).ok_or_else(|| IdentityError::Damaged { path: path.to_owned() })
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let (identity, pem) = Self::generate_pem()?;
                write_private(path, pem.as_bytes()).map_err(failed)?;
                Ok(identity)
            }
            Err(source) => Err(failed(source)),
        }
    }

    /// The fingerprint of the certificate, by which clients know a server.
    pub fn fingerprint(&self) -> Fingerprint {
        Fingerprint::of(&self.certificate)
    }

    /// The fingerprint of the key, by which a server knows a visitor.
    pub fn key_fingerprint(&self) -> KeyFingerprint {
        key_fingerprint(&self.certificate).expect("an own certificate was parsed")
    }

    fn generate_pem() -> Result<(Self, String), rcgen::Error> {
        let made = rcgen::generate_simple_self_signed(["sightline".to_owned()])?;
        let pem = made.cert.pem() + &made.signing_key.serialize_pem();
        let key = PrivatePkcs8KeyDer::from(made.signing_key.serialize_der());
        Ok((Self { certificate: made.cert.der().clone(), key: key.into() }, pem))
    }

    fn parse(pem: &[u8]) -> Option<Self> {
        let certificate = CertificateDer::from_pem_slice(pem).ok()?;
        key_fingerprint(&certificate)?;
        let key = PrivateKeyDer::from_pem_slice(pem).ok()?;
        Some(Self { certificate, key })
    }
}

/// The fingerprint of the public key in a certificate; `None` when it is no certificate.
pub fn key_fingerprint(certificate: &CertificateDer<'_>) -> Option<KeyFingerprint> {
    let parsed = ParsedCertificate::try_from(certificate).ok()?;
    Some(KeyFingerprint::of(&parsed.subject_public_key_info()))
}

/// Writes a file that only its owner may read. A crash leaves all of it or nothing.
///
/// # Errors
/// When the folder or the file cannot be made.
pub fn write_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    let partial = path.with_extension(format!("partial-{}", std::process::id()));
    let mut options = fs::OpenOptions::new();
    options.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(&partial)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(&partial, path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_certificate_is_made_once_and_kept() {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("new");
        let first = Identity::keep(&data).unwrap();
        let second = Identity::keep(&data).unwrap();
        assert_eq!(first.fingerprint(), second.fingerprint());
        assert_eq!(first.key, second.key);
        assert_eq!(first.key_fingerprint(), second.key_fingerprint());
        let other = Identity::generate().unwrap();
        assert_ne!(first.fingerprint(), other.fingerprint());
        assert_ne!(first.key_fingerprint(), other.key_fingerprint());
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = fs::metadata(data.join("identity.pem")).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
        }
    }

    #[test]
    fn a_damaged_certificate_is_an_error_and_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("identity.pem"), "not a key").unwrap();
        assert!(matches!(Identity::keep(folder.path()), Err(IdentityError::Damaged { .. })));
        assert_eq!(fs::read(folder.path().join("identity.pem")).unwrap(), b"not a key");
    }
}
