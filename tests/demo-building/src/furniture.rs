//! Furniture: detail objects in rooms that leave the way from door to door free.

use std::f32::consts::TAU;

use glam::Vec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};

use super::{
    layout::srgb,
    mesh::{Paint, Scene, metres},
    plan::{Plan, PlanSpace, SpaceKind, WALL},
    rect::LatticeRect,
};

const WOOD: Paint = Paint::opaque([168, 122, 78]);
const DARK_WOOD: Paint = Paint::opaque([98, 66, 44]);
const STEEL: Paint = Paint::opaque([112, 118, 126]);
const POT: Paint = Paint::opaque([186, 96, 62]);
const LEAF: Paint = Paint::opaque([62, 128, 58]);
const CARTON: Paint = Paint::opaque([190, 156, 110]);
const BOARD: Paint = Paint::opaque([36, 70, 60]);
/// The width that stays free along every wall of a room, so that all doors are connected: a body
/// and a half.
const AISLE: i32 = 64;
/// The depth that stays free in front of a door.
const DOOR_CLEARANCE: i32 = 72;
const SHELF_DEPTH: i32 = 22;

/// Furnishes every room, and puts plants into corridors and galleries.
pub(super) fn build(plan: &Plan, seed: u64, scene: &mut Scene) {
    let mut rng = SmallRng::seed_from_u64(seed ^ 0xF00D);
    for (node, space) in plan.spaces.iter().enumerate() {
        let mut room = Furnishing { plan, space, node, scene, floor: plan.floor(space.storey) };
        match space.kind {
            SpaceKind::Room => room.furnish(&mut rng),
            SpaceKind::Corridor if space.rect.size(0).max(space.rect.size(1)) > 512 => {
                room.plant(space.rect.min.map(|v| v + 18), 0.8);
            }
            SpaceKind::Gallery => {
                room.plant(space.rect.min.map(|v| v + 28), 1.2);
                room.plant(space.rect.max.map(|v| v - 28), 1.2);
            }
            _ => {}
        }
    }
}

struct Furnishing<'a> {
    plan: &'a Plan,
    space: &'a PlanSpace,
    node: usize,
    scene: &'a mut Scene,
    floor: i32,
}

