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

use crate::{bit_set::BitSet, interest::sight_tests::SightTester, regions::reach::Scratch};

/// So many follow one another on one thread: enough that handing them out costs nothing.
const GRAIN: usize = 16;

/// What a thread needs besides the answers, kept to save allocations. Nothing in it lives on.
#[derive(Clone, Debug)]
pub(crate) struct Workspace {
    pub(crate) reach: Scratch,
    pub(crate) shafts: SightTester,
    /// Cells that can be seen.
    pub(crate) seen: [BitSet; 2],
    /// Avatars that were met.
    pub(crate) met: BitSet,
}

/// Those who do the work.
pub(crate) struct WorkerPool {
    /// None where the caller's thread does all.
    pool: Option<Arc<ThreadPool>>,
    occluders: Arc<Occluders>,
    idle: Mutex<Vec<Workspace>>,
}

impl WorkerPool {
    /// So many threads. Where the system grants no threads, the caller's own does all.
    pub(crate) fn new(threads: usize, occluders: Arc<Occluders>) -> Self {
        let build = || ThreadPoolBuilder::new().num_threads(threads).build().ok();
        let pool = (threads > 1).then(build).flatten().map(Arc::new);
        Self { pool, occluders, idle: Mutex::default() }
    }

    /// Does something for each.
    pub(crate) fn each<T: Send>(
        &self,
        items: &mut [T],
        what: impl Fn(&mut Workspace, usize, &mut T) + Sync,
    ) {
        self.gather::<T, ()>(items, |work, at, item, _| what(work, at, item));
    }

    /// Does something for each, and gives what came of it in their order.
    pub(crate) fn gather<T: Send, R: Send>(
        &self,
        items: &mut [T],
        what: impl Fn(&mut Workspace, usize, &mut T, &mut Vec<R>) + Sync,
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

    fn begin(&self) -> Workspace {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.unwrap_or_else(|| Workspace {
            reach: Scratch::default(),
            shafts: SightTester::new(Arc::clone(&self.occluders)),
            seen: Default::default(),
            met: BitSet::default(),
        })
    }

    fn end(&self, work: Workspace) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(work);
    }
}

impl Clone for WorkerPool {
    /// The same threads, for another engine.
    fn clone(&self) -> Self {
        Self {
            pool: self.pool.clone(),
            occluders: Arc::clone(&self.occluders),
            idle: Mutex::default(),
        }
    }
}

impl fmt::Debug for WorkerPool {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let threads = self.pool.as_ref().map_or(1, |pool| pool.current_num_threads());
        f.debug_struct("WorkerPool").field("threads", &threads).finish_non_exhaustive()
    }
}
