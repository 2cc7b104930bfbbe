//! What goes into the engine and what comes out of it.

use std::time::Duration;

use glam::Vec3;
use sightline_world::motion::{AvatarId, Pose, Report, Tbv, Tolerance};

/// What the host tells the engine.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// A participant joins.
    Join {
        /// The participant. The host uses an id again only long after its participant has left.
        avatar: AvatarId,
        /// The name that others are shown.
        name: String,
        /// sRGB.
        colour: [u8; 3],
        /// Where the participant wants its eye. If that is `None` or out of bounds, it begins at a
        /// spawn point.
        place: Option<Vec3>,
    },
    /// The link to a participant's client is broken, and may be mended. The avatar stands where it
    /// is, in sight of others, and nothing is asked of its client.
    Absent {
        /// The avatar.
        avatar: AvatarId,
    },
    /// The client of a participant has come back, or another one has taken its place. It knows
    /// nothing and is told everything anew. Others notice nothing.
    Return {
        /// The avatar.
        avatar: AvatarId,
        /// Where its eye is. If that is `None`, out of bounds or behind a wall, it is where it
        /// stood.
        place: Option<Vec3>,
    },
    /// A participant leaves.
    Leave {
        /// The avatar.
        avatar: AvatarId,
    },
    /// A client reports where its avatar is.
    Report {
        /// The avatar.
        avatar: AvatarId,
        /// The report. One that was not made later than the last is ignored.
        report: Report,
    },
    /// The host itself puts an avatar elsewhere, or pushes it: a respawn, a teleporter, a jump pad.
    /// Only the world's bounds limit it.
    Relocate {
        /// The avatar.
        avatar: AvatarId,
        /// The pose.
        pose: Pose,
    },
    /// A participant goes back to a spawn point. Its client is corrected to it.
    Respawn {
        /// The avatar.
        avatar: AvatarId,
    },
    /// The host has measured the round trip of a client.
    RoundTrip {
        /// The avatar.
        avatar: AvatarId,
        /// The time from a message to its answer.
        round_trip: Duration,
    },
    /// A participant says something to those it sees.
    Chat {
        /// The avatar.
        avatar: AvatarId,
        /// The text.
        text: String,
    },
}

/// What the host must tell a client.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// The client is in the world.
    Entered {
        /// The client that is told. All outputs have this field.
        to: AvatarId,
        /// The pose.
        pose: Pose,
        /// The number of the tick.
        tick: u32,
    },
    /// An avatar may come into view.
    Appear {
        /// The client that is told.
        to: AvatarId,
        /// The avatar.
        avatar: AvatarId,
        /// The name that others are shown.
        name: String,
        /// sRGB.
        colour: [u8; 3],
        /// The pose at the tick.
        pose: Pose,
        /// The number of the tick.
        tick: u32,
    },
    /// An avatar can no longer be seen, or has left.
    Vanish {
        /// The client that is told.
        to: AvatarId,
        /// The avatar.
        avatar: AvatarId,
    },
    /// The poses at this tick of avatars that the client may see and that have a new course. Each
    /// avatar goes on with its velocity and its rate of turn until there is a newer pose.
    Poses {
        /// The client that is told.
        to: AvatarId,
        /// Where the client's own avatar has its eye.
        from: Vec3,
        /// The number of the tick.
        tick: u32,
        /// The avatars and their poses, in ascending order of id.
        poses: Vec<(AvatarId, Pose)>,
    },
    /// The client must report whenever its avatar departs from its course. If it allows less than
    /// the last order, it is an ask as well.
    Live {
        /// The client that is told.
        to: AvatarId,
        /// What may be left unsaid.
        tolerance: Tolerance,
    },
    /// Nobody can see the client: it is silent unless it is asked or is about to leave this TBV.
    Quiet {
        /// The client that is told.
        to: AvatarId,
        /// Where it may be silent.
        tbv: Tbv,
    },
    /// The client must report once, now.
    Ask {
        /// The client that is told.
        to: AvatarId,
    },
    /// A claim of the client was refused. Its avatar is here.
    Correct {
        /// The client that is told.
        to: AvatarId,
        /// The pose.
        pose: Pose,
    },
    /// An avatar that the client sees, or the client itself, said something.
    Chat {
        /// The client that is told.
        to: AvatarId,
        /// The avatar that said it.
        from: AvatarId,
        /// The text.
        text: String,
    },
    /// The client is out: it persists in false claims, does not answer, or the building is full.
    /// The engine has forgotten the avatar, so no [`Input::Leave`] need follow.
    Drop {
        /// The client that is told.
        to: AvatarId,
        /// The reason, for people.
        reason: String,
    },
}

impl Output {
    /// The client that is told.
    pub fn to(&self) -> AvatarId {
        match *self {
            Self::Entered { to, .. }
            | Self::Appear { to, .. }
            | Self::Vanish { to, .. }
            | Self::Poses { to, .. }
            | Self::Live { to, .. }
            | Self::Quiet { to, .. }
            | Self::Ask { to }
            | Self::Correct { to, .. }
            | Self::Chat { to, .. }
            | Self::Drop { to, .. } => to,
        }
    }
}
