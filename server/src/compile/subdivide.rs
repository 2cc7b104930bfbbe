//! Cells and portals: a k-d tree split along the axial occluders, after Teller and Séquin, and
//! the uncovered part of each boundary between two leaves.

use glam::{DVec2, Vec3};
use sightline_shared::{
    geometry::Aabb,
    world::{Cell, CellId, Cells, KdNode, Portal},
};

use super::occluders::{OccluderPlane, Rect, Triangle2, in_plane, other_axes, uncovered};

/// A plane splits a cell when one of its triangles covers at least this much, in square metres, and
/// what is opaque on it at least this part of the cross-section. What is smaller is furniture: it
/// hides little, and splitting along it would make many cells.
const TRIANGLE_AREA_MIN: f64 = 1.25;
/// See [`TRIANGLE_AREA_MIN`].
const SHARE_MIN: f64 = 0.1;
/// Inside walls and slabs, which are no thicker than this, in metres …
const WALL_MAX: f32 = 0.6;
/// … a plane splits when this part of the cross-section is opaque: the jambs, sills and lintels of
/// doors and windows, without which one would see sideways through the wall …
const WALL_SHARE_MIN: f64 = 0.35;
/// … and at least this much, in square metres: not the frames of panes.
const WALL_AREA_MIN: f64 = 0.15;
/// Of two opaque planes that are no farther apart than this, in metres, one is enough: what is
/// between them is the inside of a thin wall, or the frame of a pane.
const THIN_MAX: f32 = 0.1;
/// Cells of [`Grain::Places`] are no wider than this, in metres.
const PLACE_MAX: f32 = 3.0;
/// No deeper: the world file's reader allows twice as much.
const DEPTH_MAX: u16 = 256;

/// How finely to split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grain {
    /// Along occluders alone: few portals, of which each hides something. Sight lines go through
    /// these.
    Occluders,
    /// The same, and what is open and wide is split further: much less can be seen from a part of
    /// a hall than from somewhere in it. Each cell lies in one cell of [`Grain::Occluders`].
    Places,
}

/// Splits a region into cells and finds their portals. The PVS is left empty.
pub fn subdivide(bounds: &Aabb, planes: &[OccluderPlane], grain: Grain) -> Cells {
    let mut builder =
        Builder { planes, grain, tree: Vec::new(), cells: Vec::new(), portals: Vec::new() };
    let all = planes
        .iter()
        .enumerate()
        .flat_map(|(plane, p)| (0..p.triangles.len()).map(move |t| (plane as u32, t as u32)))
        .collect();
    builder.split(*bounds, all, 0);
    builder.join(0, bounds);
    let Builder { tree, mut cells, portals, .. } = builder;
    for (index, portal) in portals.iter().enumerate() {
        for cell in portal.cells {
            cells[cell.0 as usize].portals.push(index as u32);
        }
    }
    Cells { bounds: *bounds, tree, cells, portals, pvs: Vec::new() }
}

struct Builder<'a> {
    planes: &'a [OccluderPlane],
    grain: Grain,
    tree: Vec<KdNode>,
    cells: Vec<Cell>,
    portals: Vec<Portal>,
}

/// A triangle of a plane: both as indices.
type OccluderRef = (u32, u32);

