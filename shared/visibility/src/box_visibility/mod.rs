//! Whether anybody in one box can see anything in another: is every line between them blocked?
//!
//! **One occluder.** Let `C` be convex. The points `b` for which the segment from a point `e` meets
//! `C` are a convex set, since they are what is behind `C` as seen from `e`, and so are the
//! points `e` for a given `b`. So when all segments from the corners of one box to the corners of
//! another meet `C`, first all from each corner to anywhere in the other box do, and then all
//! segments between the boxes do.
//!
//! **Several.** Otherwise the wider box is halved, and each half tried on its own. That ends when each
//! part has one occluder that blocks all of it, or a line meets no occluder at all: then the answer
//! can never be that all are blocked, and the line says why. A shaft that straddles a seam
//! between two occluders is never blocked by one of them, however narrow it is. So occluders must
//! reach into each other, and are made as large as can be, whatever pieces the building came in:
//!
//! * Boxes in what is solid (`matter`): where no cell is, nobody can be, and between a point
//!   in a cell and one that is not, something opaque stands. So whatever passes through such a box is
//!   blocked, if one end of it is in a cell. Each box is grown as far as there is no cell.
//! * The brushes of a Quake map that are no boxes.
//! * Rectangles in what is flat but not the face of something solid (`sheets`).
//!
//! All are set back by a fifth of a millimetre, so that rounding, and lines that slip along an edge,
//! count as free. What is answered is therefore: no line is free that begins where an eye can be.
//! Between two points inside of the same wall lines may be free, but nobody is there to look.
//!
//! **Budget.** Half of the questions cost some hundred units of ten nanoseconds. What is not decided
//! by some thousand units is narrow: doors in line, or lines that slip along edges.
//!
//! Boxes are given in the building's own axes ([`Cells::axes`](sightline_world::Cells::axes)), as
//! regions and cells are.

mod bvh;
mod convex_occluder;
mod portal_flood;
mod search;
mod solid_occluders;
mod surface_occluders;

use std::ops::ControlFlow;

use glam::Vec3;

use bvh::Bvh;
use convex_occluder::{ConvexOccluder, Plane};
use portal_flood::PortalFlood;
pub use search::BoxScratch;
use sightline_world::{Origin, World, geometry::Aabb};
use solid_occluders::SolidOccluders;

/// Convex pieces of what blocks sight, ready to be asked.
///
/// There are no more than six for each solid leaf of the subdivision and each brush, and nine for each
/// triangle, of some hundred bytes each; most are inside of others and dropped, so that maps and
/// buildings of 400 rooms need 0.1 to 1 MB, and less than a second to make.
///
/// ```
/// use glam::Vec3;
/// use sightline_shared::{
///     geometry::Aabb,
///     shaft::{Occluders, Outcome, Scratch},
/// };
/// # use sightline_world::World;
///
/// # fn can_be_seen(world: &World, eyes: &Aabb, bodies: &Aabb) -> bool {
/// let occluders = Occluders::new(world);
/// let (mut scratch, mut budget) = (Scratch::default(), 2_000);
/// let outcome = occluders.between(&mut scratch, eyes, bodies, &mut budget);
/// outcome != Outcome::Hidden
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Occluders {
    pieces: Vec<ConvexOccluder>,
    tree: Bvh,
    passages: PortalFlood,
}

/// A box of eyes or bodies, and the spaces that they can be in.
#[derive(Clone, Copy, Debug)]
pub struct BoxInSpaces<'a> {
    /// In the building's own axes.
    pub bounds: &'a Aabb,
    /// Indices into [`Cells::spaces`](sightline_world::Cells::spaces).
    pub spaces: &'a [u32],
}

/// What is known of the lines between two boxes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BoxVisibility {
    /// All are blocked.
    Hidden,
    /// This one meets no occluder. While it joins two boxes, nothing else can be found of them.
    Visible(SightLine),
    /// Some may be free: the budget was used up, or there are seams.
    Unknown,
}

/// A line from a point to another, in own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SightLine {
    /// The eye.
    pub from: Vec3,
    /// What it sees.
    pub to: Vec3,
}

impl SightLine {
    /// Whether it joins two boxes.
    pub fn joins(&self, eyes: &Aabb, bodies: &Aabb) -> bool {
        eyes.contains(self.from) && bodies.contains(self.to)
    }
}

impl Occluders {
    /// Finds the occluders of a world.
    pub fn new(world: &World) -> Self {
        let matter = SolidOccluders::new(world);
        let mut pieces: Vec<ConvexOccluder> =
            matter.boxes(world).iter().map(ConvexOccluder::solid).collect();
        pieces.extend(world.origin.iter().flat_map(|origin| brushes(world, origin)));
        let sheets = surface_occluders::sheets(world, &matter);
        pieces.extend(sheets.iter().filter_map(|corners| ConvexOccluder::sheet(corners)));
        let boxes: Vec<Aabb> = pieces.iter().map(|piece| *piece.bounds()).collect();
        Self { pieces, tree: Bvh::new(&boxes), passages: PortalFlood::new(&world.cells) }
    }

    /// Whether some occluder meets a line.
    pub fn blocks(&self, line: &SightLine) -> bool {
        self.meets_counted(line, &mut 0)
    }

    /// Whether gates lead a line that begins in one space and ends in another, given by their indices, and no
    /// occluder meets it. What is answered of other lines means nothing. Most that are blocked take a fraction of
    /// a microsecond.
    pub fn is_free_through_gates(&self, line: &SightLine, spaces: [u32; 2]) -> bool {
        self.passages.is_free_through_gates(line, spaces) && !self.blocks(line)
    }

    /// As [`Occluders::blocks`], and counts what was compared with the line.
    fn meets_counted(&self, line: &SightLine, compared: &mut u32) -> bool {
        let flow = self.tree.along(line, compared, |index, compared| {
            *compared += 1;
            match self.pieces[index as usize].meets(line.from, line.to) {
                Some(_) => ControlFlow::Break(()),
                None => ControlFlow::Continue(()),
            }
        });
        flow.is_break()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.pieces.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// What they take in memory, about.
    pub fn bytes(&self) -> usize {
        self.pieces.iter().map(ConvexOccluder::bytes).sum::<usize>()
            + self.tree.bytes()
            + self.passages.bytes()
    }
}

/// The brushes of a map that are no boxes.
fn brushes(world: &World, origin: &Origin) -> impl Iterator<Item = ConvexOccluder> {
    let axes = world.cells.axes;
    let others = origin.solids.iter().filter(|solid| !solid_occluders::is_box(origin, solid));
    others.filter_map(move |solid| {
        let sides = origin.sides(solid).map(|side| {
            let normal = axes.own_exact(side.normal.as_dvec3());
            Some(Plane {
                distance: side.distance / normal.length(),
                normal: normal.try_normalize()?,
            })
        });
        // What has a side that is no plane is no brush.
        let sides = sides.collect::<Option<Vec<Plane>>>()?;
        (!sides.is_empty()).then(|| ConvexOccluder::behind(axes.own_box(&solid.bounds), sides))
    })
}
