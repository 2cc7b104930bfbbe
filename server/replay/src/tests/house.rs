//! Random buildings, compiled like any other, and people who walk about in them.

use std::{collections::BTreeMap, fmt::Write as _, ops::ControlFlow, sync::Arc};

use glam::Vec3;
use rand::{Rng, rngs::SmallRng};
use sightline_cli::trace::Trace;
use sightline_compiler::{CompileOptions, LightMethod, compile, model::Model};
use sightline_fixtures::boxes::box_triangles;
use sightline_oracle::Oracle;
use sightline_world::{Spawn, World, geometry::Aabb};

/// A square building: rooms in rows and columns, most inner walls with a door, solid outer walls,
/// a floor and a ceiling.
pub(super) struct House {
    pub(super) world: Arc<World>,
    /// The number of rooms along each side.
    rooms: usize,
}

const ROOM_M: f32 = 6.0;
const DOOR_M: f32 = 1.2;

impl House {
    pub(super) fn new(rng: &mut SmallRng, rooms: usize) -> Self {
        let side = rooms as f32 * ROOM_M;
        let slab = |low: f32, high: f32| {
            let out = Vec3::new(0.3, 0.0, 0.3);
            Aabb::new(Vec3::Y * low - out, Vec3::new(side, high, side) + out)
        };
        let mut boxes = vec![slab(-0.3, 0.0), slab(2.6, 2.9)];
        for line in 0..=rooms {
            let at = line as f32 * ROOM_M;
            for room in 0..rooms {
                let (from, to) = (room as f32 * ROOM_M, (room + 1) as f32 * ROOM_M);
                let inner = line > 0 && line < rooms;
                for axis in [0, 2] {
                    let door = from + rng.random_range(0.5..ROOM_M - 0.5 - DOOR_M);
                    let gaps = if inner && rng.random_bool(0.7) {
                        vec![(from, door), (door + DOOR_M, to)]
                    } else {
                        vec![(from, to)]
                    };
                    boxes.extend(gaps.into_iter().map(|(a, b)| wall(axis, at, a, b)));
                }
            }
        }
        let opaque: Vec<[Vec3; 3]> = boxes.iter().flat_map(box_triangles).collect();
        let model = Model {
            spawns: vec![Spawn { eye: Vec3::new(3.0, 1.6, 3.0), yaw: 0.0 }],
            speed_max: 2.0,
            ..Model::of_triangles("house", opaque, [200; 3])
        };
        let options = CompileOptions {
            voxel: Some(0.5),
            cell: Some(3.0),
            light: LightMethod::None,
            ..Default::default()
        };
        let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(())).unwrap();
        Self { world: Arc::new(world), rooms }
    }

    /// A trace of people who walk about, and stop where they would run into something.
    pub(super) fn trace(&self, rng: &mut SmallRng, people: u32, seconds: u32) -> Trace {
        let sight = Oracle::new(&self.world.mesh);
        let mut rows = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n".to_owned();
        let mut walkers: BTreeMap<u32, (Vec3, Vec3)> = (0..people)
            .map(|id| {
                let mut room = || (rng.random_range(0..self.rooms) as f32 + 0.5) * ROOM_M;
                (id, (Vec3::new(room(), 1.6, room()), Vec3::ZERO))
            })
            .collect();
        for k in 0..seconds * 10 {
            for (id, (eye, velocity)) in &mut walkers {
                let room = *velocity * 0.4;
                let may_go_on = sight.between(*eye, *eye + room) && !rng.random_bool(0.05);
                if !may_go_on {
                    // It stops; if it stands already, it may set off.
                    let angle = rng.random_range(0.0..std::f32::consts::TAU);
                    let is_start = *velocity == Vec3::ZERO && rng.random_bool(0.7);
                    let speed = if is_start { 1.3 } else { 0.0 };
                    *velocity = Vec3::new(angle.cos(), 0.0, angle.sin()) * speed;
                    if !sight.between(*eye, *eye + *velocity * 0.4) {
                        *velocity = Vec3::ZERO;
                    }
                }
                let (at, v) = (*eye, *velocity);
                let _ = write!(rows, "{},{id},{},{},{},0,0,", k * 100, at.x, at.y, at.z);
                let _ = writeln!(rows, "{},{},{}", v.x, v.y, v.z);
                *eye += v * 0.1;
            }
        }
        Trace::read(rows.as_bytes()).unwrap()
    }
}

/// A wall 0.2 m thick that stands across an axis at a place, and spans a range along the other
/// level axis.
fn wall(axis: usize, at: f32, from: f32, to: f32) -> Aabb {
    let (mut min, mut max) = (Vec3::ZERO, Vec3::Y * 2.6);
    (min[axis], max[axis]) = (at - 0.1, at + 0.1);
    (min[2 - axis], max[2 - axis]) = (from, to);
    Aabb::new(min, max)
}
