//! Threads for what can be done for each avatar by itself.
//!
//! Whatever is done so reads what is there and writes what is its own, and what it gives is put together
//! in order. So how many threads there are changes no output.

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use rayon::{ThreadPool, ThreadPoolBuilder, prelude::*};
use sightline_visibility::box_visibility::Occluders;

use super::{bits::Bits, looks::Shafts, reach::Scratch};

/// So many follow one another on one thread: enough that handing them out costs nothing.
const GRAIN: usize = 16;

/// What a thread needs besides the answers, kept to save allocations. Nothing in it lives on.
#[derive(Clone, Debug)]
pub(super) struct Work {
    pub(super) reach: Scratch,
    pub(super) shafts: Shafts,
    /// Cells that can be seen.
    pub(super) seen: [Bits; 2],
    /// Avatars that were met.
    pub(super) met: Bits,
}

/// Those who do the work.
pub(super) struct Crew {
    /// None where the caller's thread does all.
    pool: Option<Arc<ThreadPool>>,
    occluders: Arc<Occluders>,
    idle: Mutex<Vec<Work>>,
}

impl Crew {
    /// So many threads. Where the system grants no threads, the caller's own does all.
    pub(super) fn new(threads: usize, occluders: Arc<Occluders>) -> Self {
        let build = || ThreadPoolBuilder::new().num_threads(threads).build().ok();
        let pool = (threads > 1).then(build).flatten().map(Arc::new);
        Self { pool, occluders, idle: Mutex::default() }
    }

    /// Does something for each.
    pub(super) fn each<T: Send>(
        &self,
        items: &mut [T],
        what: impl Fn(&mut Work, usize, &mut T) + Sync,
    ) {
        self.gather::<T, ()>(items, |work, at, item, _| what(work, at, item));
    }

    /// Does something for each, and gives what came of it in their order.
    pub(super) fn gather<T: Send, R: Send>(
        &self,
        items: &mut [T],
        what: impl Fn(&mut Work, usize, &mut T, &mut Vec<R>) + Sync,
    ) -> Vec<R> {
        let some = |first: usize, items: &mut [T]| {
            let (mut work, mut found) = (self.begin(), Vec::new());
            for (at, item) in (first..).zip(items) {
                what(&mut work, at, item, &mut found);
            }
            self.end(work);
            found
        };
        let Some(pool) = self.pool.as_ref().filter(|_| items.len() > GRAIN) else {
            return some(0, items);
        };
        let parts: Vec<Vec<R>> = pool.install(|| {
            let parts = items.par_chunks_mut(GRAIN).enumerate();
            parts.map(|(part, items)| some(part * GRAIN, items)).collect()
        });
        let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
        parts.into_iter().for_each(|mut part| all.append(&mut part));
        all
    }

    fn begin(&self) -> Work {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.unwrap_or_else(|| Work {
            reach: Scratch::default(),
            shafts: Shafts::new(Arc::clone(&self.occluders)),
            seen: Default::default(),
            met: Bits::default(),
        })
    }

    fn end(&self, work: Work) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(work);
    }
}

impl Clone for Crew {
    /// The same threads, for another engine.
    fn clone(&self) -> Self {
        Self {
            pool: self.pool.clone(),
            occluders: Arc::clone(&self.occluders),
            idle: Mutex::default(),
        }
    }
}

impl fmt::Debug for Crew {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let threads = self.pool.as_ref().map_or(1, |pool| pool.current_num_threads());
        f.debug_struct("Crew").field("threads", &threads).finish_non_exhaustive()
    }
}
