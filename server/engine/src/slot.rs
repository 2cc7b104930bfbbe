//! Where avatars are kept.

use sightline_world::motion::AvatarId;

/// The place of an avatar in the [population](crate::population::Population). It is free again
/// when the avatar has left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Slot(pub(crate) u32);

/// An avatar and its slot, ordered by id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Member {
    pub(crate) id: AvatarId,
    pub(crate) slot: Slot,
}
