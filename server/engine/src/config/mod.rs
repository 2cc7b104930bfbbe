//! Configuration of the engine.

mod policy;
mod tbv;

use std::time::Duration;

pub use policy::{Policy, PolicyError};
pub use tbv::{TbvShape, Validity};

/// The longest time in a [`Config`].
const TIME_MAX: Duration = Duration::from_secs(3_600);
/// The longest horizon. For every 25 ms of it there may be a region of each avatar.
const HORIZON_MAX: Duration = Duration::from_secs(10);
/// The shortest tick.
const TICK_MIN: Duration = Duration::from_millis(1);
/// The largest budget: more than a second of sight tests.
const BUDGET_MAX: u32 = 100_000_000;
/// The largest top speed, in metres a second. Anything faster crosses a building in a tick.
const SPEED_MAX: f32 = 10_000.0;
/// The largest margin of regions, in metres.
const SPARE_MAX_M: f32 = 100.0;
/// The longest time for which an avatar is kept, in ticks.
const HOLD_TICKS_MAX: u32 = 100_000;
/// The most threads.
const THREADS_MAX: usize = 64;

/// How the engine works. The default suits people in a building, over the internet.
///
/// A value out of range counts as the nearest one in range. Times are at most an hour, a tick is at
/// least a millisecond, and the horizon is at most ten seconds. NaN counts as the default.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Which avatars each client is told of.
    pub policy: Policy,
    /// The time between two calls of [`Engine::tick`](crate::Engine::tick), and between two ticks
    /// of a client, at each of which it may report.
    pub tick: Duration,
    /// How long a TBV is made to last.
    pub validity: Validity,
    /// Whether live clients report by exception: only when their avatars depart from their courses.
    /// Otherwise, and under all policies but [`Policy::Tbv`], they report at every tick
    /// ([`Config::reports_by_exception`]).
    pub by_exception: bool,
    /// The longest validity of a TBV.
    pub validity_max: Duration,
    /// What bounds a TBV in space.
    pub shape: TbvShape,
    /// By how much a message may take longer than half of its client's measured round trip.
    pub margin: Margin,
    /// By how much a message to or from another station may take longer than half of the measured
    /// round trip of its link.
    pub bus_margin: Margin,
    /// The longest round trip, and the longest silence of a live client, that is allowed for. A
    /// client above it is treated as if it were at it, and may then be told late and be seen late.
    pub horizon_max: Duration,
    /// The assumed round trip of a client until it is measured.
    pub round_trip_initial: Duration,
    /// The top speed of avatars, in metres a second; the world's own limit when `None`.
    pub speed_max: Option<f32>,
    /// The small margin of cached live regions on each side, in metres, so that a region lasts for
    /// a few ticks.
    pub spare_m: f32,
    /// The most that all sight tests of a tick cost, in units of
    /// [`Occluders::between`](sightline_visibility::box_visibility::Occluders::between): 100,000
    /// units take one to five milliseconds. A pair that the budget does not decide counts as
    /// visible.
    pub sight_test_budget: u32,
    /// The most that the sight tests for silences cost in a tick, in the same units. They find out
    /// who can be silent.
    pub silence_budget: u32,
    /// The most that one sight test costs, in the same units.
    pub sight_test_max: u32,
    /// For how many ticks a viewer keeps an avatar after it was last found in sight. The viewer is
    /// told nothing of it meanwhile. So avatars at a door post do not flicker.
    pub hold_ticks: u32,
    /// How long after a failure the engine tries again to silence an avatar.
    pub silence_retry: Duration,
    /// A live client that is silent for so long is asked to report.
    pub stall: Duration,
    /// An ask is repeated when its answer is this much later than the round trip.
    pub ask_timeout: Duration,
    /// A client is dropped after this number of asks in a row without an answer.
    pub asks_max: u32,
    /// A client is dropped after this number of refused claims in a row.
    pub refusals_max: u32,
    /// Refused claims are in a row when less than this time is between any two of them.
    pub refusal_window: Duration,
    /// The most TBVs that end in one tick; more are spread over earlier ticks. The engine allows
    /// itself more when the population needs more.
    pub expiries_max: usize,
    /// The most participants. Each costs about 4 KiB, and more for what it sees.
    pub avatars_max: usize,
    /// The longest name, in characters. Longer names are cut.
    pub name_chars_max: usize,
    /// The longest chat message, in characters. Longer ones are cut.
    pub chat_chars_max: usize,
    /// The number of threads that share a tick; 1 is the caller's own. The outputs are the same
    /// with any number.
    pub threads: usize,
    /// Faults for tests of the tests.
    #[doc(hidden)]
    pub faults: FaultInjection,
}

