//! The SQLite database.

use std::{
    collections::HashMap,
    fs, io,
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use glam::Vec3;
use rusqlite::{Connection, OptionalExtension, Result, Row, params};
use sightline_protocol::fingerprint::KeyFingerprint;

use super::{
    changes::{Act, Change, Note, Pending, Subject},
    migrations::{self, VERSION},
    role::Role,
    ruling::{Dated, Ruling, UNDATED, line, now_ms},
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
        let mut rulings: HashMap<Subject, Ruling> = HashMap::new();
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let role = Role::of_number(row.get(1)?);
            let (is_muted, is_allowed) = (row.get(2)?, row.get(3)?);
            let ruling = Ruling::undated(Standing { role, is_muted, is_allowed });
            rulings.insert(Subject::Key(KeyFingerprint(row.get(0)?)), ruling);
        }
        let mut statement =
            self.connection.prepare_cached("SELECT subject, reason, since FROM bans")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            if let Some(subject) = subject(&row.get::<_, String>(0)?) {
                let since = u64::try_from(row.get::<_, i64>(2)?).unwrap_or_default();
                let reason = line(&row.get::<_, String>(1)?);
                let at = since.saturating_mul(1_000).max(UNDATED);
                let banned = Dated { is: Some(reason), at };
                rulings.entry(subject).or_default().banned = banned;
            }
        }
        let mut statement = self.connection.prepare_cached(
            "SELECT subject, role_at, muted_at, allowed_at, banned_at FROM rulings",
        )?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            if let Some(subject) = subject(&row.get::<_, String>(0)?) {
                let at =
                    |column| row.get::<_, i64>(column).map(|at| u64::try_from(at).unwrap_or(0));
                let ruling = rulings.entry(subject).or_default();
                // What counts has a date, or other stations would ignore it.
                ruling.role.at = at(1)?.max(ruling.role.at);
                ruling.muted.at = at(2)?.max(ruling.muted.at);
                ruling.allowed.at = at(3)?.max(ruling.allowed.at);
                ruling.banned.at = at(4)?.max(ruling.banned.at);
            }
        }
        for (subject, ruling) in rulings {
            standings.apply(&Change::Rule(subject, ruling));
        }
        let mut statement = self.connection.prepare_cached("SELECT hash, uses FROM invitations")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            standings.apply(&Change::Invite(row.get(0)?, row.get(1)?));
        }
        Ok(standings)
    }

    /// The title of the building in which a visitor was last, where, and when that was noted, in
    /// seconds since 1970.
    pub(super) fn place(&self, key: KeyFingerprint) -> Result<Option<(String, Vec3, i64)>> {
        let mut statement = self.connection.prepare_cached(
            "SELECT building, x, y, z, placed FROM visitors WHERE key = ?1 AND building IS NOT NULL",
        )?;
        let place = statement.query_row([key.0], |row| {
            let axis = |i| row.get::<_, f64>(i).map(|coordinate| coordinate as f32);
            Ok((row.get(0)?, Vec3::new(axis(1)?, axis(2)?, axis(3)?), row.get(4)?))
        });
        Ok(place.optional()?.filter(|(_, eye, _): &(String, Vec3, i64)| eye.is_finite()))
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
        for change in &pending.changes {
            write_change(&transaction, now, change)?;
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
        let change = self.standings()?.act(&act, now_ms());
        pending.changes.extend([Change::audit(author, &act, reason), change]);
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
pub(super) fn unix_time() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    since.as_secs() as i64
}

/// Whom a row is about.
fn subject(text: &str) -> Option<Subject> {
    let read = text.parse();
    let read = read.inspect_err(|error| tracing::warn!(%error, "a row in the database is ignored"));
    read.ok()
}

fn write_note(connection: &Connection, now: i64, key: KeyFingerprint, note: &Note) -> Result<()> {
    let mut statement = connection.prepare_cached(
        "INSERT INTO visitors (key, name, seen, building, x, y, z, placed)
         VALUES (?1, coalesce(?2, ''), ?3, ?4, ?5, ?6, ?7, iif(?4 IS NULL, 0, ?3))
         ON CONFLICT (key) DO UPDATE SET
             seen = excluded.seen,
             name = coalesce(?2, name),
             building = coalesce(?4, building),
             x = coalesce(?5, x), y = coalesce(?6, y), z = coalesce(?7, z),
             placed = iif(?4 IS NULL, placed, ?3)",
    )?;
    let building = note.place.as_ref().map(|(building, _)| &**building);
    let [x, y, z] = [0, 1, 2].map(|axis| note.place.as_ref().map(|(_, eye)| f64::from(eye[axis])));
    statement.execute(params![key.0, note.name, now, building, x, y, z])?;
    Ok(())
}

fn write_change(connection: &Connection, now: i64, change: &Change) -> Result<()> {
    match change {
        Change::Rule(subject, ruling) => return write_ruling(connection, now, subject, ruling),
        Change::Invite(hash, uses) => connection.execute(
            "INSERT OR REPLACE INTO invitations (hash, uses) VALUES (?1, ?2)",
            params![hash, uses],
        )?,
        Change::UseInvitation(hash) => {
            connection.execute("UPDATE invitations SET uses = uses - 1 WHERE hash = ?1", [hash])?;
            connection.execute("DELETE FROM invitations WHERE uses <= 0", [])?
        }
        Change::Audit { author, act, subject, reason } => connection.execute(
            "INSERT INTO audit (at, author, act, subject, reason) VALUES (?1, ?2, ?3, ?4, ?5)",
            params![now, author, act, subject, reason],
        )?,
    };
    Ok(())
}

/// Writes the parts of a ruling that are not older than those in the file: another program may
/// have written it meanwhile.
fn write_ruling(
    connection: &Connection,
    now: i64,
    subject: &Subject,
    ruling: &Ruling,
) -> Result<()> {
    let text = subject.to_string();
    let mut dates = connection.prepare_cached(
        "SELECT role_at, muted_at, allowed_at, banned_at FROM rulings WHERE subject = ?1",
    )?;
    let read = |row: &Row<'_>| -> Result<[i64; 4]> {
        Ok([row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?])
    };
    let before = dates.query_row([&text], read).optional()?.unwrap_or_default();
    let Ruling { role, muted, allowed, banned } = ruling;
    let at = [role.at, muted.at, allowed.at, banned.at].map(|at| at as i64);
    let is_new = [0, 1, 2, 3].map(|part| at[part] > 0 && at[part] >= before[part]);
    if let Subject::Key(key) = subject {
        let values = [role.is.number(), i64::from(muted.is), i64::from(allowed.is)];
        for ((column, value), is_new) in
            ["role", "muted", "allowed"].into_iter().zip(values).zip(is_new)
        {
            // The columns are named here, and nowhere else.
            let sql = format!(
                "INSERT INTO visitors (key, seen, {column}) VALUES (?1, ?2, ?3)
                 ON CONFLICT (key) DO UPDATE SET {column} = ?3"
            );
            if is_new {
                connection.prepare_cached(&sql)?.execute(params![key.0, now, value])?;
            }
        }
    }
    match &banned.is {
        _ if !is_new[3] => 0,
        Some(reason) => connection.execute(
            "INSERT OR REPLACE INTO bans (subject, reason, since) VALUES (?1, ?2, ?3)",
            params![text, reason, (banned.at / 1_000) as i64],
        )?,
        None => connection.execute("DELETE FROM bans WHERE subject = ?1", [&text])?,
    };
    let [role, muted, allowed, banned] = [0, 1, 2, 3].map(|part| at[part].max(before[part]));
    connection.execute(
        "INSERT OR REPLACE INTO rulings (subject, role_at, muted_at, allowed_at, banned_at)
         VALUES (?1, ?2, ?3, ?4, ?5)",
        params![text, role, muted, allowed, banned],
    )?;
    Ok(())
}
