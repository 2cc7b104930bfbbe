//! What is saved by leaving out the nodes that no eye in a box can see, and by not testing those
//! that every eye sees; and what it costs to find them.

use std::{io, sync::Arc};

use cpu_time::ProcessTime;
use serde::Serialize;
use sightline_renderer::{
    Camera, Frame, Renderer,
    node_visibility::{NodeVisibility, VoxelOccluders, boxes_ahead},
};
use sightline_world::{World, geometry::Aabb, motion::Pose};
use thiserror::Error;

use super::BenchOptions;

/// The time between two pictures, in seconds.
pub const FRAME_S: f64 = 1.0 / 60.0;
/// The largest number of prepared boxes that are kept.
const KEPT_MAX: usize = 16;

/// The number of ways to draw a picture: everything, without hidden nodes, and also without tests
/// of the nodes that every eye sees whole.
const WAYS: usize = 3;

/// All figures. Times are CPU time of all threads. Means are over all pictures. Arrays hold one
/// figure for each way to draw: everything, without hidden nodes, and also without tests of the
/// nodes that every eye sees whole.
#[derive(Clone, Debug, Serialize)]
pub struct FuzzyRun {
    /// The number of occluders: rectangles of voxels.
    pub walls: usize,
    /// Milliseconds to find the occluders, once.
    pub walls_ms: f64,
    /// The number of boxes prepared along the path.
    pub boxes: usize,
    /// The mean time to prepare a box, in milliseconds.
    pub box_ms: f64,
    /// The number of boxes that one core prepares in a second.
    pub boxes_per_s: f64,
    /// The share of nodes of 0.6 m or more that no eye in a box sees, from 0 to 1.
    pub hidden: f64,
    /// The share of these nodes that every eye in a box sees whole. The rest is neither.
    pub visible: f64,
    /// The number of pictures.
    pub pictures: usize,
    /// The share of pictures whose box was ready in time, when a separate thread prepares boxes.
    pub hit_rate: f64,
    /// Nodes visited per picture.
    pub nodes: [f64; WAYS],
    /// Nodes tested against the mask buffer per picture.
    pub mask_tests: [f64; WAYS],
    /// Milliseconds per picture.
    pub picture_ms: [f64; WAYS],
    /// The time of drawing everything, divided by the time of this way.
    pub gain: [f64; WAYS],
    /// The same ratio with the time of preparing boxes included.
    pub gain_all: [f64; WAYS],
}

/// Why the measurement fails.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FuzzyError {
    /// The pictures of two ways differ.
    #[error("picture {0} differs without the hidden nodes")]
    Differs(usize),
    /// There are more occluders than can be numbered.
    #[error(transparent)]
    VoxelOccluders(#[from] sightline_visibility::fuzzy::SurfaceError),
    /// The threads cannot be started, or the system does not report CPU time.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// Draws pictures a sixtieth of a second apart, each in all three ways, with the box around the
/// eye. The three pictures must be the same. Calls `progress` with the share done, from 0 to 1.
///
/// # Errors
/// See [`FuzzyError`].
pub fn fuzzy(
    world: &World,
    poses: &[Pose],
    options: &BenchOptions,
    progress: &mut dyn FnMut(f32),
) -> Result<FuzzyRun, FuzzyError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads.max(1)).build();
    let pool = pool.map_err(io::Error::other)?;
    let start = ProcessTime::try_now()?;
    let walls = VoxelOccluders::new(&world.octree)?;
    let walls_ms = since(start)?;
    let mut worker = Worker { walls, ready: Vec::new(), free_at_s: 0.0, sum: Sum::default() };
    let mut stage = FuzzyTimer::new(world, options);
    for (i, pose) in poses.iter().enumerate() {
        let camera = Camera::at(pose);
        let velocity = poses.get(i + 1).map_or(pose.eye, |next| next.eye) - pose.eye;
        let velocity = velocity / FRAME_S as f32;
        let focal = camera.focal(options.size.1);
        let hidden = worker.at(&Pose { velocity, ..*pose }, focal, i as f64 * FRAME_S)?;
        let is_same = pool.install(|| stage.draw(&camera, hidden))?;
        if !is_same {
            return Err(FuzzyError::Differs(i));
        }
        progress((i + 1) as f32 / poses.len() as f32);
    }
    Ok(stage.run(&worker, walls_ms, poses.len().max(1)))
}

fn since(start: ProcessTime) -> io::Result<f64> {
    Ok(ProcessTime::try_now()?.duration_since(start).as_secs_f64() * 1e3)
}

/// Simulates a thread that prepares boxes beside the drawing threads, in the path's time.
struct Worker {
    walls: VoxelOccluders,
    /// The prepared boxes, and when each is ready, in seconds.
    ready: Vec<(f64, PreparedBox)>,
    free_at_s: f64,
    sum: Sum,
}

/// The nodes hidden from a box; and the same with those that every eye sees whole.
type PreparedBox = [Arc<NodeVisibility>; 2];

#[derive(Default)]
struct Sum {
    boxes: usize,
    ms: f64,
    hidden: f64,
    visible: f64,
}

