//! How the server stands to people: the part of the database that is kept in memory.

use std::collections::HashMap;

use sightline_protocol::fingerprint::KeyFingerprint;

use super::{
    changes::{Act, Change, Subject},
    role::Role,
    ruling::Ruling,
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

/// What was ruled about everybody about whom anything was, and the invitations.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Standings {
    rulings: HashMap<Subject, Ruling>,
    /// How many each invitation still lets in, by its hash.
    invitations: HashMap<[u8; 32], u32>,
}

impl Standings {
    /// How the server stands to the owner of a key.
    pub fn of(&self, key: KeyFingerprint) -> Standing {
        self.rulings.get(&Subject::Key(key)).map(Ruling::standing).unwrap_or_default()
    }

    /// Whether somebody is kept out.
    pub fn is_banned(&self, subject: &Subject) -> bool {
        self.rulings.get(subject).is_some_and(|ruling| ruling.banned.is.is_some())
    }

    /// What was ruled about somebody.
    pub fn ruling(&self, subject: &Subject) -> Ruling {
        self.rulings.get(subject).cloned().unwrap_or_default()
    }

    /// About whom something was ruled.
    #[cfg(feature = "bus")]
    pub fn ruled(&self) -> Vec<Subject> {
        self.rulings.keys().copied().collect()
    }

    /// About how many something was ruled.
    #[cfg(feature = "bus")]
    pub fn ruled_count(&self) -> usize {
        self.rulings.len()
    }

    /// About whom something else was ruled than in others.
    pub fn differing(&self, other: &Self) -> Vec<Subject> {
        let differs =
            |(subject, ruling): &(&Subject, &Ruling)| other.rulings.get(*subject) != Some(*ruling);
        self.rulings.iter().filter(differs).map(|(subject, _)| *subject).collect()
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

    /// Takes in what somebody does at a time, in milliseconds since 1970. Returns what changes.
    pub fn act(&mut self, act: &Act, now: u64) -> Change {
        let change = act.change(|subject| self.ruling(subject), now);
        self.apply(&change);
        change
    }

    /// Takes in a change.
    pub fn apply(&mut self, change: &Change) {
        match change {
            Change::Rule(subject, ruling) => {
                self.rulings.entry(*subject).or_default().merge(ruling)
            }
            Change::Invite(token, uses) if *uses > 0 => {
                self.invitations.insert(*token, *uses);
            }
            Change::UseInvitation(token) => drop(self.use_invitation(token)),
            Change::Invite(..) | Change::Audit { .. } => {}
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
        standings.apply(&Change::Invite([1; 32], 2));
        standings.apply(&Change::UseInvitation([1; 32]));
        assert!(standings.use_invitation(&[1; 32]));
        assert!(!standings.use_invitation(&[1; 32]));
    }
}
