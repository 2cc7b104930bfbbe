//! The thread that writes the database.

use std::{
    sync::{Condvar, Mutex, PoisonError},
    time::{Duration, Instant},
};

use rusqlite::Result;

use super::Shared;

/// How often what waits is written.
const INTERVAL: Duration = Duration::from_millis(400);
/// How often strangers are forgotten of whom there are too many.
const FORGET_INTERVAL: Duration = Duration::from_secs(3_600);
/// How often it is told that the database cannot be written.
const COMPLAINT_INTERVAL: Duration = Duration::from_secs(60);

/// Tells the writer to end.
#[derive(Debug, Default)]
pub struct Signal {
    has_ended: Mutex<bool>,
    changed: Condvar,
}

impl Signal {
    /// Tells the writer to write what waits, and to end.
    pub fn end(&self) {
        *self.has_ended.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.changed.notify_all();
    }

    /// Waits for the next time to write. Returns whether it is the last one.
    fn wait(&self) -> bool {
        let has_ended = self.has_ended.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(has_ended, INTERVAL, |has_ended| !*has_ended);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Writes until it is told to end. The standings in memory are of a version of the database, as
/// others write it.
pub fn run(shared: &Shared, mut version: i64) {
    let mut forget_at = Instant::now();
    let mut complain_at = Instant::now();
    loop {
        let is_last = shared.signal.wait();
        let forgets = Instant::now() >= forget_at;
        let written = write(shared).and_then(|()| follow(shared, &mut version));
        let written = match forgets {
            true => written.and_then(|()| shared.database().forget(shared.chat_days)),
            false => written,
        };
        if forgets {
            forget_at = Instant::now() + FORGET_INTERVAL;
        }
        if let Err(error) = written
            && Instant::now() >= complain_at
        {
            tracing::error!(%error, "the database of visitors cannot be written");
            complain_at = Instant::now() + COMPLAINT_INTERVAL;
        }
        if is_last {
            return;
        }
    }
}

/// Writes what waits. What cannot be written waits on.
fn write(shared: &Shared) -> Result<()> {
    let mut database = shared.database();
    let pending = std::mem::take(&mut *shared.pending());
    if pending.is_empty() {
        return Ok(());
    }
    let written = database.write(&pending);
    if written.is_err() {
        shared.pending().put_back(pending);
    }
    written
}

/// Takes in what another program has written, such as a command of the operator.
fn follow(shared: &Shared, version: &mut i64) -> Result<()> {
    let database = shared.database();
    let now = database.foreign_version()?;
    if now != *version {
        // Reading may take long, and every hello asks for the standings.
        let mut read = database.standings()?;
        let mut standings = shared.standings();
        // What has not been written yet counts, too.
        shared.pending().changes.iter().for_each(|change| read.apply(change));
        shared.tell_ruled(read.differing(&standings));
        *standings = read;
        *version = now;
    }
    Ok(())
}
