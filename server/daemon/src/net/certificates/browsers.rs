//! What browsers are shown.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::SystemTime,
};

use rustls::sign::CertifiedKey;

use super::{
    super::{
        BindError,
        config::{ServeConfig, WebAddress},
    },
    short_lived::Turns,
    tls_files::TlsFiles,
};

/// The certificate for browsers.
#[derive(Debug)]
pub(super) enum Browsers {
    /// Made by the server, and accepted by its hash.
    ShortLived(Mutex<Turns>),
    /// The operator's, and accepted by its issuer.
    Files(Mutex<TlsFiles>),
}

impl Browsers {
    /// `None` where browsers cannot visit.
    pub(super) fn new(config: &ServeConfig) -> Result<Option<Self>, BindError> {
        if config.web == WebAddress::Off {
            return Ok(None);
        }
        Ok(Some(match config.tls_files() {
            Some([certificate, key]) => Self::Files(Mutex::new(TlsFiles::read(certificate, key)?)),
            None => Self::ShortLived(Mutex::new(Turns::begin(SystemTime::now())?)),
        }))
    }

    /// What is shown now.
    pub(super) fn shown(&self) -> Option<Arc<CertifiedKey>> {
        match self {
            Self::ShortLived(turns) => Some(locked(turns).shown(SystemTime::now())),
            Self::Files(files) => Some(locked(files).shown()),
        }
    }

    /// The hashes of what is shown now, and of what is shown next.
    pub(super) fn hashes(&self) -> Vec<[u8; 32]> {
        match self {
            Self::ShortLived(turns) => locked(turns).hashes(SystemTime::now()).to_vec(),
            Self::Files(_) => Vec::new(),
        }
    }
}

fn locked<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}
