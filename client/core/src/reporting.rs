//! When a client reports its pose.
//!
//! The server expects one of three things of a client in the world: a report when its avatar
//! departs from its course (*live*), silence inside a TBV (*quiet*), or one report at once
//! (*asked*). [`Reporter`] keeps what the server ordered last and decides whether a report is due.
//! It knows no messages and no clock, so that real clients and simulated ones decide by the same
//! code.

use std::{f32::consts::FRAC_PI_4, time::Duration};

use glam::Vec3;
use sightline_protocol::quantise::WirePose;
use sightline_world::motion::{
    Agility, FREE_FALL, KEEP_ALIVE, Pose, Report, ReportingState, Tbv, Tolerance, turn_between,
};

/// A client that reports that it leaves its TBV repeats the report this number of ticks after the
/// answer should have arrived.
const REPEAT_TICKS: u32 = 2;
/// A call that comes early, by up to a tick divided by this number, still counts for its tick.
const EARLY: u32 = 8;
/// The times of two reports differ by at least a tick divided by this number, so that they differ
/// on the wire too.
const TICK_PARTS: u32 = 32;

/// A body falls freely if it gains speed as fast as [`FREE_FALL`] within this part of it.
const FALL_SPREAD: f32 = 0.4;

/// A body that turns faster than this, in radians a second, has soon turned to where it wants. Its
/// course does not turn on.
const FLICK: f32 = 8.0;
/// A turn off course that exceeds the tolerance by more than this counts at once, in radians.
const LARGE_TURN: f32 = FRAC_PI_4;

/// Why a report is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportReason {
    /// The server asked for one report, or allows less to be left unsaid.
    Asked,
    /// The client is live and reports at every tick.
    EveryTick,
    /// The avatar has departed from its course.
    Departed,
    /// The avatar has been on course for long.
    KeepAlive,
    /// The TBV may not hold the avatar until the next tick.
    Leaving,
    /// The validity of the TBV ends.
    Expired,
}

/// What the server ordered last.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Order {
    Live(Tolerance),
    Quiet(Tbv),
}

/// For how many of its ticks in the world a client was in each state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReportingCounts {
    /// All ticks.
    pub ticks: u64,
    /// Ticks at which it was quiet.
    pub quiet: u64,
    /// Ticks at which it was live and sent no report, since its avatar was on course.
    pub on_course: u64,
}

/// Decides when one client reports. A new reporter is outside the world, where no report is due.
#[derive(Clone, Debug)]
pub struct Reporter {
    tick: Duration,
    agility: Agility,
    is_inside: bool,
    order: Order,
    /// How many orders have arrived.
    orders: u32,
    is_asked: bool,
    /// When the client's own time was zero: at its first tick in the world.
    origin: Option<Duration>,
    /// The last report, with its pose as the server knows it.
    last: Option<Report>,
    /// The earliest time of the next report.
    made_from: Duration,
    /// The pose at the last tick, with the rates at which it changed, and when that was.
    before: Option<(Duration, Pose)>,
    /// Ticks until a report that leaves the TBV may be repeated.
    repeat_ticks: u32,
    /// Whether the avatar was turned off its course at the last tick.
    was_turned: bool,
    counts: ReportingCounts,
}

impl Reporter {
    /// A reporter for a body of this agility, which decides once in every `tick`.
    pub fn new(tick: Duration, agility: Agility) -> Self {
        Self {
            tick,
            agility,
            is_inside: false,
            order: Order::Live(Tolerance::NONE),
            orders: 0,
            is_asked: false,
            origin: None,
            last: None,
            made_from: Duration::ZERO,
            before: None,
            repeat_ticks: 0,
            was_turned: false,
            counts: ReportingCounts::default(),
        }
    }

    /// The avatar enters the world. Until the server orders otherwise it reports at every tick.
    pub fn enter(&mut self) {
        self.is_inside = true;
    }

    /// The avatar leaves the world for one with these ticks, where bodies have this agility, and no
    /// order stands. The client's own time goes on.
    pub fn leave(&mut self, tick: Duration, agility: Agility) {
        let Self { origin, made_from, counts, .. } = *self;
        *self = Self { origin, made_from, counts, ..Self::new(tick, agility) };
    }

    /// The earliest time of the next report, on the client's own clock.
    pub fn reports_from(&self) -> Duration {
        self.made_from
    }

