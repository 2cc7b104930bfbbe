//! Cells and portals: space split along what occludes, and the open part of each boundary.
//!
//! It happens in two steps. First *spaces*: between solids where the model has them (`solids`),
//! along surfaces where it does not (`surfaces`). Between two spaces there are *gates*. Then each
//! space is split further into *cells*, since much less can be seen from a part of a hall than from
//! somewhere in it; between cells there are *portals*.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use sightline_world::{
    Cell, CellId, Cells, Gate, Node, Polygon, Portal, Space,
    geometry::{Aabb, Axes},
    tolerance::{CLOSED_M, ON_PLANE_F32_M, SLIVER_M},
};

use super::{
    model::ConvexSolid,
    occluders::{OccluderPlane, Rect, uncovered},
};
use draft::{BspNode, BspTree, SharedFace};
use region::{Region, SplitPlane, part};

mod draft;
pub mod region;
mod solids;
mod surfaces;

/// Walls and slabs are no thicker than this, in metres.
const WALL_MAX: f32 = 0.6;
/// No deeper: the world file's reader allows twice as much.
const DEPTH_MAX: u16 = 256;

/// What occludes.
pub struct SubdivisionInput<'a> {
    /// Opaque surfaces, by plane, in own axes.
    pub planes: &'a [OccluderPlane],
    /// What is opaque all through. When there is any, surfaces do not count: they are its faces.
    pub solids: &'a [ConvexSolid],
    /// Eyes are sure to be in some of these places; spaces between solids that no sight line from
    /// there gets into count as solid.
    pub eyes: &'a [Vec3],
}

/// How finely spaces are split into cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellSize {
    /// No cell is wider, in metres.
    pub width_max: f32,
    /// No cell is higher, in metres.
    pub height_max: f32,
}

impl CellSize {
    /// Every space is one cell.
    pub const WHOLE: Self = Self { width_max: f32::INFINITY, height_max: f32::INFINITY };

    /// Cells of this width, in metres. They are higher than wide, since eyes move on floors.
    pub fn of_width(width_max: f32) -> Self {
        Self { width_max, height_max: width_max * 1.5 }
    }

    /// Into how many cells a box of this size is split, roughly.
    pub fn cells_in(&self, size: Vec3) -> f64 {
        let cell = Vec3::new(self.width_max, self.height_max, self.width_max);
        (size / cell).ceil().max(Vec3::ONE).as_dvec3().element_product()
    }
}

/// A building split along its occluders.
pub struct Spaces {
    bounds: Aabb,
    axes: Axes,
    draft: BspTree,
    /// Which leaves of the draft are spaces.
    kept: Vec<bool>,
    gates: Vec<(SharedFace, Polygon)>,
}

impl Spaces {
    /// Splits a region, given in own axes.
    pub fn new(bounds: &Aabb, axes: Axes, occluders: &SubdivisionInput<'_>) -> Self {
        let draft = if occluders.solids.is_empty() {
            surfaces::split(bounds, occluders.planes)
        } else {
            solids::split(bounds, occluders.solids)
        };
        let joins = draft.joins(0, &Region::new(*bounds));
        let gates: Vec<(SharedFace, Polygon)> = joins
            .into_par_iter()
            .flat_map_iter(|join| open_parts(join, occluders.planes))
            .collect();
        let kept = kept(&draft, &gates, occluders);
        Self { bounds: *bounds, axes, draft, kept, gates }
    }

    /// Splits the spaces into cells, and finds the portals between these. The PVS is left empty.
    pub fn cells(&self, grain: &CellSize) -> Cells {
        let mut builder = Builder {
            spaces_in: self,
            grain: *grain,
            fine: BspTree::default(),
            spaces: Vec::new(),
            space_of: vec![u32::MAX; self.draft.leaves.len()],
            roots: Vec::new(),
        };
        builder.refine(0);
        builder.finish()
    }
}

