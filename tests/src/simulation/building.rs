//! Small random buildings: rooms in a grid, with doors, windows, holes in floors, and furniture.

use std::{f64::consts::TAU, ops::ControlFlow, sync::Arc};

use glam::{DMat3, DVec3, Vec2, Vec3, Vec3Swizzles};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_compiler::{CompileOptions, LightMethod, compile, model::Model};
use sightline_fixtures::boxes::box_triangles;
use sightline_world::{Spawn, World, geometry::Aabb, motion::Body};

/// From a floor to its ceiling, in metres.
const CEILING_M: f32 = 2.6;
/// The thickness of a slab, in metres.
const SLAB_M: f32 = 0.3;
/// The height of doors, in metres.
const DOOR_HEAD_M: f32 = 2.1;
/// The lower and upper edge of a window's opening, in metres above the floor.
const WINDOW_M: [f32; 2] = [1.1, 1.9];
/// The distance of the places in front of and behind a door from its wall, in metres.
const BESIDE_DOOR_M: f32 = 0.5;
/// The edges of voxels in metres: fine ones in every other pair of seeds, coarse ones in the rest.
const VOXELS_M: [f32; 2] = [0.1, 2.0];
/// The least distance of bodies from solids, in metres.
const CLEARANCE_M: f32 = 0.01;

/// A compiled building, and what its walkers need to know. Everything but the world is in the axes
/// that it was built in.
#[derive(Clone, Debug)]
pub struct SimulatedBuilding {
    /// The world for the engine and the oracle.
    pub world: Arc<World>,
    /// The rooms.
    pub rooms: Vec<BuildingRoom>,
    /// The solids: no body can be inside them.
    solids: Vec<Aabb>,
    /// From the axes that it was built in to the world's.
    turn: DMat3,
    /// The body: wide enough to hold a person at any angle of the building.
    body: Body,
}

/// A part of a storey between walls.
#[derive(Clone, Debug)]
pub struct BuildingRoom {
    /// The least x and z between its walls, in metres.
    pub min: Vec2,
    /// The greatest x and z between its walls, in metres.
    pub max: Vec2,
    /// The height of standing eyes, in metres.
    pub eye: f32,
    /// The ways out.
    pub doors: Vec<Doorway>,
}

/// A way out of a room.
#[derive(Clone, Copy, Debug)]
pub struct Doorway {
    /// The place in front of the door: x and z, in metres.
    pub near: Vec2,
    /// The place behind the door: x and z, in metres.
    pub far: Vec2,
    /// The index of the room behind the door.
    pub to: usize,
}

impl SimulatedBuilding {
    /// The building of a seed, compiled with coarse cells. Two of every four have voxels fine
    /// enough to tell which gates a body fits through.
    pub fn new(seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let mut draft = BuildingDraft::new(&mut rng);
        draft.raise(&mut rng);
        draft.furnish(&mut rng);
        let angle = if seed.is_multiple_of(2) { 0.0 } else { rng.random_range(0.0..TAU) };
        let turn = DMat3::from_rotation_y(angle);
        let wider = (angle.sin().abs() + angle.cos().abs()) as f32;
        let half_width = Body::PERSON.half_width * wider;
        assert!(!draft.rooms.is_empty(), "a grid has rooms");
        let model = draft.model(&turn);
        let voxel = VOXELS_M[(seed / 2 % 2) as usize];
        let options = CompileOptions {
            voxel: Some(voxel),
            cell: Some(3.0),
            light: LightMethod::None,
            ..Default::default()
        };
        let compiled = compile(&model, &options, &|_, _| ControlFlow::Continue(()));
        let (world, _) = compiled.expect("a closed house compiles");
        Self {
            world: Arc::new(world),
            rooms: draft.rooms,
            solids: draft.solids,
            turn,
            body: Body { half_width, ..Body::PERSON },
        }
    }

    /// A point of the building in the world's axes.
    pub fn world_point(&self, point: Vec3) -> Vec3 {
        (self.turn * point.as_dvec3()).as_vec3()
    }

    /// Whether a body fits where its eye is.
    pub fn is_free(&self, eye: Vec3) -> bool {
        let body = self.body.around(eye).grown(CLEARANCE_M);
        !self.solids.iter().any(|solid| solid.intersects(&body))
    }