/// Faults that a test injects, to see that another test finds them. The default injects none.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultInjection {
    /// The factor by which each TBV is larger than it should be, about its avatar.
    pub tbv_scale: f32,
    /// The factor by which the notice of a TBV is longer than it should be.
    pub notice_scale: f32,
    /// The factor by which live regions are larger than they should be, about their avatars.
    pub region_scale: f32,
    /// By how much clients are asked too late.
    pub expiry_late: Duration,
    /// How many ticks too late it shows that a result of sight tests no longer holds.
    pub certificates_late: u32,
    /// What a station does wrong with its neighbours.
    pub station: Option<StationFault>,
}

/// What a station does wrong with its neighbours.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StationFault {
    /// It takes what it hears for as new as what its own clients say.
    BusIgnored,
    /// It subscribes to what its own avatars may see from where they are now.
    LateSubscription,
    /// It lets its avatars be silent whatever others say, and whoever may see them there.
    SilenceUnasked,
    /// It does not say that an avatar leaves its box.
    LeavingUnsaid,
}

impl Default for FaultInjection {
    fn default() -> Self {
        let expiry_late = Duration::ZERO;
        let (tbv_scale, notice_scale, region_scale) = (1.0, 1.0, 1.0);
        Self {
            tbv_scale,
            notice_scale,
            region_scale,
            expiry_late,
            certificates_late: 0,
            station: None,
        }
    }
}

impl Config {
    /// Whether live clients report only when their avatars depart from their courses: with
    /// [`Config::by_exception`], and under [`Policy::Tbv`] alone.
    pub fn reports_by_exception(&self) -> bool {
        self.policy == Policy::Tbv && self.by_exception
    }

    /// The configuration with another sight-test budget, and with the same share of it for one
    /// test.
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

    /// The configuration with all values in range, so that no sum of times overflows and no search
    /// takes for ever.
    pub(crate) fn bounded(self) -> Self {
        let time = |time: Duration| time.min(TIME_MAX);
        let validity = match self.validity {
            Validity::Constant(validity) => Validity::Constant(time(validity)),
            other => other,
        };
        let bounded = |margin: Margin| match margin {
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
            margin: bounded(self.margin),
            bus_margin: bounded(self.bus_margin),
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
            by_exception: true,
            validity_max: Duration::from_secs(8),
            shape: TbvShape::Reach,
            margin: Margin::Measured {
                first: Duration::from_millis(25),
                most: Duration::from_millis(100),
            },
            bus_margin: Margin::Measured {
                first: Duration::from_millis(10),
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
            asks_max: 30,
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

/// How much jitter is allowed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Margin {
    /// Always this much.
    Fixed(Duration),
    /// As much as the arrivals of each client's reports show.
    Measured {
        /// The margin until there are enough reports.
        first: Duration,
        /// The largest margin. A client with later messages may be told late, or be seen late.
        most: Duration,
    },
}

impl Margin {
    /// The margin of a client of which nothing is known yet.
    pub fn first(self) -> Duration {
        match self {
            Self::Fixed(margin) => margin,
            Self::Measured { first, most } => first.min(most),
        }
    }
}
