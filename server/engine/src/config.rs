//! What the engine can be told about how to work.

use std::{fmt, str::FromStr, time::Duration};

/// No time in a [`Config`] is longer, ...
const TIME_MAX: Duration = Duration::from_secs(3_600);
/// ... and the horizon, for every 25 ms of which there may be a region of each avatar, no longer than this.
const HORIZON_MAX: Duration = Duration::from_secs(10);
const TICK_MIN: Duration = Duration::from_millis(1);
/// For a second and more of looks.
const BUDGET_MAX: u32 = 100_000_000;
/// In metres a second: what is faster crosses any building in a tick.
const SPEED_MAX: f32 = 10_000.0;
const SPARE_MAX_M: f32 = 100.0;
const HOLD_TICKS_MAX: u32 = 100_000;
const THREADS_MAX: usize = 64;

/// How the engine works. The default suits people in a building, over the internet.
///
/// What makes no sense counts as what comes nearest to it and does: times above an hour as an hour, a tick below a
/// millisecond as one, a horizon above ten seconds as these, and what is no number as the default.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Who is told what.
    pub policy: Policy,
    /// How often [`Engine::tick`](crate::Engine::tick) is called, and how often a live client
    /// reports.
    pub tick: Duration,
    /// How long a TBV is made to last.
    pub validity: Validity,
    /// No TBV lasts longer.
    pub validity_max: Duration,
    /// What bounds a TBV in space.
    pub shape: TbvShape,
    /// What a message may take longer than half of its client's measured round trip.
    pub margin: Margin,
    /// A client that takes longer than this for a round trip, or falls silent for longer while
    /// live, is treated as if it took just this: it may then be told late, and be seen late.
    pub horizon_max: Duration,
    /// The round trip of a client until it is measured.
    pub round_trip_initial: Duration,
    /// Faster than this no avatar moves, in metres a second; the world's own limit when `None`.
    pub speed_max: Option<f32>,
    /// Where a live avatar can be is worked out with so much to spare on each side, in metres, so
    /// that it lasts for a few ticks.
    pub spare_m: f32,
    /// What all looks from regions to regions may cost in a tick, in units of
    /// [`Occluders::between`](sightline_visibility::box_visibility::Occluders::between): 100,000 take one to
    /// five milliseconds.
    pub sight_test_budget: u32,
    /// The same, to find out who can be silent.
    pub silence_budget: u32,
    /// What one look may cost.
    pub sight_test_max: u32,
    /// For so many ticks after an avatar was last found in sight its viewer keeps it, though nothing is said
    /// of it, so that nobody flickers at a door post.
    pub hold_ticks: u32,
    /// How long after a TBV was found to be in view the next one is tried.
    pub silence_retry: Duration,
    /// A live client that is silent for so long is asked.
    pub stall: Duration,
    /// An ask that is not answered for so long beyond the round trip is sent again.
    pub ask_timeout: Duration,
    /// A client that leaves so many asks in a row unanswered is dropped.
    pub asks_max: u32,
    /// A client with so many claims refused in a row is dropped ...
    pub refusals_max: u32,
    /// ... when less than this lies between each two of them.
    pub refusal_window: Duration,
    /// TBVs that end in one tick, before they are spread over earlier ones. The engine allows
    /// itself more when the population needs more.
    pub expiries_max: usize,
    /// More participants than this are refused. Each costs about 4 KiB and what it sees.
    pub avatars_max: usize,
    /// Names are cut to so many characters.
    pub name_chars_max: usize,
    /// Chat is cut to so many characters.
    pub chat_chars_max: usize,
    /// Threads that share a tick: 1 is the caller's own. The outputs are the same with any number.
    pub threads: usize,
    #[doc(hidden)]
    pub faults: FaultInjection,
}

/// What a test breaks, to see that it is found.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultInjection {
    /// The region of each TBV is so many times as large, about its avatar's place.
    pub tbv_scale: f32,
    /// The notice of those that last until they are left is so many times as long.
    pub notice_scale: f32,
    /// Where live avatars can be soon is taken to be so many times as large, about their places.
    pub region_scale: f32,
    /// Expiries are asked so much too late.
    pub expiry_late: Duration,
}

