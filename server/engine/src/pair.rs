//! What the engine knows of a viewer and an avatar: plain data.

use sightline_visibility::box_visibility::SightLine;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose},
};

use crate::{
    generation::Generation,
    slot::{Member, Slot},
};

/// The state of a viewer and an avatar that may see each other. Kept with the viewer, by the
/// avatar's id.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) id: AvatarId,
    pub(crate) slot: Slot,
    /// By their coarse regions, the avatar may be visible to the viewer.
    pub(crate) is_candidate: bool,
    /// The viewer's client has been told of the avatar.
    pub(crate) is_held: bool,
    /// The first tick at which the client may be told that the avatar is out of sight.
    pub(crate) held_until: u32,
    /// The newest accepted pose of the avatar that need not be told any more.
    pub(crate) told_version: Generation,
    /// The course that was told last: the pose at a tick.
    pub(crate) told: Pose,
    pub(crate) told_tick: u32,
    pub(crate) sight: SightResult,
    /// Cells of these regions see each other.
    pub(crate) cells_see_for: Option<RegionVersions>,
    /// Gates, cells and rooms did not decide it between these regions.
    pub(crate) gates_undecided_for: Option<RegionVersions>,
    /// The first tick at which gates and cells are asked again.
    pub(crate) gates_again_at: u32,
    /// The first tick at which regions with a large margin are tried again.
    pub(crate) large_margin_again_at: u32,
}

impl Pair {
    pub(crate) fn new(member: Member) -> Self {
        Self {
            id: member.id,
            slot: member.slot,
            is_candidate: true,
            is_held: false,
            held_until: 0,
            told_version: Generation::default(),
            told: Pose::default(),
            told_tick: 0,
            sight: SightResult::Unknown,
            cells_see_for: None,
            gates_undecided_for: None,
            gates_again_at: 0,
            large_margin_again_at: 0,
        }
    }

    /// Forgets what sight tests have found.
    pub(crate) fn forget(&mut self) {
        (self.sight, self.gates_again_at) = (SightResult::Unknown, 0);
    }
}

/// What is known of the lines from a viewer's eye region to an avatar's body region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SightResult {
    /// Nothing is known.
    Unknown,
    /// A line may be free. The pair is tested again at that tick.
    Undecided {
        /// The tick.
        again: u32,
        /// How many tests in a row did not decide it.
        tries: u32,
    },
    /// This line is free, as far as occluders go.
    Free(SightLine),
    /// Both are in one convex space.
    Together,
    /// All lines are blocked as long as these regions last.
    Hidden(RegionVersions),
    /// All lines are blocked while the viewer's eye and the avatar's eye stay in these boxes.
    HiddenIn(EyeBoxes),
}

impl SightResult {
    /// Whether the pair is known to be hidden.
    pub(crate) fn is_hidden(&self) -> bool {
        match self {
            Self::Hidden(_) | Self::HiddenIn(_) => true,
            Self::Unknown | Self::Undecided { .. } | Self::Together | Self::Free(_) => false,
        }
    }

    /// Whether the pair is hidden even with a large margin.
    pub(crate) fn is_surely_hidden(&self) -> bool {
        matches!(self, Self::Hidden(RegionVersions { margin: RegionMargin::Large, .. }))
    }

    /// Whether a test has found that the two may see each other.
    pub(crate) fn may_see(&self) -> bool {
        matches!(self, Self::Undecided { .. } | Self::Together | Self::Free(_))
    }
}

/// Where the eyes of a pair can be, whatever walls are in these boxes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EyeBoxes {
    pub(crate) viewer: Aabb,
    pub(crate) avatar: Aabb,
}

impl EyeBoxes {
    /// Whether both boxes contain those of another pair of boxes.
    pub(crate) fn contain(&self, other: &Self) -> bool {
        self.viewer.contains_box(&other.viewer) && self.avatar.contains_box(&other.avatar)
    }
}

/// The margin of a cached region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RegionMargin {
    /// The region is dropped soon, and fits closely.
    Small,
    /// The region lasts longest.
    Large,
}

impl RegionMargin {
    /// How many margins there are.
    pub(crate) const COUNT: usize = 2;
}

/// Which cached regions of a pair a result was found for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RegionVersions {
    pub(crate) margin: RegionMargin,
    /// The version of the viewer's eye region.
    pub(crate) eyes: Generation,
    /// The version of the avatar's body region.
    pub(crate) bodies: Generation,
}
