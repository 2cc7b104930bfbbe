//! What stations tell each other.

use std::time::Duration;

use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, Tolerance},
};

/// An engine with clients of its own and neighbours on a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StationId(pub u32);

/// What a station has to say on the bus. The bus keeps the order of what one station says to
/// another.
#[derive(Clone, Debug, PartialEq)]
pub struct StationOutput {
    /// The station that is told; all when `None`.
    pub to: Option<StationId>,
    /// The message.
    pub message: StationMessage,
}

/// A message from one station to another.
#[derive(Clone, Debug, PartialEq)]
pub struct StationMessage {
    /// The sender's number for its end of the link. It changes whenever the sender forgets all that
    /// it knew of the receiver.
    pub epoch: u32,
    /// The receiver's number for its end, as far as the sender knows; zero in a heartbeat.
    pub known: u32,
    /// How many messages the sender has sent before this one, in this epoch; zero in a heartbeat. A
    /// gap shows a loss.
    pub number: u32,
    /// When it was sent, on the sender's clock.
    pub sent: Duration,
    /// What it says.
    pub word: StationWord,
}

/// What a station says.
#[derive(Clone, Debug, PartialEq)]
pub enum StationWord {
    /// The station is there. To all.
    Heartbeat(Heartbeat),
    /// The sender wants word of avatars that may be in these sectors.
    Subscribe {
        /// The number of the subscription.
        number: u32,
        /// Sectors that are new in it, ascending.
        added: Vec<u32>,
        /// Sectors that are not in it any more, ascending.
        removed: Vec<u32>,
    },
    /// Every avatar in the sectors of a subscription has been announced.
    Synced {
        /// The number of the subscription.
        number: u32,
    },
    /// An avatar of the sender may be in a sector that the receiver subscribes to.
    Announce {
        /// The avatar.
        avatar: AvatarId,
        /// The name that others are shown.
        name: String,
        /// sRGB.
        colour: [u8; 3],
        /// Where it stays, if its client is silent.
        stay: Option<Stay>,
        /// What is known of it.
        report: GuestReport,
    },
    /// What is known of an avatar that was announced: it departs from its course, or may soon leave
    /// where it was to stay, or the receiver has asked.
    Report {
        /// The avatar.
        avatar: AvatarId,
        /// What is known of it.
        report: GuestReport,
    },
    /// An avatar that was announced cannot be in any sector that the receiver subscribes to, or has
    /// left.
    Leave {
        /// The avatar.
        avatar: AvatarId,
    },
    /// The sender wants every departure of the receiver's avatar reported, and a report now if
    /// there was none while it stayed.
    Ask {
        /// The avatar.
        avatar: AvatarId,
        /// What may be left unsaid of it.
        tolerance: Tolerance,
    },
    /// The sender wants no word of the receiver's avatar as long as it stays.
    Quiet {
        /// The avatar.
        avatar: AvatarId,
        /// Where.
        stay: Stay,
    },
    /// An avatar of the sender says something to those who hold it.
    Chat {
        /// The avatar.
        avatar: AvatarId,
        /// The text.
        text: String,
    },
}

impl StationWord {
    /// The names of the kinds, for counters.
    pub const KINDS: [&'static str; 9] =
        ["heartbeat", "subscribe", "synced", "announce", "report", "leave", "ask", "quiet", "chat"];

    /// The name of the kind, for counters.
    pub fn kind(&self) -> &'static str {
        Self::KINDS[self.kind_number()]
    }

    /// The index of the kind in [`StationWord::KINDS`].
    pub fn kind_number(&self) -> usize {
        match self {
            Self::Heartbeat(_) => 0,
            Self::Subscribe { .. } => 1,
            Self::Synced { .. } => 2,
            Self::Announce { .. } => 3,
            Self::Report { .. } => 4,
            Self::Leave { .. } => 5,
            Self::Ask { .. } => 6,
            Self::Quiet { .. } => 7,
            Self::Chat { .. } => 8,
        }
    }
}

/// Where an avatar stays until its own station says otherwise, in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stay {
    /// The box of eye positions, in the building's own axes, in metres.
    pub within: Aabb,
    /// How long before its body can be outside it is said. Zero where its client does not speak
    /// before the end of its TBV.
    pub notice: Duration,
}

/// What a station says of itself at regular intervals.
#[derive(Clone, Debug, PartialEq)]
pub struct Heartbeat {
    /// The longest round trip of its clients.
    pub slowest: Duration,
    /// The longest round trip of its clients that may be silent.
    pub silent: Duration,
    /// What it has heard of each other station.
    pub heard: Vec<HeardOf>,
}

/// What a station has heard of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeardOf {
    /// The other station.
    pub station: StationId,
    /// Its epoch.
    pub epoch: u32,
    /// When its last heartbeat was sent, on its own clock.
    pub sent: Duration,
    /// For how long that has been here.
    pub held: Duration,
    /// How many messages were sent to it in this epoch.
    pub messages: u32,
}

/// What a station knows of one of its avatars. Times are on its own clock, or on the client's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuestReport {
    /// How many asks and quiet orders of the receiver for this avatar the sender has heard.
    pub orders: u32,
    /// The last accepted pose.
    pub pose: Pose,
    /// When the client made the report of it, on the client's clock; `None` where the station
    /// itself has put the avatar there.
    pub made: Option<Duration>,
    /// When it came in, on the station's clock.
    pub heard: Duration,
    /// For how long the course may be followed.
    pub course_for: Duration,
    /// What the client may leave unsaid; none where its silence means nothing.
    pub tolerance: Tolerance,
    /// The space in which its ways begin, if any.
    pub space: Option<u32>,
    /// Whether its body has no room where it was put.
    pub is_stuck: bool,
    /// Whether it moves as its claims say.
    pub is_believed: bool,
    /// Whether its client's link is broken.
    pub is_absent: bool,
    /// The client's round trip.
    pub round_trip: Duration,
    /// When its reports come in.
    pub lags: Lags,
}

/// When a client's reports come in, as the difference of two clocks, in microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Lags {
    /// By how much a message may take longer than half of the round trip.
    pub margin: Duration,
    /// The least lag, at most.
    pub least_us: i64,
    /// The greatest lag of those on time, less half of the round trip of its time.
    pub slowest_us: i64,
    /// The lag of the quickest.
    pub quickest_us: i64,
}
