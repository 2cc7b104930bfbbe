//! What moderators and operators do to visitors.

use std::{
    net::IpAddr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use serde::Serialize;
use sightline_protocol::fingerprint::KeyFingerprint;

use super::{
    client::ConnectedClient,
    state::{Registry, ServerState},
};
use crate::{
    address::network,
    people::{Act, People, Role, Standing, Subject},
};

/// A visitor, as moderators see it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct VisitorInfo {
    /// The id of its avatar.
    pub avatar: u32,
    /// The fingerprint of its key, as text.
    pub key: String,
    /// The name that others see.
    pub name: String,
    /// What it may do.
    pub role: Role,
    /// The address of its machine.
    pub address: IpAddr,
    /// Whether it is connected. Otherwise its link broke, and its avatar is kept.
    pub is_connected: bool,
    /// Whether nobody hears what it says.
    pub is_muted: bool,
}

/// The person or program that does something to a visitor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Author {
    /// Whoever runs the server.
    Operator,
    /// The owner of a key.
    Visitor(KeyFingerprint),
}

/// Why something is not done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModerationError {
    /// The author is no moderator.
    #[error("only moderators may do that")]
    NoModerator,
    /// The author is banned.
    #[error("you are banned")]
    Banned,
    /// The author is no owner.
    #[error("only owners may do that")]
    NoOwner,
    /// The other has the same role, or a higher one.
    #[error("you cannot do that to somebody of your own role or a higher one")]
    Outranked,
    /// There is no such visitor.
    #[error("nobody of that name is here")]
    NotHere,
}

/// What moderators and operators may do to visitors. Everything is noted in the audit log.
#[derive(Clone)]
pub struct Moderation {
    people: Arc<People>,
    registry: Arc<Mutex<Registry>>,
}

impl Moderation {
    pub(super) fn new(state: &ServerState) -> Self {
        Self { people: state.people.clone(), registry: state.registry.clone() }
    }

    /// All visitors, by name.
    pub fn visitors(&self) -> Vec<VisitorInfo> {
        let clients: Vec<_> = {
            let registry = self.registry();
            let all = registry.visitors.all();
            all.map(|(client, is_connected)| (client.clone(), is_connected)).collect()
        };
        let info = |(client, is_connected): (Arc<ConnectedClient>, bool)| {
            let standing = self.people.standing(client.visit.key);
            VisitorInfo {
                avatar: client.avatar().0,
                key: client.visit.key.to_string(),
                name: client.visit.name.to_string(),
                role: standing.role,
                address: client.address(),
                is_connected,
                is_muted: standing.is_muted,
            }
        };
        let mut visitors: Vec<VisitorInfo> = clients.into_iter().map(info).collect();
        visitors.sort_by(|one, other| one.name.cmp(&other.name));
        visitors
    }

    /// Removes a visitor, who may come again.
    ///
    /// # Errors
    /// When the author may not, or the visitor is not here.
    pub fn kick(
        &self,
        author: Author,
        key: KeyFingerprint,
        reason: &str,
    ) -> Result<(), ModerationError> {
        self.check(author, key)?;
        if !self.remove(key, &told("a moderator removed you", reason)) {
            return Err(ModerationError::NotHere);
        }
        self.people.note_act(&author.to_string(), "kick", &key.to_string(), reason);
        Ok(())
    }

    /// Mutes somebody, or lets them speak again.
    ///
    /// # Errors
    /// When the author may not.
    pub fn set_muted(
        &self,
        author: Author,
        key: KeyFingerprint,
        is_muted: bool,
        reason: &str,
    ) -> Result<(), ModerationError> {
        self.check(author, key)?;
        self.people.act(&author.to_string(), Act::SetMuted(key, is_muted), reason);
        Ok(())
    }

    /// Keeps somebody out, or all of a network, and removes those who are here.
    ///
    /// # Errors
    /// When the author may not.
    pub fn ban(
        &self,
        author: Author,
        subject: Subject,
        reason: &str,
    ) -> Result<(), ModerationError> {
        self.check_role(author, Role::Moderator)?;
        self.keys_of(subject).into_iter().try_for_each(|key| self.check(author, key))?;
        self.people.act(&author.to_string(), Act::Ban(subject, reason.to_owned()), reason);
        // More may have come in before the ban.
        self.remove_banned(subject, reason);
        Ok(())
    }

    /// Removes those who are here and are banned now.
    pub(super) fn remove_banned(&self, subject: Subject, reason: &str) {
        let keys = self.keys_of(subject).into_iter();
        for key in keys.filter(|key| self.is_banned(*key)) {
            self.remove(key, &told("you are banned", reason));
        }
    }