impl Builder<'_> {
    /// Adds the subtree of a region, split along occluders, of which `inside` are the occluders that cross its interior.
    fn split(&mut self, region: Aabb, inside: Vec<OccluderRef>, depth: u16) -> u32 {
        let index = self.tree.len() as u32;
        let chosen = (depth < DEPTH_MAX).then(|| self.best_plane(&region, &inside)).flatten();
        let Some(plane) = chosen else { return self.split_open(region) };
        let OccluderPlane { axis, at, .. } = self.planes[plane];
        self.tree.push(KdNode::Split { axis: axis as u8, at, sides: [0; 2] });
        let sides = halves(&region, axis, at).map(|half| {
            let kept = inside.iter().copied().filter(|&o| self.crosses(o, &half)).collect();
            self.split(half, kept, depth + 1)
        });
        self.tree[index as usize] = KdNode::Split { axis: axis as u8, at, sides };
        index
    }

    /// Whether an occluder has a part in the interior of a region.
    fn crosses(&self, (plane, triangle): OccluderRef, region: &Aabb) -> bool {
        let OccluderPlane { axis, at, ref triangles, .. } = self.planes[plane as usize];
        region.min[axis] < at
            && at < region.max[axis]
            && clipped_area(&triangles[triangle as usize], &section(region, axis)) > 0.0
    }

    /// Adds the subtree of a region without occluders to split along.
    fn split_open(&mut self, region: Aabb) -> u32 {
        let index = self.tree.len() as u32;
        let size = region.size();
        let axis = if size.x >= size.z { 0 } else { 2 };
        let is_wide = size[axis] > PLACE_MAX && size.min_element() > WALL_MAX;
        if self.grain == Grain::Occluders || !is_wide {
            self.tree.push(KdNode::Leaf(CellId(self.cells.len() as u32)));
            self.cells.push(Cell { bounds: region, portals: Vec::new() });
            return index;
        }
        let at = region.centre()[axis];
        self.tree.push(KdNode::Split { axis: axis as u8, at, sides: [0; 2] });
        let sides = halves(&region, axis, at).map(|half| self.split_open(half));
        self.tree[index as usize] = KdNode::Split { axis: axis as u8, at, sides };
        index
    }

    /// The plane of which the greatest share of the cross-section is opaque; among those alike,
    /// the one nearest the middle.
    fn best_plane(&self, region: &Aabb, inside: &[OccluderRef]) -> Option<usize> {
        inside
            .chunk_by(|a, b| a.0 == b.0)
            .filter_map(|on_plane| Some((on_plane[0].0 as usize, self.worth(region, on_plane)?)))
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .map(|(index, _)| index)
    }

    /// How good it is to split a region along a plane; none when the region is better left whole.
    fn worth(&self, region: &Aabb, on_plane: &[OccluderRef]) -> Option<f64> {
        let OccluderPlane { axis, at, ref triangles, .. } = self.planes[on_plane[0].0 as usize];
        let section = section(region, axis);
        let (mut area, mut largest) = (0.0, 0.0f64);
        for &(_, triangle) in on_plane {
            let part = clipped_area(&triangles[triangle as usize], &section);
            area += part;
            largest = largest.max(part);
        }
        // Overlapping triangles count twice; a share is never more than all.
        let share = (area / section.area()).min(1.0);
        let in_wall = region.size().min_element() <= WALL_MAX;
        let enough = (largest >= TRIANGLE_AREA_MIN && share >= SHARE_MIN)
            || (in_wall && share >= WALL_SHARE_MIN && area >= WALL_AREA_MIN);
        if !enough || self.repeats_boundary(region, axis, at, area) {
            return None;
        }
        let off_middle = ((at - region.min[axis]) / region.size()[axis] - 0.5).abs() * 2.0;
        Some(share - 0.1 * f64::from(off_middle))
    }

    /// Whether a plane lies so close to a side of the region that hides as much.
    fn repeats_boundary(&self, region: &Aabb, axis: usize, at: f32, area: f64) -> bool {
        let near = |side: f32| (side - at).abs() <= THIN_MAX;
        [region.min[axis], region.max[axis]]
            .into_iter()
            .filter(|&side| near(side))
            .filter_map(|side| self.plane_at(axis, side))
            .any(|plane| {
                let section = section(region, axis);
                let opaque: f64 = plane
                    .overlapping(&section)
                    .iter()
                    .map(|triangle| clipped_area(triangle, &section))
                    .sum();
                opaque >= 0.95 * area
            })
    }

    fn plane_at(&self, axis: usize, at: f32) -> Option<&OccluderPlane> {
        // The planes come by axis, then ascending.
        let index = self.planes.partition_point(|p| (p.axis, p.at) < (axis, at));
        self.planes.get(index).filter(|p| (p.axis, p.at) == (axis, at))
    }

    /// Adds the portals between the leaves on both sides of each split of a subtree.
    fn join(&mut self, node: u32, region: &Aabb) {
        if let KdNode::Split { axis, at, sides } = self.tree[node as usize] {
            let axis = usize::from(axis);
            let [low, high] = halves(region, axis, at);
            self.join_across(sides, axis, at, &section(region, axis));
            self.join(sides[0], &low);
            self.join(sides[1], &high);
        }
    }

    /// Adds the portals between a subtree below a plane and one above it, within a rectangle.
    fn join_across(&mut self, nodes: [u32; 2], axis: usize, at: f32, rect: &Rect) {
        if rect.is_flat() {
            return;
        }
        for below in 0..2 {
            let KdNode::Split { axis: a, at: cut, sides } = self.tree[nodes[below] as usize] else {
                continue;
            };
            let replaced = |side| if below == 0 { [side, nodes[1]] } else { [nodes[0], side] };
            if usize::from(a) == axis {
                // Only the side that touches the plane can have a portal on it.
                self.join_across(replaced(sides[1 - below]), axis, at, rect);
            } else {
                let (low, high) = cut_rect(rect, axis, usize::from(a), cut);
                self.join_across(replaced(sides[0]), axis, at, &low);
                self.join_across(replaced(sides[1]), axis, at, &high);
            }
            return;
        }
        if let [KdNode::Leaf(low), KdNode::Leaf(high)] = nodes.map(|n| self.tree[n as usize]) {
            self.add_portals([low, high], axis, at, rect);
        }
    }

    fn add_portals(&mut self, cells: [CellId; 2], axis: usize, at: f32, rect: &Rect) {
        let opaque = self.plane_at(axis, at).map_or(Vec::new(), |plane| plane.overlapping(rect));
        for free in uncovered(rect, &opaque) {
            let bounds = Aabb::new(on_plane(free.min, axis, at), on_plane(free.max, axis, at));
            self.portals.push(Portal { cells, axis: axis as u8, bounds });
        }
    }
}