    /// The server asks for one report.
    pub fn ask(&mut self) {
        self.is_asked = true;
    }

    /// The server expects silence while a TBV holds the avatar.
    pub fn expect_silence(&mut self, tbv: Tbv) {
        self.order = Order::Quiet(tbv);
        self.orders = self.orders.wrapping_add(1);
        self.is_asked = false;
        self.repeat_ticks = 0;
    }

    /// The server expects reports when the avatar departs from its course. If less may be left
    /// unsaid than before, or nothing was, one report is owed at once: it shows that the client
    /// knows the order.
    pub fn expect_reports(&mut self, tolerance: Tolerance) {
        let is_allowed = match &self.order {
            Order::Live(before) => !before.is_none() && before.is_within(&tolerance),
            Order::Quiet(_) => false,
        };
        self.is_asked |= !is_allowed;
        self.order = Order::Live(tolerance);
        self.orders = self.orders.wrapping_add(1);
    }

    /// The server has put the avatar elsewhere, or a report was refused. The course begins anew.
    pub fn forget_course(&mut self) {
        (self.last, self.before) = (None, None);
    }

    /// The report that is owed at once because the server asked for it, if it did. The debt is then
    /// settled.
    pub fn answer(&mut self, now: Duration, pose: &Pose) -> Option<Report> {
        let is_owed = self.is_inside && self.origin.is_some() && self.is_asked;
        is_owed.then(|| self.report(now.saturating_sub(self.origin.unwrap_or(now)), now, pose))
    }

    /// Why a client at this pose should report now; `None` when it should be silent. Nothing is
    /// settled, and an answer to an earlier report is not waited for.
    pub fn due(&self, now: Duration, pose: &Pose) -> Option<ReportReason> {
        if !self.is_inside {
            return None;
        }
        if self.is_asked {
            return Some(ReportReason::Asked);
        }
        match &self.order {
            Order::Live(tolerance) => self.due_on_course(now, pose, tolerance),
            Order::Quiet(tbv) if !tbv.holds(pose, self.tick, &self.agility) => {
                Some(ReportReason::Leaving)
            }
            Order::Quiet(tbv) => (now + self.tick > tbv.expiry).then_some(ReportReason::Expired),
        }
    }

    fn due_on_course(
        &self,
        now: Duration,
        pose: &Pose,
        tolerance: &Tolerance,
    ) -> Option<ReportReason> {
        if tolerance.is_none() {
            return Some(ReportReason::EveryTick);
        }
        let Some(last) = self.last else { return Some(ReportReason::Departed) };
        let elapsed = self.tick_time(now).saturating_sub(last.made);
        let course = last.pose.on_course(elapsed, &self.agility);
        let is_there = tolerance.holds(&course, &self.moving(now, pose), &self.agility);
        // No promise depends on how an avatar is turned, and many a small turn is taken back at
        // once.
        let radians = tolerance.radians + if self.was_turned { 0.0 } else { LARGE_TURN };
        let is_turned = !Tolerance { radians, ..*tolerance }.holds_turn(&course, pose);
        if !is_there || is_turned {
            Some(ReportReason::Departed)
        } else {
            (elapsed + self.tick > KEEP_ALIVE).then_some(ReportReason::KeepAlive)
        }
    }

    /// The report of a client at this pose at this tick, and its reason; `None` when it is silent.
    /// To be called once a tick. A report that leaves the TBV is not repeated before its answer
    /// should have come, one `round_trip` later.
    pub fn tick(
        &mut self,
        now: Duration,
        pose: &Pose,
        round_trip: Duration,
    ) -> Option<(ReportReason, Report)> {
        debug_assert!(pose.is_finite(), "an own pose is finite: {pose:?}");
        if !self.is_inside {
            return None;
        }
        self.origin.get_or_insert(now);
        let mut reason = self.due(now, pose);
        if matches!(reason, Some(ReportReason::Leaving | ReportReason::Expired)) {
            if self.repeat_ticks > 0 {
                reason = None;
            } else {
                let round_trip_ticks = round_trip.div_duration_f32(self.tick).ceil();
                self.repeat_ticks = (round_trip_ticks as u32).saturating_add(REPEAT_TICKS);
            }
        }
        self.repeat_ticks = self.repeat_ticks.saturating_sub(1);
        let is_quiet = self.state() == Some(ReportingState::Quiet);
        self.counts.ticks += 1;
        self.counts.quiet += u64::from(is_quiet);
        self.counts.on_course += u64::from(!is_quiet && reason.is_none());
        self.was_turned = reason.is_none() && self.is_turned(now, pose);
        let report = reason.map(|reason| (reason, self.report(self.tick_time(now), now, pose)));
        self.before = Some((now, self.moving(now, pose)));
        report
    }

