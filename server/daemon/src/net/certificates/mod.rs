//! The certificates that the server shows: to native clients its own, by which they know it again;
//! to browsers one that they accept.

#[cfg(feature = "web")]
mod browsers;
#[cfg(feature = "web")]
mod short_lived;
#[cfg(feature = "web")]
mod tls_files;

use std::sync::Arc;

use rustls::{
    crypto::ring::default_provider,
    server::{ClientHello, ResolvesServerCert},
    sign::CertifiedKey,
};
use sightline_cli::identity::Identity;
use sightline_protocol::ALPN;

#[cfg(feature = "web")]
use browsers::Browsers;
#[cfg(feature = "web")]
pub use tls_files::TlsFileError;

use super::{BindError, config::ServeConfig};

/// The TLS application protocol of HTTP/3, by which browsers come.
#[cfg(feature = "web")]
pub const HTTP3: &[u8] = b"h3";

/// The certificates of a server.
#[derive(Debug)]
pub struct Certificates {
    own: Arc<CertifiedKey>,
    /// `None` where browsers cannot visit.
    #[cfg(feature = "web")]
    browsers: Option<Browsers>,
}

impl Certificates {
    /// The certificates of a server of this configuration and identity.
    pub fn new(config: &ServeConfig, identity: &Identity) -> Result<Self, BindError> {
        let chain = vec![identity.certificate.clone()];
        let own = CertifiedKey::from_der(chain, identity.key.clone_key(), &default_provider())?;
        #[cfg(feature = "web")]
        let browsers = Browsers::new(config)?;
        #[cfg(not(feature = "web"))]
        let _ = config;
        Ok(Self {
            own: Arc::new(own),
            #[cfg(feature = "web")]
            browsers,
        })
    }

    /// The application protocols that the endpoint speaks.
    pub fn protocols(&self) -> Vec<Vec<u8>> {
        let own = ALPN.to_vec();
        #[cfg(feature = "web")]
        if self.browsers.is_some() {
            return vec![own, HTTP3.to_vec()];
        }
        vec![own]
    }

    /// The SHA-256 hashes of certificates that a page may accept. `None` where browsers accept them
    /// by their issuer.
    #[cfg(feature = "web")]
    pub fn hashes(&self) -> Vec<[u8; 32]> {
        self.browsers.as_ref().map(Browsers::hashes).unwrap_or_default()
    }
}

impl ResolvesServerCert for Certificates {
    fn resolve(&self, client: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        #[cfg(feature = "web")]
        {
            let is_native =
                client.alpn().is_some_and(|mut protocols| protocols.any(|name| name == ALPN));
            if !is_native && let Some(browsers) = &self.browsers {
                return browsers.shown();
            }
        }
        #[cfg(not(feature = "web"))]
        let _ = client;
        Some(self.own.clone())
    }
}
