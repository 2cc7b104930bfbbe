//! From surfaces to the octree: every voxel that a triangle touches, with the mean of its
//! materials.
//!
//! The grid is cut into the blocks of the octree. First, triangles are scattered to the blocks that
//! they touch. Then each block is halved down to voxels and packed on its own, on any thread, so
//! that only one block of voxels per thread is in memory. Blocks follow in the order of their keys,
//! so the result does not depend on the threads.

mod material_mean;
mod overlap;

use std::{
    collections::BTreeMap,
    ops::ControlFlow,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
};

use glam::{UVec3, Vec3};
use rayon::prelude::*;
use sightline_world::{
    geometry::Aabb,
    octree::{BLOCK_LEVELS, DEPTH_MAX, Octree, OctreeError, Voxel, VoxelBlock, morton},
};
use thiserror::Error;

use crate::{
    light::{Light, PatchLight},
    model::Surface,
    palette::{Palette, Shade, TriangleMaterial},
};
use material_mean::MaterialMean;
use overlap::Overlap;

/// The most voxels of a world. Such an octree takes about 640 MiB, and 2 GiB while it is made.
pub const VOXELS_MAX: usize = 128 << 20;

/// [`default_voxel`] aims at fewer voxels than this: an octree of about 100 MiB.
const VOXELS_DEFAULT: f64 = 20.0e6;

/// The least edge of a voxel, in metres.
const EDGE_MIN: f32 = 0.001;

/// The greatest edge of a voxel, in metres.
const EDGE_MAX: f32 = 100.0;

/// The most pairs of a block and a triangle: 8 bytes each.
const SCATTERED_MAX: usize = 64 << 20;

/// The offset of the grid from whole multiples of the voxel. Authors put walls and floors at round
/// coordinates, and a surface exactly between two voxels would fill both. Upwards, voxels reach
/// just above surfaces, so that feet stand on the floor and not above it.
const GRID_SHIFT: Vec3 = Vec3::new(0.37, 0.87, 0.37);

/// Why a model cannot be voxelised.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum VoxeliseError {
    /// The voxels would take too much memory.
    #[error("voxels of {voxel} m are too many for this model; --voxel {enough} would do")]
    TooMany {
        /// The edge that was asked for, in metres.
        voxel: f32,
        /// An edge that is large enough, in metres.
        enough: f32,
    },
    /// The edge is out of range.
    #[error("--voxel must be between {EDGE_MIN} and {EDGE_MAX} metres, not {0}")]
    Edge(f32),
    /// The progress callback broke the work.
    #[error("cancelled")]
    Cancelled,
    /// The octree cannot be made.
    #[error(transparent)]
    Octree(#[from] OctreeError),
}

/// An edge that suits a model, in metres: 1/32, or more for a large building, in alternating steps
/// of 4/3 and 3/2. Every second edge is a power of two.
pub fn default_voxel(surfaces: &[Surface], bounds: &Aabb) -> f32 {
    let powers = std::iter::successors(Some(1.0 / 32.0), |power| Some(power * 2.0));
    let mut edges = powers.flat_map(|power| [power, power * 4.0 / 3.0]);
    edges.find(|&edge| fits(surfaces, bounds, edge, VOXELS_DEFAULT)).unwrap_or(EDGE_MAX)
}

/// An edge that is large enough: the given one, doubled until the voxels fit.
fn enough(surfaces: &[Surface], bounds: &Aabb, voxel: f32) -> f32 {
    let mut edges = std::iter::successors(Some(voxel * 2.0), |edge| Some(edge * 2.0));
    let edge = edges.find(|&edge| fits(surfaces, bounds, edge, 0.8 * VOXELS_MAX as f64));
    edge.unwrap_or(EDGE_MAX)
}

/// Whether a model needs at most about this many voxels, or the edge cannot be larger anyway.
fn fits(surfaces: &[Surface], bounds: &Aabb, edge: f32, voxels: f64) -> bool {
    let can_be_larger = edge < EDGE_MAX * 0.5;
    let is_small = voxels_about(surfaces, edge) <= voxels && depth_for(bounds, edge) <= DEPTH_MAX;
    is_small || !can_be_larger
}

