//! What moves by itself, and is drawn at a cost that follows what of it is in view.
//!
//! Movers sit in an octree of their own ([`Occupants`]) and are drawn after the building, whose depths
//! decide. In the order of Sudarsky and Gotsman (*Output-Sensitive Visibility Algorithms for Dynamic
//! Scenes*, sections 2.1 and 3.2), each way does less than the one before:
//!
//! * [`Culling::Plain`]: every mover is placed and drawn, in each picture.
//! * [`Culling::Hierarchical`]: every mover is placed in the octree; its nodes are tested against the Z
//!   pyramid, front to back, and what is in nodes that nothing of can be seen is not drawn.
//! * [`Culling::Temporal`]: a mover that was not seen is replaced by a temporal bounding volume, the box
//!   that it sweeps until the volume expires. It is not looked at again before that, or
//!   before the volume comes into view. Volumes last longer after they expired, and shorter after
//!   they were seen.
//!
//! All three draw the same pixels. Movers do not hide each other's nodes: walls do most of that.

use std::{collections::BTreeSet, time::Duration};

use sightline_shared::{
    geometry::Aabb,
    motion::trajectory::Course,
    octree::{
        Octree,
        occupants::{Met, OccupantId, Occupants},
    },
    world::Mover,
};

use super::{
    Camera, Frame, movers,
    pyramid::{Pyramid, Span},
    view::{NEAR, View},
};

/// The edge of the smallest nodes, in metres: about what stands in a room.
const NODE_M: f32 = 1.0;
/// What a volume is made to last at first.
const VALIDITY_FIRST: Duration = Duration::from_secs(1);
/// Shorter ones are not worth it.
const VALIDITY_MIN: Duration = Duration::from_millis(50);
const VALIDITY_MAX: Duration = Duration::from_secs(60);
/// Boxes are taken to be so much larger on each side, for what rounding does, as a part of their
/// distance from the origin.
const ROUNDING: f32 = 1e-5;

/// What is done about movers that cannot be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Culling {
    /// Nothing.
    Plain,
    /// They are not drawn.
    Hierarchical,
    /// They are not even looked at.
    #[default]
    Temporal,
}

/// What the last picture took, in counts that do not depend on the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Effort {
    /// Movers that were drawn.
    pub drawn: usize,
    /// Movers whose place was worked out.
    pub placed: usize,
    /// Boxes, of nodes and movers, that were tested against the picture.
    pub tested: usize,
    /// Volumes that expired.
    pub expired: usize,
    /// Volumes that came into view.
    pub revealed: usize,
}

/// The movers of a world, from one picture to the next.
#[derive(Clone, Debug)]
pub struct Moving {
    culling: Culling,
    /// By number: nobody ever leaves.
    occupants: Occupants,
    things: Vec<Thing>,
    /// By number, those that are placed in each picture.
    tracked: BTreeSet<u32>,
    expiries: BTreeSet<(Duration, u32)>,
    /// Of the last picture.
    now: Duration,
    pyramid: Pyramid,
    effort: Effort,
}

/// What is known of a mover.
#[derive(Clone, Debug)]
struct Thing {
    /// How long its volume was made to last.
    validity: Duration,
    /// When the volume expires that stands for it, if one does.
    until: Option<Duration>,
}

/// What a picture hides.
struct Sight<'a> {
    view: View,
    frame: &'a Frame,
    pyramid: &'a mut Pyramid,
    tested: usize,
}

impl Moving {
    /// Movers in a building. Those whose box is nowhere are never drawn.
    pub fn new(octree: &Octree, movers: &[Mover], culling: Culling) -> Self {
        let depth = (octree.edge / NODE_M).log2().ceil().clamp(1.0, 12.0) as u8;
        let mut moving = Self {
            culling,
            occupants: Occupants::new(octree.origin, octree.edge, depth),
            things: Vec::new(),
            tracked: BTreeSet::new(),
            expiries: BTreeSet::new(),
            now: Duration::ZERO,
            pyramid: Pyramid::default(),
            effort: Effort::default(),
        };
        for mover in movers {
            // One without a sane box gets a number all the same, and is met by nobody.
            let nowhere = [Aabb::around(octree.origin, 0.0)];
            let bounds = [placed(mover, Duration::ZERO, Duration::ZERO)];
            let occupants = &mut moving.occupants;
            if occupants.insert(&bounds).or_else(|_| occupants.insert(&nowhere)).is_err() {
                break;
            }
            moving.tracked.insert(moving.things.len() as u32);
            moving.things.push(Thing { validity: VALIDITY_FIRST, until: None });
        }
        moving
    }

