//! Whom the server remembers: keys, names, roles, bans, the last place of each visitor, what
//! moderators did and, if it is told to, what was said. It is kept in an SQLite database in the
//! data folder.
//!
//! [`People`] answers from memory, and a thread of its own writes changes: at most a second passes
//! until they are in the file.

mod access;
mod changes;
mod database;
mod invitation;
mod migrations;
mod records;
mod role;
mod ruling;
#[cfg(feature = "bus")]
mod sharing;
mod standing;
mod writer;

use std::{
    net::IpAddr,
    path::Path,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError},
    thread::JoinHandle,
};

use glam::Vec3;
use sightline_protocol::{
    fingerprint::KeyFingerprint,
    text::{ChatLine, Name},
};
use tokio::sync::mpsc;

pub use access::{Access, AccessError};
pub use changes::{Act, Subject, SubjectError};
pub use database::{Database, DatabaseError};
pub use invitation::{NoRandomness, hash, new_invitation};
pub use records::{AuditRecord, ChatRecord};
pub use role::{Role, RoleError};
#[cfg(feature = "bus")]
pub(crate) use ruling::Ruling;
pub(crate) use ruling::now_ms;
pub use standing::Standing;

use changes::{Change, Note, Pending, Said};
use database::unix_time;
use standing::Standings;
use writer::Signal;

/// Whom the server remembers.
pub struct People {
    shared: Arc<Shared>,
    writer: Mutex<Option<JoinHandle<()>>>,
}

/// What the writer shares with all others. Locks are taken in the order of these fields.
struct Shared {
    database: Mutex<Database>,
    standings: Mutex<Standings>,
    pending: Mutex<Pending>,
    signal: Signal,
    /// For how many days chat is kept; zero when it is not.
    chat_days: u32,
    /// Who is told of whom something is ruled about here.
    ruled: OnceLock<mpsc::UnboundedSender<Subject>>,
}

impl People {
    /// Opens the database in a data folder, which is made now if there is none. Without a folder,
    /// everything is forgotten in the end. Chat is kept for some days; for none if that is zero.
    ///
    /// # Errors
    /// When the file cannot be opened, is none of ours, or was written by a later version.
    pub fn open(folder: Option<&Path>, chat_days: u32) -> Result<Self, DatabaseError> {
        let database = match folder {
            Some(folder) => Database::open(folder)?,
            None => Database::in_memory()?,
        };
        let version = database.foreign_version()?;
        let standings = Mutex::new(database.standings()?);
        let (database, pending) = (Mutex::new(database), Mutex::default());
        let signal = Signal::default();
        let ruled = OnceLock::new();
        let shared = Arc::new(Shared { database, standings, pending, signal, chat_days, ruled });
        let writing = shared.clone();
        let writer = std::thread::Builder::new().name("people".into());
        let writer =
            writer.spawn(move || writer::run(&writing, version)).map_err(DatabaseError::Thread)?;
        Ok(Self { shared, writer: Mutex::new(Some(writer)) })
    }

    /// How the server stands to the owner of a key.
    pub fn standing(&self, key: KeyFingerprint) -> Standing {
        self.shared.standings().of(key)
    }

    /// Whether a visitor is kept out, by its key or, if its address is known, by its network. The ban
    /// of a network is about visitors: moderators and owners of it come in.
    pub fn is_banned(&self, key: KeyFingerprint, address: impl Into<Option<IpAddr>>) -> bool {
        let standings = self.shared.standings();
        let network = address.into().map(Subject::of);
        let network = network.filter(|_| standings.of(key).role == Role::Visitor);
        let mut subjects = [Some(Subject::Key(key)), network].into_iter().flatten();
        subjects.any(|subject| standings.is_banned(&subject))
    }

    /// Whether an invitation lets somebody in. If it does, its owner is let in without it from now
    /// on.
    pub fn accept_invitation(&self, key: KeyFingerprint, invitation: &str) -> bool {
        let token = hash(invitation);
        let mut standings = self.shared.standings();
        if !standings.use_invitation(&token) {
            return false;
        }
        let allowed = standings.act(&Act::Allow(key), now_ms());
        let mut pending = self.shared.pending();
        pending.changes.extend([Change::UseInvitation(token), allowed]);
        drop((pending, standings));
        self.shared.tell_ruled([Subject::Key(key)]);
        true
    }

    /// Takes in that a visitor has come in.
    pub fn note_name(&self, key: KeyFingerprint, name: &Name) {
        self.shared.pending().note(key).name = Some(name.to_string());
    }

    /// Takes in what a visitor says, if chat is kept.
    pub fn note_chat(&self, key: KeyFingerprint, name: &Name, text: &ChatLine) {
        if self.shared.chat_days > 0 {
            let (name, text) = (name.to_string(), text.to_string());
            self.shared.pending().say(Said { key, name, text });
        }
    }

    /// Takes in where visitors are, in a building of this title.
    pub fn note_places(&self, building: &Arc<str>, places: &[(KeyFingerprint, Vec3)]) {
        let mut pending = self.shared.pending();
        for (key, eye) in places {
            pending.note(*key).place = Some((building.clone(), *eye));
        }
    }

    /// Where a visitor was last in a building of this title, and when that was noted, in seconds
    /// since 1970. Reads the file.
    pub fn last_place(&self, key: KeyFingerprint, building: &str) -> Option<(Vec3, i64)> {
        let noted = self.shared.pending().noted(key).and_then(|note: &Note| note.place.clone());
        let noted = noted.map(|(title, eye)| (title.to_string(), eye, unix_time()));
        let place = noted.or_else(|| {
            let read = self.shared.database().place(key);
            read.unwrap_or_else(|error| {
                tracing::warn!(%key, %error, "the last place cannot be read");
                None
            })
        });
        place.filter(|(title, ..)| title == building).map(|(_, eye, noted_s)| (eye, noted_s))
    }

    /// Does something that lasts, and notes in the audit log who did it and why.
    pub fn act(&self, author: &str, act: Act, reason: &str) {
        // Whoever reads the standings anew must find the act in them or in what waits.
        let mut standings = self.shared.standings();
        let change = standings.act(&act, now_ms());
        let ruled = match &change {
            Change::Rule(subject, _) => Some(*subject),
            _ => None,
        };
        let mut pending = self.shared.pending();
        pending.changes.push(Change::audit(author, &act, reason));
        pending.changes.push(change);
        drop((pending, standings));
        self.shared.tell_ruled(ruled);
    }

    /// Notes in the audit log what a moderator did that does not last.
    pub fn note_act(&self, author: &str, act: &str, subject: &str, reason: &str) {
        let [author, act, subject, reason] = [author, act, subject, reason].map(str::to_owned);
        self.shared.pending().changes.push(Change::Audit { author, act, subject, reason });
    }

    /// Writes all that waits. Nothing is written after that.
    pub fn finish(&self) {
        self.shared.signal.end();
        let writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner).take();
        if writer.is_some_and(|writer| writer.join().is_err()) {
            tracing::error!("the thread that writes the database panicked");
        }
    }
}

impl Drop for People {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Shared {
    fn database(&self) -> MutexGuard<'_, Database> {
        self.database.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn standings(&self) -> MutexGuard<'_, Standings> {
        self.standings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells who follows that something was ruled here.
    fn tell_ruled(&self, subjects: impl IntoIterator<Item = Subject>) {
        if let Some(told) = self.ruled.get() {
            // Who has ended need not be told.
            for subject in subjects {
                let _ = told.send(subject);
            }
        }
    }

    fn pending(&self) -> MutexGuard<'_, Pending> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests;
