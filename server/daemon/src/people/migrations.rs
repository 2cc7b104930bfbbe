//! The schema of the database, version by version.

use rusqlite::{Connection, Result};

/// Each step leads from the version of its number to the next. A released one never changes.
const STEPS: [&str; 4] = [
    "
CREATE TABLE visitors (
    key BLOB PRIMARY KEY CHECK (length(key) = 10),
    name TEXT NOT NULL DEFAULT '',
    seen INTEGER NOT NULL,  -- Unix time, in seconds, as all times.
    role INTEGER NOT NULL DEFAULT 0,
    muted INTEGER NOT NULL DEFAULT 0,
    allowed INTEGER NOT NULL DEFAULT 0,
    building TEXT,
    x REAL, y REAL, z REAL
) STRICT, WITHOUT ROWID;
CREATE INDEX visitors_by_seen ON visitors (seen) WHERE role = 0 AND muted = 0 AND allowed = 0;
CREATE TABLE bans (
    subject TEXT PRIMARY KEY,
    reason TEXT NOT NULL,
    since INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TABLE invitations (
    hash BLOB PRIMARY KEY CHECK (length(hash) = 32),
    uses INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TABLE audit (
    at INTEGER NOT NULL,
    author TEXT NOT NULL,
    act TEXT NOT NULL,
    subject TEXT NOT NULL,
    reason TEXT NOT NULL
) STRICT;
",
    "
CREATE TABLE chat (
    at INTEGER NOT NULL,
    key TEXT NOT NULL,
    name TEXT NOT NULL,
    text TEXT NOT NULL
) STRICT;
CREATE INDEX chat_by_time ON chat (at);
",
    "
-- When each part of a ruling was made, in milliseconds since 1970.
CREATE TABLE rulings (
    subject TEXT PRIMARY KEY,
    role_at INTEGER NOT NULL,
    muted_at INTEGER NOT NULL,
    allowed_at INTEGER NOT NULL,
    banned_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
",
    "
-- When the place was noted; zero if that was before there was this column.
ALTER TABLE visitors ADD COLUMN placed INTEGER NOT NULL DEFAULT 0;
",
];

/// The version that this program writes.
pub const VERSION: usize = STEPS.len();

/// Brings a database to this version. Each step is done wholly or not at all. Returns the version
/// that it had.
pub fn migrate(connection: &mut Connection) -> Result<usize> {
    let version = |connection: &Connection| {
        connection.query_row("PRAGMA user_version", [], |row| row.get::<_, i64>(0))
    };
    let before = usize::try_from(version(connection)?).unwrap_or(usize::MAX);
    for (from, step) in STEPS.iter().enumerate().skip(before) {
        let transaction = connection.transaction()?;
        transaction.execute_batch(step)?;
        transaction.pragma_update(None, "user_version", from as i64 + 1)?;
        transaction.commit()?;
    }
    Ok(before)
}
