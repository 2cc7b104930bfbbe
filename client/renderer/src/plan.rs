//! The plan: the storey that one is on, from above, found from the voxels.

use glam::{Vec2, Vec3};
use sightline_world::{World, geometry::Aabb, motion::Pose};

use super::{Frame, text};

/// Walls are what is solid at these heights above the soles, in metres.
const WALL_M: [f32; 2] = [1.0, 1.6];
/// A floor is at most this far above and below the soles, in metres.
const FLOOR_M: f32 = 0.9;
/// A plan serves while the soles are no farther than this above or below its storey, in metres.
const STOREY_M: f32 = 1.2;
/// Pixels along the longer side of a plan.
const SIDE_PX: usize = 440;
/// Pixels along the longer side of the first look, which finds where the building is.
const LOOK_PX: usize = 110;
/// The free margin around the building, in metres.
const MARGIN_M: f32 = 1.0;

const WALL: u32 = 0x0020_262e;
const GLASS: u32 = 0x0080_b4d8;
const EDGE: u32 = 0x0012_161a;
/// The colour in which floors are shown is half of this and half of their own.
const PAPER: [u8; 3] = [250, 246, 236];

/// The plan of a storey.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Columns and rows.
    size: [usize; 2],
    /// Row by row; `None` where there is neither floor nor wall.
    pixels: Vec<Option<u32>>,
    /// The world's x and z at the upper left corner, in metres.
    corner: Vec2,
    /// The length that a pixel spans, in metres.
    metres: f32,
    /// The height of the soles, in metres.
    soles: f32,
}

/// Somebody on a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlanMark {
    /// The pixel of the plan.
    at: [i32; 2],
    colour: u32,
    /// Where somebody looks, in 32nds of a turn, as a yaw counts. Only one's own mark has it.
    looks: Option<i32>,
}

impl PartialEq for Plan {
    /// Plans are told apart by where they are: a storey of a building has one plan.
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

/// A plan that is being made, row by row.
#[derive(Debug)]
pub struct PlanSketch {
    plan: Plan,
    /// Whether this is only the first look, which finds where the building is.
    is_look: bool,
}

impl PlanSketch {
    /// Begins the plan of the storey of a body with its soles at this height, in metres.
    pub fn new(world: &World, soles: f32) -> Self {
        Self { plan: Plan::blank(soles, &world.bounds(), LOOK_PX), is_look: true }
    }

    /// Goes on for some rows: a whole plan has up to 550. Returns it once it is made.
    pub fn go_on(&mut self, world: &World, rows: usize) -> Option<Plan> {
        for _ in 0..rows {
            if self.plan.rows_made() < self.plan.size[1] {
                self.plan.look_at_row(world);
            } else if self.is_look {
                let found = self.plan.built_area();
                let found = if found.is_empty() { world.bounds() } else { found.grown(MARGIN_M) };
                let plan = Plan::blank(self.plan.soles, &found, SIDE_PX);
                *self = Self { plan, is_look: false };
            }
        }
        let is_made = !self.is_look && self.plan.rows_made() == self.plan.size[1];
        is_made.then(|| self.plan.clone())
    }
}

impl Plan {
    /// The plan of the storey of a body with its soles at this height. It takes up to a second.
    pub fn new(world: &World, soles: f32) -> Self {
        let mut sketch = PlanSketch::new(world, soles);
        loop {
            if let Some(plan) = sketch.go_on(world, SIDE_PX) {
                return plan;
            }
        }
    }

    /// The plan of an area without any row.
    fn blank(soles: f32, area: &Aabb, side: usize) -> Self {
        let extent = area.size();
        let metres = (extent.x.max(extent.z) / side as f32).max(0.01);
        let size = [extent.x, extent.z].map(|of| ((of / metres).ceil() as usize).clamp(1, side));
        let corner = Vec2::new(area.min.x, area.min.z);
        Self { size, pixels: Vec::new(), corner, metres, soles }
    }

    fn rows_made(&self) -> usize {
        self.pixels.len() / self.size[0]
    }

    fn look_at_row(&mut self, world: &World) {
        let row = self.rows_made();
        let pixels: Vec<Option<u32>> =
            (0..self.size[0]).map(|column| self.look(world, column, row)).collect();
        self.pixels.extend(pixels);
    }