impl Furnishing<'_> {
    fn furnish(&mut self, rng: &mut SmallRng) {
        let middle = self.space.rect.grown(-AISLE);
        if !middle.is_empty() && middle.size(0) >= 64 && middle.size(1) >= 64 {
            match rng.random_range(0..6) {
                0 => self.meeting(middle),
                1 | 2 => self.desks(middle),
                3 => self.lounge(middle, rng),
                4 => self.store(middle, rng),
                _ => self.class(middle),
            }
        }
        for _ in 0..2 {
            self.shelf(rng);
        }
        let corner = [0, 1].map(|axis| {
            let [min, max] = self.space.rect.span(axis);
            if rng.random_bool(0.5) { min + 20 } else { max - 20 }
        });
        if self.is_free(&LatticeRect::new(corner, corner).grown(18)) {
            self.plant(corner, rng.random_range(0.7..1.1));
        }
    }

    /// Whether furniture may stand here: inside the room, and away from every door.
    fn is_free(&self, rect: &LatticeRect) -> bool {
        let inside =
            self.space.rect.contains(rect.min) && self.space.rect.contains(rect.max.map(|v| v - 1));
        let mut doors = self.plan.doors_on(self.space.storey);
        inside && doors.all(|door| !door.rect.grown(DOOR_CLEARANCE).overlaps(rect))
    }

    fn block(&mut self, paint: Paint, rect: LatticeRect, up: [i32; 2]) {
        let floor = self.floor;
        let min = [rect.min[0], floor + up[0], rect.min[1]];
        self.scene.block(self.node, paint, min, [rect.max[0], floor + up[1], rect.max[1]]);
    }

    /// Adds a table: a top on two panels.
    fn table(&mut self, rect: LatticeRect, paint: Paint) {
        self.block(paint, rect, [45, 48]);
        let axis = usize::from(rect.size(1) > rect.size(0));
        let [min, max] = rect.span(axis);
        for panel in [[min + 4, min + 7], [max - 7, max - 4]] {
            self.block(
                STEEL,
                rect.with_span(axis, panel).grown(-1).with_span(axis, panel),
                [0, 45],
            );
        }
    }

    /// Adds a chair: a seat on a foot, with its back across `axis`.
    fn chair(&mut self, centre: [i32; 2], axis: usize, back_at_max: bool) {
        let seat = LatticeRect::new(centre, centre).grown(14);
        let paint = Paint::opaque(self.space.colours[1]);
        self.block(paint, seat, [27, 30]);
        self.block(STEEL, seat.grown(-10), [0, 27]);
        let [min, max] = seat.span(axis);
        let back = if back_at_max { [max - 3, max] } else { [min, min + 3] };
        self.block(paint, seat.with_span(axis, back), [30, 56]);
    }

    /// Adds one long table with chairs on both sides.
    fn meeting(&mut self, middle: LatticeRect) {
        let axis = usize::from(middle.size(1) > middle.size(0));
        let across = 1 - axis;
        let centre = middle.centre()[across];
        let half = (middle.size(across) / 2 - 20).clamp(14, 40);
        self.table(middle.with_span(across, [centre - half, centre + half]), DARK_WOOD);
        let count = middle.size(axis) / 48;
        for i in 0..count {
            let along = middle.min[axis] + (2 * i + 1) * middle.size(axis) / (2 * count);
            for (offset, back_at_max) in [(-half - 4, false), (half + 4, true)] {
                let mut at = [along; 2];
                at[across] = centre + offset;
                self.chair(at, across, back_at_max);
            }
        }
    }

    /// Adds rows of desks with a screen and a chair each.
    fn desks(&mut self, middle: LatticeRect) {
        let count = [middle.size(0) / 128, middle.size(1) / 128].map(|n| n.clamp(1, 4));
        for i in 0..count[0] * count[1] {
            let (column, row) = (i % count[0], i / count[0]);
            let centre = [
                middle.min[0] + (2 * column + 1) * middle.size(0) / (2 * count[0]),
                middle.min[1] + (2 * row + 1) * middle.size(1) / (2 * count[1]),
            ];
            let desk =
                LatticeRect::new([centre[0] - 32, centre[1] - 20], [centre[0] + 32, centre[1] + 6]);
            self.table(desk, WOOD);
            let screen = LatticeRect::new(
                [centre[0] - 12, desk.min[1] + 5],
                [centre[0] + 12, desk.min[1] + 7],
            );
            self.block(STEEL, screen, [50, 72]);
            self.chair([centre[0], centre[1] + 18], 1, true);
        }
    }

    /// Adds sofas around a low round table.
    fn lounge(&mut self, middle: LatticeRect, rng: &mut SmallRng) {
        let paint = Paint::opaque(srgb(rng.random(), 0.6, 0.7));
        let axis = usize::from(middle.size(1) > middle.size(0));
        for at_max in [false, true] {
            let [min, max] = middle.span(axis);
            let seat = if at_max { [max - 30, max] } else { [min, min + 30] };
            let back = if at_max { [max - 8, max] } else { [min, min + 8] };
            if middle.size(axis) >= 120 || !at_max {
                self.block(paint, middle.with_span(axis, seat), [6, 28]);
                self.block(paint, middle.with_span(axis, back), [28, 54]);
            }
        }
        let centre = middle.centre();
        self.cone(WOOD, centre, [0.0, 0.4], [0.1, 0.1]);
        self.cone(WOOD, centre, [0.4, 0.44], [0.1, 0.45]);
        self.cone(WOOD, centre, [0.44, 0.47], [0.45, 0.0]);
    }

    /// Adds stacks of boxes.
    fn store(&mut self, middle: LatticeRect, rng: &mut SmallRng) {
        for x in (middle.min[0]..middle.max[0] - 36).step_by(44) {
            for z in (middle.min[1]..middle.max[1] - 36).step_by(44) {
                let size = rng.random_range(24..40);
                let stack = rng.random_range(0..4);
                let rect = LatticeRect::new([x, z], [x + size, z + size]);
                if stack > 0 {
                    let paint =
                        if stack == 3 { Paint::opaque(self.space.colours[1]) } else { CARTON };
                    self.block(paint, rect, [0, 26 * stack]);
                }
            }
        }
    }

    /// Adds rows of tables that face a board on the wall.
    fn class(&mut self, middle: LatticeRect) {
        for z in (middle.min[1]..middle.max[1] - 52).step_by(76) {
            for x in (middle.min[0]..=middle.max[0] - 64).step_by(84) {
                self.table(LatticeRect::new([x, z], [x + 64, z + 24]), WOOD);
                self.chair([x + 18, z + 34], 1, true);
                self.chair([x + 46, z + 34], 1, true);
            }
        }
        let wall =
            self.space.rect.with_span(1, [self.space.rect.min[1], self.space.rect.min[1] + 2]);
        let board = wall.with_span(0, middle.span(0));
        if self.wall_is_whole(&board) {
            self.block(BOARD, board, [56, 120]);
        }
    }

    /// Whether the wall beside a strip of a room has no opening there.
    fn wall_is_whole(&self, strip: &LatticeRect) -> bool {
        let behind = strip.grown(WALL);
        self.plan.openings[self.space.storey].iter().all(|opening| !opening.rect.overlaps(&behind))
    }

    /// Adds shelves with coloured books, against a piece of wall without an opening.
    fn shelf(&mut self, rng: &mut SmallRng) {
        let axis = rng.random_range(0..2);
        let rect = self.space.rect;
        let [min, max] = rect.span(axis);
        let depth =
            if rng.random_bool(0.5) { [min, min + SHELF_DEPTH] } else { [max - SHELF_DEPTH, max] };
        let [start, end] = rect.span(1 - axis);
        let length = 96.min(end - start - 32);
        if length < 48 {
            return;
        }
        let at = rng.random_range(start + 16..=end - 16 - length);
        let shelf = rect.with_span(axis, depth).with_span(1 - axis, [at, at + length]);
        if !self.is_free(&shelf) || !self.wall_is_whole(&shelf) {
            return;
        }
        for board in 0..5 {
            self.block(DARK_WOOD, shelf, [board * 28, board * 28 + 2]);
        }
        for side in [[at, at + 2], [at + length - 2, at + length]] {
            self.block(DARK_WOOD, shelf.with_span(1 - axis, side), [2, 112]);
        }
        for row in 0..4 {
            let books = [at + 4, at + 4 + rng.random_range(16..length - 8)];
            let paint = Paint::opaque(srgb(rng.random(), 0.55, 0.6));
            let rect =
                shelf.with_span(1 - axis, books).with_span(axis, [depth[0] + 3, depth[1] - 3]);
            self.block(paint, rect, [row * 28 + 2, row * 28 + 20]);
        }
    }

    /// Adds a plant: a pot and leaves, none of them axial.
    fn plant(&mut self, at: [i32; 2], height: f32) {
        self.cone(POT, at, [0.0, 0.35], [0.13, 0.2]);
        self.cone(LEAF, at, [0.35, 0.35 + height * 0.45], [0.06, 0.3]);
        self.cone(LEAF, at, [0.35 + height * 0.45, 0.4 + height], [0.3, 0.0]);
    }

    /// Adds a seven-sided ring between two heights and radii, in metres.
    fn cone(&mut self, paint: Paint, at: [i32; 2], up: [f32; 2], radii: [f32; 2]) {
        const SIDES: u32 = 7;
        let foot = Vec3::new(metres(at[0]), metres(self.floor), metres(at[1]));
        let ring = |side: u32, end: usize| {
            let turn = side as f32 / SIDES as f32 * TAU + 0.2;
            foot + Vec3::new(radii[end] * turn.sin(), up[end], radii[end] * turn.cos())
        };
        for side in 0..SIDES {
            let corners = [ring(side, 0), ring(side + 1, 0), ring(side + 1, 1), ring(side, 1)];
            let corners = if radii[1] == 0.0 { &corners[..3] } else { &corners[..] };
            self.scene.polygon(self.node, paint, corners);
        }
    }
}
