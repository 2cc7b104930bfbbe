//! Invitations: texts of which only the hash is kept.

use ring::rand::{SecureRandom, SystemRandom};

/// The random bytes of an invitation.
const BYTES: usize = 16;

/// The system gave no randomness.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the system gives no randomness for an invitation")]
pub struct NoRandomness;

/// A new invitation.
///
/// # Errors
/// When the system gives no randomness.
pub fn new_invitation() -> Result<String, NoRandomness> {
    let mut bytes = [0; BYTES];
    SystemRandom::new().fill(&mut bytes).map_err(|_| NoRandomness)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The hash of an invitation, which is what the database has of it.
pub fn hash(invitation: &str) -> [u8; 32] {
    *blake3::hash(invitation.trim().as_bytes()).as_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invitations_differ() {
        let [one, other] = [(); 2].map(|()| new_invitation().unwrap());
        assert_eq!(one.len(), 2 * BYTES);
        assert_ne!(one, other);
        assert_eq!(hash(&format!(" {one}\n")), hash(&one));
        assert_ne!(hash(&one), hash(&other));
    }
}