    /// Where there is a floor or a wall.
    fn built_area(&self) -> Aabb {
        let mut found = Aabb::EMPTY;
        for (i, _) in self.pixels.iter().enumerate().filter(|(_, pixel)| pixel.is_some()) {
            let [x, z] = [i % self.size[0], i / self.size[0]].map(|at| at as f32 * self.metres);
            let min = Vec3::new(self.corner.x + x, self.soles, self.corner.y + z);
            let max = min + Vec3::new(self.metres, 0.0, self.metres);
            found = found.union(&Aabb { min, max });
        }
        found
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The colour of each pixel as 0x00RRGGBB, row by row from the north; `None` where there is
    /// neither floor nor wall.
    pub fn pixels(&self) -> &[Option<u32>] {
        &self.pixels
    }

    /// The world's x and z at the upper left corner, in metres.
    pub fn corner(&self) -> Vec2 {
        self.corner
    }

    /// The length that a pixel spans, in metres.
    pub fn metres(&self) -> f32 {
        self.metres
    }

    /// Whether this is the storey of a body with its soles at this height, in metres.
    pub fn serves(&self, soles: f32) -> bool {
        (self.soles - soles).abs() <= STOREY_M
    }

    /// What a pixel shows.
    fn look(&self, world: &World, column: usize, row: usize) -> Option<u32> {
        let [x, z] = [column, row].map(|at| at as f32 * self.metres);
        let corner = Vec3::new(self.corner.x + x, self.soles, self.corner.y + z);
        let part = |low: f32, high: f32| Aabb {
            min: corner + Vec3::Y * low,
            max: corner + Vec3::new(self.metres, high, self.metres),
        };
        let middle = corner + Vec3::new(0.5, 0.0, 0.5) * self.metres;
        let octree = &world.octree;
        if octree.solid_in(&part(WALL_M[0], WALL_M[1])) {
            let pane = octree.leaf_at(middle + Vec3::Y * (WALL_M[0] + WALL_M[1]) * 0.5);
            return Some(if pane.is_some_and(|pane| pane.is_glass()) { GLASS } else { WALL });
        }
        if !octree.solid_in(&part(-FLOOR_M, FLOOR_M)) {
            return None;
        }
        let voxel = octree.voxel().max(0.02);
        let steps = (2.0 * FLOOR_M / voxel) as u32;
        let mut heights = (0..=steps).map(|step| FLOOR_M - step as f32 * voxel);
        let found = heights.find_map(|height| octree.leaf_at(middle + Vec3::Y * height));
        let own = found.map_or(PAPER, |material| material.colour);
        let mixed = [0, 1, 2].map(|i| ((u16::from(own[i]) + u16::from(PAPER[i])) / 2) as u8);
        Some(u32::from_be_bytes([0, mixed[0], mixed[1], mixed[2]]))
    }

    /// A mark for somebody at an eye; `None` beside the plan.
    fn mark(&self, eye: Vec3, colour: u32, looks: Option<i32>) -> Option<PlanMark> {
        let at = (Vec2::new(eye.x, eye.z) - self.corner) / self.metres;
        let is_on = at.cmpge(Vec2::ZERO).all() && at.x < self.size[0] as f32;
        let at = [at.x as i32, at.y as i32];
        (is_on && at[1] < self.size[1] as i32).then_some(PlanMark { at, colour, looks })
    }

    /// The marks of others on the storey and of oneself, which comes last.
    pub fn marks(
        &self,
        own: &Pose,
        others: impl Iterator<Item = (Pose, [u8; 3])>,
        below_eye: f32,
    ) -> Vec<PlanMark> {
        let is_here = |eye: Vec3| (eye.y - below_eye - self.soles).abs() < 2.0 * STOREY_M;
        let others = others.filter(|(pose, _)| is_here(pose.eye));
        let mut marks: Vec<PlanMark> = others
            .filter_map(|(pose, [r, g, b])| {
                self.mark(pose.eye, u32::from_be_bytes([0, r, g, b]), None)
            })
            .collect();
        let looks = (own.yaw / std::f32::consts::TAU * 32.0).round() as i32;
        marks.extend(self.mark(own.eye, 0x00ff_3030, Some(looks)));
        marks
    }

    /// Draws the plan in the middle of a picture.
    pub fn draw(&self, frame: &mut Frame, marks: &[PlanMark]) {
        let [columns, rows] = self.size;
        let free = [frame.width() / columns, frame.height() / rows];
        let zoom = free[0].min(free[1]).clamp(1, 2);
        let size = [columns * zoom, rows * zoom];
        let corner = [0, 1].map(|axis| {
            let side = if axis == 0 { frame.width() } else { frame.height() };
            (side as i32 - size[axis] as i32) / 2
        });
        let rim = 6;
        let around = [size[0] + 2 * rim, size[1] + 2 * rim];
        let outer = corner.map(|at| at - rim as i32);
        for _ in 0..2 {
            text::darken(frame, outer, around);
        }
        let place = |[x, y]: [i32; 2]| [corner[0] + x * zoom as i32, corner[1] + y * zoom as i32];
        for (i, pixel) in self.pixels.iter().enumerate() {
            if let Some(colour) = pixel {
                let at = place([(i % columns) as i32, (i / columns) as i32]);
                text::fill(frame, at, [zoom, zoom], *colour);
            }
        }
        for mark in marks {
            draw_mark(frame, place(mark.at), mark);
        }
    }
}

/// Draws a disc with an edge, and for oneself a line to where one looks.
fn draw_mark(frame: &mut Frame, [x, y]: [i32; 2], mark: &PlanMark) {
    let radius = if mark.looks.is_some() { 4 } else { 3 };
    if let Some(looks) = mark.looks {
        let (sin, cos) = (looks as f32 / 32.0 * std::f32::consts::TAU).sin_cos();
        for step in 0..14 {
            let [right, down] = [-sin, -cos].map(|of| (of * step as f32).round() as i32);
            text::fill(frame, [x + right - 1, y + down - 1], [3, 3], mark.colour);
        }
    }
    for (reach, colour) in [(radius + 1, EDGE), (radius, mark.colour)] {
        for down in -reach..=reach {
            let across = ((reach * reach - down * down) as f32).sqrt() as i32;
            text::fill(frame, [x - across, y + down], [(2 * across + 1) as usize, 1], colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor::{self, SPAWN};
    use sightline_world::octree::Material;

    use super::*;

    /// What the plan of the fixture's floor with these boxes shows at a place.
    fn shown(plan: &Plan, x: f32, z: f32) -> Option<u32> {
        let [column, row] = [x - plan.corner.x, z - plan.corner.y].map(|of| of / plan.metres);
        plan.pixels[row as usize * plan.size[0] + column as usize]
    }

    #[test]
    fn a_plan_shows_walls_glass_floors_and_voids() {
        let wall = ([32, 0, 0], [33, 24, 64], 0);
        let pane = ([0, 0, 48], [32, 24, 49], Material::GLASS);
        let table = ([8, 0, 8], [16, 6, 16], 0);
        let world = voxel_floor::world(&[wall, pane, table]);
        let plan = Plan::new(&world, 0.125);
        assert_eq!(shown(&plan, 4.06, 2.0), Some(WALL));
        assert_eq!(shown(&plan, 2.0, 6.06), Some(GLASS));
        for [x, z] in [[2.0, 4.0], [6.0, 6.0], [1.5, 1.5]] {
            let floor = shown(&plan, x, z).expect("a floor");
            assert!(![WALL, GLASS].contains(&floor), "{x}, {z}");
        }
        let above = Plan::new(&world, 5.0);
        assert!(above.pixels.iter().all(Option::is_none), "no storey is there");
    }

    #[test]
    fn marks_are_where_people_are_and_only_on_their_storey() {
        let world = voxel_floor::world(&[]);
        let plan = Plan::new(&world, 0.125);
        let own = Pose { eye: SPAWN.eye, yaw: std::f32::consts::PI, ..Pose::default() };
        let other = |eye: Vec3| (Pose { eye, ..Pose::default() }, [9, 8, 7]);
        let eyes = [Vec3::new(6.0, 1.7, 2.0), Vec3::new(6.0, 6.0, 2.0), Vec3::new(60.0, 1.7, 2.0)];
        let marks = plan.marks(&own, eyes.map(other).into_iter(), world.body.below_eye);
        assert_eq!(marks.len(), 2, "one above, one beside the plan: {marks:?}");
        assert_eq!(marks[1].looks, Some(16));
        let off = marks[0].at[0] - marks[1].at[0];
        assert!((off as f32 * plan.metres - 4.0).abs() < 0.05, "four metres east: {off} pixels");
        let mut frame = Frame::new(500, 500);
        plan.draw(&mut frame, &marks);
        assert!(frame.colour.contains(&0x00ff_3030) && frame.colour.contains(&0x0009_0807));
    }
}
