//! The SQLite database.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use glam::Vec3;
use rusqlite::{Connection, OptionalExtension, Result, params};
use sightline_protocol::fingerprint::KeyFingerprint;

use super::{
    changes::{Act, Note, Pending, Subject},
    migrations::{self, VERSION},
    role::Role,
    standing::{Standing, Standings},
};

/// The name of the file in the data folder.
const FILE: &str = "people.db";
/// How long another program may hold the file, such as a command of the operator.
const BUSY: Duration = Duration::from_secs(5);
/// The most strangers that are remembered, of about 150 bytes each. Those who have not been seen
/// for longest are forgotten.
const STRANGERS_MAX: i64 = 100_000;
/// The most lines of the audit log.
const AUDIT_MAX: i64 = 1_000_000;

/// Why there is no database.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatabaseError {
    /// The file cannot be made.
    #[error("cannot write {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file cannot be opened, or is no database of this program.
    #[error("cannot use {path}: {source}; restore it, or remove it to begin with an empty one")]
    Open {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: rusqlite::Error,
    },
    /// A later version of the program has written the file.
    #[error("{path} was written by a later version of this program: use that one")]
    Later {
        /// The file.
        path: PathBuf,
    },
    /// The database cannot be read or written.
    #[error("cannot use the database of visitors: {0}")]
    Use(#[from] rusqlite::Error),
    /// There is no thread to write it.
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
}

/// The database.
#[derive(Debug)]
pub struct Database {
    connection: Connection,
}

impl Database {
    /// Opens the database in a data folder, or makes it. Only its owner may read it.
    ///
    /// # Errors
    /// When the file cannot be opened, is none of ours, or was written by a later version.
    pub fn open(folder: &Path) -> Result<Self, DatabaseError> {
        let path = folder.join(FILE);
        let io = |source| DatabaseError::Io { path: path.clone(), source };
        fs::create_dir_all(folder).map_err(io)?;
        let mut options = fs::OpenOptions::new();
        options.write(true).create(true).truncate(false);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        options.open(&path).map_err(io)?;
        let opened = Connection::open(&path).and_then(Self::prepare);
        let (database, before) =
            opened.map_err(|source| DatabaseError::Open { path: path.clone(), source })?;
        if before > VERSION { Err(DatabaseError::Later { path }) } else { Ok(database) }
    }

    /// A database that is not kept.
    ///
    /// # Errors
    /// When there is no memory for it.
    pub fn in_memory() -> Result<Self, DatabaseError> {
        Ok(Self::prepare(Connection::open_in_memory()?)?.0)
    }

    /// Returns the version that it had as well.
    fn prepare(mut connection: Connection) -> Result<(Self, usize)> {
        connection.busy_timeout(BUSY)?;
        // A transaction that is cut off leaves no trace, whatever is killed.
        connection.pragma_update(None, "journal_mode", "wal")?;
        connection.pragma_update(None, "synchronous", "normal")?;
        let before = migrations::migrate(&mut connection)?;
        Ok((Self { connection }, before))
    }

