//! The occluders of a building, and questions about single lines.

use std::ops::ControlFlow;

use sightline_world::{Origin, World, geometry::Aabb};

use super::{
    bvh::Bvh,
    convex_occluder::ConvexOccluder,
    portal_flood::PortalFlood,
    sight_line::SightLine,
    solid_occluders::{SolidOccluders, is_box},
    surface_occluders::surface_occluders,
};
use crate::HalfSpace;

/// The convex occluders of a building, and the gates between its spaces.
///
/// There are at most six occluders for each solid leaf of the subdivision and each brush, and nine
/// for each triangle, of some hundred bytes each. Most lie inside others and are dropped: maps, and
/// buildings of 400 rooms, need 0.1 to 1 MB and less than a second.
///
/// ```
/// use glam::Vec3;
/// use sightline_visibility::box_visibility::{BoxScratch, BoxVisibility, Occluders};
/// use sightline_world::geometry::Aabb;
///
/// let occluders = Occluders::new(&sightline_fixtures::two_rooms::world());
/// let (mut scratch, mut budget) = (BoxScratch::default(), 2_000);
/// let eyes = Aabb::around(Vec3::new(3.0, 1.6, 4.5), 0.1);
/// let body = Aabb::around(Vec3::new(9.0, 1.0, 4.5), 0.3);
/// let answer = occluders.between(&mut scratch, &eyes, &body, &mut budget);
/// assert_eq!(answer, BoxVisibility::Hidden);
/// ```
#[derive(Clone, Debug)]
pub struct Occluders {
    pub(super) pieces: Vec<ConvexOccluder>,
    pub(super) bvh: Bvh,
    pub(super) flood: PortalFlood,
}

impl Occluders {
    /// Finds the occluders of a world.
    pub fn new(world: &World) -> Self {
        let solid = SolidOccluders::new(world);
        let mut pieces: Vec<ConvexOccluder> =
            solid.boxes(world).iter().map(ConvexOccluder::solid).collect();
        pieces.extend(world.origin.iter().flat_map(|origin| brushes(world, origin)));
        let polygons = surface_occluders(world, &solid);
        pieces.extend(polygons.iter().filter_map(|corners| ConvexOccluder::flat(corners)));
        Self::from_pieces(pieces, PortalFlood::new(&world.cells))
    }

    pub(super) fn from_pieces(pieces: Vec<ConvexOccluder>, flood: PortalFlood) -> Self {
        let boxes: Vec<Aabb> = pieces.iter().map(|piece| *piece.bounds()).collect();
        Self { bvh: Bvh::new(&boxes), pieces, flood }
    }

    /// Whether some occluder blocks a line.
    pub fn blocks(&self, line: &SightLine) -> bool {
        self.blocks_counted(line, &mut 0)
    }

    /// Whether gates let a line pass from one space to another and no occluder blocks it. Spaces
    /// are indices into [`Cells::spaces`](sightline_world::Cells::spaces). The line must begin in
    /// the first space and end in the second, or the answer means nothing. For most blocked lines
    /// this takes a fraction of a microsecond.
    pub fn is_free_through_gates(&self, line: &SightLine, spaces: [u32; 2]) -> bool {
        self.flood.lets_pass(line, spaces) && !self.blocks(line)
    }

    /// Whether some occluder blocks a line. `compared` grows by the number of nodes and occluders
    /// that were compared with it.
    pub(super) fn blocks_counted(&self, line: &SightLine, compared: &mut u32) -> bool {
        let flow = self.bvh.along(line, compared, |index, compared| {
            *compared += 1;
            match self.pieces[index as usize].meets(line.from, line.to) {
                Some(_) => ControlFlow::Break(()),
                None => ControlFlow::Continue(()),
            }
        });
        flow.is_break()
    }

    /// The number of occluders.
    pub fn len(&self) -> usize {
        self.pieces.len()
    }

    /// Whether there are no occluders.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Approximate memory in use, in bytes.
    pub fn bytes(&self) -> usize {
        self.pieces.iter().map(ConvexOccluder::bytes).sum::<usize>()
            + self.bvh.bytes()
            + self.flood.bytes()
    }
}

/// The brushes of a Quake map that are not boxes.
fn brushes(world: &World, origin: &Origin) -> impl Iterator<Item = ConvexOccluder> {
    let axes = world.cells.axes;
    let others = origin.solids.iter().filter(|solid| !is_box(origin, solid));
    others.filter_map(move |solid| {
        let sides = origin.sides(solid).map(|side| {
            let normal = axes.own_exact(side.normal.as_dvec3());
            Some(HalfSpace {
                distance: side.distance / normal.length(),
                normal: normal.try_normalize()?,
            })
        });
        // A brush with a side that is no plane is left out.
        let sides = sides.collect::<Option<Vec<HalfSpace>>>()?;
        (!sides.is_empty()).then(|| ConvexOccluder::behind(axes.own_box(&solid.bounds), sides))
    })
}