    /// The keys of those whom a ban is about.
    fn keys_of(&self, subject: Subject) -> Vec<KeyFingerprint> {
        match subject {
            Subject::Key(key) => vec![key],
            Subject::Network(network) => self.of_network(network),
        }
    }

    /// How the server stands to somebody, here or not.
    pub fn standing(&self, key: KeyFingerprint) -> Standing {
        self.people.standing(key)
    }

    /// Whether the owner of a key is kept out.
    pub fn keeps_out(&self, key: KeyFingerprint) -> bool {
        self.people.is_banned(key, None)
    }

    /// The key of a visitor.
    ///
    /// # Errors
    /// When nobody has this avatar.
    pub fn key_of(&self, avatar: u32) -> Result<KeyFingerprint, ModerationError> {
        let registry = self.registry();
        let mut all = registry.visitors.all().map(|(client, _)| client);
        let client = all.find(|client| client.avatar().0 == avatar);
        client.map(|client| client.visit.key).ok_or(ModerationError::NotHere)
    }

    /// The network of a visitor, to be banned.
    ///
    /// # Errors
    /// When the visitor is not here.
    pub fn network_of(&self, key: KeyFingerprint) -> Result<Subject, ModerationError> {
        let registry = self.registry();
        let client = registry.visitors.get(key).ok_or(ModerationError::NotHere)?;
        Ok(Subject::of(client.address()))
    }

    /// Lets somebody in again.
    ///
    /// # Errors
    /// When the author may not.
    pub fn unban(&self, author: Author, subject: Subject) -> Result<(), ModerationError> {
        self.check_role(author, Role::Moderator)?;
        self.people.act(&author.to_string(), Act::Unban(subject), "");
        Ok(())
    }

    /// Puts somebody on the list of those who are let in.
    ///
    /// # Errors
    /// When the author may not.
    pub fn allow(&self, author: Author, key: KeyFingerprint) -> Result<(), ModerationError> {
        self.check_role(author, Role::Moderator)?;
        self.people.act(&author.to_string(), Act::Allow(key), "");
        Ok(())
    }

    /// Gives somebody a role.
    ///
    /// # Errors
    /// When the author may not.
    pub fn set_role(
        &self,
        author: Author,
        key: KeyFingerprint,
        role: Role,
    ) -> Result<(), ModerationError> {
        self.check_role(author, Role::Owner)?;
        self.check(author, key)?;
        self.people.act(&author.to_string(), Act::SetRole(key, role), "");
        Ok(())
    }

    /// Checks that somebody may moderate the owner of a key.
    fn check(&self, author: Author, key: KeyFingerprint) -> Result<(), ModerationError> {
        self.check_role(author, Role::Moderator)?;
        let Author::Visitor(own) = author else { return Ok(()) };
        let [own, other] = [own, key].map(|key| self.people.standing(key).role);
        if own > other { Ok(()) } else { Err(ModerationError::Outranked) }
    }

    /// Checks that somebody has a role, and is not banned. The server hears a client for a moment
    /// after its ban.
    pub(super) fn check_role(&self, author: Author, role: Role) -> Result<(), ModerationError> {
        match author {
            Author::Visitor(key) if self.is_banned(key) => Err(ModerationError::Banned),
            Author::Visitor(key) if self.people.standing(key).role < role => match role {
                Role::Owner => Err(ModerationError::NoOwner),
                Role::Visitor | Role::Moderator => Err(ModerationError::NoModerator),
            },
            Author::Visitor(_) | Author::Operator => Ok(()),
        }
    }

    /// Whether somebody is banned, by the key or by the network from which it came in.
    fn is_banned(&self, key: KeyFingerprint) -> bool {
        let address = self.registry().visitors.get(key).map(|client| client.address());
        self.people.is_banned(key, address)
    }

    /// The keys of the visitors of a network.
    fn of_network(&self, wanted: IpAddr) -> Vec<KeyFingerprint> {
        let registry = self.registry();
        let all = registry.visitors.all().map(|(client, _)| client);
        let theirs = all.filter(|client| network(client.address()) == wanted);
        theirs.map(|client| client.visit.key).collect()
    }

    /// Removes a visitor. Returns whether it was here.
    fn remove(&self, key: KeyFingerprint, why: &str) -> bool {
        let mut registry = self.registry();
        let Some(client) = registry.visitors.get(key).cloned() else { return false };
        client.outbox.end(why, false);
        registry.visitors.give_up(key);
        true
    }

    fn registry(&self) -> MutexGuard<'_, Registry> {
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl std::fmt::Display for Author {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Operator => f.write_str("operator"),
            Self::Visitor(key) => write!(f, "{key}"),
        }
    }
}

/// What somebody is told, and why.
fn told(what: &str, reason: &str) -> String {
    if reason.is_empty() { what.to_owned() } else { format!("{what}: {reason}") }
}
