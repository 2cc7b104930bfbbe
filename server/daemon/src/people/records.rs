//! What people said and what moderators did, for whoever runs the server.

use rusqlite::{Result, Row};

use super::database::{Database, DatabaseError};

/// A line of chat.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChatRecord {
    /// When it was said, in coordinated universal time.
    pub at: String,
    /// The fingerprint of the speaker's key.
    pub key: String,
    /// The name that others saw.
    pub name: String,
    /// What was said.
    pub text: String,
}

/// A line of the audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditRecord {
    /// When it was done, in coordinated universal time.
    pub at: String,
    /// Who did it: a fingerprint, or a word for one without a key.
    pub author: String,
    /// What was done.
    pub act: String,
    /// To whom.
    pub subject: String,
    /// Why.
    pub reason: String,
}

impl Database {
    /// The last lines of chat that are kept, the oldest first.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub fn chat(&self, lines: u32) -> Result<Vec<ChatRecord>, DatabaseError> {
        let select = "SELECT datetime(at, 'unixepoch'), key, name, text FROM chat";
        self.last(select, lines, |row| {
            let [at, key, name, text] = texts(row)?;
            Ok(ChatRecord { at, key, name, text })
        })
    }

    /// The last lines of the audit log, the oldest first.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub fn audit(&self, lines: u32) -> Result<Vec<AuditRecord>, DatabaseError> {
        let select = "SELECT datetime(at, 'unixepoch'), author, act, subject, reason FROM audit";
        self.last(select, lines, |row| {
            let [at, author, act, subject, reason] = texts(row)?;
            Ok(AuditRecord { at, author, act, subject, reason })
        })
    }

    fn last<T>(
        &self,
        select: &str,
        lines: u32,
        record: fn(&Row<'_>) -> Result<T>,
    ) -> Result<Vec<T>, DatabaseError> {
        let sql = format!("{select} ORDER BY rowid DESC LIMIT ?1");
        let mut statement = self.connection().prepare(&sql)?;
        let mut records = statement.query_map([lines], record)?.collect::<Result<Vec<T>>>()?;
        records.reverse();
        Ok(records)
    }
}

fn texts<const N: usize>(row: &Row<'_>) -> Result<[String; N]> {
    let mut texts = [const { String::new() }; N];
    for (column, text) in texts.iter_mut().enumerate() {
        *text = row.get(column)?;
    }
    Ok(texts)
}
