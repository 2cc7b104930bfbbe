//! The plan of a storey: what it looks like from above, found from the voxels.
//!
//! A packed plan: the height of the soles, the x and z of the corner and the length of a pixel, in
//! metres as `f32`; columns and rows as `u16`; and a zstd frame. In the frame each pixel has a byte
//! that says what it is, and then each pixel of a floor has its red, green and blue, in three
//! planes. Numbers are little-endian.

use std::io::Read as _;

use glam::{Vec2, Vec3};

use crate::{
    geometry::Aabb,
    packing::{self, Unpacker},
    world::World,
};

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

/// The colour of walls, as 0x00RRGGBB.
pub const WALL: u32 = 0x0020_262e;
/// The colour of panes, as 0x00RRGGBB.
pub const GLASS: u32 = 0x0080_b4d8;
/// The colour in which floors are shown is half of this and half of their own.
const PAPER: [u8; 3] = [250, 246, 236];
/// Floors are shown in shades this far apart: nobody sees more, and packed they take a third.
const SHADE: u8 = 8;

/// A packed plan begins with this: four numbers of 32 bits, and two of 16.
const PLACE_BYTES: usize = 20;
/// Higher levels take much longer and gain little.
const ZSTD_LEVEL: i32 = 9;

/// Bytes are no packed plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the plan of a storey is malformed")]
pub struct PlanError;

/// The plan of a storey.
#[derive(Clone, Debug, PartialEq)]
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

    /// The height of the soles, in metres.
    pub fn soles(&self) -> f32 {
        self.soles
    }

    /// Whether this is the storey of a body with its soles at this height, in metres.
    pub fn serves(&self, soles: f32) -> bool {
        is_on_storey(self.soles, soles)
    }

    /// The bytes of the plan, packed. Equal plans give equal bytes on all native platforms.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for number in [self.soles, self.corner.x, self.corner.y, self.metres] {
            out.extend(number.to_le_bytes());
        }
        self.size.iter().for_each(|&side| out.extend((side as u16).to_le_bytes()));
        let mut planes: Vec<u8> = self.pixels.iter().map(|pixel| Kind::of(*pixel) as u8).collect();
        let floors = || self.pixels.iter().filter(|pixel| Kind::of(**pixel) == Kind::Floor);
        for part in 1..4 {
            planes.extend(floors().flatten().map(|colour| colour.to_be_bytes()[part]));
        }
        out.extend(packing::pack(&planes, ZSTD_LEVEL));
        out
    }

    /// Reads a packed plan. Any bytes give a valid plan or an error.
    ///
    /// # Errors
    /// When the bytes are not exactly one plan.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PlanError> {
        let (place, packed) = bytes.split_first_chunk::<PLACE_BYTES>().ok_or(PlanError)?;
        let (numbers, sides) = place.split_at(16);
        let numbers: Vec<f32> = numbers
            .as_chunks()
            .0
            .iter()
            .map(|bytes| f32::from_le_bytes(*bytes))
            .filter(|number| number.is_finite())
            .collect();
        let &[soles, x, z, metres] = numbers.as_slice() else { return Err(PlanError) };
        let &[columns, rows] = sides.as_chunks().0 else { return Err(PlanError) };
        let size = [columns, rows].map(|side| usize::from(u16::from_le_bytes(side)));
        if metres <= 0.0 || size.iter().any(|side| !(1..=SIDE_PX).contains(side)) {
            return Err(PlanError);
        }
        let pixels = read_pixels(packed, size[0] * size[1]).ok_or(PlanError)?;
        Ok(Self { size, pixels, corner: Vec2::new(x, z), metres, soles })
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
        let mixed = [0, 1, 2].map(|i| own[i].midpoint(PAPER[i]) / SHADE * SHADE);
        Some(u32::from_be_bytes([0, mixed[0], mixed[1], mixed[2]]))
    }
}

/// Whether a body with its soles at one height is on the storey with a plan for another, in metres.
pub(crate) fn is_on_storey(storey: f32, soles: f32) -> bool {
    (storey - soles).abs() <= STOREY_M
}

/// What is at a pixel, as it is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Nothing,
    Wall,
    Glass,
    Floor,
}

impl Kind {
    fn of(pixel: Option<u32>) -> Self {
        match pixel {
            None => Self::Nothing,
            Some(WALL) => Self::Wall,
            Some(GLASS) => Self::Glass,
            Some(_) => Self::Floor,
        }
    }

    fn read(byte: u8) -> Option<Self> {
        [Self::Nothing, Self::Wall, Self::Glass, Self::Floor].into_iter().nth(byte.into())
    }
}

/// Unpacks this number of pixels; `None` when the bytes are not exactly these.
fn read_pixels(packed: &[u8], count: usize) -> Option<Vec<Option<u32>>> {
    let mut planes = Vec::new();
    let limited = Unpacker::new(packed).ok()?;
    limited.take(4 * count as u64 + 1).read_to_end(&mut planes).ok()?;
    let (kinds, colours) = planes.split_at_checked(count)?;
    let kinds: Vec<Kind> = kinds.iter().map(|byte| Kind::read(*byte)).collect::<Option<_>>()?;
    let floors = kinds.iter().filter(|kind| **kind == Kind::Floor).count();
    if colours.len() != 3 * floors {
        return None;
    }
    let mut floor = 0..floors;
    let pixels = kinds.iter().map(|kind| match kind {
        Kind::Nothing => None,
        Kind::Wall => Some(WALL),
        Kind::Glass => Some(GLASS),
        Kind::Floor => {
            let at = floor.next().unwrap_or(0);
            let part = |plane: usize| colours.get(plane * floors + at).copied().unwrap_or(0);
            Some(u32::from_be_bytes([0, part(0), part(1), part(2)]))
        }
    });
    Some(pixels.collect())
}