    /// Everybody to whom the server stands in another way than to strangers.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub(super) fn standings(&self) -> Result<Standings> {
        let mut standings = Standings::default();
        let mut statement = self.connection.prepare_cached(
            "SELECT key, role, muted, allowed FROM visitors
             WHERE role != 0 OR muted != 0 OR allowed != 0",
        )?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let role = Role::of_number(row.get(1)?);
            let (is_muted, is_allowed) = (row.get(2)?, row.get(3)?);
            standings.set(KeyFingerprint(row.get(0)?), Standing { role, is_muted, is_allowed });
        }
        let mut statement = self.connection.prepare_cached("SELECT subject FROM bans")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            match row.get::<_, String>(0)?.parse::<Subject>() {
                Ok(subject) => standings.apply(&Act::Ban(subject, String::new())),
                Err(error) => tracing::warn!(%error, "a ban in the database is ignored"),
            }
        }
        let mut statement = self.connection.prepare_cached("SELECT hash, uses FROM invitations")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            standings.apply(&Act::Invite(row.get(0)?, row.get(1)?));
        }
        Ok(standings)
    }

    /// The title of the building in which a visitor was last, and where.
    pub(super) fn place(&self, key: KeyFingerprint) -> Result<Option<(String, Vec3)>> {
        let mut statement = self.connection.prepare_cached(
            "SELECT building, x, y, z FROM visitors WHERE key = ?1 AND building IS NOT NULL",
        )?;
        let place = statement.query_row([key.0], |row| {
            let axis = |i| row.get::<_, f64>(i).map(|coordinate| coordinate as f32);
            Ok((row.get(0)?, Vec3::new(axis(1)?, axis(2)?, axis(3)?)))
        });
        Ok(place.optional()?.filter(|(_, eye): &(String, Vec3)| eye.is_finite()))
    }

    /// Writes all that waits, or nothing.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub(super) fn write(&mut self, pending: &Pending) -> Result<()> {
        let transaction = self.connection.transaction()?;
        let now = unix_time();
        for (key, note) in pending.notes() {
            write_note(&transaction, now, *key, note)?;
        }
        for act in &pending.acts {
            write_act(&transaction, now, act)?;
        }
        for said in pending.said() {
            let mut statement = transaction
                .prepare_cached("INSERT INTO chat (at, key, name, text) VALUES (?1, ?2, ?3, ?4)")?;
            statement.execute(params![now, said.key.to_string(), said.name, said.text])?;
        }
        transaction.commit()
    }

    /// Does something that lasts, and notes it in the audit log.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub fn act(&mut self, author: &str, act: Act, reason: &str) -> Result<(), DatabaseError> {
        let mut pending = Pending::default();
        pending.acts.extend([Act::audit(author, &act, reason), act]);
        Ok(self.write(&pending)?)
    }

    /// Forgets strangers and lines of the audit log beyond their greatest numbers, and chat that is
    /// older than this number of days.
    pub(super) fn forget(&mut self, chat_days: u32) -> Result<()> {
        self.connection.execute(
            "DELETE FROM visitors WHERE key IN (
                 SELECT key FROM visitors WHERE role = 0 AND muted = 0 AND allowed = 0
                 ORDER BY seen DESC LIMIT -1 OFFSET ?1)",
            [STRANGERS_MAX],
        )?;
        self.connection.execute(
            "DELETE FROM audit WHERE rowid <= (SELECT max(rowid) FROM audit) - ?1",
            [AUDIT_MAX],
        )?;
        let oldest = unix_time() - i64::from(chat_days) * 86_400;
        self.connection.execute("DELETE FROM chat WHERE at <= ?1", [oldest])?;
        Ok(())
    }

    /// What reads records.
    pub(super) fn connection(&self) -> &Connection {
        &self.connection
    }

    /// A number that changes when another program writes the database.
    pub(super) fn foreign_version(&self) -> Result<i64> {
        self.connection.query_row("PRAGMA data_version", [], |row| row.get(0))
    }
}

/// The time since 1970, in seconds.
fn unix_time() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    since.as_secs() as i64
}

fn write_note(connection: &Connection, now: i64, key: KeyFingerprint, note: &Note) -> Result<()> {
    let mut statement = connection.prepare_cached(
        "INSERT INTO visitors (key, name, seen, building, x, y, z)
         VALUES (?1, coalesce(?2, ''), ?3, ?4, ?5, ?6, ?7)
         ON CONFLICT (key) DO UPDATE SET
             seen = excluded.seen,
             name = coalesce(?2, name),
             building = coalesce(?4, building),
             x = coalesce(?5, x), y = coalesce(?6, y), z = coalesce(?7, z)",
    )?;
    let building = note.place.as_ref().map(|(building, _)| &**building);
    let [x, y, z] = [0, 1, 2].map(|axis| note.place.as_ref().map(|(_, eye)| f64::from(eye[axis])));
    statement.execute(params![key.0, note.name, now, building, x, y, z])?;
    Ok(())
}

fn write_act(connection: &Connection, now: i64, act: &Act) -> Result<()> {
    let set = |column: &str, key: &KeyFingerprint, value: i64| {
        // The columns are named here, and nowhere else.
        let sql = format!(
            "INSERT INTO visitors (key, seen, {column}) VALUES (?1, ?2, ?3)
             ON CONFLICT (key) DO UPDATE SET {column} = ?3"
        );
        connection.prepare_cached(&sql)?.execute(params![key.0, now, value])
    };
    match act {
        Act::SetRole(key, role) => set("role", key, role.number())?,
        Act::SetMuted(key, is_muted) => set("muted", key, i64::from(*is_muted))?,
        Act::Allow(key) => set("allowed", key, 1)?,
        Act::Ban(subject, reason) => connection.execute(
            "INSERT OR REPLACE INTO bans (subject, reason, since) VALUES (?1, ?2, ?3)",
            params![subject.to_string(), reason, now],
        )?,
        Act::Unban(subject) => {
            connection.execute("DELETE FROM bans WHERE subject = ?1", [subject.to_string()])?
        }
        Act::Invite(hash, uses) => connection.execute(
            "INSERT OR REPLACE INTO invitations (hash, uses) VALUES (?1, ?2)",
            params![hash, uses],
        )?,
        Act::UseInvitation(hash) => {
            connection.execute("UPDATE invitations SET uses = uses - 1 WHERE hash = ?1", [hash])?;
            connection.execute("DELETE FROM invitations WHERE uses <= 0", [])?
        }
        Act::Audit { author, act, subject, reason } => connection.execute(
            "INSERT INTO audit (at, author, act, subject, reason) VALUES (?1, ?2, ?3, ?4, ?5)",
            params![now, author, act, subject, reason],
        )?,
    };
    Ok(())
}