impl Worker {
    fn at(&mut self, pose: &Pose, focal: f32, now_s: f64) -> io::Result<Option<PreparedBox>> {
        for eyes in boxes_ahead(pose.eye, pose.velocity) {
            let is_there = self.ready.iter().any(|(_, [known, _])| known.eyes() == eyes);
            if !is_there && self.free_at_s <= now_s {
                self.prepare(eyes, focal, now_s)?;
            }
        }
        let of = |(ready_s, [known, _]): &&(f64, PreparedBox)| {
            *ready_s <= now_s && known.eyes().contains(pose.eye)
        };
        Ok(self.ready.iter().find(of).map(|(_, known)| known.clone()))
    }

    fn prepare(&mut self, eyes: Aabb, focal: f32, now_s: f64) -> io::Result<()> {
        let start = ProcessTime::try_now()?;
        let hidden = NodeVisibility::new(&self.walls, eyes, focal);
        let ms = since(start)?;
        let counts = hidden.counts();
        self.sum.boxes += 1;
        self.sum.ms += ms;
        let share = |count: usize| count as f64 / counts.all.max(1) as f64;
        self.sum.hidden += share(counts.hidden);
        self.sum.visible += share(counts.visible);
        assert!(counts.hidden + counts.visible <= counts.all, "a node is hidden or visible");
        self.free_at_s = now_s + ms * 1e-3;
        let known = [hidden.clone().without_unoccluded(), hidden].map(Arc::new);
        self.ready.push((self.free_at_s, known));
        if self.ready.len() > KEPT_MAX {
            self.ready.remove(0);
        }
        Ok(())
    }
}

struct FuzzyTimer<'a> {
    world: &'a World,
    repeats: usize,
    renderer: Renderer,
    frames: [Frame; WAYS],
    hits: usize,
    nodes: [f64; WAYS],
    mask_tests: [f64; WAYS],
    ms: [f64; WAYS],
}

impl<'a> FuzzyTimer<'a> {
    fn new(world: &'a World, options: &BenchOptions) -> Self {
        let (width, height) = options.size;
        Self {
            world,
            repeats: options.repeats.max(1),
            renderer: Renderer::default(),
            frames: [(); WAYS].map(|()| Frame::new(width, height)),
            hits: 0,
            nodes: [0.0; WAYS],
            mask_tests: [0.0; WAYS],
            ms: [0.0; WAYS],
        }
    }

    /// Draws a picture in all ways. Returns whether the three are the same.
    fn draw(&mut self, camera: &Camera, known: Option<PreparedBox>) -> io::Result<bool> {
        self.hits += usize::from(known.is_some());
        let mut best = [f64::INFINITY; WAYS];
        for turn in 0..WAYS * self.repeats {
            // The ways take turns, and each is first as often as last.
            let way = (turn + turn / WAYS) % WAYS;
            let hidden = |known: &PreparedBox| (way > 0).then(|| Arc::clone(&known[way - 1]));
            self.renderer.node_visibility = known.as_ref().and_then(hidden);
            let start = ProcessTime::try_now()?;
            self.renderer.draw(&self.world.octree, camera, &mut self.frames[way]);
            best[way] = best[way].min(since(start)?);
            if turn < WAYS {
                let counters = self.renderer.counters();
                self.nodes[way] += counters.nodes as f64;
                self.mask_tests[way] += counters.mask_tests as f64;
            }
        }
        (0..WAYS).for_each(|way| self.ms[way] += best[way]);
        Ok(self.frames[1..].iter().all(|frame| *frame == self.frames[0]))
    }

    fn run(&self, worker: &Worker, walls_ms: f64, pictures: usize) -> FuzzyRun {
        let Sum { boxes, ms, hidden, visible } = worker.sum;
        let box_ms = ms / boxes.max(1) as f64;
        let mean = |sums: [f64; WAYS]| sums.map(|sum| sum / pictures as f64);
        let [whole, less, untested] = self.ms;
        FuzzyRun {
            walls: worker.walls.len(),
            walls_ms,
            boxes,
            box_ms,
            boxes_per_s: if box_ms > 0.0 { 1e3 / box_ms } else { 0.0 },
            hidden: hidden / boxes.max(1) as f64,
            visible: visible / boxes.max(1) as f64,
            pictures,
            hit_rate: self.hits as f64 / pictures as f64,
            nodes: mean(self.nodes),
            mask_tests: mean(self.mask_tests),
            picture_ms: mean(self.ms),
            gain: self.ms.map(|of| whole / of),
            gain_all: [whole, less + ms, untested + ms].map(|all| whole / all),
        }
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor::world;

    use super::*;
    use crate::camera_path::CameraPath;

    #[test]
    fn leaving_out_hidden_nodes_changes_no_picture() {
        let world = world(&[([31, 1, 8], [33, 30, 64], 0), ([40, 1, 8], [60, 9, 40], 0)]);
        let path = CameraPath::through(&world);
        let poses: Vec<Pose> = (0..90).map(|i| path.at(f64::from(i) * FRAME_S)).collect();
        let options = BenchOptions { size: (64, 48), threads: 2, repeats: 2, mode: None };
        let run = fuzzy(&world, &poses, &options, &mut |_| {}).unwrap();
        assert!(run.boxes >= 1 && run.hit_rate > 0.5 && run.hidden > 0.0, "{run:?}");
        assert!(run.visible > 0.0 && run.hidden + run.visible <= 1.0, "{run:?}");
        assert!(run.nodes[1] <= run.nodes[0] && run.mask_tests[2] <= run.mask_tests[1], "{run:?}");
        assert!(run.gain_all[1] < run.gain[1] && run.gain_all[0] == 1.0, "{run:?}");
    }
}