    /// Whether the avatar is turned off its course.
    fn is_turned(&self, now: Duration, pose: &Pose) -> bool {
        let (Some(last), Order::Live(tolerance)) = (&self.last, &self.order) else { return false };
        let elapsed = self.tick_time(now).saturating_sub(last.made);
        !tolerance.holds_turn(&last.pose.on_course(elapsed, &self.agility), pose)
    }

    /// Whether the avatar is in the world.
    pub fn is_inside(&self) -> bool {
        self.is_inside
    }

    /// What the server expects of the client; `None` before it is in the world.
    pub fn state(&self) -> Option<ReportingState> {
        match self.order {
            _ if !self.is_inside => None,
            Order::Quiet(_) if self.is_asked => Some(ReportingState::Asked),
            Order::Quiet(_) => Some(ReportingState::Quiet),
            Order::Live(_) => Some(ReportingState::Live),
        }
    }

    /// The region in which silence is expected; `None` while live.
    pub fn tbv(&self) -> Option<Tbv> {
        match self.order {
            Order::Quiet(tbv) => Some(tbv),
            Order::Live(_) => None,
        }
    }

    /// What may be left unsaid; `None` while quiet.
    pub fn tolerance(&self) -> Option<Tolerance> {
        match self.order {
            Order::Live(tolerance) => Some(tolerance),
            Order::Quiet(_) => None,
        }
    }

    /// For how many ticks the client was in each state.
    pub fn counts(&self) -> ReportingCounts {
        self.counts
    }

    /// Makes a report at a time of the client's own. What was asked for is then settled.
    fn report(&mut self, time: Duration, now: Duration, pose: &Pose) -> Report {
        let pose = Pose::from(WirePose::from(&self.moving(now, pose)));
        let made = time.max(self.made_from);
        self.made_from = made + self.tick / TICK_PARTS;
        let report = Report { made, orders: self.orders, pose };
        self.is_asked = false;
        self.last = Some(report);
        report
    }

    /// The client's own time at a tick: a multiple of the tick interval, however late the tick is.
    /// So the server knows at which moments the client compares its avatar with the course. A late
    /// tick then looks like a late message.
    fn tick_time(&self, now: Duration) -> Duration {
        let elapsed = now.saturating_sub(self.origin.unwrap_or(now));
        let ticks = (elapsed + self.tick / EARLY).as_nanos() / self.tick.as_nanos().max(1);
        self.tick * u32::try_from(ticks).unwrap_or(u32::MAX)
    }

    /// A pose with the rates at which it changes: the means over the last tick. For a body in jerky
    /// motion they predict better than the velocity of the moment.
    fn moving(&self, now: Duration, pose: &Pose) -> Pose {
        let Some((at, before)) = self.before else { return *pose };
        let elapsed = now.saturating_sub(at);
        if elapsed < self.tick / 2 {
            let Pose { velocity, yaw_rate, falls, .. } = before;
            return Pose { velocity, yaw_rate, falls, ..*pose };
        }
        if elapsed > self.tick * 2 {
            return *pose;
        }
        let seconds = elapsed.as_secs_f32();
        let mean = (pose.eye - before.eye) / seconds;
        // In free fall the velocity of the moment is ahead of the mean by half a tick.
        let half = 0.5 * FREE_FALL * seconds;
        let mean_before = before.velocity.y + if before.falls { half } else { 0.0 };
        let gained = (mean_before - mean.y) / seconds;
        let falls = (gained - FREE_FALL).abs() < FALL_SPREAD * FREE_FALL;
        let is_likely = mean.distance(pose.velocity) <= self.agility.dash;
        let turned = turn_between(before.yaw, pose.yaw);
        let velocity = match is_likely {
            true if falls => mean - Vec3::Y * half,
            true => mean,
            false => pose.velocity,
        };
        let yaw_rate = if turned.abs() > FLICK * seconds { 0.0 } else { turned / seconds };
        Pose { velocity, yaw_rate, falls: falls && is_likely, ..*pose }
    }
}

#[cfg(test)]
mod tests;
