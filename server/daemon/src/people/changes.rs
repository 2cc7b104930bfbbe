//! What is to be written.

use std::{
    collections::HashMap,
    fmt,
    net::{IpAddr, Ipv6Addr},
    str::FromStr,
    sync::Arc,
};

use glam::Vec3;
use sightline_protocol::fingerprint::KeyFingerprint;

use super::{role::Role, ruling::Ruling};
use crate::address::network;

/// The most visitors of whom something waits to be written. Beyond them it is forgotten: the disk
/// must have been full for long.
const NOTES_MAX: usize = 65_536;
/// The most lines of chat that wait to be written.
const LINES_MAX: usize = 16_384;

/// Whom a ban keeps out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Subject {
    /// The owner of a key.
    Key(KeyFingerprint),
    /// An IPv4 address, or the /64 network of an IPv6 address.
    Network(IpAddr),
}

/// Something that lasts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Act {
    /// Somebody has another role.
    SetRole(KeyFingerprint, Role),
    /// Somebody may chat, or may not.
    SetMuted(KeyFingerprint, bool),
    /// Somebody is let in where not everybody is.
    Allow(KeyFingerprint),
    /// Somebody is kept out, for a reason.
    Ban(Subject, String),
    /// Somebody is kept out no more.
    Unban(Subject),
    /// The BLAKE3 hash of an invitation, and how many it lets in.
    Invite([u8; 32], u32),
}

/// A change of what is remembered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// What was ruled about somebody, here or elsewhere.
    Rule(Subject, Ruling),
    /// The hash of an invitation, and how many it lets in.
    Invite([u8; 32], u32),
    /// An invitation has let somebody in.
    UseInvitation([u8; 32]),
    /// A line of the audit log.
    Audit {
        /// Who did it: a fingerprint, or a word for one without a key.
        author: String,
        /// What was done.
        act: String,
        /// To whom.
        subject: String,
        /// Why.
        reason: String,
    },
}

/// What is new of a visitor.
#[derive(Clone, Debug, Default)]
pub struct Note {
    /// The name, if it has just come in.
    pub name: Option<String>,
    /// The title of the building, and the place of its eye.
    pub place: Option<(Arc<str>, Vec3)>,
}

/// A line of chat.
#[derive(Clone, Debug)]
pub struct Said {
    pub key: KeyFingerprint,
    /// The name that others see.
    pub name: String,
    pub text: String,
}

/// What waits to be written.
#[derive(Debug, Default)]
pub struct Pending {
    notes: HashMap<KeyFingerprint, Note>,
    pub changes: Vec<Change>,
    said: Vec<Said>,
    /// Where notes go for which there is no room.
    spare: Note,
}

impl Pending {
    /// What is new of a visitor.
    pub fn note(&mut self, key: KeyFingerprint) -> &mut Note {
        if self.notes.len() >= NOTES_MAX && !self.notes.contains_key(&key) {
            return &mut self.spare;
        }
        self.notes.entry(key).or_default()
    }

    /// What is new of a visitor, if anything is.
    pub fn noted(&self, key: KeyFingerprint) -> Option<&Note> {
        self.notes.get(&key)
    }

    /// All that is new of visitors.
    pub fn notes(&self) -> impl Iterator<Item = (&KeyFingerprint, &Note)> {
        self.notes.iter()
    }

    /// Takes in a line of chat, if there is room.
    pub fn say(&mut self, said: Said) {
        if self.said.len() < LINES_MAX {
            self.said.push(said);
        }
    }

    /// The lines of chat.
    pub fn said(&self) -> &[Said] {
        &self.said
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.notes.is_empty() && self.changes.is_empty() && self.said.is_empty()
    }

    /// Puts back what could not be written. What has become new since then is newer.
    pub fn put_back(&mut self, before: Self) {
        for (key, old) in before.notes {
            let note = self.note(key);
            note.name = note.name.take().or(old.name);
            note.place = note.place.take().or(old.place);
        }
        self.changes.splice(0..0, before.changes);
        self.said.splice(0..0, before.said);
        self.said.truncate(LINES_MAX);
    }
}

impl Subject {
    /// The network of an address.
    pub fn of(address: IpAddr) -> Self {
        Self::Network(network(address))
    }
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Key(key) => write!(f, "{key}"),
            Self::Network(IpAddr::V4(v4)) => write!(f, "{v4}"),
            Self::Network(IpAddr::V6(v6)) => write!(f, "{v6}/64"),
        }
    }
}