    /// A random place in a room where a body fits, if one is found.
    pub fn place(&self, room: usize, rng: &mut SmallRng) -> Option<Vec2> {
        let BuildingRoom { min, max, eye, .. } = &self.rooms[room];
        let mut places = (0..20)
            .map(|_| *min + (*max - *min) * Vec2::new(rng.random(), rng.random()))
            .filter(|at| self.is_free(Vec3::new(at.x, *eye, at.y)));
        places.next()
    }
}

/// A building under construction.
struct BuildingDraft {
    /// The positions of walls along x and along z, in metres.
    lines: [Vec<f32>; 2],
    storeys: usize,
    /// Half the thickness of a wall, in metres.
    wall: f32,
    rooms: Vec<BuildingRoom>,
    solids: Vec<Aabb>,
}

/// A piece of wall: the walls of a storey lie on lines across an axis, and cross walls divide them
/// into pieces.
#[derive(Clone, Copy)]
struct WallPiece {
    storey: usize,
    /// 0: across x; 1: across z.
    axis: usize,
    line: usize,
    piece: usize,
}

/// An opening in a piece of wall, in metres: along the wall, and above the floor.
#[derive(Clone, Copy)]
struct WallOpening {
    along: [f32; 2],
    up: [f32; 2],
}

impl BuildingDraft {
    fn new(rng: &mut SmallRng) -> Self {
        let lines = [(); 2].map(|()| {
            let mut lines = vec![0.0];
            for i in 0..rng.random_range(2..=3) {
                lines.push(lines[i] + rng.random_range(2.6_f32..6.0));
            }
            lines
        });
        let storeys = if rng.random_bool(0.25) { 2 } else { 1 };
        let wall = [0.05, 0.1, 0.15][rng.random_range(0..3)];
        Self { lines, storeys, wall, rooms: Vec::new(), solids: Vec::new() }
    }

    /// Adds rooms, slabs and walls.
    fn raise(&mut self, rng: &mut SmallRng) {
        let [xs, zs] = self.lines.clone();
        for storey in 0..self.storeys {
            let floor = storey as f32 * (CEILING_M + SLAB_M);
            for x in xs.windows(2) {
                for z in zs.windows(2) {
                    let (min, max) = (Vec2::new(x[0], z[0]), Vec2::new(x[1], z[1]));
                    let hole = storey > 0 && rng.random_bool(0.3);
                    self.slab(min, max, floor, hole.then(|| rng.random_range(0.3..0.6)));
                    if storey + 1 == self.storeys {
                        self.slab(min, max, floor + CEILING_M + SLAB_M, None);
                    }
                    let (min, max) = (min + self.wall, max - self.wall);
                    let eye = floor + Body::PERSON.below_eye + 2.0 * CLEARANCE_M;
                    self.rooms.push(BuildingRoom { min, max, eye, doors: Vec::new() });
                }
            }
            for axis in [0, 1] {
                for line in 0..self.lines[axis].len() {
                    for piece in 0..self.lines[1 - axis].len() - 1 {
                        self.wall(WallPiece { storey, axis, line, piece }, rng);
                    }
                }
            }
        }
    }

    /// Adds the slab under a floor, up to the outer faces of the walls. A hole takes the given
    /// share of its width and depth.
    fn slab(&mut self, min: Vec2, max: Vec2, floor: f32, hole: Option<f32>) {
        let (min, max) = (min - self.wall, max + self.wall);
        let mut put = |min: Vec2, max: Vec2| {
            let (low, high) = (Vec3::new(min.x, floor - SLAB_M, min.y), max.extend(floor).xzy());
            self.solids.push(Aabb::new(low, high));
        };
        let Some(part) = hole else { return put(min, max) };
        let (middle, half) = ((min + max) * 0.5, (max - min) * 0.5 * part);
        let (low, high) = (middle - half, middle + half);
        put(min, Vec2::new(max.x, low.y));
        put(Vec2::new(min.x, high.y), max);
        put(Vec2::new(min.x, low.y), Vec2::new(low.x, high.y));
        put(Vec2::new(high.x, low.y), Vec2::new(max.x, high.y));
    }

