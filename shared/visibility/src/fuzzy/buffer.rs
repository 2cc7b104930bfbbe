//! The fuzzy buffer: the distance of the nearest non-fuzzy region in every direction (Lim 1999,
//! FIG. 6).

use glam::{DVec2, DVec3, USizeVec2};
use sightline_world::geometry::Aabb;

use super::{
    depths::{DepthPyramid, Occlusion, ProjectedBox, hidden_from},
    faces::{CubeFace, ViewpointBox, projected, region, spans},
    raster::{ROUNDING, elements, rows},
    scan::{FacePlane, FaceRows},
    sub_surfaces::{SubSurface, SubSurfaces},
    surfaces::{PatchSurface, RUN, Surfaces},
    visibility::PatchVisibility,
};

/// For every direction, the greatest distance at which the nearest surface can be that hides what
/// is behind it from all eyes of a box. Distances are from the middle of the box.
#[derive(Clone, Debug)]
pub struct FuzzyBuffer {
    size: usize,
    middle: DVec3,
    /// The depths of each face, by [`CubeFace::index`]. None where a face is inactive.
    faces: [Option<DepthPyramid>; 6],
    /// Whether there are no eyes to see anything.
    is_blind: bool,
}

/// A surface that spans fewer elements each way is not worth projecting.
const ELEMENTS_MIN: f64 = 4.0;
/// Nor is a surface with fewer elements for each facet: curved surfaces hide little for what they
/// cost.
const ELEMENTS_PER_FACET_MIN: f64 = 16.0;
/// Nor is a surface that is not this many times wider than the box of eyes: it has next to no
/// non-fuzzy region.
const WIDER_MIN: f32 = 4.0;

/// Something that may be worth projecting.
struct Candidate<'a> {
    bounds: &'a Aabb,
    /// The number of its facets.
    facets: usize,
    /// Its distance from the middle of the box of eyes, in metres.
    distance: f64,
}

impl FuzzyBuffer {
    /// Projects all surfaces that are wide enough to hide something. Faces have `size` × `size`
    /// elements, from 1 to 4,096 each way.
    pub fn new(surfaces: &Surfaces, viewpoints: &ViewpointBox, size: usize) -> Self {
        let size = size.clamp(1, 4_096);
        let mut buffer = Self {
            size,
            middle: viewpoints.middle(),
            faces: Default::default(),
            is_blind: viewpoints.is_empty(),
        };
        if buffer.is_blind {
            return buffer;
        }
        let width_m = viewpoints.eyes().size().min_element();
        let mut worthy: Vec<(f64, &PatchSurface)> = surfaces
            .surfaces()
            .iter()
            .map(|surface| (buffer.distance(&surface.bounds), surface))
            .filter(|&(distance, PatchSurface { bounds, facets })| {
                buffer.is_worthy(&Candidate { bounds, facets: facets.len(), distance }, width_m)
            })
            .collect();
        worthy.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut sub_surfaces = SubSurfaces::new(surfaces, viewpoints, width_m, size);
        for face in viewpoints.faces() {
            buffer.project_all(face, &worthy, &mut sub_surfaces);
        }
        buffer
    }

    /// The distance from the middle of the box of eyes to a box, along the axis on which it is
    /// greatest.
    fn distance(&self, bounds: &Aabb) -> f64 {
        let (below, above) =
            (bounds.min.as_dvec3() - self.middle, self.middle - bounds.max.as_dvec3());
        below.max(above).max(DVec3::ZERO).max_element()
    }

    /// Whether something may have a non-fuzzy region worth having. `width_m` is the least width of
    /// the box of eyes.
    fn is_worthy(&self, candidate: &Candidate<'_>, width_m: f32) -> bool {
        let &Candidate { bounds, facets, distance } = candidate;
        let width = bounds.size().max_element();
        let elements = 0.5 * f64::from(width) * self.size as f64;
        width > WIDER_MIN * width_m
            && elements > ELEMENTS_MIN * distance
            && elements * elements > ELEMENTS_PER_FACET_MIN * facets as f64 * distance * distance
    }

    /// Fills in a face. Surfaces around the eyes come first. The others follow, nearest first,
    /// unless they are hidden already.
    fn project_all(
        &mut self,
        face: CubeFace,
        worthy: &[(f64, &PatchSurface)],
        sub_surfaces: &mut SubSurfaces<'_>,
    ) {
        let mut depths = DepthPyramid::new(self.size);
        let around = worthy.partition_point(|(distance, _)| *distance == 0.0);
        for (_, surface) in &worthy[..around] {
            self.project_surface(face, surface, sub_surfaces, &mut depths, |_, _| true);
        }
        depths.find_levels();
        let is_open = |depths: &DepthPyramid, bounds: &Aabb| {
            self.test_with(face, bounds, depths).is_some_and(|hidden| hidden != Occlusion::All)
        };
        for (_, surface) in &worthy[around..] {
            if is_open(&depths, &surface.bounds) {
                self.project_surface(face, surface, sub_surfaces, &mut depths, is_open);
            }
        }
        depths.find_levels();
        self.faces[face.index()] = Some(depths);
    }

