//! The server's certificate: made once, kept in the data folder, known to clients by its
//! fingerprint.

use std::{
    fs, io,
    io::Write,
    path::{Path, PathBuf},
};

use rustls::pki_types::{CertificateDer, PrivateKeyDer, pem::PemObject};
use sightline_protocol::fingerprint::Fingerprint;

/// A self-signed certificate and its key.
#[derive(Debug)]
pub struct Identity {
    /// The certificate, which clients are shown.
    pub certificate: CertificateDer<'static>,
    /// The private key, which proves that the certificate is the server's own.
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
    /// The file holds something else. It is left alone, since clients know the old certificate.
    #[error(
        "{path} holds no certificate and key; restore it, or remove it to have new ones made \
         (clients will then see another fingerprint)"
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

    /// The certificate in a data folder, which is made now if the folder has none. One file holds
    /// the certificate and its key, so that neither can be lost without the other. Only its owner
    /// may read it.
    ///
    /// # Errors
    /// When the file cannot be read or written, or holds something else.
    pub fn keep(folder: &Path) -> Result<Self, IdentityError> {
        let path = folder.join("identity.pem");
        match fs::read(&path) {
            Ok(pem) => Self::parse(&pem).ok_or(IdentityError::Damaged { path }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let (identity, pem) = Self::generate_pem()?;
                write_private(folder, &path, pem.as_bytes())
                    .map_err(|source| IdentityError::Io { path, source })?;
                Ok(identity)
            }
            Err(source) => Err(IdentityError::Io { path, source }),
        }
    }

    /// The fingerprint, by which clients know the server.
    pub fn fingerprint(&self) -> Fingerprint {
        Fingerprint::of(&self.certificate)
    }

    fn generate_pem() -> Result<(Self, String), rcgen::Error> {
        let made = rcgen::generate_simple_self_signed(["sightline".to_owned()])?;
        let pem = made.cert.pem() + &made.signing_key.serialize_pem();
        let key = rustls::pki_types::PrivatePkcs8KeyDer::from(made.signing_key.serialize_der());
        Ok((Self { certificate: made.cert.der().clone(), key: key.into() }, pem))
    }

    fn parse(pem: &[u8]) -> Option<Self> {
        let certificate = CertificateDer::from_pem_slice(pem).ok()?;
        let key = PrivateKeyDer::from_pem_slice(pem).ok()?;
        Some(Self { certificate, key })
    }
}

/// Writes a file that only its owner may read. A crash leaves all of it or nothing.
fn write_private(folder: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    fs::create_dir_all(folder)?;
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
        assert_ne!(first.fingerprint(), Identity::generate().unwrap().fingerprint());
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
