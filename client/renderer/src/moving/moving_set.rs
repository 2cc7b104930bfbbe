//! Where what moves is, and will be.

use std::time::Duration;

use sightline_world::{
    Mover, World,
    geometry::Aabb,
    motion::{Agility, AvatarId, Pose, trajectory::Playback},
};

use crate::avatars;
use sightline_client_core::replica::{AvatarSource, Update, VisibleAvatar};

/// Boxes are taken to be so much larger on each side, for what rounding does, as a part of their
/// distance from the origin.
pub(super) const ROUNDING: f32 = 1e-5;

/// Something that moves.
#[derive(Clone, Copy, Debug)]
pub(super) enum MovingId {
    /// By its place among the world's.
    Mover(u32),
    Avatar(AvatarId),
}

/// All that moves, at one time.
pub(super) struct MovingSet<'a> {
    pub(super) world: &'a World,
    pub(super) told: &'a dyn AvatarSource,
    pub(super) now: Duration,
    agility: Agility,
}

impl<'a> MovingSet<'a> {
    pub(super) fn new(world: &'a World, told: &'a dyn AvatarSource, now: Duration) -> Self {
        let agility = Agility::of(&world.body, world.speed_max);
        Self { world, told, now, agility }
    }

    /// The box that something fills now, its name's foot included; `None` when it is gone.
    pub(super) fn bounds(&self, what: MovingId) -> Option<Aabb> {
        match what {
            MovingId::Mover(_) => self.volume(what, self.now),
            MovingId::Avatar(avatar) => {
                let (Pose { eye, .. }, _) = self.told.path(avatar, self.now, self.now)?;
                Some(self.figure(&Aabb::new(eye, eye)))
            }
        }
    }

    /// The box that it surely stays in up to a time, or does for all that a body can do.
    pub(super) fn volume(&self, what: MovingId, until: Duration) -> Option<Aabb> {
        match what {
            MovingId::Mover(at) => {
                self.world.movers.get(at as usize).map(|mover| swept(mover, self.now, until))
            }
            MovingId::Avatar(avatar) => {
                let (pose, path) = self.told.path(avatar, self.now, until)?;
                let time = until.saturating_sub(self.now);
                let eyes = self.agility.eyes(pose.eye, pose.velocity, time);
                Some(self.figure(&eyes.union(&path)))
            }
        }
    }

    /// The box that an avatar fills up to a time, as far as was told.
    pub(super) fn path(&self, avatar: AvatarId, until: Duration) -> Option<Aabb> {
        self.told.path(avatar, self.now, until).map(|(_, eyes)| self.figure(&eyes))
    }

    /// How many letters its name has, as it is drawn.
    pub(super) fn letters(&self, avatar: AvatarId) -> usize {
        let shown = self.told.shown(avatar, self.now);
        shown.map_or(0, |avatar| avatars::letters(&avatar.name))
    }

    fn figure(&self, eyes: &Aabb) -> Aabb {
        rounded(&avatars::bounds(&self.world.body, eyes))
    }
}

/// The box that a mover stays in from one time to another. One that something sets off rests.
fn swept(mover: &Mover, from: Duration, until: Duration) -> Aabb {
    rounded(&match mover.trajectory.playback() {
        Playback::Triggered => mover.swept(Duration::ZERO, Duration::ZERO),
        _ => mover.swept(from, until),
    })
}

fn rounded(bounds: &Aabb) -> Aabb {
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    bounds.grown(ROUNDING * farthest.min(f32::MAX))
}

/// Who is alone.
pub(super) struct NoAvatars;

impl AvatarSource for NoAvatars {
    fn updates(&mut self) -> Vec<(AvatarId, Update)> {
        Vec::new()
    }

    fn path(&self, _: AvatarId, _: Duration, _: Duration) -> Option<(Pose, Aabb)> {
        None
    }

    fn shown(&self, _: AvatarId, _: Duration) -> Option<VisibleAvatar> {
        None
    }
}