    /// Draws those of the movers, which are those that it was made for, that are in view at a time of
    /// the server's clock, into a frame that shows the building from the same camera.
    pub fn draw(&mut self, frame: &mut Frame, camera: &Camera, movers: &[Mover], now: Duration) {
        self.effort = Effort::default();
        let count = self.things.len().min(movers.len());
        if frame.width() == 0 || frame.height() == 0 || count == 0 {
            return;
        }
        if self.culling == Culling::Plain {
            self.effort = Effort { drawn: count, placed: count, ..self.effort };
            movers::draw(frame, camera, movers, now);
            return;
        }
        self.wake(now);
        let tracked: Vec<u32> = self.tracked.iter().copied().collect();
        for number in tracked.iter().map(|number| *number as usize).filter(|at| *at < count) {
            self.place(number, placed(&movers[number], now, now));
        }
        let seen = self.find(frame, camera, movers, now);
        let those: Vec<&Mover> = seen.iter().map(|number| &movers[*number as usize]).collect();
        self.effort.drawn = those.len();
        movers::draw_those(frame, camera, &those, now);
    }

    /// What the last picture took.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Tracks those again whose volumes have expired; all when time went backwards.
    fn wake(&mut self, now: Duration) {
        let is_back = now < std::mem::replace(&mut self.now, now);
        while let Some(&(until, number)) = self.expiries.first()
            && (is_back || until < now)
        {
            self.expiries.pop_first();
            self.effort.expired += 1;
            let thing = &mut self.things[number as usize];
            thing.validity = (thing.validity * 3 / 2).min(VALIDITY_MAX);
            thing.until = None;
            self.tracked.insert(number);
        }
    }

    fn place(&mut self, number: usize, bounds: Aabb) {
        self.effort.placed += 1;
        // What has no sane box stays where it was.
        let _ = self.occupants.move_to(OccupantId(number as u32), &[bounds]);
    }

    /// Finds whom to draw; and gives those that are not seen a volume to be replaced by.
    fn find(
        &mut self,
        frame: &Frame,
        camera: &Camera,
        movers: &[Mover],
        now: Duration,
    ) -> Vec<u32> {
        self.pyramid.begin([frame.width(), frame.height()]);
        let mut pyramid = std::mem::take(&mut self.pyramid);
        let view = View::new(camera, frame.width(), frame.height());
        let mut sight = Sight { view, frame, pyramid: &mut pyramid, tested: 0 };
        let mut met = Vec::new();
        self.occupants.front_to_back(camera.eye, |what| match what {
            Met::Node(bounds) => sight.shows(&bounds),
            Met::Occupant(id) => {
                met.push(id);
                true
            }
        });
        met.retain(|id| self.occupants.primitives(*id).any(|bounds| sight.shows(bounds)));
        let mut seen = BTreeSet::new();
        for number in met.into_iter().map(|id| id.0).filter(|at| (*at as usize) < movers.len()) {
            let is_seen = self.things[number as usize].until.is_none()
                || self.reveal(&mut sight, number, &movers[number as usize], now);
            if is_seen {
                seen.insert(number);
            }
        }
        if self.culling == Culling::Temporal {
            let unseen: Vec<u32> = self.tracked.difference(&seen).copied().collect();
            for number in unseen {
                if let Some(mover) = movers.get(number as usize) {
                    self.hide(&mut sight, number, mover, now);
                }
            }
        }
        self.effort.tested = sight.tested;
        self.pyramid = pyramid;
        seen.into_iter().collect()
    }

