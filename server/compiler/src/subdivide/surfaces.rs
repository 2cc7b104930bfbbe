//! Spaces along surfaces (Teller and Séquin 1991): each split is along the plane of which the
//! greatest share of the cross-section is opaque.

use glam::{DVec2, DVec3};
use sightline_world::geometry::Aabb;
use sightline_world::tolerance::ON_PLANE_F32_M;

use super::{
    bsp_tree::{BspTree, DEPTH_MAX},
    region::{Region, WALL_MAX},
};
use crate::{
    occluders::{OccluderPlane, PlaneRect, PlaneTriangle},
    split_plane::SplitPlane,
};

/// A plane splits a space when one of its triangles covers at least this area, in square metres,
/// and all opaque triangles together at least [`SHARE_MIN`] of the cross-section. Smaller triangles
/// are furniture: they hide little, and splits along them would make many spaces.
const TRIANGLE_AREA_MIN: f64 = 1.25;
/// The least opaque share of the cross-section; see [`TRIANGLE_AREA_MIN`].
const SHARE_MIN: f64 = 0.1;
/// A plane also splits a space when its opaque area is at least this, in square metres …
const AREA_MIN: f64 = 2.5;
/// … and at least this share of the cross-section, in triangles of any size.
const AREA_SHARE_MIN: f64 = 0.25;
/// Inside walls and slabs a plane splits when this share of the cross-section is opaque. These are
/// jambs, sills and lintels, without which sight would pass sideways through the wall …
const WALL_SHARE_MIN: f64 = 0.35;
/// … and at least this area, in square metres. Frames of panes are smaller.
const WALL_AREA_MIN: f64 = 0.15;
/// Of two opaque planes no farther apart than this, in metres, one is enough. Between them is the
/// inside of a thin wall, or the frame of a pane.
const THIN_MAX: f32 = 0.1;

/// Splits a region along opaque surfaces: along axial planes first, then other vertical planes,
/// then level planes with turned edges, of which only the covered part is left by then.
pub(super) fn split(bounds: &Aabb, planes: &[OccluderPlane]) -> BspTree {
    let mut builder = Builder { planes, tree: BspTree::default() };
    let all = planes
        .iter()
        .enumerate()
        .flat_map(|(plane, p)| {
            let triangles = 0..p.triangles.len() as u32;
            triangles.map(move |triangle| OccluderRef { plane: plane as u32, triangle })
        })
        .collect();
    builder.split(Region::new(*bounds), all, 0);
    builder.tree
}

struct Builder<'a> {
    planes: &'a [OccluderPlane],
    tree: BspTree,
}

/// A triangle of a plane, by indices.
#[derive(Clone, Copy)]
struct OccluderRef {
    plane: u32,
    triangle: u32,
}