impl Default for FaultInjection {
    fn default() -> Self {
        let expiry_late = Duration::ZERO;
        Self { tbv_scale: 1.0, notice_scale: 1.0, region_scale: 1.0, expiry_late }
    }
}

impl Config {
    /// With another budget for looks, and with as great a share of it for one look as before.
    #[must_use]
    pub fn with_sight_test_budget(self, sight_test_budget: u32) -> Self {
        let share = u64::from(self.sight_test_max) * u64::from(sight_test_budget);
        let sight_test_max = share / u64::from(self.sight_test_budget.max(1));
        Self {
            sight_test_budget,
            sight_test_max: u32::try_from(sight_test_max).unwrap_or(u32::MAX),
            ..self
        }
    }

    /// With all within bounds, so that no sum of times overflows, and nothing is worked out for ever.
    pub(crate) fn bounded(self) -> Self {
        let time = |time: Duration| time.min(TIME_MAX);
        let validity = match self.validity {
            Validity::Constant(validity) => Validity::Constant(time(validity)),
            other => other,
        };
        let margin = match self.margin {
            Margin::Fixed(margin) => Margin::Fixed(margin.min(HORIZON_MAX)),
            Margin::Measured { first, most } => {
                Margin::Measured { first: first.min(HORIZON_MAX), most: most.min(HORIZON_MAX) }
            }
        };
        let spare_m = self.spare_m.clamp(0.0, SPARE_MAX_M);
        Self {
            tick: self.tick.clamp(TICK_MIN, TIME_MAX),
            validity,
            validity_max: time(self.validity_max),
            margin,
            horizon_max: self.horizon_max.min(HORIZON_MAX),
            round_trip_initial: time(self.round_trip_initial),
            speed_max: self.speed_max.filter(|s| !s.is_nan()).map(|s| s.clamp(0.0, SPEED_MAX)),
            spare_m: if spare_m.is_nan() { Self::default().spare_m } else { spare_m },
            sight_test_budget: self.sight_test_budget.min(BUDGET_MAX),
            silence_budget: self.silence_budget.min(BUDGET_MAX),
            sight_test_max: self.sight_test_max.min(BUDGET_MAX),
            hold_ticks: self.hold_ticks.min(HOLD_TICKS_MAX),
            silence_retry: time(self.silence_retry),
            stall: time(self.stall),
            ask_timeout: time(self.ask_timeout),
            refusal_window: time(self.refusal_window),
            expiries_max: self.expiries_max.max(1),
            threads: self.threads.min(THREADS_MAX),
            ..self
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            policy: Policy::Tbv,
            tick: Duration::from_millis(50),
            validity: Validity::UntilLeft,
            validity_max: Duration::from_secs(8),
            shape: TbvShape::Reach,
            margin: Margin::Measured {
                first: Duration::from_millis(25),
                most: Duration::from_millis(100),
            },
            horizon_max: Duration::from_millis(400),
            round_trip_initial: Duration::from_millis(100),
            speed_max: None,
            spare_m: 0.125,
            sight_test_budget: 300_000,
            silence_budget: 60_000,
            sight_test_max: 10_000,
            hold_ticks: 2,
            silence_retry: Duration::from_millis(100),
            stall: Duration::from_secs(1),
            ask_timeout: Duration::from_secs(1),
            asks_max: 10,
            refusals_max: 20,
            refusal_window: Duration::from_secs(5),
            expiries_max: 64,
            avatars_max: 16_384,
            name_chars_max: 32,
            chat_chars_max: 256,
            threads: 1,
            faults: FaultInjection::default(),
        }
    }
}

