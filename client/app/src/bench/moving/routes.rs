//! Routes for moving things, where a body can walk.

use std::time::Duration;

use glam::{DAffine3, DVec3, Quat, Vec3};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_client_core::navigation::Navigation;
use sightline_world::{
    Mesh, Mover, World,
    geometry::Aabb,
    motion::{
        Body, Pose,
        trajectory::{Joint, KeyframeTrack, Playback, Trajectory},
    },
};

/// The length of a route, in metres.
const WAY_M: f32 = 1.5;
/// The distance around a route that must be hidden as well, in metres.
const AROUND_M: f32 = 0.5;
/// The number of random places tried for each hidden route.
const TRIES: usize = 40;

/// Finds routes where a body can walk.
pub(super) struct RoutePlanner(Navigation);

/// A route to and fro, for an eye.
#[derive(Clone, Copy, Debug)]
pub(super) struct Route {
    ends: [Vec3; 2],
    /// The duration of a round trip, in seconds.
    length_s: f32,
}

impl RoutePlanner {
    /// A planner for a world. `None` when nobody can walk there.
    pub(super) fn new(world: &World) -> Option<Self> {
        let navigation = Navigation::new(world);
        (!navigation.is_empty()).then_some(Self(navigation))
    }

    /// At most `count` routes all over the building, or only in cells that the first spawn point's
    /// cell cannot see.
    pub(super) fn ways(&self, world: &World, count: usize, hidden: bool) -> Vec<Route> {
        let random = &mut SmallRng::seed_from_u64(2);
        let mut ways = Vec::with_capacity(count);
        for _ in 0..count * TRIES {
            if ways.len() == count {
                break;
            }
            let Some(from) = self.0.random(random) else { break };
            let angle = random.random_range(0.0..std::f32::consts::TAU);
            let along = Vec3::new(angle.cos(), 0.0, angle.sin()) * WAY_M;
            let way = Route { ends: [from, from + along], length_s: random.random_range(4.0..9.0) };
            if !hidden || way.is_hidden(world) {
                ways.push(way);
            }
        }
        ways
    }
}

impl Route {
    /// Whether the first spawn point's cell sees none of the cells near the route.
    fn is_hidden(&self, world: &World) -> bool {
        let cells = &world.cells;
        let Some(eye) = world.spawns.first().and_then(|spawn| cells.at(spawn.eye)) else {
            return false;
        };
        let around = world.body.around_box(&Aabb::from_points(self.ends)).grown(AROUND_M);
        let mut met = Vec::new();
        cells.overlapping(&cells.axes.own_box(&around), &mut met);
        !met.is_empty() && met.iter().all(|cell| !cells.sees(eye, *cell))
    }

    /// The pose of an eye at a time.
    pub(super) fn pose(&self, time: Duration) -> Pose {
        let phase = 2.0 * (time.as_secs_f32() / self.length_s).fract();
        let [from, to] = self.ends;
        let velocity = (to - from) * (2.0 / self.length_s);
        let (share, side) = if phase < 1.0 { (phase, 1.0) } else { (2.0 - phase, -1.0) };
        Pose { eye: from.lerp(to, share), velocity: velocity * side, ..Pose::default() }
    }

    /// A chair of six boards that follows the route.
    pub(super) fn chair(&self, body: &Body) -> Option<Mover> {
        let mut mesh = Mesh::default();
        for [x, z] in [[0.0, 0.0], [0.36, 0.0], [0.0, 0.36], [0.36, 0.36]] {
            board(&mut mesh, Vec3::new(x, 0.0, z), Vec3::new(0.04, 0.42, 0.04));
        }
        board(&mut mesh, Vec3::new(0.0, 0.42, 0.0), Vec3::new(0.4, 0.03, 0.4));
        board(&mut mesh, Vec3::new(0.0, 0.45, 0.0), Vec3::new(0.4, 0.45, 0.03));
        let [from, to] = self.ends.map(|eye| eye - Vec3::Y * body.below_eye);
        let along = to - from;
        let mut joint = Joint::still(DAffine3::from_translation(DVec3::ZERO));
        let keys = vec![(0.0, from), (self.length_s * 0.5, to), (self.length_s, from)];
        joint.translation = KeyframeTrack::linear(keys);
        joint.rotation = KeyframeTrack::constant(Quat::from_rotation_y(along.x.atan2(along.z)));
        let colours = vec![[150, 100, 60]; mesh.triangles.len()];
        let trajectory = Trajectory::new(vec![joint], self.length_s, Playback::Loop).ok()?;
        Mover::new("chair".to_owned(), mesh, colours, trajectory)
    }
}

fn board(mesh: &mut Mesh, from: Vec3, size: Vec3) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(Aabb::new(from, from + size).corners());
    for side in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    {
        let [a, b, c, d] = side.map(|corner: u32| first + corner);
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
}
