//! Walks through the triangles of a building, without its plan.

use std::collections::{HashMap, HashSet};

use glam::Vec3;

use super::*;
use sightline_compiler::{import::glb, model::Model};

/// The grid on which a body steps, in metres.
const STEP: f32 = 0.125;
/// The half width of a body, in metres.
const HALF_WIDTH: f32 = 0.18;
const HEIGHT: f32 = 1.7;
/// The highest step, up or down, in metres.
const CLIMB: f32 = 0.25;

/// The heights of triangles in each column of the grid.
struct Columns(HashMap<(i32, i32), Vec<(f32, f32)>>);

impl Columns {
    fn new(model: &Model) -> Self {
        let mut columns: HashMap<(i32, i32), Vec<(f32, f32)>> = HashMap::new();
        for [a, b, c] in model.surfaces.iter().flat_map(|surface| surface.corners()) {
            let (min, max) = (a.min(b).min(c), a.max(b).max(c));
            // A triangle that only touches the side of a column does not count.
            let cells = |from: f32, to: f32| {
                let first = (from / STEP + 1e-3).floor() as i32;
                first..=first.max((to / STEP - 1e-3).floor() as i32)
            };
            for x in cells(min.x, max.x) {
                for z in cells(min.z, max.z) {
                    columns.entry((x, z)).or_default().push((min.y, max.y));
                }
            }
        }
        Self(columns)
    }

    /// The floor on which feet stand when a body enters a column from a height.
    fn floor(&self, column: (i32, i32), from: f32) -> Option<f32> {
        let levels = self.0.get(&column)?.iter().map(|span| span.1);
        levels.filter(|y| (y - from).abs() <= CLIMB).max_by(f32::total_cmp)
    }

    fn fits(&self, (x, z): (i32, i32), floor: f32) -> bool {
        let reach = (HALF_WIDTH / STEP).ceil() as i32;
        let body = (floor + CLIMB + 0.01, floor + HEIGHT);
        (x - reach..=x + reach).all(|x| {
            (z - reach..=z + reach).all(|z| {
                let spans = self.0.get(&(x, z)).map_or(&[][..], Vec::as_slice);
                spans.iter().all(|&(low, high)| high < body.0 || low > body.1)
            })
        })
    }

    /// All places that can be walked to: columns, with the height of the floor in centimetres.
    fn flood(&self, start: Vec3) -> HashSet<(i32, i32, i32)> {
        let column = ((start.x / STEP).floor() as i32, (start.z / STEP).floor() as i32);
        let mut stack = vec![(column, start.y)];
        let mut reached = HashSet::new();
        while let Some(((x, z), from)) = stack.pop() {
            let Some(floor) = self.floor((x, z), from) else { continue };
            if !self.fits((x, z), floor) || !reached.insert((x, z, (floor * 100.0) as i32)) {
                continue;
            }
            stack.extend([(x + 1, z), (x - 1, z), (x, z + 1), (x, z - 1)].map(|c| (c, floor)));
        }
        reached
    }
}

/// From the first spawn point, people can walk to every other one and into every room.
#[test]
fn every_room_can_be_walked_to() {
    for (rooms, seed) in [(1, 1), (5, 2), (21, 3), (60, 1)] {
        let building = build(rooms, seed);
        let model = glb::read_slice(&building.glb, None, "demo").unwrap();
        let columns = Columns::new(&model);
        let feet = |eye: Vec3| eye - Vec3::Y * model.body.below_eye;
        let reached = columns.flood(feet(model.spawns[0].eye));
        for spawn in &model.spawns {
            let feet = feet(spawn.eye);
            let near = reached.iter().any(|&(x, z, y)| {
                let place = Vec3::new(x as f32 * STEP, y as f32 / 100.0, z as f32 * STEP);
                (place - feet).length() < 0.3
            });
            assert!(near, "{rooms} rooms, seed {seed}: no way to {feet}");
        }
        for space in &building.plan.spaces {
            let metres = |v: i32| mesh::metres(v);
            let floor = (metres(building.plan.floor(space.storey)) * 100.0) as i32;
            let inside = |&&(x, z, y): &&(i32, i32, i32)| {
                let place = [x, z].map(|v| (v as f32 * STEP * UNITS_PER_METRE as f32) as i32);
                space.rect.contains(place) && (y - floor).abs() < 5
            };
            let area = reached.iter().filter(inside).count() as f32 * STEP * STEP;
            assert!(area > 1.0, "{rooms} rooms, seed {seed}: {area} m² of {space:?}");
        }
    }
}