/// An estimate of the number of voxels. A slanted surface fills more voxels than its area, and
/// overlapping surfaces fill fewer.
fn voxels_about(surfaces: &[Surface], voxel: f32) -> f64 {
    let area = surfaces.iter().flat_map(Surface::corners).map(doubled_area).sum::<f64>() / 2.0;
    1.2 * area / f64::from(voxel * voxel)
}

fn doubled_area([a, b, c]: [Vec3; 3]) -> f64 {
    let area = f64::from((b - a).cross(c - a).length());
    if area.is_finite() { area } else { 0.0 }
}

/// The least depth of a grid that covers a box, wherever its lines lie.
fn depth_for(bounds: &Aabb, voxel: f32) -> u8 {
    let across = (bounds.size().max_element() / voxel).max(1.0) + 2.0;
    across.log2().ceil().min(255.0) as u8
}

/// Checks that voxels of an edge in metres are not hopelessly many, before any is made.
///
/// # Errors
/// When there would be too many, or the edge is out of range.
pub fn check(surfaces: &[Surface], bounds: &Aabb, voxel: f32) -> Result<(), VoxeliseError> {
    if !(EDGE_MIN..=EDGE_MAX).contains(&voxel) {
        return Err(VoxeliseError::Edge(voxel));
    }
    let is_too_deep = depth_for(bounds, voxel) > DEPTH_MAX;
    if is_too_deep || voxels_about(surfaces, voxel) > 4.0 * VOXELS_MAX as f64 {
        return Err(VoxeliseError::TooMany { voxel, enough: enough(surfaces, bounds, voxel) });
    }
    Ok(())
}

