//! The avatar source: what a picture asks about the other avatars, one by one, so that hidden
//! avatars cost almost nothing.

use std::time::Duration;

use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose},
};

use super::{Replica, ShownAvatar};

/// What a client was told of an avatar since the last request for updates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Update {
    /// The avatar appeared, or appeared again.
    Appeared,
    /// The avatar has a new course.
    Moved,
}

/// The avatars that a client is told of. Times are those of [`Replica::server_time`].
pub trait AvatarSource {
    /// The avatars with an update since the last call; at the first call all avatars. Avatars that
    /// vanished are not among them.
    fn updates(&mut self) -> Vec<(AvatarId, Update)>;

    /// The pose of an avatar at a time, and a box that its eye stays in from then until another
    /// time, unless there is an update of it. `None` once it has vanished.
    fn path(&self, avatar: AvatarId, now: Duration, until: Duration) -> Option<(Pose, Aabb)>;

    /// An avatar as it is drawn at a time; `None` once it has vanished.
    fn shown(&self, avatar: AvatarId, now: Duration) -> Option<ShownAvatar>;
}

impl AvatarSource for Replica {
    fn updates(&mut self) -> Vec<(AvatarId, Update)> {
        std::mem::take(&mut self.updates).into_iter().collect()
    }

    fn path(&self, avatar: AvatarId, now: Duration, until: Duration) -> Option<(Pose, Aabb)> {
        let timeline = &self.others.get(&avatar)?.timeline;
        let ticks = [now, until].map(|time| self.clock.tick_at(time));
        Some((timeline.at(ticks[0]), timeline.eyes(ticks)))
    }

    fn shown(&self, avatar: AvatarId, now: Duration) -> Option<ShownAvatar> {
        let other = self.others.get(&avatar)?;
        let pose = other.timeline.at(self.clock.tick_at(now));
        Some(ShownAvatar { id: avatar, name: other.name.clone(), colour: other.colour, pose })
    }
}