fn halves(region: &Aabb, axis: usize, at: f32) -> [Aabb; 2] {
    let (mut low, mut high) = (*region, *region);
    low.max[axis] = at;
    high.min[axis] = at;
    [low, high]
}

fn section(region: &Aabb, axis: usize) -> Rect {
    Rect { min: in_plane(region.min, axis), max: in_plane(region.max, axis) }
}

/// A rectangle on a plane perpendicular to `axis`, cut by a plane perpendicular to another axis.
fn cut_rect(rect: &Rect, axis: usize, cut_axis: usize, at: f32) -> (Rect, Rect) {
    let (mut low, mut high) = (*rect, *rect);
    let coordinate = usize::from(other_axes(axis).1 == cut_axis);
    low.max[coordinate] = low.max[coordinate].min(f64::from(at));
    high.min[coordinate] = high.min[coordinate].max(f64::from(at));
    (low, high)
}

/// Rectangles are made of single-precision corners, so that the way back is exact.
fn on_plane(point: DVec2, axis: usize, at: f32) -> Vec3 {
    let (u, v) = other_axes(axis);
    let mut place = Vec3::splat(at);
    place[u] = point.x as f32;
    place[v] = point.y as f32;
    place
}

/// The area of the part of a triangle inside a rectangle, in square metres.
fn clipped_area(triangle: &Triangle2, rect: &Rect) -> f64 {
    let around = Rect::around(triangle).intersection(rect);
    if around.is_flat() {
        return 0.0;
    }
    let mut polygon = triangle.to_vec();
    for coordinate in 0..2 {
        polygon = keep(&polygon, |p| p[coordinate] - rect.min[coordinate]);
        polygon = keep(&polygon, |p| rect.max[coordinate] - p[coordinate]);
    }
    let fan = |i: usize| (polygon[i] - polygon[0]).perp_dot(polygon[i + 1] - polygon[0]);
    (1..polygon.len().saturating_sub(1)).map(fan).sum::<f64>() * 0.5
}