    /// Looks at a mover whose volume has come into view: whether it is in view itself. Otherwise it
    /// gets a shorter one.
    fn reveal(&mut self, sight: &mut Sight<'_>, number: u32, mover: &Mover, now: Duration) -> bool {
        self.effort.revealed += 1;
        let thing = &mut self.things[number as usize];
        thing.validity = (thing.validity / 2).max(VALIDITY_MIN);
        if let Some(until) = thing.until.take() {
            self.expiries.remove(&(until, number));
        }
        self.tracked.insert(number);
        let bounds = placed(mover, now, now);
        self.place(number as usize, bounds);
        sight.shows(&bounds)
    }

    /// Lets a volume that is not in view stand for a mover, if there is one that is worth it.
    fn hide(&mut self, sight: &mut Sight<'_>, number: u32, mover: &Mover, now: Duration) {
        let mut validity = self.things[number as usize].validity;
        while validity >= VALIDITY_MIN {
            let until = now.saturating_add(validity);
            let volume = placed(mover, now, until);
            if !sight.shows(&volume) {
                self.place(number as usize, volume);
                self.things[number as usize] = Thing { validity, until: Some(until) };
                self.tracked.remove(&number);
                self.expiries.insert((until, number));
                return;
            }
            validity /= 2;
        }
        self.things[number as usize].validity = VALIDITY_MIN;
    }
}

impl Sight<'_> {
    /// Whether some of a box may be in the picture.
    fn shows(&mut self, bounds: &Aabb) -> bool {
        self.tested += 1;
        let (centre, half) = (bounds.centre(), bounds.size() * 0.5);
        let (columns, rows) = self.view.bounds(centre, half);
        // A pixel more on each side, for what rounding does.
        let span = |[low, high]: [f32; 2], side: usize| -> Option<Span> {
            let first = (low - 1.0).floor().max(0.0) as usize;
            let after = ((high + 2.0).ceil().max(0.0) as usize).min(side);
            (low <= high && first < after).then_some([first, after])
        };
        let spans = span(columns, self.frame.width()).zip(span(rows, self.frame.height()));
        let Some((columns, rows)) = spans else { return false };
        let depths = bounds.corners().map(|corner| self.view.project(corner).z);
        let nearest = depths.into_iter().fold(f32::INFINITY, f32::min) * (1.0 - ROUNDING);
        nearest < NEAR || !self.pyramid.hides(&self.frame.depth, columns, rows, nearest)
    }
}

