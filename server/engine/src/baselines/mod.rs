//! Baselines: what policies that know no walls need. They exist only for comparison.

mod partition;

use glam::{IVec3, Vec3};

use crate::config::Policy;

pub(crate) use partition::{Area, Partition};

/// Where an avatar is, for a policy that knows no walls.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Location {
    pub(crate) eye: Vec3,
    pub(crate) area: Area,
}

/// Whether a policy that knows no walls tells a viewer of an avatar.
pub(crate) fn tells(
    policy: Policy,
    partition: &Partition,
    viewer: Location,
    avatar: Location,
) -> bool {
    match policy {
        Policy::Radius(metres) => viewer.eye.distance(avatar.eye) <= metres,
        Policy::Grid(metres) => {
            let cube = |eye: Vec3| (eye / metres).floor().as_ivec3();
            let apart = cube(viewer.eye).saturating_sub(cube(avatar.eye));
            (apart.cmpge(IVec3::NEG_ONE) & apart.cmple(IVec3::ONE)).all()
        }
        Policy::Region { .. } | Policy::Room { .. } => partition.tells(viewer.area, avatar.area),
        Policy::Broadcast | Policy::Pvs | Policy::Tbv => true,
    }
}