/// The open parts of where two spaces join.
fn open_parts(join: SharedFace, planes: &[OccluderPlane]) -> Vec<(SharedFace, Polygon)> {
    let Some(plane) = join.plane else {
        let polygon = polygon(&join.cut, &join.polygon);
        return polygon.map(|polygon| (join, polygon)).into_iter().collect();
    };
    let plane = &planes[plane as usize];
    let flat: Vec<DVec2> = join.polygon.iter().map(|&corner| join.cut.flat(corner)).collect();
    let around = Rect {
        min: flat.iter().fold(DVec2::INFINITY, |a, &b| a.min(b)),
        max: flat.iter().fold(DVec2::NEG_INFINITY, |a, &b| a.max(b)),
    };
    uncovered(&around, &plane.overlapping(&around))
        .into_iter()
        .filter_map(|free| {
            let corners = within(&join, &free);
            let polygon = polygon(&join.cut, &corners)?;
            let SharedFace { leaves, cut, plane, .. } = join;
            Some((SharedFace { leaves, cut, plane, polygon: corners }, polygon))
        })
        .collect()
}

/// What a rectangle in a join's plane and the join's polygon share.
fn within(join: &SharedFace, free: &Rect) -> Vec<DVec3> {
    let corners = free.corners().map(|corner| join.cut.upright(corner));
    let normal = join.cut.normal();
    let centre = join.polygon.iter().sum::<DVec3>() / join.polygon.len() as f64;
    let mut kept = corners.to_vec();
    for (i, &from) in join.polygon.iter().enumerate() {
        let along = join.polygon[(i + 1) % join.polygon.len()] - from;
        let Some(inwards) = normal.cross(along).try_normalize() else { continue };
        let inwards = if inwards.dot(centre - from) < 0.0 { -inwards } else { inwards };
        let edge = SplitPlane::Plane { normal: inwards, distance: inwards.dot(from) - SLIVER_M };
        kept = part(&kept, &edge, true);
    }
    kept
}

/// How far apart the nearest two parallel lines are that hold a convex polygon between them, one
/// along an edge, in metres.
fn width(corners: &[DVec3]) -> f64 {
    let across = |i: usize| {
        let (from, to) = (corners[i], corners[(i + 1) % corners.len()]);
        let along = (to - from).try_normalize()?;
        let away = |&corner: &DVec3| (corner - from).reject_from_normalized(along).length();
        corners.iter().map(away).max_by(f64::total_cmp)
    };
    (0..corners.len()).filter_map(across).min_by(f64::total_cmp).unwrap_or(0.0)
}

/// A convex polygon as the world has it; none when it counts as closed.
fn polygon(cut: &SplitPlane, corners: &[DVec3]) -> Option<Polygon> {
    if corners.len() < 3 || width(corners) < CLOSED_M {
        return None;
    }
    let bounds = Aabb::from_points(corners.iter().map(|corner| corner.as_vec3()));
    if let SplitPlane::Axial { axis, .. } = *cut {
        let flat: Vec<DVec2> = corners.iter().map(|&corner| cut.flat(corner)).collect();
        let on_side = |&corner: &DVec2| {
            let (min, max) = (cut.flat(bounds.min.as_dvec3()), cut.flat(bounds.max.as_dvec3()));
            let is_near = |at: f64, side: f64| (at - side).abs() < ON_PLANE_F32_M;
            (0..2).all(|i| is_near(corner[i], min[i]) || is_near(corner[i], max[i]))
        };
        if flat.iter().all(on_side) {
            return Some(Polygon::Rectangle { axis: axis as u8, bounds });
        }
    }
    let corners = corners.iter().map(|corner| corner.as_vec3()).collect();
    Some(Polygon::Other { normal: cut.normal(), corners })
}

/// Which leaves of the draft are spaces in which somebody can be.
fn kept(
    draft: &BspTree,
    gates: &[(SharedFace, Polygon)],
    occluders: &SubdivisionInput<'_>,
) -> Vec<bool> {
    let mut next = vec![Vec::new(); draft.leaves.len()];
    for (SharedFace { leaves: [a, b], .. }, _) in gates {
        next[*a as usize].push(*b);
        next[*b as usize].push(*a);
    }
    if occluders.solids.is_empty() {
        // The inside of walls and slabs.
        let is_wall = |leaf: &Region| leaf.bounds.size().min_element() <= WALL_MAX;
        return (0..)
            .zip(&draft.leaves)
            .map(|(i, leaf)| {
                let i: usize = i;
                !(next[i].is_empty() && is_wall(leaf))
            })
            .collect();
    }
    let mut reached = vec![false; draft.leaves.len()];
    let starts = occluders.eyes.iter().filter_map(|eye| draft.leaf_at(eye.as_dvec3()));
    let mut open: Vec<u32> = starts.collect();
    if open.is_empty() {
        return vec![true; draft.leaves.len()];
    }
    while let Some(leaf) = open.pop() {
        if !std::mem::replace(&mut reached[leaf as usize], true) {
            open.extend(&next[leaf as usize]);
        }
    }
    reached
}

