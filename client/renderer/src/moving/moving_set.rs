//! The moving set: where movers and avatars are, and where they will be.

use std::time::Duration;

use glam::Vec3;
use sightline_client_core::replica::{AvatarSource, ShownAvatar, Update};
use sightline_world::{
    Mover, World,
    geometry::Aabb,
    motion::{Agility, AvatarId, Pose, trajectory::Playback},
};

use crate::avatars::shadow;

/// Boxes are grown on each side by this share of their distance from the origin, for rounding.
pub(super) const ROUNDING: f32 = 1e-5;

/// A mover or an avatar.
#[derive(Clone, Copy, Debug)]
pub(super) enum MovingId {
    /// A mover, by its index in the world.
    Mover(u32),
    /// An avatar.
    Avatar(AvatarId),
}

/// The movers of a world and the avatars of a source, at one time.
pub(super) struct MovingSet<'a> {
    pub(super) world: &'a World,
    pub(super) source: &'a dyn AvatarSource,
    pub(super) now: Duration,
    agility: Agility,
}

impl<'a> MovingSet<'a> {
    pub(super) fn new(world: &'a World, source: &'a dyn AvatarSource, now: Duration) -> Self {
        let agility = Agility::of(&world.body, world.speed_max);
        Self { world, source, now, agility }
    }

    /// The box that an object fills now; `None` when it has vanished.
    pub(super) fn bounds(&self, id: MovingId) -> Option<Aabb> {
        match id {
            MovingId::Mover(_) => self.volume(id, self.now),
            MovingId::Avatar(avatar) => {
                let (Pose { eye, .. }, _) = self.source.path(avatar, self.now, self.now)?;
                Some(self.figure(&Aabb::new(eye, eye)))
            }
        }
    }

    /// A box that an object stays in until a time, as far as a body can move; `None` when it has
    /// vanished.
    pub(super) fn volume(&self, id: MovingId, until: Duration) -> Option<Aabb> {
        match id {
            MovingId::Mover(at) => {
                self.world.movers.get(at as usize).map(|mover| swept(mover, self.now, until))
            }
            MovingId::Avatar(avatar) => {
                let (pose, path) = self.source.path(avatar, self.now, until)?;
                let time = until.saturating_sub(self.now);
                let eyes = self.agility.eyes(pose.eye, pose.velocity, time);
                Some(self.figure(&eyes.union(&path)))
            }
        }
    }

    /// The box that an avatar fills until a time, unless there is an update of it; `None` when it
    /// has vanished.
    pub(super) fn path(&self, avatar: AvatarId, until: Duration) -> Option<Aabb> {
        self.source.path(avatar, self.now, until).map(|(_, eyes)| self.figure(&eyes))
    }

    /// The box that contains a figure and its shadow while its eye is in a box.
    fn figure(&self, eyes: &Aabb) -> Aabb {
        let body = self.world.body.around_box(eyes);
        let aside = (shadow::RADIUS_M - self.world.body.half_width).max(0.0);
        let shadow = Vec3::new(aside, shadow::HEIGHT_M, aside);
        rounded(&Aabb::new(body.min - shadow, body.max + shadow.with_y(0.0)))
    }
}

/// The box that a mover stays in from one time to another. A triggered mover rests.
fn swept(mover: &Mover, from: Duration, until: Duration) -> Aabb {
    rounded(&match mover.trajectory.playback() {
        Playback::Triggered => mover.swept(Duration::ZERO, Duration::ZERO),
        _ => mover.swept(from, until),
    })
}

/// A box grown by [`ROUNDING`].
fn rounded(bounds: &Aabb) -> Aabb {
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    bounds.grown(ROUNDING * farthest.min(f32::MAX))
}

/// The avatar source of a picture without avatars.
pub(super) struct NoAvatars;

impl AvatarSource for NoAvatars {
    fn updates(&mut self) -> Vec<(AvatarId, Update)> {
        Vec::new()
    }

    fn path(&self, _: AvatarId, _: Duration, _: Duration) -> Option<(Pose, Aabb)> {
        None
    }

    fn shown(&self, _: AvatarId, _: Duration) -> Option<ShownAvatar> {
        None
    }
}
