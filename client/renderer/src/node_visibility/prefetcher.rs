//! Prepares node visibility before the eye gets there, on a thread of its own.

use std::{
    collections::VecDeque,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
};

use glam::Vec3;
use sightline_world::{geometry::Aabb, octree::Octree};

use super::{NodeVisibility, VoxelOccluders, boxes_ahead};

/// How many results are kept. Each takes two bits for every inner node of the octree.
const KEPT_MAX: usize = 16;

/// Prepares the node visibility of viewpoint boxes along an eye's motion, on a thread of its own.
/// No caller ever waits for it.
pub struct VisibilityPrefetcher {
    shared: Arc<SharedJobs>,
    thread: Option<JoinHandle<()>>,
}

/// What the two threads share.
#[derive(Default)]
struct SharedJobs {
    jobs: Mutex<Jobs>,
    changed: Condvar,
}

#[derive(Default)]
struct Jobs {
    wanted: Vec<Aabb>,
    focal_min: f32,
    /// Results, the newest last.
    done: VecDeque<Arc<NodeVisibility>>,
    is_over: bool,
}

impl VisibilityPrefetcher {
    /// A prefetcher for a building. Finding the building's occluders comes first and visits every
    /// voxel.
    ///
    /// # Errors
    /// When the building is too large, or no thread can be started.
    pub fn new(octree: &Octree) -> std::io::Result<Self> {
        let occluders = VoxelOccluders::new(octree).map_err(std::io::Error::other)?;
        let shared = Arc::new(SharedJobs::default());
        let worker = Arc::clone(&shared);
        let thread = thread::Builder::new().name("node visibility".into());
        let thread = thread.spawn(move || worker.prepare(&occluders))?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// The node visibility of the viewpoint box that an eye is in, if it is ready. Also requests
    /// the boxes ahead of the eye. `focal_min` is that of [`NodeVisibility::new`].
    pub fn at(&self, eye: Vec3, velocity: Vec3, focal_min: f32) -> Option<Arc<NodeVisibility>> {
        let mut jobs = self.shared.jobs();
        // What holds for smaller pictures holds for larger ones too.
        jobs.focal_min = focal_min;
        jobs.done.retain(|done| done.focal_min <= focal_min);
        let is_new = |eyes: &Aabb| jobs.done.iter().all(|done| done.eyes() != *eyes);
        let wanted: Vec<Aabb> = boxes_ahead(eye, velocity).into_iter().filter(is_new).collect();
        if !wanted.is_empty() {
            self.shared.changed.notify_one();
        }
        jobs.wanted = wanted;
        jobs.done.iter().find(|done| done.eyes().contains(eye)).cloned()
    }
}

impl Drop for VisibilityPrefetcher {
    fn drop(&mut self) {
        self.shared.jobs().is_over = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // The thread ends after its current box. Had it panicked, pictures would only have
            // been drawn without node visibility.
            let _ = thread.join();
        }
    }
}

impl SharedJobs {
    fn jobs(&self) -> MutexGuard<'_, Jobs> {
        // No holder of the lock leaves the jobs half changed.
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn prepare(&self, occluders: &VoxelOccluders) {
        let mut jobs = self.jobs();
        while !jobs.is_over {
            let Some(&eyes) = jobs.wanted.first() else {
                jobs = self.changed.wait(jobs).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            let focal_min = jobs.focal_min;
            drop(jobs);
            let visibility = NodeVisibility::new(occluders, eyes, focal_min);
            jobs = self.jobs();
            jobs.wanted.retain(|wanted| *wanted != eyes);
            if focal_min <= jobs.focal_min {
                jobs.done.push_back(Arc::new(visibility));
            }
            if jobs.done.len() > KEPT_MAX {
                jobs.done.pop_front();
            }
            debug_assert!(jobs.done.len() <= KEPT_MAX, "{} results", jobs.done.len());
        }
    }
}