/// A text names nobody who can be banned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("name the fingerprint of a key, an IPv4 address, or an IPv6 network such as 2001:db8::/64")]
pub struct SubjectError;

impl FromStr for Subject {
    type Err = SubjectError;

    fn from_str(text: &str) -> Result<Self, SubjectError> {
        if let Ok(key) = text.parse() {
            return Ok(Self::Key(key));
        }
        if let Some(v6) = text.strip_suffix("/64") {
            return v6.parse::<Ipv6Addr>().map(|v6| Self::of(v6.into())).map_err(|_| SubjectError);
        }
        text.parse::<IpAddr>().map(Self::of).map_err(|_| SubjectError)
    }
}

impl Act {
    /// What it changes at a time, in milliseconds since 1970, where something was ruled before.
    pub fn change(&self, before: impl FnOnce(&Subject) -> Ruling, now: u64) -> Change {
        let subject = match self {
            Self::SetRole(key, _) | Self::SetMuted(key, _) | Self::Allow(key) => Subject::Key(*key),
            Self::Ban(subject, _) | Self::Unban(subject) => *subject,
            Self::Invite(hash, uses) => return Change::Invite(*hash, *uses),
        };
        let mut ruling = before(&subject);
        ruling.take(self, now);
        Change::Rule(subject, ruling)
    }
}

impl Change {
    /// The line of the audit log about an act.
    pub fn audit(author: &str, done: &Act, reason: &str) -> Self {
        let (act, subject) = match done {
            Act::SetRole(key, role) => (format!("make {role}"), key.to_string()),
            Act::SetMuted(key, true) => ("mute".to_owned(), key.to_string()),
            Act::SetMuted(key, false) => ("unmute".to_owned(), key.to_string()),
            Act::Allow(key) => ("allow".to_owned(), key.to_string()),
            Act::Ban(subject, _) => ("ban".to_owned(), subject.to_string()),
            Act::Unban(subject) => ("unban".to_owned(), subject.to_string()),
            Act::Invite(_, uses) => (format!("invite {uses}"), String::new()),
        };
        Self::Audit { author: author.to_owned(), act, subject, reason: reason.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subjects_read_back_from_their_texts() {
        let key = Subject::Key(KeyFingerprint([7; 10]));
        for (text, expected) in [
            ("192.0.2.1", "192.0.2.1"),
            ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
            ("2001:db8:1:2::/64", "2001:db8:1:2::/64"),
            ("::ffff:192.0.2.1", "192.0.2.1"),
            (&key.to_string(), &key.to_string()),
        ] {
            let subject: Subject = text.parse().unwrap();
            assert_eq!(subject.to_string(), expected);
            assert_eq!(subject.to_string().parse(), Ok(subject));
        }
        for wrong in ["", "Ada", "192.0.2.1/64", "2001:db8::/48"] {
            assert_eq!(wrong.parse::<Subject>(), Err(SubjectError), "{wrong}");
        }
    }

    #[test]
    fn what_could_not_be_written_waits_without_hiding_what_is_newer() {
        let key = KeyFingerprint([1; 10]);
        let mut before = Pending::default();
        let building: Arc<str> = "house".into();
        *before.note(key) =
            Note { name: Some("Ada".to_owned()), place: Some((building.clone(), Vec3::ZERO)) };
        before.changes.push(Change::UseInvitation([1; 32]));
        let mut now = Pending::default();
        now.note(key).place = Some((building, Vec3::ONE));
        now.changes.push(Change::UseInvitation([2; 32]));
        now.put_back(before);
        let note = now.noted(key).unwrap();
        assert_eq!(note.name.as_deref(), Some("Ada"));
        assert_eq!(note.place.as_ref().unwrap().1, Vec3::ONE);
        assert_eq!(now.changes, [1, 2].map(|n| Change::UseInvitation([n; 32])));
    }

    #[test]
    fn the_memory_for_notes_has_a_limit() {
        let mut pending = Pending::default();
        for i in 0..2 * NOTES_MAX as u64 {
            let mut key = [0; 10];
            key[..8].copy_from_slice(&i.to_le_bytes());
            pending.note(KeyFingerprint(key)).name = Some(String::new());
        }
        assert_eq!(pending.notes().count(), NOTES_MAX);
    }
}