/// The part of a convex polygon where a linear function is not negative.
fn keep(polygon: &[DVec2], inside: impl Fn(DVec2) -> f64) -> Vec<DVec2> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (here, there) = (inside(p), inside(q));
        if here >= 0.0 {
            kept.push(p);
        }
        if here * there < 0.0 {
            kept.push(p.lerp(q, here / (here - there)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compile::occluders::axial_planes;

    /// A rectangle perpendicular to an axis, as two triangles.
    fn rect(axis: usize, at: f32, min: [f64; 2], max: [f64; 2]) -> [[Vec3; 3]; 2] {
        let corners = Rect { min: min.into(), max: max.into() }.corners();
        let [a, b, c, d] = corners.map(|p| on_plane(p, axis, at));
        [[a, b, c], [a, c, d]]
    }

    fn bounds() -> Aabb {
        Aabb::new(Vec3::ZERO, Vec3::new(10.0, 3.0, 4.0))
    }

    #[test]
    fn an_empty_region_is_one_cell() {
        let cells = subdivide(&bounds(), &[], Grain::Occluders);
        assert_eq!((cells.cells.len(), cells.portals.len()), (1, 0));
        assert_eq!(cells.at(Vec3::ONE), CellId(0));
    }

    #[test]
    fn a_wall_with_a_door_makes_two_cells_and_one_portal() {
        let wall = [
            rect(0, 5.0, [0.0, 0.0], [3.0, 1.5]),
            rect(0, 5.0, [0.0, 2.5], [3.0, 4.0]),
            rect(0, 5.0, [2.0, 1.5], [3.0, 2.5]),
        ];
        let cells = subdivide(&bounds(), &axial_planes(wall.as_flattened()), Grain::Occluders);
        assert_eq!(cells.cells.len(), 2);
        let door = Aabb::new(Vec3::new(5.0, 0.0, 1.5), Vec3::new(5.0, 2.0, 2.5));
        assert_eq!(cells.portals.iter().map(|p| p.bounds).collect::<Vec<_>>(), vec![door]);
        assert_ne!(cells.at(Vec3::new(4.9, 1.0, 2.0)), cells.at(Vec3::new(5.1, 1.0, 2.0)));
        let mut found = Vec::new();
        cells.overlapping(&Aabb::around(Vec3::new(5.0, 1.0, 2.0), 0.1), &mut found);
        assert_eq!(found, vec![CellId(0), CellId(1)]);
    }

    #[test]
    fn something_small_makes_no_cell() {
        let shelf = rect(1, 1.0, [1.0, 1.0], [2.0, 1.5]);
        assert_eq!(subdivide(&bounds(), &axial_planes(&shelf), Grain::Occluders).cells.len(), 1);
    }

    #[test]
    fn places_lie_in_one_cell_each_and_are_not_wide() {
        let wall = [rect(0, 5.0, [0.0, 0.0], [3.0, 1.5]), rect(0, 5.0, [0.0, 2.5], [3.0, 4.0])];
        let planes = axial_planes(wall.as_flattened());
        let large = subdivide(&bounds(), &planes, Grain::Occluders);
        let small = subdivide(&bounds(), &planes, Grain::Places);
        assert_eq!((large.cells.len(), small.cells.len()), (2, 8));
        for place in &small.cells {
            let around = &large.cells[large.at(place.bounds.centre()).0 as usize];
            assert!(around.bounds.contains_box(&place.bounds));
            assert!(place.bounds.size().x <= PLACE_MAX && place.bounds.size().z <= PLACE_MAX);
        }
        // Four inside each room, and the door cut in two.
        assert_eq!(small.portals.len(), 4 + 4 + 2);
    }
}