/// The box that a mover stays in from one time to another. One that something sets off rests.
fn placed(mover: &Mover, from: Duration, until: Duration) -> Aabb {
    let bounds = match mover.trajectory.course() {
        Course::Triggered => mover.swept(Duration::ZERO, Duration::ZERO),
        _ => mover.swept(from, until),
    };
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    bounds.grown(ROUNDING * farthest.min(f32::MAX))
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3, Vec3};
    use rand::{Rng, SeedableRng, rngs::SmallRng};
    use sightline_shared::{
        motion::trajectory::{Joint, Track, Trajectory},
        world::Mesh,
    };

    use super::*;

    const SIZE: [usize; 2] = [160, 120];

    /// A tent that goes back and forth, stands still, or goes away for good.
    fn mover(random: &mut SmallRng) -> Mover {
        let mut within = |low: f32, high: f32| random.random_range(low..high);
        let at = Vec3::new(within(1.0, 31.0), within(0.5, 4.0), within(1.0, 31.0));
        let mut point = |at: Vec3, size: f32| {
            at + Vec3::new(within(-size, size), within(-size, size), within(-size, size))
        };
        let positions: Vec<Vec3> = (0..4).map(|_| point(Vec3::ZERO, 0.6)).collect();
        let (there, back) = (point(at, 4.0), point(at, 0.1));
        let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 2, 3]];
        let mut joint = Joint::still(DAffine3::from_translation(DVec3::ZERO));
        let length_s = within(1.0, 8.0);
        let keys = vec![(0.0, at), (length_s * 0.5, there), (length_s, back)];
        joint.translation = Track::linear(keys);
        let course = match random.random_range(0..4) {
            0 => Course::Once,
            1 => Course::Triggered,
            _ => Course::Loop,
        };
        let trajectory = Trajectory::new(vec![joint], length_s, course).unwrap();
        let colours = (0..3).map(|i| [200, 40 * i, random.random()]).collect();
        Mover::new("tent".into(), Mesh { positions, triangles }, colours, trajectory).unwrap()
    }

    /// A picture with walls at all distances in it.
    fn building(random: &mut SmallRng) -> Frame {
        let mut frame = Frame::new(SIZE[0], SIZE[1]);
        frame.depth.fill(random.random_range(3.0..12.0));
        for _ in 0..random.random_range(0..6) {
            let [left, right] = [0, 1].map(|_| random.random_range(0..SIZE[0]));
            let [top, bottom] = [0, 1].map(|_| random.random_range(0..SIZE[1]));
            let depth = if random.random_bool(0.2) {
                f32::INFINITY
            } else {
                random.random_range(0.5..20.0)
            };
            for y in top.min(bottom)..=top.max(bottom) {
                frame.depth[y * SIZE[0] + left.min(right)..=y * SIZE[0] + left.max(right)]
                    .fill(depth);
            }
        }
        frame
    }

    #[test]
    fn all_ways_draw_the_same_pixels() {
        let (mut saved, mut plain_placed, mut drawn) = (0, 0, 0);
        for seed in 0..40 {
            let random = &mut SmallRng::seed_from_u64(seed);
            let movers: Vec<Mover> = (0..60).map(|_| mover(random)).collect();
            let octree = Octree::empty(Vec3::ZERO, 0.5, 6);
            let mut ways = [Culling::Plain, Culling::Hierarchical, Culling::Temporal]
                .map(|culling| Moving::new(&octree, &movers, culling));
            let mut now = Duration::ZERO;
            let mut camera = Camera::looking_at(Vec3::new(16.0, 2.0, 16.0), Vec3::ZERO);
            for _ in 0..60 {
                // Now and then time leaps, either way.
                now = match random.random_range(0..40) {
                    0 => now / 2,
                    1 => now + Duration::from_secs(20),
                    _ => now + Duration::from_millis(random.random_range(1..60)),
                };
                camera.yaw += random.random_range(-0.1..0.1);
                camera.eye += Vec3::new(random.random_range(-0.2..0.2), 0.0, 0.1);
                let empty = building(random);
                let pictures = [0, 1, 2].map(|way: usize| {
                    let mut frame = empty.clone();
                    ways[way].draw(&mut frame, &camera, &movers, now);
                    frame
                });
                assert!(pictures[0] == pictures[1], "by the pyramid, seed {seed} at {now:?}");
                assert!(pictures[0] == pictures[2], "by volumes, seed {seed} at {now:?}");
                plain_placed += ways[1].effort().placed;
                saved += ways[1].effort().placed.saturating_sub(ways[2].effort().placed);
                drawn += usize::from(pictures[0] != empty);
            }
        }
        assert!(drawn > 1_000, "{drawn} pictures show anything");
        assert!(2 * saved > plain_placed, "{saved} of {plain_placed} were left alone");
    }

    #[test]
    fn nobody_and_nothing_is_drawn_without_harm() {
        let octree = Octree::empty(Vec3::ZERO, 1.0, 2);
        let mut moving = Moving::new(&octree, &[], Culling::Temporal);
        let camera = Camera::looking_at(Vec3::ONE, Vec3::ZERO);
        moving.draw(&mut Frame::new(4, 4), &camera, &[], Duration::MAX);
        let random = &mut SmallRng::seed_from_u64(1);
        let movers = [mover(random), mover(random)];
        let mut moving = Moving::new(&octree, &movers, Culling::Temporal);
        moving.draw(&mut Frame::new(0, 9), &camera, &movers, Duration::ZERO);
        moving.draw(&mut Frame::new(9, 9), &camera, &movers[..1], Duration::MAX);
    }
}