    /// Projects the sub-surfaces of a surface that are worth it.
    fn project_surface(
        &self,
        face: CubeFace,
        surface: &PatchSurface,
        all: &mut SubSurfaces<'_>,
        depths: &mut DepthPyramid,
        is_open: impl Fn(&DepthPyramid, &Aabb) -> bool,
    ) {
        let surfaces = all.surfaces;
        let found = all.take(surface);
        for sub_surface in &found {
            let SubSurface { bounds, facets, border } = sub_surface;
            let distance = self.distance(bounds);
            let candidate = Candidate { bounds, facets: facets.len(), distance };
            if !self.is_worthy(&candidate, all.width_m) || !is_open(depths, bounds) {
                continue;
            }
            self.scan(face, sub_surface, surfaces, &mut all.rows, &mut all.spare);
            for ends in border {
                let band = region(face, ends, &all.eyes, self.size as f64, &mut all.spare);
                all.rows.erase(&band, self.size);
            }
            all.rows.merge_into(&mut depths.nearest, self.size);
        }
        all.found.insert(surface.facets.start, found);
    }

    /// The number of elements of a face each way.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Whether nearer surfaces hide all of a box from every eye.
    pub fn hides(&self, bounds: &Aabb) -> bool {
        self.is_blind || bounds.is_empty() || self.test(bounds) == Occlusion::All
    }

    /// What the buffer says about a box.
    fn test(&self, bounds: &Aabb) -> Occlusion {
        if !(bounds.min.is_finite() && bounds.max.is_finite()) {
            return Occlusion::Nothing;
        }
        let mut all = Occlusion::All;
        let mut is_one = true;
        for face in self.faces_towards(bounds) {
            let Some(found) = self.test_on(face, bounds) else { continue };
            all = if is_one || all == found { found } else { Occlusion::Perhaps };
            is_one = false;
        }
        all
    }

    /// The faces that some of a box may project onto.
    fn faces_towards(&self, bounds: &Aabb) -> impl Iterator<Item = CubeFace> {
        let [low, high] = [bounds.min, bounds.max].map(|at| at.as_dvec3() - self.middle);
        let aside = low.max(-high).max(DVec3::ZERO).max_element();
        let is_towards = move |face: &CubeFace| {
            let ahead = face.most(low, high);
            ahead > 0.0 && aside <= ahead
        };
        CubeFace::ALL.into_iter().filter(is_towards)
    }

    /// What the buffer says about the part of a box that projects onto one face. None if no part
    /// does.
    fn test_on(&self, face: CubeFace, bounds: &Aabb) -> Option<Occlusion> {
        let projected = self.project_box(face, bounds)?;
        let found = |depths: &DepthPyramid| depths.test(&projected);
        Some(self.faces[face.index()].as_ref().map_or(Occlusion::Nothing, found))
    }

    /// What other depths say about the part of a box that projects onto one face. None if no part
    /// does.
    fn test_with(&self, face: CubeFace, bounds: &Aabb, depths: &DepthPyramid) -> Option<Occlusion> {
        Some(depths.test(&self.project_box(face, bounds)?))
    }

    /// The projection of a box onto a face, as seen from the middle of the box of eyes. None if the
    /// box does not project onto the face.
    fn project_box(&self, face: CubeFace, bounds: &Aabb) -> Option<ProjectedBox> {
        let [low, high] =
            [bounds.min, bounds.max].map(|at| face.turned(at.as_dvec3() - self.middle));
        let (low, high) = (low.with_z(low.z.min(high.z)), high.with_z(low.z.max(high.z)));
        let aside = low.max(-high).max(DVec3::ZERO).truncate();
        if high.z <= 0.0 || aside.max_element() > high.z {
            return None;
        }
        let [across, down] = spans(low, high)?;
        let half = 0.5 * self.size as f64;
        let of = |[low, high]: [f64; 2]| {
            elements((low + 1.0) * half, (high + 1.0) * half, self.size, ROUNDING)
        };
        let (columns, rows) = of(across).zip(of(down))?;
        // A point on this face is at least as far along its axis as it is aside.
        let nearest = low.z.max(aside.max_element());
        let (near, far) = (hidden_from(nearest), hidden_from(high.z));
        Some(ProjectedBox { columns, rows, near, far })
    }