struct Builder<'a> {
    spaces_in: &'a Spaces,
    grain: CellSize,
    /// The final tree. Its leaves are the cells.
    fine: BspTree,
    spaces: Vec<(Range<u32>, Region)>,
    /// For each leaf of the draft, its space.
    space_of: Vec<u32>,
    /// For each space, its node in the final tree.
    roots: Vec<u32>,
}

impl Builder<'_> {
    /// Adds a subtree of the draft, its spaces split into cells.
    fn refine(&mut self, node: u32) -> u32 {
        match &self.spaces_in.draft.nodes[node as usize] {
            BspNode::Split { cut, plane, sides } => {
                let index = self.fine.reserve();
                let sides = sides.map(|side| self.refine(side));
                self.fine.set_split(index, *cut, *plane, sides);
                index
            }
            BspNode::Leaf(leaf) if self.spaces_in.kept[*leaf as usize] => {
                let region = &self.spaces_in.draft.leaves[*leaf as usize];
                let start = self.fine.leaves.len() as u32;
                self.space_of[*leaf as usize] = self.spaces.len() as u32;
                let root = self.split_open(region.clone());
                self.spaces.push((start..self.fine.leaves.len() as u32, region.clone()));
                self.roots.push(root);
                root
            }
            BspNode::Leaf(_) | BspNode::Solid => self.fine.solid(),
        }
    }

    /// Adds the subtree of a space.
    fn split_open(&mut self, region: Region) -> u32 {
        let Some((bounds, _)) = region.extent() else { return self.fine.solid() };
        let size = bounds.size();
        let too =
            size / Vec3::new(self.grain.width_max, self.grain.height_max, self.grain.width_max);
        let axis = (0..3).max_by(|&a, &b| too[a].total_cmp(&too[b])).unwrap_or(0);
        if too[axis] <= 1.0 || size.min_element() <= WALL_MAX && too[axis] <= 2.0 {
            return self.fine.space(region);
        }
        let cut = SplitPlane::Axial { axis, at: bounds.centre()[axis] };
        let index = self.fine.reserve();
        let sides = region.halves(&cut).map(|half| self.split_open(half.tightened()));
        self.fine.set_split(index, cut, None, sides);
        index
    }

    fn finish(self) -> Cells {
        let Spaces { bounds, axes, gates, .. } = self.spaces_in;
        let mut spaces: Vec<Space> = self
            .spaces
            .iter()
            .map(|(cells, region)| {
                let bounds = region.extent().map_or(region.bounds, |(bounds, _)| bounds);
                Space { bounds, cells: cells.clone(), gates: Vec::new() }
            })
            .collect();
        let mut portals = Vec::new();
        let mut found = Vec::new();
        for (space, (_, region)) in self.spaces.iter().enumerate() {
            found.extend(self.fine.joins(self.roots[space], region));
        }
        let mut world_gates = Vec::new();
        for (join, polygon) in gates {
            let ids = join.leaves.map(|leaf| self.space_of[leaf as usize]);
            if ids.contains(&u32::MAX) {
                continue;
            }
            for space in ids {
                spaces[space as usize].gates.push(world_gates.len() as u32);
            }
            world_gates.push(Gate { spaces: ids, polygon: polygon.clone() });
            let roots = ids.map(|space| self.roots[space as usize]);
            self.fine.join_across(roots, &join.cut, None, join.polygon.clone(), &mut found);
        }
        let mut cells: Vec<Cell> = Vec::with_capacity(self.fine.leaves.len());
        for (space, (range, _)) in (0..).zip(&self.spaces) {
            for leaf in range.clone() {
                let region = &self.fine.leaves[leaf as usize];
                let bounds = region.extent().map_or(region.bounds, |(bounds, _)| bounds);
                cells.push(Cell { bounds, space, portals: Vec::new() });
            }
        }
        for join in found {
            let Some(polygon) = polygon(&join.cut, &join.polygon) else { continue };
            for cell in join.leaves {
                cells[cell as usize].portals.push(portals.len() as u32);
            }
            portals.push(Portal { cells: join.leaves.map(CellId), polygon });
        }
        let tree = self.fine.nodes.iter().map(world_node).collect();
        let gates = world_gates;
        Cells { axes: *axes, bounds: *bounds, tree, cells, portals, spaces, gates, pvs: Vec::new() }
    }
}

