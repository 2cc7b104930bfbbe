//! What a picture asks about the others, one by one: so that nobody who is hidden need be looked at.

use std::time::Duration;

use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose},
};

use super::{Replica, VisibleAvatar};

/// What a client was told of an avatar since it asked last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Update {
    /// It is there, or there again.
    Appeared,
    /// Where it is.
    Moved,
}

/// The avatars that a client is told of. Times are [`Replica::server_time`]'s.
pub trait AvatarSource {
    /// Those that appeared, or were told of, since this was asked last; all of them at first. Who
    /// vanished is not among them.
    fn updates(&mut self) -> Vec<(AvatarId, Update)>;

    /// Where an avatar is to be drawn at a time, and a box that its eye stays in from then until another
    /// time, unless there is news of it; `None` once it has vanished.
    fn path(&self, avatar: AvatarId, now: Duration, until: Duration) -> Option<(Pose, Aabb)>;

    /// An avatar as it is to be drawn at a time; `None` once it has vanished.
    fn shown(&self, avatar: AvatarId, now: Duration) -> Option<VisibleAvatar>;
}

impl AvatarSource for Replica {
    fn updates(&mut self) -> Vec<(AvatarId, Update)> {
        std::mem::take(&mut self.news).into_iter().collect()
    }

    fn path(&self, avatar: AvatarId, now: Duration, until: Duration) -> Option<(Pose, Aabb)> {
        let timeline = &self.others.get(&avatar)?.timeline;
        let ticks = [now, until].map(|time| self.clock.tick_at(time));
        let pose = timeline.at(ticks[0], self.tick_interval);
        Some((pose, timeline.eyes(ticks, self.tick_interval)))
    }

    fn shown(&self, avatar: AvatarId, now: Duration) -> Option<VisibleAvatar> {
        let other = self.others.get(&avatar)?;
        let pose = other.timeline.at(self.clock.tick_at(now), self.tick_interval);
        Some(VisibleAvatar { id: avatar, name: other.name.clone(), colour: other.colour, pose })
    }
}
