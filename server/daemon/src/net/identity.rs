//! The server's certificate: made once, kept in the data folder, known by its fingerprint.

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
    /// What clients are shown.
    pub certificate: CertificateDer<'static>,
    /// What proves that it is ours.
    pub key: PrivateKeyDer<'static>,
}

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentityError {
    /// The file cannot be read or written.
    #[error("cannot keep the certificate in {path}: {source}")]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file holds something else. It is left as it is, since clients know the old certificate.
    #[error("{path} holds no certificate and key; remove it to have new ones made")]
    Damaged {
        /// Which file.
        path: PathBuf,
    },
    /// A certificate cannot be made.
    #[error("cannot make a certificate: {0}")]
    Make(#[from] rcgen::Error),
}

impl Identity {
    /// Makes a certificate that is kept nowhere.
    pub fn generate() -> Result<Self, IdentityError> {
        Ok(Self::generate_pem()?.0)
    }

    /// The certificate in a data folder, made now if it has none. One file holds it and its key, so
    /// that one cannot be lost without the other; nobody else may read it.
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

    /// How clients know it.
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

/// Writes a file that only its owner may read, whole or not at all.
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
    fn it_is_made_once_and_kept() {
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
    fn a_damaged_one_is_told_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("identity.pem"), "not a key").unwrap();
        assert!(matches!(Identity::keep(folder.path()), Err(IdentityError::Damaged { .. })));
        assert_eq!(fs::read(folder.path().join("identity.pem")).unwrap(), b"not a key");
    }
}
