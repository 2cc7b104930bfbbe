//! Worker pool: threads for work on one avatar at a time.
//!
//! Each task reads everything and writes only what belongs to its own avatar. Results are put
//! together in order. So the number of threads changes no output.

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use rayon::{ThreadPool, ThreadPoolBuilder, prelude::*};
use sightline_world::motion::{AvatarId, Pose};

use crate::{
    bit_set::BitSet,
    claims::WaySearch,
    regions::{ReachSearch, SightTester},
};

/// How many successive items one thread takes: enough to make handing them out cheap.
const GRAIN: usize = 16;

/// The memory of one thread's algorithms, kept to save allocations. No result depends on it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Workspace {
    /// Cells that are visible from where an eye can be.
    pub(crate) seen_by_eyes: BitSet,
    /// Cells that are visible from where a body can be.
    pub(crate) seeing_bodies: BitSet,
    pub(crate) reach: ReachSearch,
    pub(crate) sight: SightTester,
    pub(crate) ways: WaySearch,
    /// What one viewer is told at a tick.
    pub(crate) poses: Vec<(AvatarId, Pose)>,
}

/// Threads that share the work of a tick.
pub(crate) struct WorkerPool {
    /// `None` where the caller's thread does all the work.
    pool: Option<Arc<ThreadPool>>,
    idle: Mutex<Vec<Workspace>>,
}

impl WorkerPool {
    /// A pool of some threads. Where the system grants none, the caller's own does all the work.
    pub(crate) fn new(threads: usize) -> Self {
        let build = || ThreadPoolBuilder::new().num_threads(threads).build().ok();
        let pool = (threads > 1).then(build).flatten().map(Arc::new);
        Self { pool, idle: Mutex::default() }
    }

    /// Runs a task for each item.
    pub(crate) fn each<T: Send>(
        &self,
        items: &mut [T],
        task: impl Fn(&mut Workspace, usize, &mut T) + Sync,
    ) {
        self.gather::<T, ()>(items, |workspace, index, item, _| task(workspace, index, item));
    }

    /// Runs a task for each item, and returns all results in the order of the items.
    pub(crate) fn gather<T: Send, R: Send>(
        &self,
        items: &mut [T],
        task: impl Fn(&mut Workspace, usize, &mut T, &mut Vec<R>) + Sync,
    ) -> Vec<R> {
        let run = |first: usize, items: &mut [T]| {
            let (mut workspace, mut results) = (self.take(), Vec::new());
            for (index, item) in (first..).zip(items) {
                task(&mut workspace, index, item, &mut results);
            }
            self.give_back(workspace);
            results
        };
        let Some(pool) = self.pool.as_ref().filter(|_| items.len() > GRAIN) else {
            return run(0, items);
        };
        let parts: Vec<Vec<R>> = pool.install(|| {
            let parts = items.par_chunks_mut(GRAIN).enumerate();
            parts.map(|(part, items)| run(part * GRAIN, items)).collect()
        });
        let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
        parts.into_iter().for_each(|mut part| all.append(&mut part));
        all
    }

    fn take(&self) -> Workspace {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.unwrap_or_default()
    }

    fn give_back(&self, workspace: Workspace) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}

impl Clone for WorkerPool {
    /// A pool that shares the threads, for another engine.
    fn clone(&self) -> Self {
        Self { pool: self.pool.clone(), idle: Mutex::default() }
    }
}

impl fmt::Debug for WorkerPool {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let threads = self.pool.as_ref().map_or(1, |pool| pool.current_num_threads());
        f.debug_struct("WorkerPool").field("threads", &threads).finish_non_exhaustive()
    }
}
