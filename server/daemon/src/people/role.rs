//! Roles: what somebody may do.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

/// What somebody may do. Each role may do what those before it may, to those before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Walks and chats.
    #[default]
    Visitor,
    /// Kicks, mutes and bans.
    Moderator,
    /// Makes moderators.
    Owner,
}

/// A text is not a role.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a role is visitor, moderator or owner")]
pub struct RoleError;

/// All roles, by their numbers in the database.
const ROLES: [(Role, &str); 3] =
    [(Role::Visitor, "visitor"), (Role::Moderator, "moderator"), (Role::Owner, "owner")];

impl Role {
    /// Its number in the database.
    pub(super) fn number(self) -> i64 {
        self as i64
    }

    /// The role of a number; that of a visitor for one that no role has.
    pub(super) fn of_number(number: i64) -> Self {
        let index = usize::try_from(number).unwrap_or_default();
        ROLES.get(index).map_or(Self::Visitor, |(role, _)| *role)
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(ROLES[*self as usize].1)
    }
}

impl FromStr for Role {
    type Err = RoleError;

    fn from_str(text: &str) -> Result<Self, RoleError> {
        ROLES.iter().find(|(_, name)| *name == text).map(|(role, _)| *role).ok_or(RoleError)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_read_back_from_their_names_and_numbers() {
        for (role, name) in ROLES {
            assert_eq!((role.to_string().as_str(), name.parse()), (name, Ok(role)));
            assert_eq!(Role::of_number(role.number()), role);
        }
        assert_eq!("boss".parse::<Role>(), Err(RoleError));
        assert_eq!([-1, 3].map(Role::of_number), [Role::Visitor; 2]);
    }
}
