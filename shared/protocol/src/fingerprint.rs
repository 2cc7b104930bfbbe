//! Fingerprints: by them a client knows a server, and a server knows visitors.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

/// The BLAKE3 hash of a certificate in DER. Clients pin it to recognise a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Fingerprint(pub [u8; 32]);

/// A text is not a fingerprint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a fingerprint has 64 hexadecimal digits")]
pub struct FingerprintError;

impl Fingerprint {
    /// The fingerprint of a certificate in DER.
    pub fn of(certificate_der: &[u8]) -> Self {
        Self(*blake3::hash(certificate_der).as_bytes())
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl FromStr for Fingerprint {
    type Err = FingerprintError;

    fn from_str(text: &str) -> Result<Self, FingerprintError> {
        let hash = blake3::Hash::from_hex(text.trim()).map_err(|_| FingerprintError)?;
        Ok(Self(*hash.as_bytes()))
    }
}

/// The first 80 bits of the BLAKE3 hash of a visitor's public key, as a SubjectPublicKeyInfo in
/// DER, or of the secret of a visitor with a browser. It is short enough to be read out and typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct KeyFingerprint(pub [u8; KEY_BYTES]);

/// The length of the fingerprint of a key, in bytes.
pub const KEY_BYTES: usize = 10;

/// What a visitor with a browser is known by, which has no key: random bytes that the page keeps.
/// Whoever knows them is that visitor, so they are not shown.
#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct VisitorSecret(pub [u8; 32]);

impl VisitorSecret {
    /// What stands for the fingerprint of a key, wherever one is used.
    pub fn fingerprint(&self) -> KeyFingerprint {
        KeyFingerprint::shortened(&blake3::derive_key("sightline secret of a visitor", &self.0))
    }
}

impl fmt::Debug for VisitorSecret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("VisitorSecret(..)")
    }
}

/// A text is not the fingerprint of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the fingerprint of a key has 20 hexadecimal digits, such as 3f2a-90bc-11d2-7f80-aa01")]
pub struct KeyFingerprintError;

impl KeyFingerprint {
    /// The fingerprint of a public key in DER.
    pub fn of(public_key_der: &[u8]) -> Self {
        Self::shortened(blake3::hash(public_key_der).as_bytes())
    }

    fn shortened(hash: &[u8; 32]) -> Self {
        let mut short = [0; KEY_BYTES];
        short.copy_from_slice(&hash[..KEY_BYTES]);
        Self(short)
    }
}

impl fmt::Display for KeyFingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, pair) in self.0.chunks(2).enumerate() {
            let dash = if i == 0 { "" } else { "-" };
            write!(f, "{dash}{:02x}{:02x}", pair[0], pair[1])?;
        }
        Ok(())
    }
}

impl FromStr for KeyFingerprint {
    type Err = KeyFingerprintError;

    fn from_str(text: &str) -> Result<Self, KeyFingerprintError> {
        let digits = text.trim().chars().filter(|c| *c != '-').map(|c| c.to_digit(16));
        let digits: Option<Vec<u32>> = digits.collect();
        let digits = digits.filter(|digits| digits.len() == 2 * KEY_BYTES);
        let mut bytes = [0; KEY_BYTES];
        for (byte, pair) in bytes.iter_mut().zip(digits.ok_or(KeyFingerprintError)?.chunks(2)) {
            *byte = (pair[0] * 16 + pair[1]) as u8;
        }
        Ok(Self(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fingerprint_of_a_key_is_short_and_reads_back() {
        let fingerprint = KeyFingerprint::of(b"a key");
        let text = fingerprint.to_string();
        assert_eq!((text.len(), text.matches('-').count()), (24, 4));
        assert_eq!(text.parse(), Ok(fingerprint));
        assert_eq!(text.replace('-', "").to_uppercase().parse(), Ok(fingerprint));
        for wrong in ["", "3f2a", "3f2a-90bc-11d2-7f80-aa0", "3f2a-90bc-11d2-7f80-aag1", "é"] {
            assert_eq!(wrong.parse::<KeyFingerprint>(), Err(KeyFingerprintError), "{wrong}");
        }
    }

    #[test]
    fn a_fingerprint_reads_back_from_its_text() {
        let fingerprint = Fingerprint::of(b"a certificate");
        let text = fingerprint.to_string();
        assert_eq!(text.len(), 64);
        assert_eq!(text.parse(), Ok(fingerprint));
        assert_eq!(text[1..].parse::<Fingerprint>(), Err(FingerprintError));
        assert_eq!("é".repeat(32).parse::<Fingerprint>(), Err(FingerprintError));
    }
}