/// Who is told what about whom. All but [`Policy::Tbv`] exist to compare with it: under them every
/// client is live for ever.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Policy {
    /// Everyone is told about everyone.
    Broadcast,
    /// Everyone within so many metres, eye to eye.
    Radius(f32),
    /// Everyone in the same cube of a grid of so many metres, or in one of the 26 around it.
    Grid(f32),
    /// Squares as in voxel games: everyone in the viewer's square of a horizontal grid or in one of
    /// the eight around it, whatever the height. An avatar is in the square that it was in until it
    /// is more than the margin outside of it.
    Region {
        /// Of a square, in metres.
        edge: f32,
        /// In metres.
        margin: f32,
    },
    /// Everyone in the viewer's room, as where each room is a channel of its own; or in a room that
    /// so many doors or fewer lead to. Rooms are found from the world's spaces: those are in one room
    /// where a gate between them is longer than 1.6 m both ways, or at least half of the side that it is
    /// on of both; less than 2 m² of floor is no room but part of the one that its widest gate leads to.
    Room {
        /// 0 is the same room alone.
        doors: u32,
    },
    /// Everyone who may be visible from somewhere in the viewer's region: by sectors, then cells, then shafts.
    Pvs,
    /// The same; and those whom nobody can see are silent.
    Tbv,
}

impl Policy {
    /// Whether cells and the PVS decide.
    pub fn uses_cells(self) -> bool {
        matches!(self, Self::Pvs | Self::Tbv)
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Broadcast => f.write_str("broadcast"),
            Self::Radius(metres) => write!(f, "radius:{metres}"),
            Self::Grid(metres) => write!(f, "grid:{metres}"),
            Self::Region { edge, margin } => write!(f, "region:{edge}:{margin}"),
            Self::Room { doors: 0 } => f.write_str("room"),
            Self::Room { doors } => write!(f, "room:{doors}"),
            Self::Pvs => f.write_str("pvs"),
            Self::Tbv => f.write_str("tbv"),
        }
    }
}

/// How long a TBV is made to last. (Sudarsky and Gotsman, section 3.2.)
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Validity {
    /// Always so long.
    Constant(Duration),
    /// Half as long again after each that expired, half as long after each that was revealed.
    Adaptive,
    /// As long as it stays unseen by all that is known now: found by doubling, then bisection.
    Maximal,
    /// Until the client says that it is about to leave it, in as large a region as stays unseen by all that is
    /// known now.
    UntilLeft,
}

impl Validity {
    /// The longest that there can be.
    pub fn max(self, limit: Duration) -> Duration {
        if let Self::Constant(validity) = self { validity } else { limit }
    }
}

impl fmt::Display for Validity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Constant(validity) => write!(f, "{} ms", validity.as_millis()),
            Self::Adaptive => f.write_str("adaptive"),
            Self::Maximal => f.write_str("maximal"),
            Self::UntilLeft => f.write_str("until-left"),
        }
    }
}

impl FromStr for Validity {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match (text, text.parse()) {
            ("adaptive", _) => Ok(Self::Adaptive),
            ("maximal", _) => Ok(Self::Maximal),
            ("until-left", _) => Ok(Self::UntilLeft),
            (_, Ok(ms @ 1..=60_000)) => Ok(Self::Constant(Duration::from_millis(ms))),
            _ => Err("use until-left, maximal, adaptive, or milliseconds from 1 to 60000"),
        }
    }
}

/// What jitter is allowed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Margin {
    /// Always so much.
    Fixed(Duration),
    /// As much as each client's reports show to be needed.
    Measured {
        /// Until there were enough of them.
        first: Duration,
        /// Never more: what is later still may be told, or seen, late.
        most: Duration,
    },
}

impl Margin {
    /// For a client of whom nothing is known yet.
    pub fn first(self) -> Duration {
        match self {
            Self::Fixed(margin) => margin,
            Self::Measured { first, most } => first.min(most),
        }
    }
}

/// What bounds a TBV in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TbvShape {
    /// How fast a body can be, whatever is in between: a sphere of maximum speed times validity.
    Sphere,
    /// What a body can do from its present velocity, and what portals lead to on ways so long.
    Reach,
}

