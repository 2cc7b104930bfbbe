//! Which parts of the octree can be seen from where: what a client needs to have arrived.
//!
//! A **viewpoint** is a space of the building, and a part is a branch of the octree
//! ([`pieces`](sightline_world::octree::pieces)). A line of sight that is free of voxels is free of
//! opaque triangles. Where it meets a voxel, it is in a cell, or at its edge. So a branch that an
//! eye sees has voxels that touch a cell that the eye's cell sees by the PVS. All other branches
//! are ruled out.

use glam::Vec3;
use roaring::RoaringBitmap;
use sightline_world::{
    Viewpoints, World, WorldPieces,
    geometry::Aabb,
    octree::{Cursor, pieces::PartialOctree},
    plan::Plan,
    tolerance::TOUCH_M,
};

/// Nodes of this number of levels count as filled: far away, they are drawn as a whole.
const DRAWN_LEVELS: u8 = 2;

/// Cuts a world into pieces, with plans of the storeys on which soles are at these heights, in
/// metres.
///
/// ```
/// use sightline_visibility::streaming;
/// use sightline_world::WorldHead;
///
/// let world = sightline_fixtures::voxel_floor::world(&[]);
/// let pieces = streaming::pieces_of(&world, &[]);
/// let mut head = WorldHead::read(&pieces.head)?;
/// let seen = head.seen_from(world.spawns[0].eye).expect("the eye is in a cell").clone();
/// for branch in seen {
///     let grades = head.octree.grades();
///     for grade in 0..grades {
///         let number = branch as usize * usize::from(grades) + usize::from(grade);
///         head.octree.grow(branch as usize, &pieces.pieces[number])?;
///     }
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn pieces_of(world: &World, storeys: &[f32]) -> WorldPieces {
    let octree = world.octree.to_pieces();
    let viewpoints = Viewpoints::of(&world.cells);
    let seen = match PartialOctree::new(&octree.trunk) {
        Ok(trunk) => branches_seen(world, &trunk, &viewpoints),
        // A world's own trunk can be read; if not, everything may be seen.
        Err(_) => vec![(0..octree.branches.len() as u32).collect(); viewpoints.len()],
    };
    let plans: Vec<Plan> = storeys.iter().map(|&soles| Plan::new(world, soles)).collect();
    WorldPieces::new(world, octree, &viewpoints, &seen, &plans)
}

/// For each viewpoint, the branches that may be seen from some eye in it.
///
/// The same for equal worlds. It takes a second for some ten thousand cells.
pub fn branches_seen(
    world: &World,
    trunk: &PartialOctree,
    viewpoints: &Viewpoints,
) -> Vec<RoaringBitmap> {
    let cells = &world.cells;
    let touched = Touching { world, trunk };
    let touched: Vec<BitRow> = cells
        .cells
        .iter()
        .map(|cell| {
            let region = cells.axes.world_box(&cell.bounds);
            touched.by(&Aabb::new(region.min - TOUCH_M, region.max + TOUCH_M))
        })
        .collect();
    let seen_from = |&space: &u32| {
        let own = &cells.spaces[space as usize].cells;
        let seen =
            own.clone().fold(RoaringBitmap::new(), |all, cell| all | &cells.pvs[cell as usize]);
        let mut row = vec![0u64; trunk.branches().div_ceil(64)];
        for cell in seen {
            row.iter_mut().zip(&touched[cell as usize]).for_each(|(row, touched)| *row |= touched);
        }
        let is_set = |branch: &u32| row[*branch as usize / 64] >> (branch % 64) & 1 == 1;
        (0..trunk.branches() as u32).filter(is_set).collect()
    };
    viewpoints.spaces().iter().map(seen_from).collect()
}

/// A bit for each branch.
type BitRow = Vec<u64>;

/// Finds the branches with voxels that a box touches.
struct Touching<'a> {
    world: &'a World,
    trunk: &'a PartialOctree,
}

impl Touching<'_> {
    fn by(&self, region: &Aabb) -> BitRow {
        let mut row = vec![0; self.trunk.branches().div_ceil(64)];
        let octree = &self.world.octree;
        if let Some(root) = octree.root() {
            self.descend(
                root,
                &Aabb::new(octree.origin, octree.origin + octree.edge),
                region,
                &mut row,
            );
        }
        row
    }

    fn descend(&self, node: Cursor<'_>, cube: &Aabb, region: &Aabb, row: &mut BitRow) {
        let apart = region.min.cmpgt(cube.max) | region.max.cmplt(cube.min);
        if apart.any() {
            return;
        }
        let edge = cube.size().x;
        let is_small = node.level() + DRAWN_LEVELS >= self.world.octree.depth;
        if edge <= self.trunk.edge_after(0) * 1.5 {
            let Some(branch) = self.trunk.branch_at(cube.centre()) else { return };
            if row[branch / 64] >> (branch % 64) & 1 == 1 {
                return;
            }
            if is_small {
                row[branch / 64] |= 1 << (branch % 64);
                return;
            }
        }
        for (octant, child) in node.children() {
            let half = edge * 0.5;
            let corner = Vec3::from([0, 1, 2].map(|axis| f32::from(octant >> axis & 1)));
            let min = cube.min + corner * half;
            self.descend(child, &Aabb::new(min, min + half), region, row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sightline_fixtures::two_rooms;
    use sightline_world::WorldHead;

    #[test]
    fn what_lies_behind_a_wall_is_not_needed() {
        let world = two_rooms::without_door();
        let head = WorldHead::read(&pieces_of(&world, &[]).head).unwrap();
        let all = head.octree.branches();
        for (x, beyond) in [(3.0, 6.0..12.0), (9.0, 0.0..6.0)] {
            let seen = head.seen_from(Vec3::new(x, 1.6, 3.0)).unwrap();
            assert!(!seen.is_empty() && (seen.len() as usize) < all, "{} of {all}", seen.len());
            for branch in 0..all {
                let bounds = head.octree.bounds_of(branch).unwrap();
                let hidden = bounds.min.x > beyond.start && bounds.max.x < beyond.end;
                assert!(!hidden || !seen.contains(branch as u32), "{bounds:?}");
            }
        }
    }
}