/// Fills every voxel of edge `voxel` (in metres) that a triangle inside `bounds` touches.
/// `progress` hears the share that is done, from 0 to 1, from any thread. When it breaks, no more
/// work begins.
///
/// # Errors
///
/// When there would be too many voxels, the edge is out of range, or `progress` breaks.
pub fn voxelise(
    surfaces: &[Surface],
    bounds: &Aabb,
    voxel: f32,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<Octree, VoxeliseError> {
    voxelise_lit(surfaces, None, bounds, voxel, progress)
}

/// As [`voxelise`], with light on the surfaces.
///
/// # Errors
///
/// As [`voxelise`].
pub(crate) fn voxelise_lit(
    surfaces: &[Surface],
    light: Option<&Light>,
    bounds: &Aabb,
    voxel: f32,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<Octree, VoxeliseError> {
    check(surfaces, bounds, voxel)?;
    let too_many = || VoxeliseError::TooMany { voxel, enough: enough(surfaces, bounds, voxel) };
    let depth = depth_for(bounds, voxel);
    assert!(depth <= DEPTH_MAX, "the grid fits an octree");
    let origin = (bounds.min / voxel).floor() * voxel - (1.0 - GRID_SHIFT) * voxel;
    let grid = Grid { surfaces, light, palette: Palette::new(surfaces), origin, voxel, depth };
    let blocks = grid.scatter().ok_or_else(too_many)?;
    let (filled, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let cancelled = AtomicBool::new(false);
    let parts = blocks
        .par_iter()
        .map(|(&key, triangles)| {
            let mut voxels = Vec::new();
            // Once there are too many voxels, the rest is not made: the result is an error.
            let given_up = filled.load(Ordering::Relaxed) > VOXELS_MAX;
            if given_up || cancelled.load(Ordering::Relaxed) {
                return Ok(None);
            }
            grid.fill(key, triangles, &mut voxels);
            filled.fetch_add(voxels.len(), Ordering::Relaxed);
            let share = (done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / blocks.len() as f32;
            if progress(share).is_break() {
                cancelled.store(true, Ordering::Relaxed);
            }
            VoxelBlock::new(depth, &voxels)
        })
        .collect::<Result<Vec<_>, _>>()?;
    if cancelled.into_inner() {
        return Err(VoxeliseError::Cancelled);
    }
    if filled.into_inner() > VOXELS_MAX {
        return Err(too_many());
    }
    Ok(Octree::from_blocks(origin, voxel, depth, parts.into_iter().flatten().collect())?)
}

/// A triangle of a surface, by indices.
#[derive(Clone, Copy)]
struct Face {
    surface: u32,
    triangle: u32,
}

/// The voxel grid, and what fills it.
struct Grid<'a> {
    surfaces: &'a [Surface],
    light: Option<&'a Light>,
    palette: Palette,
    origin: Vec3,
    voxel: f32,
    depth: u8,
}

impl Grid<'_> {
    /// The triangles that touch each block. `None` when there are too many.
    fn scatter(&self) -> Option<BTreeMap<u64, Vec<Face>>> {
        let mut blocks = BTreeMap::<u64, Vec<Face>>::new();
        let mut total = 0;
        for (index, surface) in self.surfaces.iter().enumerate() {
            for triangle in 0..surface.triangles.len() {
                let corners = surface.corners_of(triangle);
                let corners = corners.map(|corners| self.to_grid(corners, Vec3::ZERO));
                let Some(overlap) = corners.and_then(Overlap::new) else { continue };
                let face = Face { surface: index as u32, triangle: triangle as u32 };
                let levels = self.depth - self.depth.min(BLOCK_LEVELS);
                let width = (1u32 << self.depth) as f32;
                each_block(&overlap, Vec3::ZERO, width, levels, 0, &mut |key| {
                    total += 1;
                    if total <= SCATTERED_MAX {
                        blocks.entry(key).or_default().push(face);
                    }
                });
            }
        }
        (total <= SCATTERED_MAX).then_some(blocks)
    }

    /// Corners in voxels, from a corner of the grid. The way leads through f64: far from the
    /// origin, f32 has no digits left for parts of a voxel.
    fn to_grid(&self, corners: [Vec3; 3], from: Vec3) -> [Vec3; 3] {
        let (origin, from) = (self.origin.as_dvec3(), from.as_dvec3());
        corners.map(|c| ((c.as_dvec3() - origin) / f64::from(self.voxel) - from).as_vec3())
    }

    /// Appends the voxels of a block, in ascending order of key.
    fn fill(&self, key: u64, faces: &[Face], voxels: &mut Vec<Voxel>) {
        let levels = self.depth.min(BLOCK_LEVELS);
        let corner = unmorton(key) << u32::from(levels);
        let corner_grid = corner.as_vec3();
        let candidates = faces
            .iter()
            .filter_map(|&face| {
                let surface = &self.surfaces[face.surface as usize];
                let corners = surface.corners_of(face.triangle as usize)?;
                let overlap = Overlap::new(self.to_grid(corners, corner_grid))?;
                let material =
                    self.palette.material_of(surface, face.triangle as usize, self.voxel)?;
                let light = self
                    .light
                    .and_then(|light| light.of(face.surface as usize, face.triangle as usize));
                Some(Candidate { overlap, material, corners, light })
            })
            .collect::<Vec<_>>();
        let touching = (0..candidates.len() as u32).map(Touching::new).collect();
        let mut block = Block { candidates, touching, first_key: morton(corner), voxels };
        block.descend(0, UVec3::ZERO, levels);
        debug_assert!(voxels.is_sorted_by_key(|voxel| voxel.key), "voxels are in order of key");
    }
}

/// Calls `found` with the key of each block that a triangle touches.
fn each_block(
    overlap: &Overlap,
    corner: Vec3,
    width: f32,
    levels: u8,
    key: u64,
    found: &mut impl FnMut(u64),
) {
    let half = width * 0.5;
    if !overlap.touches(corner + half, half) {
        return;
    }
    if levels == 0 {
        return found(key);
    }
    for octant in 0..8 {
        let corner = corner + octant_corner(octant).as_vec3() * half;
        each_block(overlap, corner, half, levels - 1, key << 3 | octant, found);
    }
}

/// The corner with the least coordinates of an octant, in a cube of edge 2.
fn octant_corner(octant: u64) -> UVec3 {
    let octant = octant as u32;
    UVec3::new(octant & 1, octant >> 1 & 1, octant >> 2 & 1)
}

/// The coordinates that [`morton`] interleaved.
fn unmorton(key: u64) -> UVec3 {
    let mut at = UVec3::ZERO;
    for bit in 0..16 {
        let octant = (key >> (3 * bit)) as u32;
        at |= UVec3::new(octant & 1, octant >> 1 & 1, octant >> 2 & 1) << bit;
    }
    at
}

/// A triangle that touches a block.
struct Candidate<'a> {
    overlap: Overlap,
    material: TriangleMaterial<'a>,
    /// In metres.
    corners: [Vec3; 3],
    light: Option<PatchLight<'a>>,
}

impl Candidate<'_> {
    /// The sRGB colour, from 0 to 1, at the place that is nearly the nearest to a point in voxels.
    fn colour(&self, point: Vec3) -> Vec3 {
        let weights = self.overlap.weights(point);
        let shade = self.light.map_or(Shade::Factor(1.0), |light| {
            let [a, b, c] = self.corners;
            light.at(a * weights[0] + b * weights[1] + c * weights[2])
        });
        self.material.colour(weights, shade)
    }
}