impl fmt::Display for TbvShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if *self == Self::Sphere { "sphere" } else { "reach" })
    }
}

impl FromStr for TbvShape {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "sphere" => Ok(Self::Sphere),
            "reach" => Ok(Self::Reach),
            _ => Err("use sphere or reach"),
        }
    }
}

/// No building has a room that is further away.
const DOORS_MAX: u32 = 100;

/// Why a policy's name was not understood.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolicyError {
    /// There is no such policy.
    #[error(
        "no such policy: use broadcast, radius:METRES, grid:METRES, region:METRES[:MARGIN], \
         room[:DOORS], pvs or tbv"
    )]
    Unknown,
    /// A length is missing or is none.
    #[error("the policy needs a length above 0 in metres, as in radius:20")]
    Length,
    /// It is no number of doors.
    #[error("rooms are up to 100 doors away, as in room:1")]
    Doors,
}

impl FromStr for Policy {
    type Err = PolicyError;

    fn from_str(text: &str) -> Result<Self, PolicyError> {
        let (name, length) = match text.split_once(':') {
            Some((name, length)) => (name, Some(length)),
            None => (text, None),
        };
        let metres = || above_zero(length.ok_or(PolicyError::Length)?);
        match (name, length) {
            ("broadcast", None) => Ok(Self::Broadcast),
            ("pvs", None) => Ok(Self::Pvs),
            ("tbv", None) => Ok(Self::Tbv),
            ("radius", _) => metres().map(Self::Radius),
            ("grid", _) => metres().map(Self::Grid),
            ("region", _) => region(length.ok_or(PolicyError::Length)?),
            ("room", None) => Ok(Self::Room { doors: 0 }),
            ("room", Some(doors)) => match doors.parse() {
                Ok(doors) if doors <= DOORS_MAX => Ok(Self::Room { doors }),
                _ => Err(PolicyError::Doors),
            },
            _ => Err(PolicyError::Unknown),
        }
    }
}

fn above_zero(metres: &str) -> Result<f32, PolicyError> {
    let metres = metres.parse::<f32>().ok().filter(|m| m.is_finite() && *m > 0.0);
    metres.ok_or(PolicyError::Length)
}

/// An edge and, after a colon, a margin, which is else an eighth of it.
fn region(lengths: &str) -> Result<Policy, PolicyError> {
    let (edge, margin) = match lengths.split_once(':') {
        Some((edge, margin)) => (above_zero(edge)?, Some(above_zero(margin)?)),
        None => (above_zero(lengths)?, None),
    };
    Ok(Policy::Region { edge, margin: margin.unwrap_or(edge / 8.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_are_read_as_they_are_written() {
        for text in [
            "broadcast",
            "radius:20",
            "radius:2.5",
            "grid:16",
            "region:16:2.5",
            "room",
            "room:2",
            "pvs",
            "tbv",
        ] {
            assert_eq!(text.parse::<Policy>().unwrap().to_string(), text);
        }
        assert_eq!("region:16".parse(), Ok(Policy::Region { edge: 16.0, margin: 2.0 }));
        assert_eq!("room:0".parse(), Ok(Policy::Room { doors: 0 }));
        for (text, error) in [
            ("radius", PolicyError::Length),
            ("radius:", PolicyError::Length),
            ("radius:-1", PolicyError::Length),
            ("grid:NaN", PolicyError::Length),
            ("grid:inf", PolicyError::Length),
            ("region", PolicyError::Length),
            ("region:16:", PolicyError::Length),
            ("region:16:-2", PolicyError::Length),
            ("room:", PolicyError::Doors),
            ("room:-1", PolicyError::Doors),
            ("room:101", PolicyError::Doors),
            ("tbv:1", PolicyError::Unknown),
            ("", PolicyError::Unknown),
            ("Broadcast", PolicyError::Unknown),
        ] {
            assert_eq!(text.parse::<Policy>(), Err(error), "{text}");
        }
    }
}
