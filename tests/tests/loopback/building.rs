//! Two rooms, 16 m by 10 m, joined by two narrow lobbies. Their doors are placed so that no line of
//! sight leads from one room into the other.

use std::sync::{Arc, OnceLock};

use glam::Vec3;
use sightline_compiler::{CompileOptions, compile, model::Model};
use sightline_fixtures::boxes::box_triangles;
use sightline_server::net::ServedWorld;
use sightline_world::{Spawn, geometry::Aabb};

/// The top speed of avatars, in metres per second.
pub const SPEED_MAX: f32 = 12.0;
/// A place deep inside each of the two rooms.
pub const WEST: Vec3 = Vec3::new(3.0, 1.6, 8.0);
pub const EAST: Vec3 = Vec3::new(33.0, 1.6, 8.0);
/// The way from `WEST` to `EAST`, through the three doors.
pub const WAY: [Vec3; 5] =
    [WEST, Vec3::new(16.0, 1.6, 0.6), Vec3::new(18.0, 1.6, 9.4), Vec3::new(20.0, 1.6, 0.6), EAST];

/// The building, compiled once for all tests.
pub fn world() -> ServedWorld {
    static WORLD: OnceLock<ServedWorld> = OnceLock::new();
    WORLD.get_or_init(|| compiled(&model(), 0.1)).clone()
}

/// The same building with coarser voxels.
pub fn coarse_world() -> ServedWorld {
    compiled(&model(), 0.2)
}

/// The building with shelves in the western half of the western room, between which no body fits.
pub fn crammed_world() -> ServedWorld {
    let shelf = |i: u8| {
        let x = f32::from(i) * 0.4;
        box_triangles(&Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 0.2, 3.0, 10.0)))
    };
    let spawns = vec![Spawn { eye: WAY[1], yaw: 0.0 }];
    let opaque = model().opaque.into_iter().chain((0..20).flat_map(shelf)).collect();
    compiled(&Model { spawns, ..model_of(opaque) }, 0.2)
}

fn compiled(model: &Model, voxel: f32) -> ServedWorld {
    let options = CompileOptions { voxel: Some(voxel), cell: Some(3.0), ..Default::default() };
    let (world, _) = compile(model, &options, &|_, _| std::ops::ControlFlow::Continue(())).unwrap();
    ServedWorld::from_world(Arc::new(world))
}

fn model() -> Model {
    let wall = |min: [f32; 3], max: [f32; 3]| Aabb::new(min.into(), max.into());
    let baffle = |x: f32, z: [f32; 2]| wall([x - 0.1, 0.0, z[0]], [x + 0.1, 3.0, z[1]]);
    // The walls are so thick that no TBV reaches the outside, where everything outside is in view.
    // They consist of three parts, so that two TBVs in the same wall are not taken to meet there.
    let t = 12.0;
    let parts = [[-t, 15.9], [15.9, 20.1], [20.1, 36.0 + t]];
    let shell = parts.into_iter().flat_map(|[from, to]| {
        [
            wall([from, -t, -t], [to, 0.0, 10.0 + t]),
            wall([from, 3.0, -t], [to, 3.0 + t, 10.0 + t]),
            wall([from, 0.0, -t], [to, 3.0, 0.0]),
            wall([from, 0.0, 10.0], [to, 3.0, 10.0 + t]),
        ]
    });
    let inner = [
        wall([-t, 0.0, 0.0], [0.0, 3.0, 10.0]),
        wall([36.0, 0.0, 0.0], [36.0 + t, 3.0, 10.0]),
        baffle(16.0, [1.2, 10.0]),
        baffle(18.0, [0.0, 8.8]),
        baffle(20.0, [1.2, 10.0]),
    ];
    let boxes: Vec<Aabb> = shell.chain(inner).collect();
    model_of(boxes.iter().flat_map(box_triangles).collect())
}

fn model_of(opaque: Vec<[Vec3; 3]>) -> Model {
    Model {
        spawns: vec![Spawn { eye: WEST, yaw: 0.0 }],
        speed_max: SPEED_MAX,
        ..Model::of_triangles("two rooms", opaque, [200, 180, 160])
    }
}
