//! Invisibility: how far the nearest non-fuzzy region is in every direction.

use glam::{DVec2, DVec3, USizeVec2};

use super::{
    PatchVisibility, Surfaces, ViewpointBox,
    depths::{DepthPyramid, Occlusion},
    faces::{CubeFace, projected, region, spans},
    raster::{ROUNDING, elements, rows},
    scan::{FacePlane, FaceRows},
    sub_surfaces::{SubSurface, SubSurfaces},
    surfaces::{PatchSurface, RUN},
};
use sightline_world::{geometry::Aabb, tolerance::BEHIND_M};

/// The same as a part of the distance, for what single precision leaves open.
const BEHIND_SHARE: f64 = 1e-5;

/// For every direction, how far the nearest surface is at the most that hides what is behind it from
/// all eyes of a box, as seen from the middle of it.
#[derive(Clone, Debug)]
pub struct FuzzyBuffer {
    size: usize,
    middle: DVec3,
    /// By [`CubeFace::index`]; `None` where a face is inactive.
    faces: [Option<DepthPyramid>; 6],
    /// There are no eyes to see anything.
    is_blind: bool,
}

/// What meets fewer elements each way is not worth projecting.
const ELEMENTS_MIN: f64 = 4.0;
/// Nor is what consists of so many facets that there are fewer elements for each: curved things hide little for what they cost.
const ELEMENTS_PER_FACET_MIN: f64 = 16.0;
/// Sheets that are not so many times wider than the box of eyes have next to no non-fuzzy region.
const WIDER_MIN: f32 = 4.0;

/// Columns and rows of a face, and two depths.
type Shown = ([usize; 2], [usize; 2], [f32; 2]);