fn world_node(node: &BspNode) -> Node {
    match *node {
        BspNode::Split { cut: SplitPlane::Axial { axis, at }, sides, .. } => {
            Node::Axial { axis: axis as u8, at, sides }
        }
        BspNode::Split { cut: SplitPlane::Plane { normal, distance }, sides, .. } => {
            Node::Plane { normal, distance, sides }
        }
        BspNode::Leaf(leaf) => Node::Leaf(CellId(leaf)),
        BspNode::Solid => Node::Solid,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::occluders::{Opaque, planes};

    /// A rectangle perpendicular to an axis, as two triangles.
    fn rect(axis: usize, at: f32, min: [f64; 2], max: [f64; 2]) -> [[DVec3; 3]; 2] {
        let corners = Rect { min: min.into(), max: max.into() }.corners();
        let [a, b, c, d] = corners.map(|p| SplitPlane::Axial { axis, at }.upright(p));
        [[a, b, c], [a, c, d]]
    }

    fn bounds() -> Aabb {
        Aabb::new(Vec3::ZERO, Vec3::new(10.0, 3.0, 4.0))
    }

    fn split(opaque: &[[DVec3; 3]], grain: &CellSize) -> Cells {
        let opaque = opaque.iter().map(|&corners| Opaque { corners, is_last: false });
        let planes = planes(&opaque.collect::<Vec<_>>());
        let occluders = SubdivisionInput { planes: &planes, solids: &[], eyes: &[] };
        Spaces::new(&bounds(), Axes::WORLD, &occluders).cells(grain)
    }

    #[test]
    fn an_empty_region_is_one_cell() {
        let cells = split(&[], &CellSize::WHOLE);
        assert_eq!((cells.cells.len(), cells.portals.len()), (1, 0));
        assert_eq!(cells.at(Vec3::ONE), Some(CellId(0)));
    }

    #[test]
    fn a_wall_with_a_door_makes_two_cells_and_one_portal() {
        let wall = [
            rect(0, 5.0, [0.0, 0.0], [3.0, 1.5]),
            rect(0, 5.0, [0.0, 2.5], [3.0, 4.0]),
            rect(0, 5.0, [2.0, 1.5], [3.0, 2.5]),
        ];
        let cells = split(wall.as_flattened(), &CellSize::WHOLE);
        assert_eq!(cells.cells.len(), 2);
        let door = Aabb::new(Vec3::new(5.0, 0.0, 1.5), Vec3::new(5.0, 2.0, 2.5));
        assert_eq!(
            cells.portals.iter().map(|p| p.polygon.bounds()).collect::<Vec<_>>(),
            vec![door]
        );
        assert_ne!(cells.at(Vec3::new(4.9, 1.0, 2.0)), cells.at(Vec3::new(5.1, 1.0, 2.0)));
        let mut found = Vec::new();
        cells.overlapping(&Aabb::around(Vec3::new(5.0, 1.0, 2.0), 0.1), &mut found);
        assert_eq!(found, vec![CellId(0), CellId(1)]);
    }

    #[test]
    fn something_small_makes_no_cell() {
        let shelf = rect(1, 1.0, [1.0, 1.0], [2.0, 1.5]);
        assert_eq!(split(&shelf, &CellSize::WHOLE).cells.len(), 1);
    }

    #[test]
    fn cells_lie_in_one_space_each_and_are_not_wide() {
        let wall = [rect(0, 5.0, [0.0, 0.0], [3.0, 1.5]), rect(0, 5.0, [0.0, 2.5], [3.0, 4.0])];
        let large = split(wall.as_flattened(), &CellSize::WHOLE);
        let small = split(wall.as_flattened(), &CellSize { width_max: 3.0, height_max: 4.0 });
        assert_eq!((large.cells.len(), small.cells.len()), (2, 8));
        assert_eq!((large.spaces.len(), small.spaces.len()), (2, 2));
        for place in &small.cells {
            let around = large.at(place.bounds.centre()).unwrap();
            assert!(large.cells[around.0 as usize].bounds.contains_box(&place.bounds));
            assert!(small.spaces[place.space as usize].bounds.contains_box(&place.bounds));
            assert!(place.bounds.size().x <= 3.0 && place.bounds.size().z <= 3.0);
        }
        // Four inside each room, and the door cut in two.
        assert_eq!(small.portals.len(), 4 + 4 + 2);
    }
}