/// A candidate that touches a cube.
#[derive(Clone, Copy)]
struct Touching {
    candidate: u32,
    /// Whether the cube lies wholly between the triangle's edges, so that the plane alone decides
    /// which parts of the cube it touches.
    is_between: bool,
}

impl Touching {
    /// A candidate that may touch anything.
    fn new(candidate: u32) -> Self {
        Self { candidate, is_between: false }
    }
}

/// A block that is being filled.
struct Block<'a> {
    candidates: Vec<Candidate<'a>>,
    /// What touches the cubes on the way from the block to the present one, one after the other.
    touching: Vec<Touching>,
    first_key: u64,
    voxels: &'a mut Vec<Voxel>,
}

impl Block<'_> {
    /// Adds the voxels of a cube that the candidates from `start` on touch.
    fn descend(&mut self, start: usize, corner: UVec3, levels: u8) {
        if levels == 0 {
            let voxel = self.voxel(&self.touching[start..], corner);
            self.voxels.push(voxel);
            return;
        }
        let width = 1u32 << (levels - 1);
        let end = self.touching.len();
        for octant in 0..8 {
            let corner = corner + octant_corner(octant) * width;
            let half = width as f32 * 0.5;
            let centre = corner.as_vec3() + half;
            for index in start..end {
                let touching = self.touching[index];
                let overlap = &self.candidates[touching.candidate as usize].overlap;
                let touches = if touching.is_between {
                    overlap.plane_touches(centre, half)
                } else {
                    overlap.touches(centre, half)
                };
                if touches {
                    let is_between =
                        touching.is_between || levels > 1 && overlap.is_between(centre, half);
                    self.touching.push(Touching { is_between, ..touching });
                }
            }
            if self.touching.len() > end {
                self.descend(end, corner, levels - 1);
                self.touching.truncate(end);
            }
        }
    }

    /// The material of a voxel: the mean of what touches it, weighted by the area inside. Glass
    /// counts only where there is nothing else.
    fn voxel(&self, touching: &[Touching], corner: UVec3) -> Voxel {
        let candidates =
            touching.iter().map(|touching| &self.candidates[touching.candidate as usize]);
        let glass = candidates.clone().all(|candidate| candidate.material.glass);
        let centre = corner.as_vec3() + 0.5;
        let mut mean = MaterialMean::default();
        for candidate in candidates.filter(|candidate| candidate.material.glass == glass) {
            let area = if touching.len() == 1 { 1.0 } else { candidate.overlap.area_in(centre) };
            mean.add(area, candidate.colour(centre), candidate.overlap.normal());
        }
        mean.voxel(self.first_key + morton(corner), glass)
    }
}

#[cfg(test)]
mod tests;