impl Builder<'_> {
    /// Adds the subtree of a region. `inside` are the occluders that cross its interior.
    fn split(&mut self, region: Region, inside: Vec<OccluderRef>, depth: u16) -> u32 {
        let chosen = (depth < DEPTH_MAX).then(|| self.best_plane(&region, &inside)).flatten();
        let Some(plane) = chosen else { return self.leaf(region) };
        let index = self.tree.reserve();
        let cut = self.planes[plane as usize].cut;
        let sides = region.halves(&cut).map(|half| {
            let half = half.tightened();
            let is_kept =
                |&occluder: &OccluderRef| occluder.plane != plane && self.crosses(occluder, &half);
            let kept = inside.iter().copied().filter(is_kept).collect();
            self.split(half, kept, depth + 1)
        });
        self.tree.set_split(index, cut, Some(plane), sides);
        index
    }

    fn leaf(&mut self, region: Region) -> u32 {
        if region.extent().is_some() { self.tree.space(region) } else { self.tree.solid() }
    }

    /// Whether part of an occluder lies in the interior of a region.
    fn crosses(&self, occluder: OccluderRef, region: &Region) -> bool {
        let OccluderRef { plane, triangle } = occluder;
        let OccluderPlane { cut, ref triangles, .. } = self.planes[plane as usize];
        if let SplitPlane::Axial { axis, at } = cut
            && !(region.bounds.min[axis] < at && at < region.bounds.max[axis])
        {
            return false;
        }
        let section = Section::new(region, &cut);
        section.area > 0.0 && section.covered(&triangles[triangle as usize]) > 0.0
    }

    /// The plane to split along: of the first kind there is, the one with the greatest opaque
    /// share; among similar ones, the one nearest the middle.
    fn best_plane(&self, region: &Region, inside: &[OccluderRef]) -> Option<u32> {
        inside
            .chunk_by(|a, b| a.plane == b.plane)
            .filter_map(|on_plane| {
                let plane = on_plane[0].plane;
                let OccluderPlane { cut, is_last, .. } = &self.planes[plane as usize];
                let rank = match cut {
                    SplitPlane::Axial { .. }
                        if on_plane.iter().any(|of| !is_last[of.triangle as usize]) =>
                    {
                        2
                    }
                    SplitPlane::Axial { .. } => 0,
                    SplitPlane::Plane { .. } => 1,
                };
                Some((plane, rank, self.worth(region, on_plane)?))
            })
            .max_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)).then(b.0.cmp(&a.0)))
            .map(|(plane, ..)| plane)
    }

    /// The benefit of a split along a plane. None when the region is better left whole.
    fn worth(&self, region: &Region, on_plane: &[OccluderRef]) -> Option<f64> {
        let OccluderPlane { cut, ref triangles, .. } = self.planes[on_plane[0].plane as usize];
        let section = Section::new(region, &cut);
        let (mut area, mut largest) = (0.0, 0.0f64);
        for occluder in on_plane {
            let part = section.covered(&triangles[occluder.triangle as usize]);
            area += part;
            largest = largest.max(part);
        }
        // Overlapping triangles count twice, but the share is at most 1.
        let share = (area / section.area).min(1.0);
        let in_wall = region.bounds.size().min_element() <= WALL_MAX;
        let enough = (largest >= TRIANGLE_AREA_MIN && share >= SHARE_MIN)
            || (area >= AREA_MIN && share >= AREA_SHARE_MIN)
            || (in_wall && share >= WALL_SHARE_MIN && area >= WALL_AREA_MIN);
        if !enough || self.repeats_boundary(region, &cut, area) {
            return None;
        }
        let off_middle = match cut {
            SplitPlane::Axial { axis, at } => {
                ((at - region.bounds.min[axis]) / region.bounds.size()[axis] - 0.5).abs() * 2.0
            }
            SplitPlane::Plane { .. } => 0.0,
        };
        Some(share - 0.1 * f64::from(off_middle))
    }

    /// Whether the plane lies close to a side of the region that already hides as much.
    fn repeats_boundary(&self, region: &Region, cut: &SplitPlane, area: f64) -> bool {
        let SplitPlane::Axial { axis, at } = *cut else { return false };
        let near = |side: f32| (side - at).abs() <= THIN_MAX;
        [region.bounds.min[axis], region.bounds.max[axis]]
            .into_iter()
            .filter(|&side| near(side))
            .filter_map(|side| self.plane_at(axis, side))
            .any(|plane| {
                let section = Section::new(region, &plane.cut);
                let found = plane.overlapping(&section.around);
                let opaque: f64 = found.iter().map(|triangle| section.covered(triangle)).sum();
                opaque >= 0.95 * area
            })
    }

    fn plane_at(&self, axis: usize, at: f32) -> Option<&OccluderPlane> {
        // Axial planes come first, by axis and then ascending.
        let before = |p: &OccluderPlane| match p.cut {
            SplitPlane::Axial { axis: a, at: there } => (a, there) < (axis, at),
            SplitPlane::Plane { .. } => false,
        };
        let index = self.planes.partition_point(before);
        self.planes.get(index).filter(|p| p.cut == SplitPlane::Axial { axis, at })
    }
}

/// The section of a region with a plane, in the coordinates of the plane.
struct Section {
    /// The corners, anticlockwise.
    polygon: Vec<DVec2>,
    around: PlaneRect,
    is_rect: bool,
    area: f64,
}

impl Section {
    fn new(region: &Region, cut: &SplitPlane) -> Self {
        let polygon: Vec<DVec2> =
            region.section(cut).iter().map(|&corner: &DVec3| cut.flat(corner)).collect();
        let around = polygon
            .iter()
            .fold(PlaneRect { min: DVec2::INFINITY, max: DVec2::NEG_INFINITY }, |r, &c| {
                PlaneRect { min: r.min.min(c), max: r.max.max(c) }
            });
        let mut polygon = polygon;
        let mut area = area(&polygon);
        if area < 0.0 {
            polygon.reverse();
            area = -area;
        }
        let is_rect = (around.area() - area).abs() <= 1e-9 * area;
        Self { polygon, around, is_rect, area }
    }

    /// The area that a triangle covers, in square metres.
    fn covered(&self, triangle: &PlaneTriangle) -> f64 {
        let around = PlaneRect::around(triangle).intersection(&self.around);
        if around.is_flat() {
            return 0.0;
        }
        let mut part = triangle.to_vec();
        if self.is_rect {
            for coordinate in 0..2 {
                part = keep(&part, |p| p[coordinate] - self.around.min[coordinate]);
                part = keep(&part, |p| self.around.max[coordinate] - p[coordinate]);
            }
        } else {
            for (i, &from) in self.polygon.iter().enumerate() {
                let along = self.polygon[(i + 1) % self.polygon.len()] - from;
                part = keep(&part, |p| along.perp_dot(p - from));
            }
        }
        let area = area(&part);
        if area > ON_PLANE_F32_M * ON_PLANE_F32_M { area } else { 0.0 }
    }
}

/// The area of a convex polygon, in square metres; negative when it runs clockwise.
fn area(polygon: &[DVec2]) -> f64 {
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
