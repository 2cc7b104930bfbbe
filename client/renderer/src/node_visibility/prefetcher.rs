//! Boxes of eyes, before the eye gets there.

use std::{
    collections::VecDeque,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
};

use glam::{IVec3, Vec3};
use sightline_world::{geometry::Aabb, octree::Octree};

use super::{NodeVisibility, VoxelOccluders};

/// The edge of a box, in metres.
const EDGE_M: f32 = 0.5;
/// How far ahead boxes are prepared, in seconds.
const AHEAD_S: f32 = 1.0;
/// On the way ahead so many places are looked at.
const STEPS: usize = 8;
/// So many boxes are kept: the bits of the octree's inner nodes each.
const KEPT_MAX: usize = 16;

/// The boxes that an eye will want, the one that it is in first.
pub fn boxes_ahead(eye: Vec3, velocity: Vec3) -> Vec<Aabb> {
    let mut places: Vec<IVec3> = Vec::new();
    for step in 0..=STEPS {
        let at = eye + velocity * (AHEAD_S * step as f32 / STEPS as f32);
        let place = (at / EDGE_M).floor().as_ivec3();
        if !places.contains(&place) {
            places.push(place);
        }
    }
    let bounds = |place: IVec3| {
        let min = place.as_vec3() * EDGE_M;
        Aabb::new(min, min + EDGE_M)
    };
    places.into_iter().map(bounds).collect()
}

/// Prepares boxes on a thread of its own, along an eye's motion. Nobody ever waits for it.
pub struct VisibilityPrefetcher {
    desk: Arc<Desk>,
    thread: Option<JoinHandle<()>>,
}

/// What the two threads share.
#[derive(Default)]
struct Desk {
    work: Mutex<Work>,
    called: Condvar,
}

#[derive(Default)]
struct Work {
    wanted: Vec<Aabb>,
    focal_min: f32,
    /// The newest last.
    done: VecDeque<Arc<NodeVisibility>>,
    is_over: bool,
}

impl VisibilityPrefetcher {
    /// For a building. It takes a look at each voxel first.
    ///
    /// # Errors
    /// When the building is too large, or there can be no thread.
    pub fn new(octree: &Octree) -> std::io::Result<Self> {
        let walls = VoxelOccluders::new(octree).map_err(std::io::Error::other)?;
        let desk = Arc::new(Desk::default());
        let shared = Arc::clone(&desk);
        let thread = thread::Builder::new().name("boxes ahead".into());
        let thread = thread.spawn(move || shared.prepare(&walls))?;
        Ok(Self { desk, thread: Some(thread) })
    }

    /// What is hidden from a box that an eye is in, if that is known yet; and asks for the boxes ahead. `focal_min` as
    /// for [`NodeVisibility::new`].
    pub fn at(&self, eye: Vec3, velocity: Vec3, focal_min: f32) -> Option<Arc<NodeVisibility>> {
        let mut work = self.desk.work();
        // In larger pictures what was found for smaller ones holds too.
        work.focal_min = focal_min;
        work.done.retain(|done| done.focal_min <= focal_min);
        let wanted = boxes_ahead(eye, velocity);
        let is_new = |eyes: &Aabb| work.done.iter().all(|done| done.eyes() != *eyes);
        let wanted: Vec<Aabb> = wanted.into_iter().filter(is_new).collect();
        if !wanted.is_empty() {
            self.desk.called.notify_one();
        }
        work.wanted = wanted;
        work.done.iter().find(|done| done.eyes().contains(eye)).cloned()
    }
}

impl Drop for VisibilityPrefetcher {
    fn drop(&mut self) {
        self.desk.work().is_over = true;
        self.desk.called.notify_one();
        if let Some(thread) = self.thread.take() {
            // It ends after the box that it is at; had it panicked, the next picture would be whole.
            let _ = thread.join();
        }
    }
}

impl Desk {
    fn work(&self) -> MutexGuard<'_, Work> {
        // Nothing that holds the lock leaves the work half done.
        self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn prepare(&self, walls: &VoxelOccluders) {
        let mut work = self.work();
        while !work.is_over {
            let Some(&eyes) = work.wanted.first() else {
                work = self.called.wait(work).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            let focal_min = work.focal_min;
            drop(work);
            let hidden = NodeVisibility::new(walls, eyes, focal_min);
            work = self.work();
            work.wanted.retain(|wanted| *wanted != eyes);
            if focal_min <= work.focal_min {
                work.done.push_back(Arc::new(hidden));
            }
            if work.done.len() > KEPT_MAX {
                work.done.pop_front();
            }
        }
    }
}
