//! The operator's certificate, read again when its files change.

use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant, SystemTime},
};

use rustls::{
    crypto::ring::default_provider,
    pki_types::{
        CertificateDer, PrivateKeyDer,
        pem::{self, PemObject},
    },
    sign::CertifiedKey,
};

/// How often it is looked whether the files have changed.
const LOOK_INTERVAL: Duration = Duration::from_secs(5);

/// The files of a certificate and its key.
#[derive(Debug)]
pub(super) struct TlsFiles {
    paths: [PathBuf; 2],
    /// When the files were changed that were read.
    changed: [SystemTime; 2],
    key: Arc<CertifiedKey>,
    looked: Instant,
}

/// Why a certificate cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TlsFileError {
    /// A file cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file is no PEM, or has no certificate or key.
    #[error("{path}: {source}; it must be a file in PEM, as ACME clients write it")]
    Pem {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: pem::Error,
    },
    /// The key is not that of the certificate, or of an unknown kind.
    #[error("{certificate} and {key} cannot be used together: {source}")]
    Pair {
        /// The file of the certificate.
        certificate: PathBuf,
        /// The file of the key.
        key: PathBuf,
        /// What is wrong.
        source: rustls::Error,
    },
}

impl TlsFiles {
    /// Reads the files.
    pub(super) fn read(certificate: &Path, key: &Path) -> Result<Self, TlsFileError> {
        let paths = [certificate.to_owned(), key.to_owned()];
        let changed = changed(&paths)?;
        let key = Arc::new(load(&paths)?);
        Ok(Self { paths, changed, key, looked: Instant::now() })
    }

    /// The certificate, as the files have it now. While they are wrong, it is the one before.
    pub(super) fn shown(&mut self) -> Arc<CertifiedKey> {
        if self.looked.elapsed() >= LOOK_INTERVAL {
            self.look();
        }
        self.key.clone()
    }

    fn look(&mut self) {
        self.looked = Instant::now();
        let read = changed(&self.paths).and_then(|changed| {
            let is_new = changed != self.changed;
            Ok(if is_new { Some((changed, load(&self.paths)?)) } else { None })
        });
        match read {
            Ok(Some((changed, key))) => {
                (self.changed, self.key) = (changed, Arc::new(key));
                tracing::info!("the certificate for browsers has changed");
            }
            Ok(None) => {}
            Err(error) => tracing::warn!("the certificate before stays in use: {error}"),
        }
    }
}

/// When the files were changed.
fn changed(paths: &[PathBuf; 2]) -> Result<[SystemTime; 2], TlsFileError> {
    let of = |path: &PathBuf| {
        let changed = fs::metadata(path).and_then(|about| about.modified());
        changed.map_err(|source| TlsFileError::Read { path: path.clone(), source })
    };
    Ok([of(&paths[0])?, of(&paths[1])?])
}

fn load([certificate, key]: &[PathBuf; 2]) -> Result<CertifiedKey, TlsFileError> {
    let read = |path: &PathBuf| {
        fs::read(path).map_err(|source| TlsFileError::Read { path: path.clone(), source })
    };
    let pem = |path: &PathBuf, source| TlsFileError::Pem { path: path.clone(), source };
    let chain: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&read(certificate)?).collect();
    let chain = chain.map_err(|error| pem(certificate, error))?;
    let secret = PrivateKeyDer::from_pem_slice(&read(key)?).map_err(|error| pem(key, error))?;
    if chain.is_empty() {
        return Err(pem(certificate, pem::Error::NoItemsFound));
    }
    CertifiedKey::from_der(chain, secret, &default_provider()).map_err(|source| {
        TlsFileError::Pair { certificate: certificate.clone(), key: key.clone(), source }
    })
}

#[cfg(test)]
mod tests {
    use rcgen::{CertifiedKey as Made, generate_simple_self_signed};

    use super::*;

    fn make(folder: &Path) -> [PathBuf; 2] {
        let Made { cert, signing_key } =
            generate_simple_self_signed(["house.example".to_owned()]).unwrap();
        let paths = ["cert.pem", "key.pem"].map(|name| folder.join(name));
        fs::write(&paths[0], cert.pem()).unwrap();
        fs::write(&paths[1], signing_key.serialize_pem()).unwrap();
        paths
    }

    #[test]
    fn files_that_change_are_read_again_and_wrong_ones_are_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let [certificate, key] = make(folder.path());
        let mut files = TlsFiles::read(&certificate, &key).unwrap();
        let first = files.shown();
        let later = SystemTime::now() + Duration::from_secs(60);
        fs::write(&key, "no key").unwrap();
        fs::File::open(&key).unwrap().set_modified(later).unwrap();
        files.look();
        assert!(Arc::ptr_eq(&first, &files.shown()));
        make(folder.path());
        files.look();
        assert_ne!(first.cert, files.shown().cert);
    }

    #[test]
    fn what_is_no_certificate_or_not_the_keys_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let [certificate, key] = make(folder.path());
        let said = |certificate: &Path, key: &Path| {
            TlsFiles::read(certificate, key).unwrap_err().to_string()
        };
        assert!(said(&folder.path().join("none"), &key).contains("cannot read"));
        assert!(said(&key, &key).contains("key.pem: "));
        assert!(said(&certificate, &certificate).contains("cert.pem: "));
        let other = tempfile::tempdir().unwrap();
        let [_, other] = make(other.path());
        assert!(said(&certificate, &other).contains("together"));
    }
}
