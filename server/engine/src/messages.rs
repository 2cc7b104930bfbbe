//! What goes into the engine and what comes out of it.

use std::time::Duration;

use glam::Vec3;
use sightline_world::motion::{AvatarId, Pose, Tbv};

/// What happens to the engine. Times are on the server's clock.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// A participant comes in, at a place of its choice if it may stand there.
    Join {
        /// Who; the caller never uses an id twice.
        avatar: AvatarId,
        /// How it is called.
        name: String,
        /// sRGB.
        colour: [u8; 3],
        /// Where it wants its eye; a spawn point when `None`.
        place: Option<Vec3>,
    },
    /// A participant is gone.
    Leave {
        /// Who.
        avatar: AvatarId,
    },
    /// A client says where it is.
    Report {
        /// Who.
        avatar: AvatarId,
        /// Grows with each report of the same client; an older one is ignored.
        sequence: u32,
        /// Where.
        pose: Pose,
    },
    /// The host itself puts an avatar elsewhere: a respawn, a teleporter, a jump pad. No limit
    /// applies but the world's bounds.
    Relocate {
        /// Who.
        avatar: AvatarId,
        /// Where.
        pose: Pose,
    },
    /// A client's measured round trip.
    RoundTrip {
        /// Who.
        avatar: AvatarId,
        /// From the ask to the answer.
        round_trip: Duration,
    },
    /// A participant says something to those it sees.
    Chat {
        /// Who.
        avatar: AvatarId,
        /// What.
        text: String,
    },
}

/// What the engine wants told to a client.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// You are in.
    Entered {
        /// To whom; also in the other outputs.
        to: AvatarId,
        /// Where.
        pose: Pose,
    },
    /// An avatar may come into view.
    Appear {
        /// To whom.
        to: AvatarId,
        /// Who.
        avatar: AvatarId,
        /// How it is called.
        name: String,
        /// sRGB.
        colour: [u8; 3],
        /// Where it was last.
        pose: Pose,
    },
    /// An avatar cannot be seen any more, or has left.
    Vanish {
        /// To whom.
        to: AvatarId,
        /// Who.
        avatar: AvatarId,
    },
    /// The avatars that this client may see and that have news, as they were at this tick.
    Poses {
        /// To whom.
        to: AvatarId,
        /// Counts ticks.
        tick: u32,
        /// In ascending order of id.
        poses: Vec<(AvatarId, Pose)>,
    },
    /// Report now and at every tick from now on. To a quiet client it is an ask as well.
    Live {
        /// To whom.
        to: AvatarId,
    },
    /// Nobody can see you: be silent unless asked, or about to leave this region.
    Quiet {
        /// To whom.
        to: AvatarId,
        /// The region.
        tbv: Tbv,
    },
    /// Report once, now.
    Ask {
        /// To whom.
        to: AvatarId,
    },
    /// Your claim was refused: you are here.
    Correct {
        /// To whom.
        to: AvatarId,
        /// Where.
        pose: Pose,
    },
    /// Somebody you can see, or you yourself, said something.
    Chat {
        /// To whom.
        to: AvatarId,
        /// Who.
        from: AvatarId,
        /// What.
        text: String,
    },
    /// You persist in false claims, do not answer, or find no room: out. The engine has forgotten
    /// the avatar; a leave need not follow.
    Drop {
        /// To whom.
        to: AvatarId,
        /// Why, for people.
        reason: String,
    },
}

impl Output {
    /// To whom it goes.
    pub fn to(&self) -> AvatarId {
        match *self {
            Self::Entered { to, .. }
            | Self::Appear { to, .. }
            | Self::Vanish { to, .. }
            | Self::Poses { to, .. }
            | Self::Live { to }
            | Self::Quiet { to, .. }
            | Self::Ask { to }
            | Self::Correct { to, .. }
            | Self::Chat { to, .. }
            | Self::Drop { to, .. } => to,
        }
    }
}
