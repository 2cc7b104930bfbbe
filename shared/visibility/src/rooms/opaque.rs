//! What opaque rooms hide from eyes outside (Menon and Rossignac 1999, FIG. 7, step 705).
//!
//! A sight line that comes into an opaque room through its wall, and not through a window, shows
//! nothing beyond the room. What is in the room is up to other rules.
//!
//! A place is hidden when a single convex piece of the room hides all of it. The points that a
//! convex piece hides from an eye make a convex set, and so do the eyes from which it hides a
//! point. So a piece hides all of a box from a box of eyes when it stands between each two of their
//! corners.

use glam::{DVec3, Vec3};
use sightline_world::{geometry::Aabb, tolerance::ROOM_BOUNDARY_M};

use super::{
    pieces::ConvexPiece,
    region::BooleanRegion,
    sight::{RoomWindows, Viewpoint},
};
use crate::HalfSpace;

/// The greatest height over a plane that counts as rounding, for each metre of the plane's lever.
const ROUNDING: f64 = 1e-9;

/// An opaque room, in own axes.
#[derive(Clone, Debug)]
pub(super) struct OpaqueRoom {
    pieces: Vec<OpaquePiece>,
    /// The windows, as seen by somebody who looks into the room.
    inward: RoomWindows,
}

/// A convex piece of an opaque room.
#[derive(Clone, Debug)]
struct OpaquePiece {
    piece: ConvexPiece,
    sides: Vec<HalfSpace>,
    /// Each corner once.
    corners: Vec<DVec3>,
}

impl OpaqueRoom {
    /// An opaque room that consists of some pieces. `inward` are its windows, as seen by somebody
    /// who looks in.
    pub(super) fn new(pieces: &[ConvexPiece], inward: RoomWindows) -> Self {
        Self { pieces: pieces.iter().map(OpaquePiece::new).collect(), inward }
    }

    /// Whether the room hides all of a box from all eyes in another: may be wrongly false, never
    /// wrongly true. It hides nothing from an eye inside, and nothing that reaches into it.
    pub(super) fn hides(&self, eyes: &Aabb, body: &Aabb) -> bool {
        let near = eyes.union(body);
        self.pieces.iter().any(|part| part.piece.bounds.intersects(&near))
            && !self.meets(eyes)
            && !self.meets(body)
            && self.pieces.iter().any(|part| part.is_between(eyes, body))
            && !self.inward.show(eyes, body)
    }

    /// All that the room hides from an eye. What is less than `wall_m` outside of the room counts
    /// as in it. `None` for an eye inside.
    pub(super) fn hidden_from(&self, eye: Vec3, wall_m: f32) -> Option<BooleanRegion> {
        let eyes = Aabb::new(eye, eye);
        if self.meets(&eyes) {
            return None;
        }
        let shadows = self.pieces.iter().map(|part| part.shadow(eye.as_dvec3())).collect();
        let inside = self.pieces.iter().map(|part| part.grown(wall_m));
        let shown = inside.chain([self.inward.seen(&Viewpoint::all_round(eyes))]).collect();
        let shown = BooleanRegion::Not(Box::new(BooleanRegion::Any(shown)));
        Some(BooleanRegion::All(vec![BooleanRegion::Any(shadows), shown]))
    }

    /// Whether some of a box may be in the room: may be wrongly true, never wrongly false.
    fn meets(&self, region: &Aabb) -> bool {
        self.pieces.iter().any(|part| part.piece.meets(region))
    }
}

impl OpaquePiece {
    fn new(piece: &ConvexPiece) -> Self {
        let mut corners: Vec<DVec3> = Vec::new();
        for corner in piece.faces.iter().flatten().map(|corner| corner.as_dvec3()) {
            if !corners.contains(&corner) {
                corners.push(corner);
            }
        }
        Self { sides: piece.all_sides().collect(), corners, piece: piece.clone() }
    }

    /// Whether the piece stands between all eyes of a box and all points of another.
    fn is_between(&self, eyes: &Aabb, body: &Aabb) -> bool {
        let [eyes, body] = [eyes, body].map(|region| region.corners().map(|at| at.as_dvec3()));
        eyes.iter().all(|eye| body.iter().all(|at| self.is_crossed(*eye, *at)))
    }

    /// Whether a line between two points passes through the piece, or along its boundary.
    fn is_crossed(&self, from: DVec3, to: DVec3) -> bool {
        let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
        for side in &self.sides {
            let [a, b] = [from, to].map(|point| side.height(point));
            if a > 0.0 && b > 0.0 {
                return false;
            }
            if a > 0.0 {
                enters = enters.max(a / (a - b));
            } else if b > 0.0 {
                leaves = leaves.min(a / (a - b));
            }
        }
        enters <= leaves
    }

    /// The piece and all that it hides from an eye outside: what is behind all sides that face the
    /// eye, and in the cone from the eye around the piece.
    fn shadow(&self, eye: DVec3) -> BooleanRegion {
        let facing = self.sides.iter().filter(|side| side.height(eye) > 0.0);
        let facing = facing.map(|side| side.moved(-f64::from(ROOM_BOUNDARY_M)));
        let pairs = self.corners.iter().enumerate();
        let pairs = pairs.flat_map(|(at, a)| self.corners[at + 1..].iter().map(move |b| (*a, *b)));
        let cone = pairs.filter_map(|(a, b)| self.tangent(eye, a, b));
        BooleanRegion::within(facing.chain(cone))
    }

    /// The half-space through an eye and two corners that holds all corners. `None` when there is
    /// no such half-space.
    fn tangent(&self, eye: DVec3, a: DVec3, b: DVec3) -> Option<HalfSpace> {
        let normal = (a - eye).cross(b - eye).try_normalize()?;
        let heights = self.corners.iter().map(|at| (normal.dot(*at - eye), at.distance(eye)));
        let (mut is_below, mut is_above) = (true, true);
        for (height, lever) in heights {
            is_below &= height <= ROUNDING * lever;
            is_above &= height >= -ROUNDING * lever;
        }
        let normal = if is_below { normal } else { -normal };
        let side = HalfSpace { normal, distance: normal.dot(eye) };
        (is_below || is_above).then(|| side.moved(-f64::from(ROOM_BOUNDARY_M)))
    }

    /// The piece, grown by a length in metres.
    fn grown(&self, by: f32) -> BooleanRegion {
        let by = f64::from(by + ROOM_BOUNDARY_M);
        BooleanRegion::within(self.sides.iter().map(|side| side.moved(by)))
    }
}
