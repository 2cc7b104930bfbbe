//! The token by which the owner of a server acts on its page.

use std::{fmt, io, path::Path};

use sightline_cli::identity::write_private;

use crate::people::new_invitation;

/// The file of the data folder that has the token.
const FILE: &str = "owner-token";
/// The fewest characters of a token that somebody has put into the file.
const CHARACTERS_MIN: usize = 16;

/// The token by which the owner of a server acts on its page.
#[derive(Clone)]
pub struct OwnerToken(String);

impl OwnerToken {
    /// A token that is not kept.
    ///
    /// # Errors
    /// When the system gives no randomness.
    pub fn new() -> io::Result<Self> {
        new_invitation().map(Self).map_err(io::Error::other)
    }

    /// The token of a data folder. If there is none, it is made. Only the folder's owner may read
    /// it.
    ///
    /// # Errors
    /// When the file cannot be read or written, or is too short to be a secret.
    pub fn keep(folder: &Path) -> io::Result<Self> {
        let path = folder.join(FILE);
        let token = match std::fs::read_to_string(&path) {
            Ok(text) => Self(text.trim().to_owned()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let token = Self::new()?;
                write_private(&path, token.0.as_bytes())?;
                token
            }
            Err(error) => return Err(error),
        };
        let is_secret = token.0.len() >= CHARACTERS_MIN && token.0.is_ascii();
        let short =
            || io::Error::other("the token is too short: remove the file to have a new one");
        if is_secret { Ok(token) } else { Err(short()) }
    }

    /// Whether a text is the token. The time that this takes does not tell how much of it is right.
    pub(super) fn is(&self, text: &str) -> bool {
        blake3::hash(self.0.as_bytes()) == blake3::hash(text.as_bytes())
    }
}

impl fmt::Display for OwnerToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_made_once_and_only_it_is_right() {
        let folder = tempfile::tempdir().unwrap();
        let token = OwnerToken::keep(folder.path()).unwrap();
        let again = OwnerToken::keep(folder.path()).unwrap();
        assert!(token.is(&again.to_string()));
        assert!(!token.is("") && !token.is(&OwnerToken::new().unwrap().to_string()));
    }

    #[test]
    fn a_file_without_a_secret_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        for text in ["", "\n", "secret"] {
            std::fs::write(folder.path().join(FILE), text).unwrap();
            assert!(OwnerToken::keep(folder.path()).is_err(), "{text:?}");
        }
    }
}
