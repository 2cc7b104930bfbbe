//! Rules of who is let in.

use std::{fmt, str::FromStr};

/// Who is let in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Access {
    /// Everybody who is not banned.
    #[default]
    Open,
    /// Those who are on the list, moderators and owners.
    AllowList,
    /// Those on the list, and holders of an invitation, which puts them on the list.
    Invitation,
}

/// A text is not the name of an access rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("use open, allow-list or invitation")]
pub struct AccessError;

impl fmt::Display for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Open => "open",
            Self::AllowList => "allow-list",
            Self::Invitation => "invitation",
        })
    }
}

impl FromStr for Access {
    type Err = AccessError;

    fn from_str(text: &str) -> Result<Self, AccessError> {
        let all = [Self::Open, Self::AllowList, Self::Invitation];
        all.into_iter().find(|access| access.to_string() == text).ok_or(AccessError)
    }
}