    /// Adds a piece of wall across an axis, with or without an opening.
    fn wall(&mut self, at: WallPiece, rng: &mut SmallRng) {
        let WallPiece { axis, line, piece, .. } = at;
        let ends = [self.lines[1 - axis][piece], self.lines[1 - axis][piece + 1]];
        let outer = line == 0 || line + 1 == self.lines[axis].len();
        let width = rng.random_range(0.9..1.5);
        let from = rng.random_range(ends[0] + 0.3..ends[1] - 0.3 - width);
        let along = [from, from + width];
        let (up, is_door) = match rng.random_range(0..20) {
            _ if outer => return self.put_wall(at, ends, None),
            0..13 => ([0.0, DOOR_HEAD_M], true),
            13..15 => ([0.0, CEILING_M], true),
            15..17 => (WINDOW_M, false),
            _ => return self.put_wall(at, ends, None),
        };
        self.put_wall(at, ends, Some(WallOpening { along, up }));
        if is_door {
            self.put_door(at, (along[0] + along[1]) * 0.5);
        }
    }

    fn put_wall(&mut self, at: WallPiece, ends: [f32; 2], opening: Option<WallOpening>) {
        let WallPiece { storey, axis, line, .. } = at;
        let across = self.lines[axis][line];
        let floor = storey as f32 * (CEILING_M + SLAB_M);
        let wall = self.wall;
        let mut put = |along: [f32; 2], up: [f32; 2]| {
            if along[1] - along[0] < 1e-3 || up[1] - up[0] < 1e-3 {
                return;
            }
            let (mut min, mut max) = (Vec2::splat(along[0]), Vec2::splat(along[1]));
            (min[axis], max[axis]) = (across - wall, across + wall);
            let (low, high) = (min.extend(floor + up[0]).xzy(), max.extend(floor + up[1]).xzy());
            self.solids.push(Aabb::new(low, high));
        };
        // Extended to the posts where walls meet.
        let ends = [ends[0] - wall, ends[1] + wall];
        let Some(WallOpening { along, up }) = opening else { return put(ends, [0.0, CEILING_M]) };
        put([ends[0], along[0]], [0.0, CEILING_M]);
        put([along[1], ends[1]], [0.0, CEILING_M]);
        put(along, [0.0, up[0]]);
        put(along, [up[1], CEILING_M]);
    }

    fn put_door(&mut self, at: WallPiece, middle: f32) {
        let WallPiece { storey, axis, line, piece } = at;
        let rooms_z = self.lines[1].len() - 1;
        let rooms = (self.lines[0].len() - 1) * rooms_z;
        let room = |line: usize| {
            let (x, z) = if axis == 0 { (line, piece) } else { (piece, line) };
            storey * rooms + x * rooms_z + z
        };
        let place = |side: f32| {
            let mut at = Vec2::splat(middle);
            at[axis] = self.lines[axis][line] + side * (self.wall + BESIDE_DOOR_M);
            at
        };
        let (near, far) = (place(-1.0), place(1.0));
        let (before, behind) = (room(line - 1), room(line));
        assert_ne!(before, behind, "a door joins two rooms");
        self.rooms[before].doors.push(Doorway { near, far, to: behind });
        self.rooms[behind].doors.push(Doorway { near: far, far: near, to: before });
    }

    /// Adds boxes in the middle of rooms, some as high as the room.
    fn furnish(&mut self, rng: &mut SmallRng) {
        for room in &self.rooms {
            let floor = room.eye - Body::PERSON.below_eye - 2.0 * CLEARANCE_M;
            let spare = (room.max - room.min) * 0.5 - 1.2;
            if spare.min_element() < 0.2 || rng.random_bool(0.5) {
                continue;
            }
            let half = spare * Vec2::new(rng.random_range(0.3..1.0), rng.random_range(0.3..1.0));
            let middle = (room.min + room.max) * 0.5;
            let height = [0.8, 1.8, CEILING_M][rng.random_range(0..3)];
            let low = (middle - half).extend(floor).xzy();
            self.solids.push(Aabb::new(low, (middle + half).extend(floor + height).xzy()));
        }
    }

    fn model(&self, turn: &DMat3) -> Model {
        let moved = |p: Vec3| -> Vec3 { (*turn * DVec3::from(p)).as_vec3() };
        let faces = self.solids.iter().flat_map(box_triangles);
        let opaque: Vec<[Vec3; 3]> = faces.map(|triangle| triangle.map(moved)).collect();
        let room = &self.rooms[0];
        let eye = (room.min + 0.4).extend(room.eye).xzy();
        Model {
            spawns: vec![Spawn { eye: moved(eye), yaw: 0.0 }],
            speed_max: 4.0,
            ..Model::of_triangles("simulated", opaque, [200; 3])
        }
    }
}