    /// Whether nearer surfaces hide all of a patch from every eye.
    fn hides_patch(&self, surfaces: &Surfaces, patch: usize, spare: &mut Vec<DVec3>) -> bool {
        let count = surfaces.mesh.edges(patch).len() as f64;
        let middle = surfaces.mesh.corners(patch).sum::<DVec3>() / count;
        self.hides_point(middle)
            && self.faces_towards(&surfaces.mesh.patch(patch).bounds).all(|face| {
                let polygon = self.project(face, surfaces, patch, spare);
                if polygon.is_empty() {
                    return true;
                }
                let Some(depths) = &self.faces[face.index()] else { return false };
                let plane = FacePlane::of(&surfaces.mesh, patch, self.middle, face);
                plane.is_behind(&polygon, &depths.nearest, self.size)
            })
    }

    /// Whether something hides a point. For most patches that are seen, their middle tells it.
    fn hides_point(&self, point: DVec3) -> bool {
        let away = point - self.middle;
        let depth = away.abs().max_element();
        let on = CubeFace::ALL.into_iter().find(|face| face.turned(away).z == depth);
        let Some(face) = on.filter(|_| depth > 0.0) else { return false };
        let Some(depths) = &self.faces[face.index()] else { return false };
        let at = (face.turned(away).truncate() / depth + 1.0) * (0.5 * self.size as f64);
        let element = at.as_usizevec2().min(USizeVec2::splat(self.size - 1));
        depths.nearest[element.y * self.size + element.x] < hidden_from(depth)
    }

    /// Marks the patches that no eye sees, among those that are not settled. `classes` has an entry
    /// for each patch, in order.
    pub fn find_hidden(&self, surfaces: &Surfaces, classes: &mut [PatchVisibility]) {
        debug_assert_eq!(classes.len(), surfaces.len(), "one entry for each patch");
        let mut spare = Vec::new();
        let top = surfaces.runs().len() - 1;
        let mut waiting: Vec<(usize, usize)> =
            (0..surfaces.runs()[top].len()).map(|place| (top, place)).collect();
        while let Some((level, place)) = waiting.pop() {
            let bounds = &surfaces.runs()[level][place];
            let found = if self.is_blind { Occlusion::All } else { self.test(bounds) };
            let width = RUN.pow(level as u32);
            let patches = place * width..((place + 1) * width).min(surfaces.len());
            match found {
                Occlusion::Nothing => {}
                Occlusion::All => {
                    let classes = classes.get_mut(patches).unwrap_or_default();
                    let open =
                        classes.iter_mut().filter(|class| **class == PatchVisibility::Remaining);
                    open.for_each(|class| *class = PatchVisibility::Invisible);
                }
                Occlusion::Perhaps if level == 0 => {
                    if classes.get(place) == Some(&PatchVisibility::Remaining)
                        && self.hides_patch(surfaces, place, &mut spare)
                    {
                        classes[place] = PatchVisibility::Invisible;
                    }
                }
                Occlusion::Perhaps => {
                    let last = ((place + 1) * RUN).min(surfaces.runs()[level - 1].len());
                    waiting.extend((place * RUN..last).map(|place| (level - 1, place)));
                }
            }
        }
    }

    /// The projection of a patch onto a face, in elements, as seen from the middle of the box of
    /// eyes.
    fn project(
        &self,
        face: CubeFace,
        surfaces: &Surfaces,
        patch: usize,
        spare: &mut Vec<DVec3>,
    ) -> Vec<DVec2> {
        let corners = surfaces.mesh.corners(patch).map(|corner| face.turned(corner - self.middle));
        projected(&mut corners.collect(), self.size as f64, spare)
    }

    /// Scan-converts the facets of a sub-surface into rows.
    fn scan(
        &self,
        face: CubeFace,
        sub_surface: &SubSurface,
        surfaces: &Surfaces,
        rows_of: &mut FaceRows,
        spare: &mut Vec<DVec3>,
    ) {
        for facet in sub_surface.facets.iter().map(|facet| surfaces.facet(*facet)) {
            let ends =
                facet.edges.iter().map(|edge| edge.ends.map(|end| face.turned(end - self.middle)));
            let plane = rows_of.planes.len() as u32;
            let depths = ends.clone().flatten().map(|end| end.z);
            rows_of.planes.push(FacePlane {
                normal: face.turned(facet.normal),
                offset: facet.offset - facet.normal.dot(self.middle),
                nearest: depths.clone().fold(f64::INFINITY, f64::min),
                farthest: depths.fold(f64::NEG_INFINITY, f64::max),
            });
            rows_of.cross(plane, ends.clone(), self.size);
            // Beside its outline a facet may meet an element, but not the line through its middle.
            for [from, to] in ends {
                let line = projected(&mut vec![from, to], self.size as f64, spare);
                rows(&line, self.size, ROUNDING, |row, from, to| {
                    rows_of.add(row, [from, to], plane)
                });
            }
        }
    }
}