impl FuzzyBuffer {
    /// Projects all surfaces that are wide enough to hide anything. Faces have `size` × `size` elements, from
    /// 1 to 4,096 each way.
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
            .groups()
            .iter()
            .map(|group| (buffer.distance(&group.bounds), group))
            .filter(|(distance, group)| {
                buffer.is_worthy(*distance, (&group.bounds, group.facets.len()), width_m)
            })
            .collect();
        worthy.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut sheets = SubSurfaces::new(surfaces, viewpoints, width_m, size);
        for face in viewpoints.faces() {
            buffer.project_all(face, &worthy, &mut sheets);
        }
        buffer
    }

    /// How far it is to a box along the axis that says most.
    fn distance(&self, bounds: &Aabb) -> f64 {
        let (below, above) =
            (bounds.min.as_dvec3() - self.middle, self.middle - bounds.max.as_dvec3());
        below.max(above).max(DVec3::ZERO).max_element()
    }

    /// Whether so many facets in a box may have a non-fuzzy region worth having.
    fn is_worthy(&self, distance: f64, (bounds, facets): (&Aabb, usize), width_m: f32) -> bool {
        let width = bounds.size().max_element();
        let elements = 0.5 * f64::from(width) * self.size as f64;
        width > WIDER_MIN * width_m
            && elements > ELEMENTS_MIN * distance
            && elements * elements > ELEMENTS_PER_FACET_MIN * facets as f64 * distance * distance
    }

    /// Fills in a face: first with what is around the eyes, then with the rest, nearest first, as far
    /// as that does not hide it.
    fn project_all(
        &mut self,
        face: CubeFace,
        worthy: &[(f64, &PatchSurface)],
        sheets: &mut SubSurfaces<'_>,
    ) {
        let mut depths = DepthPyramid::new(self.size);
        let around = worthy.partition_point(|(distance, _)| *distance == 0.0);
        for (_, group) in &worthy[..around] {
            self.project_group(face, group, sheets, &mut depths, |_, _| true);
        }
        depths.find_levels();
        let is_open = |depths: &DepthPyramid, bounds: &Aabb| {
            self.look_at(face, bounds, depths).is_some_and(|hidden| hidden != Occlusion::All)
        };
        for (_, group) in &worthy[around..] {
            if is_open(&depths, &group.bounds) {
                self.project_group(face, group, sheets, &mut depths, is_open);
            }
        }
        depths.find_levels();
        self.faces[face.index()] = Some(depths);
    }

    /// Projects those sheets of a surface that are worth it.
    fn project_group(
        &self,
        face: CubeFace,
        group: &PatchSurface,
        of: &mut SubSurfaces<'_>,
        depths: &mut DepthPyramid,
        is_open: impl Fn(&DepthPyramid, &Aabb) -> bool,
    ) {
        let surfaces = of.surfaces;
        let found = of.take(group);
        for sheet in &found {
            let distance = self.distance(&sheet.bounds);
            let size = (&sheet.bounds, sheet.facets.len());
            if !self.is_worthy(distance, size, of.width_m) || !is_open(depths, &sheet.bounds) {
                continue;
            }
            self.scan(face, sheet, surfaces, &mut of.rows, &mut of.spare);
            for ends in &sheet.border {
                let band = region(face, ends, &of.eyes, self.size as f64, &mut of.spare);
                of.rows.erase(&band, self.size);
            }
            of.rows.merge_into(&mut depths.nearest, self.size);
        }
        of.found.insert(group.facets.start, found);
    }

    /// How many elements each way a face has.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Whether no eye sees anything of a box, since what is nearer hides it.
    pub fn hides(&self, bounds: &Aabb) -> bool {
        self.is_blind || bounds.is_empty() || self.look(bounds) == Occlusion::All
    }

    fn look(&self, bounds: &Aabb) -> Occlusion {
        if !(bounds.min.is_finite() && bounds.max.is_finite()) {
            return Occlusion::Nothing;
        }
        let mut all = Occlusion::All;
        let mut is_one = true;
        for face in self.faces_towards(bounds) {
            let Some(found) = self.look_on(face, bounds) else { continue };
            all = if is_one || all == found { found } else { Occlusion::Perhaps };
            is_one = false;
        }
        all
    }

    /// The faces that something of a box may project onto.
    fn faces_towards(&self, bounds: &Aabb) -> impl Iterator<Item = CubeFace> {
        let [low, high] = [bounds.min, bounds.max].map(|at| at.as_dvec3() - self.middle);
        let aside = low.max(-high).max(DVec3::ZERO).max_element();
        let is_towards = move |face: &CubeFace| {
            let ahead = face.most(low, high);
            ahead > 0.0 && aside <= ahead
        };
        CubeFace::ALL.into_iter().filter(is_towards)
    }

    /// The same of what projects onto one face; `None` when nothing does.
    fn look_on(&self, face: CubeFace, bounds: &Aabb) -> Option<Occlusion> {
        let (columns, rows, depths) = self.shown(face, bounds)?;
        let found = |at: &DepthPyramid| at.look(columns, rows, depths);
        Some(self.faces[face.index()].as_ref().map_or(Occlusion::Nothing, found))
    }

    /// The same with other depths.
    fn look_at(&self, face: CubeFace, bounds: &Aabb, at: &DepthPyramid) -> Option<Occlusion> {
        let (columns, rows, depths) = self.shown(face, bounds)?;
        Some(at.look(columns, rows, depths))
    }

    /// Where the eye in the middle sees what is in a box, and from where to where it is deep; `None` when it is not on a face.
    fn shown(&self, face: CubeFace, bounds: &Aabb) -> Option<Shown> {
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
        // On this face nothing is nearer along its axis than it is aside.
        let nearest = low.z.max(aside.max_element());
        Some((columns, rows, [hidden_from(nearest), hidden_from(high.z)]))
    }

    /// Whether no eye sees anything of a patch.
    fn hides_patch(&self, surfaces: &Surfaces, patch: usize, spare: &mut Vec<DVec3>) -> bool {
        let count = surfaces.edges(patch).len() as f64;
        let middle = surfaces.corners(patch).sum::<DVec3>() / count;
        self.hides_point(middle)
            && self.faces_towards(&surfaces.patch(patch).bounds).all(|face| {
                let polygon = self.project(face, surfaces, patch, spare);
                if polygon.is_empty() {
                    return true;
                }
                let Some(depths) = &self.faces[face.index()] else { return false };
                let plane = FacePlane::of(surfaces, patch, self.middle, face);
                plane.is_behind(&polygon, &depths.nearest, self.size)
            })
    }

    /// Whether something is before a point: of most patches that are seen their middle tells it.
    fn hides_point(&self, point: DVec3) -> bool {
        let way = point - self.middle;
        let depth = way.abs().max_element();
        let on = CubeFace::ALL.into_iter().find(|face| face.turned(way).z == depth);
        let Some(face) = on.filter(|_| depth > 0.0) else { return false };
        let Some(depths) = &self.faces[face.index()] else { return false };
        let at = (face.turned(way).truncate() / depth + 1.0) * (0.5 * self.size as f64);
        let element = at.as_usizevec2().min(USizeVec2::splat(self.size - 1));
        depths.nearest[element.y * self.size + element.x] < hidden_from(depth)
    }

    /// Marks the patches that no eye sees, of those that are not settled. `classes` are those of all
    /// patches, in their order.
    pub fn find_hidden(&self, surfaces: &Surfaces, classes: &mut [PatchVisibility]) {
        let mut spare = Vec::new();
        let top = surfaces.runs().len() - 1;
        let mut waiting: Vec<(usize, usize)> =
            (0..surfaces.runs()[top].len()).map(|place| (top, place)).collect();
        while let Some((level, place)) = waiting.pop() {
            let bounds = &surfaces.runs()[level][place];
            let found = if self.is_blind { Occlusion::All } else { self.look(bounds) };
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

    /// What of a patch the eye in the middle sees on a face, in elements.
    fn project(
        &self,
        face: CubeFace,
        surfaces: &Surfaces,
        patch: usize,
        spare: &mut Vec<DVec3>,
    ) -> Vec<DVec2> {
        let corners = surfaces.corners(patch).map(|corner| face.turned(corner - self.middle));
        projected(&mut corners.collect(), self.size as f64, spare)
    }

    /// Puts the facets of a sheet into rows.
    fn scan(
        &self,
        face: CubeFace,
        sheet: &SubSurface,
        surfaces: &Surfaces,
        rows_of: &mut FaceRows,
        spare: &mut Vec<DVec3>,
    ) {
        for facet in sheet.facets.iter().map(|facet| surfaces.facet(*facet)) {
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
            // Next to its outline it may meet an element and not the line through the middle of it.
            for [from, to] in ends {
                let line = projected(&mut vec![from, to], self.size as f64, spare);
                rows(&line, self.size, ROUNDING, |row, from, to| {
                    rows_of.add(row, [from, to], plane)
                });
            }
        }
    }
}

/// The depth from which on what is behind counts as hidden: less is nearer than `nearest`.
pub(super) fn hidden_from(nearest: f64) -> f32 {
    ((nearest - BEHIND_M) * (1.0 - BEHIND_SHARE)) as f32
}
