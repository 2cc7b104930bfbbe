//! Self-signed certificates that pages accept by their hashes, for two weeks at most.

use std::{
    sync::Arc,
    time::{Duration, SystemTime},
};

use rcgen::{CertificateParams, KeyPair, PKCS_ECDSA_P256_SHA256};
use ring::digest::{SHA256, digest};
use rustls::{crypto::ring::default_provider, pki_types::PrivatePkcs8KeyDer, sign::CertifiedKey};
use sightline_cli::identity::IdentityError;

use super::super::BindError;

/// How long a certificate is valid. Browsers accept 14 days at most.
const VALIDITY: Duration = Duration::from_secs(13 * DAY_S);
/// How long one is shown. The next one is known for as long before.
const TURN: Duration = Duration::from_secs(6 * DAY_S);
/// The clocks of visitors may be late by this much.
const CLOCKS: Duration = Duration::from_secs(DAY_S / 2);
const DAY_S: u64 = 24 * 3_600;

/// The certificate that is shown, and the next one. A page learns the hashes of both, so it may
/// come with what it has learnt days before.
#[derive(Debug)]
pub(super) struct Turns {
    shown: ShortLived,
    next: ShortLived,
    /// When the one that is shown began to be shown.
    since: SystemTime,
}

#[derive(Debug)]
struct ShortLived {
    key: Arc<CertifiedKey>,
    sha256: [u8; 32],
}

impl Turns {
    pub(super) fn begin(now: SystemTime) -> Result<Self, BindError> {
        Ok(Self { shown: ShortLived::make(now)?, next: ShortLived::make(now)?, since: now })
    }

    /// The certificate to show at a time.
    pub(super) fn shown(&mut self, now: SystemTime) -> Arc<CertifiedKey> {
        self.turn(now);
        self.shown.key.clone()
    }

    /// The SHA-256 hashes of the certificate that is shown, and of the next one.
    pub(super) fn hashes(&mut self, now: SystemTime) -> [[u8; 32]; 2] {
        self.turn(now);
        [self.shown.sha256, self.next.sha256]
    }

    /// Goes on to the next certificate when it is time. The one that was next was made when the one
    /// before began, so it is still valid for its whole turn. After a pause of the machine, neither
    /// may be.
    fn turn(&mut self, now: SystemTime) {
        // A clock that was put back shows nothing to be due.
        let age = now.duration_since(self.since).unwrap_or_default();
        if age < TURN {
            return;
        }
        let made = if age < 2 * TURN {
            self.go_on(now)
        } else {
            Self::begin(now).map(|turns| *self = turns)
        };
        if let Err(error) = made {
            tracing::warn!(%error, "no new certificate for browsers");
        }
    }

    fn go_on(&mut self, now: SystemTime) -> Result<(), BindError> {
        let new = ShortLived::make(now)?;
        self.shown = std::mem::replace(&mut self.next, new);
        self.since += TURN;
        Ok(())
    }
}

impl ShortLived {
    fn make(now: SystemTime) -> Result<Self, BindError> {
        let key = KeyPair::generate_for(&PKCS_ECDSA_P256_SHA256).map_err(IdentityError::Make)?;
        let mut params =
            CertificateParams::new(["localhost".to_owned()]).map_err(IdentityError::Make)?;
        let from = now - CLOCKS;
        (params.not_before, params.not_after) = (from.into(), (from + VALIDITY).into());
        let certificate = params.self_signed(&key).map_err(IdentityError::Make)?.der().clone();
        let mut sha256 = [0; 32];
        sha256.copy_from_slice(digest(&SHA256, &certificate).as_ref());
        let key = PrivatePkcs8KeyDer::from(key.serialize_der()).into();
        let key = CertifiedKey::from_der(vec![certificate], key, &default_provider())?;
        Ok(Self { key: Arc::new(key), sha256 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_certificate_is_known_before_it_is_shown_and_valid_while_it_is() {
        let start = SystemTime::now();
        let mut turns = Turns::begin(start).unwrap();
        let mut known: Vec<[u8; 32]> = turns.hashes(start).to_vec();
        let mut made = vec![(known[0], start), (known[1], start)];
        for hour in 0..24 * 60 {
            let now = start + Duration::from_secs(hour * 3_600);
            let shown = turns.shown(now);
            let hash = digest(&SHA256, &shown.cert[0]);
            assert!(known.iter().any(|known| known == hash.as_ref()), "hour {hour}");
            let since = made.iter().find(|(known, _)| known == hash.as_ref()).unwrap().1;
            assert!(now.duration_since(since).unwrap() < VALIDITY - CLOCKS, "hour {hour}");
            known = turns.hashes(now).to_vec();
            for hash in &known {
                if !made.iter().any(|(known, _)| known == hash) {
                    made.push((*hash, now));
                }
            }
        }
        assert!(made.len() > 9, "{} in 60 days", made.len());
    }

    #[test]
    fn after_a_long_pause_none_is_shown_that_has_expired() {
        let start = SystemTime::now();
        let mut turns = Turns::begin(start).unwrap();
        let before = turns.hashes(start);
        let after = |turns: &mut Turns, hours: u64| {
            let hashes = turns.hashes(start + Duration::from_secs(hours * 3_600));
            before.iter().filter(|hash| hashes.contains(hash)).count()
        };
        assert_eq!(after(&mut turns, 24 * 11), 1, "the second one is valid for another day");
        assert_eq!(after(&mut turns, 24 * 12 + 1), 0);
        let mut turns = Turns::begin(start).unwrap();
        let before = turns.hashes(start);
        let after = turns.hashes(start + Duration::from_secs(13 * DAY_S));
        assert!(before.iter().all(|hash| !after.contains(hash)));
    }
}
