//! What it saves to leave out what no eye in a box can see, and not to test what all see, and what it costs to find that
//! out.

use std::{io, sync::Arc};

use cpu_time::ProcessTime;
use serde::Serialize;
use sightline_world::{World, geometry::Aabb, motion::Pose};
use thiserror::Error;

use super::BenchOptions;
use sightline_renderer::{
    Camera, Frame, Renderer,
    node_visibility::{NodeVisibility, VoxelOccluders, boxes_ahead},
};

/// From one picture to the next, in seconds.
pub const FRAME_S: f64 = 1.0 / 60.0;
/// Boxes that are kept.
const KEPT_MAX: usize = 16;

/// The ways to draw a picture: the whole building; without what is hidden; and besides without tests of what every eye
/// sees whole.
const WAYS: usize = 3;

/// All that was measured. Times are of CPU, all threads together; means are over all pictures. What there is for each way
/// to draw is in this order: the whole building, without what is hidden, and besides without tests of what every eye
/// sees whole.
#[derive(Clone, Debug, Serialize)]
pub struct FuzzyRun {
    /// Rectangles of voxels that hide what is behind them.
    pub walls: usize,
    /// Milliseconds to find these, once.
    pub walls_ms: f64,
    /// Boxes that were prepared on the way.
    pub boxes: usize,
    /// Milliseconds for a box, the mean.
    pub box_ms: f64,
    /// How many a core prepares in a second.
    pub boxes_per_s: f64,
    /// The part of the nodes of 0.6 m or more that no eye in a box sees.
    pub hidden: f64,
    /// The part of them that every eye sees whole. What remains is neither.
    pub visible: f64,
    /// Pictures of the way.
    pub pictures: usize,
    /// The part of them whose box was there in time, when one thread prepares boxes beside those that draw.
    pub hit_rate: f64,
    /// Nodes that a picture looks at.
    pub nodes: [f64; WAYS],
    /// Nodes tested against the mask buffer.
    pub mask_tests: [f64; WAYS],
    /// Milliseconds for a picture.
    pub picture_ms: [f64; WAYS],
    /// How many times as long the whole building takes.
    pub gain: [f64; WAYS],
    /// The same when the boxes' preparation counts too.
    pub gain_all: [f64; WAYS],
}

/// Why nothing is measured.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FuzzyError {
    /// A picture differs.
    #[error("picture {0} is not the same without what is hidden")]
    Differs(usize),
    /// There are more walls than can be numbered.
    #[error(transparent)]
    VoxelOccluders(#[from] sightline_visibility::fuzzy::SurfaceError),
    /// There can be no such threads, or the system does not tell CPU time.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// Draws pictures a sixtieth of a second apart, each in all three ways, with the box that the eye is in, which
/// must show the same. `hear` is told the share done, from 0 to 1.
///
/// # Errors
/// See [`FuzzyError`].
pub fn fuzzy(
    world: &World,
    poses: &[Pose],
    options: &BenchOptions,
    hear: &mut dyn FnMut(f32),
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
        let hidden = worker.at((pose.eye, velocity), focal, i as f64 * FRAME_S)?;
        let is_same = pool.install(|| stage.draw(&camera, hidden))?;
        if !is_same {
            return Err(FuzzyError::Differs(i));
        }
        hear((i + 1) as f32 / poses.len() as f32);
    }
    Ok(stage.run(&worker, walls_ms, poses.len().max(1)))
}

fn since(start: ProcessTime) -> io::Result<f64> {
    Ok(ProcessTime::try_now()?.duration_since(start).as_secs_f64() * 1e3)
}

/// A thread beside those that draw, by the path's clock: what takes so long is there so much later.
struct Worker {
    walls: VoxelOccluders,
    /// When boxes are there.
    ready: Vec<(f64, BoxVisibility)>,
    free_at_s: f64,
    sum: Sum,
}

/// What is known of a box: what is hidden, and the same with what every eye sees whole.
type BoxVisibility = [Arc<NodeVisibility>; 2];

#[derive(Default)]
struct Sum {
    boxes: usize,
    ms: f64,
    hidden: f64,
    visible: f64,
}

impl Worker {
    fn at(
        &mut self,
        (eye, velocity): (glam::Vec3, glam::Vec3),
        focal: f32,
        now_s: f64,
    ) -> io::Result<Option<BoxVisibility>> {
        for eyes in boxes_ahead(eye, velocity) {
            let is_there = self.ready.iter().any(|(_, [known, _])| known.eyes() == eyes);
            if !is_there && self.free_at_s <= now_s {
                self.prepare(eyes, focal, now_s)?;
            }
        }
        let of = |(ready_s, [known, _]): &&(f64, BoxVisibility)| {
            *ready_s <= now_s && known.eyes().contains(eye)
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

    /// Draws all pictures; tells whether they are the same.
    fn draw(&mut self, camera: &Camera, known: Option<BoxVisibility>) -> io::Result<bool> {
        self.hits += usize::from(known.is_some());
        let mut best = [f64::INFINITY; WAYS];
        for turn in 0..WAYS * self.repeats {
            // In turn, and each as often first as last.
            let way = (turn + turn / WAYS) % WAYS;
            let hidden = |known: &BoxVisibility| (way > 0).then(|| Arc::clone(&known[way - 1]));
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
    use super::*;
    use crate::camera_path::CameraPath;
    use sightline_fixtures::voxel_floor::world;

    #[test]
    fn a_walk_is_the_same_with_less() {
        let world = world(&[([31, 1, 8], [33, 30, 64], 0), ([40, 1, 8], [60, 9, 40], 0)]);
        let path = CameraPath::through(&world);
        let poses: Vec<Pose> = (0..90).map(|i| path.at(f64::from(i) * FRAME_S)).collect();
        let options = BenchOptions { size: (64, 48), threads: 2, repeats: 2 };
        let run = fuzzy(&world, &poses, &options, &mut |_| {}).unwrap();
        assert!(run.boxes >= 1 && run.hit_rate > 0.5 && run.hidden > 0.0, "{run:?}");
        assert!(run.visible > 0.0 && run.hidden + run.visible <= 1.0, "{run:?}");
        assert!(run.nodes[1] <= run.nodes[0] && run.mask_tests[2] <= run.mask_tests[1], "{run:?}");
        assert!(run.gain_all[1] < run.gain[1] && run.gain_all[0] == 1.0, "{run:?}");
    }
}
