//! How the server stands to people: the part of the database that is kept in memory.

use std::collections::{HashMap, HashSet};

use sightline_protocol::fingerprint::KeyFingerprint;

use super::{
    changes::{Act, Subject},
    role::Role,
};

/// How the server stands to somebody.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Standing {
    /// What they may do.
    pub role: Role,
    /// Whether nobody hears what they say.
    pub is_muted: bool,
    /// Whether they are let in where not everybody is.
    pub is_allowed: bool,
}

/// Everybody to whom the server stands in another way than to strangers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Standings {
    by_key: HashMap<KeyFingerprint, Standing>,
    bans: HashSet<Subject>,
    /// How many each invitation still lets in, by its hash.
    invitations: HashMap<[u8; 32], u32>,
}

impl Standings {
    /// How the server stands to the owner of a key.
    pub fn of(&self, key: KeyFingerprint) -> Standing {
        self.by_key.get(&key).copied().unwrap_or_default()
    }

    /// Whether somebody is kept out.
    pub fn is_banned(&self, subject: &Subject) -> bool {
        self.bans.contains(subject)
    }

    /// Takes in how the server stands to the owner of a key.
    pub fn set(&mut self, key: KeyFingerprint, standing: Standing) {
        if standing == Standing::default() {
            self.by_key.remove(&key);
        } else {
            self.by_key.insert(key, standing);
        }
    }

    /// Lets somebody in by an invitation. Returns whether it lets anybody in.
    pub fn use_invitation(&mut self, token: &[u8; 32]) -> bool {
        let Some(uses) = self.invitations.get_mut(token) else { return false };
        *uses -= 1;
        if *uses == 0 {
            self.invitations.remove(token);
        }
        true
    }

    /// Takes in something that lasts.
    pub fn apply(&mut self, act: &Act) {
        match act {
            Act::SetRole(key, role) => self.set(*key, Standing { role: *role, ..self.of(*key) }),
            Act::SetMuted(key, is_muted) => {
                self.set(*key, Standing { is_muted: *is_muted, ..self.of(*key) });
            }
            Act::Allow(key) => self.set(*key, Standing { is_allowed: true, ..self.of(*key) }),
            Act::Ban(subject, _) => drop(self.bans.insert(*subject)),
            Act::Unban(subject) => drop(self.bans.remove(subject)),
            Act::Invite(token, uses) if *uses > 0 => drop(self.invitations.insert(*token, *uses)),
            Act::UseInvitation(token) => drop(self.use_invitation(token)),
            Act::Invite(..) | Act::Audit { .. } => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What waits to be written is taken in again when the database was read anew.
    #[test]
    fn an_invitation_that_was_used_lets_in_one_fewer() {
        let mut standings = Standings::default();
        standings.apply(&Act::Invite([1; 32], 2));
        standings.apply(&Act::UseInvitation([1; 32]));
        assert!(standings.use_invitation(&[1; 32]));
        assert!(!standings.use_invitation(&[1; 32]));
    }
}
