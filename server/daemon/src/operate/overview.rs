//! What the page for operators and the command `status` show.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use sightline_world::geometry::{Aabb, Axes};

use super::{BusStats, OverloadStats, ProcessUse, TickSummary};
use crate::people::Role;

/// A server at one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Overview {
    /// How long the server has run, in seconds.
    pub uptime_s: f64,
    /// The world that is served; `None` before the first.
    pub world: Option<WorldName>,
    /// Ticks in a second at present.
    pub tick_hz: f64,
    /// How long ticks took.
    pub ticks: TickSummary,
    /// How long the stages of all ticks took together.
    pub stages: StageSums,
    /// How the server copes with its load.
    pub overload: OverloadStats,
    /// How many clients are in each state.
    pub clients: ClientCounts,
    /// Messages from and to all clients since the start.
    pub totals: Totals,
    /// How often a peer was refused something since the start: a limit was reached, or the peer did
    /// what no client does.
    pub refused: u64,
    /// What it has to do with other servers of the building; `None` where there is no bus.
    pub bus: Option<BusStats>,
    /// What the process has used; `None` where the system does not tell.
    pub process: Option<ProcessUse>,
    /// The clients, by avatar.
    pub people: Vec<Person>,
}

/// How long the stages of all ticks since the start took, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageSums {
    /// Taking in what clients did.
    pub take_s: f64,
    /// The engine's own ticks.
    pub engine_s: f64,
    /// Handing out what clients are told.
    pub tell_s: f64,
}

/// A world that is served.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WorldName {
    /// Its number, from 1.
    pub number: u32,
    /// Its title.
    pub title: String,
}

/// How many clients are in each state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClientCounts {
    /// Connected, and not in the world yet.
    pub joining: usize,
    /// Somebody may see them, and they report.
    pub live: usize,
    /// Somebody may see them, and their silence says that they are on course.
    pub on_course: usize,
    /// Hidden and silent.
    pub quiet: usize,
    /// They owe a report.
    pub asked: usize,
    /// Their links broke, and their avatars are kept for a while.
    pub absent: usize,
}

impl ClientCounts {
    /// Counts a client.
    pub(crate) fn add(&mut self, state: PersonState) {
        *match state {
            PersonState::Joining => &mut self.joining,
            PersonState::Live => &mut self.live,
            PersonState::OnCourse => &mut self.on_course,
            PersonState::Quiet => &mut self.quiet,
            PersonState::Asked => &mut self.asked,
            PersonState::Absent => &mut self.absent,
        } += 1;
    }
}

/// What a client does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PersonState {
    /// It is not in the world yet.
    Joining,
    /// Somebody may see its avatar, and it reports.
    Live,
    /// Somebody may see its avatar, and its silence says that the avatar is on course.
    OnCourse,
    /// It is hidden and silent.
    Quiet,
    /// It owes a report.
    Asked,
    /// Its link broke, and its avatar is kept for a while.
    Absent,
}

impl PersonState {
    /// The state, for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Joining => "joining",
            Self::Live => "live",
            Self::OnCourse => "on course",
            Self::Quiet => "quiet",
            Self::Asked => "asked",
            Self::Absent => "absent",
        }
    }
}

/// Application messages and their bytes since the start, without what QUIC itself adds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Messages received.
    pub messages_in: u64,
    /// Bytes received.
    pub bytes_in: u64,
    /// Messages sent, without the world.
    pub messages_out: u64,
    /// Bytes sent, without the world.
    pub bytes_out: u64,
    /// Bytes of worlds sent.
    pub world_bytes_out: u64,
}

/// A client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Person {
    /// Its avatar.
    pub avatar: u32,
    /// The name that others see. It comes from the client.
    pub name: String,
    /// The address of its machine.
    pub address: String,
    /// What it may do.
    pub role: Role,
    /// Whether nobody hears what it says.
    pub is_muted: bool,
    /// What it does.
    pub state: PersonState,
    /// How long it has been connected, in seconds.
    pub connected_s: f64,
    /// The round trip, in milliseconds.
    pub round_trip_ms: f64,
    /// Messages since it connected.
    pub totals: Totals,
    /// Its place; `None` before it is in the world.
    pub place: Option<Place>,
}

/// Where an avatar is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// The last accepted eye, moved on along its course, in metres.
    pub eye: [f32; 3],
    /// The heading in radians, anticlockwise from -z.
    pub yaw: f32,
    /// The TBV of a hidden avatar.
    pub tbv: Option<Prism>,
    /// How many avatars its client holds.
    pub held: usize,
}

/// An upright prism over a rectangle, in metres and the world's axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prism {
    /// The corners of the rectangle in order: x and z.
    pub corners: [[f32; 2]; 4],
    /// The lowest and the highest y.
    pub heights: [f32; 2],
}

impl Prism {
    /// A box along own axes.
    pub(crate) fn new(within: &Aabb, axes: &Axes) -> Self {
        let corner = |x, z| {
            let at = axes.world(Vec3::new(x, within.min.y, z));
            [at.x, at.z]
        };
        let (min, max) = (within.min, within.max);
        Self {
            corners: [
                corner(min.x, min.z),
                corner(max.x, min.z),
                corner(max.x, max.z),
                corner(min.x, max.z),
            ],
            heights: [min.y, max.y],
        }
    }
}

/// What one viewer may see.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sight {
    /// The avatars that its client was told of.
    pub held: Vec<u32>,
    /// The PVS of the cell of its eye: boxes around the cells, apart from those beyond the limit.
    pub cells: Vec<Prism>,
    /// How many cells there are, with those beyond the limit.
    pub cells_all: usize,
}
