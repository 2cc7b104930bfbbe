//! When a client reports its pose.
//!
//! The server expects one of three things of a client in the world: a report at every tick
//! (*live*), silence inside a TBV (*quiet*), or one report at once (*asked*). [`Reporter`] keeps
//! what the server ordered last and decides whether a report is due. It knows no messages and no
//! clock, so that real clients and simulated ones decide by the same code.

use std::time::Duration;

use sightline_world::motion::{Agility, Pose, ReportingState, Tbv};

/// A report that leaves the TBV is repeated this many ticks after its answer should have come.
const REPEAT_TICKS: u32 = 2;

/// Why a report is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportReason {
    /// The server asked for one report.
    Asked,
    /// The client is live and reports at every tick.
    Live,
    /// The TBV may not hold the avatar until the next tick.
    Leaving,
}

/// Decides when one client reports. A new reporter is outside the world, where no report is due.
#[derive(Clone, Debug)]
pub struct Reporter {
    tick: Duration,
    agility: Agility,
    is_inside: bool,
    /// The region in which silence is expected; `None` while live.
    tbv: Option<Tbv>,
    is_asked: bool,
    /// Ticks until a report that leaves the TBV may be repeated.
    repeat_ticks: u32,
    quiet_since: Option<Duration>,
    /// Time in silence before `quiet_since`.
    quiet_before: Duration,
}

impl Reporter {
    /// A reporter for a body of this agility, which decides once in every `tick`.
    pub fn new(tick: Duration, agility: Agility) -> Self {
        Self {
            tick,
            agility,
            is_inside: false,
            tbv: None,
            is_asked: false,
            repeat_ticks: 0,
            quiet_since: None,
            quiet_before: Duration::ZERO,
        }
    }

    /// The avatar enters the world. Unless the server ordered otherwise it is live.
    pub fn enter(&mut self) {
        self.is_inside = true;
    }

    /// The server asks for one report.
    pub fn ask(&mut self) {
        self.is_asked = true;
    }

    /// The server expects silence while a TBV holds the avatar.
    pub fn expect_silence(&mut self, tbv: Tbv, now: Duration) {
        self.tbv = Some(tbv);
        self.is_asked = false;
        self.repeat_ticks = 0;
        self.quiet_since.get_or_insert(now);
        debug_assert!(self.state() != Some(ReportingState::Live), "{:?}", self.state());
    }

    /// The server expects a report at every tick.
    pub fn expect_reports(&mut self, now: Duration) {
        self.tbv = None;
        self.is_asked = false;
        if let Some(since) = self.quiet_since.take() {
            self.quiet_before += now.saturating_sub(since);
        }
        debug_assert!(!matches!(self.state(), Some(ReportingState::Quiet | ReportingState::Asked)));
    }

    /// Whether a report is owed at once because the server asked for it. The debt is then settled.
    pub fn take_ask(&mut self) -> bool {
        self.is_inside && std::mem::take(&mut self.is_asked)
    }

    /// Why a client at this pose should report now; `None` when it should be silent. Nothing is
    /// settled, and an answer to an earlier report is not waited for.
    pub fn due(&self, pose: &Pose) -> Option<ReportReason> {
        if !self.is_inside {
            return None;
        }
        match &self.tbv {
            _ if self.is_asked => Some(ReportReason::Asked),
            None => Some(ReportReason::Live),
            Some(tbv) if tbv.holds(pose, self.tick, &self.agility) => None,
            Some(_) => Some(ReportReason::Leaving),
        }
    }

    /// Why a client at this pose reports at this tick; `None` when it is silent. To be called once
    /// a tick. A report that leaves the TBV is not repeated before its answer should have come,
    /// one `round_trip` later.
    pub fn tick(&mut self, pose: &Pose, round_trip: Duration) -> Option<ReportReason> {
        debug_assert!(pose.is_finite(), "an own pose is finite: {pose:?}");
        let reason = self.due(pose);
        if reason == Some(ReportReason::Asked) {
            self.is_asked = false;
            return reason;
        }
        if self.is_inside && self.tbv.is_some() {
            self.repeat_ticks = self.repeat_ticks.saturating_sub(1);
        }
        if reason == Some(ReportReason::Leaving) {
            if self.repeat_ticks > 0 {
                return None;
            }
            let round_trip_ticks = round_trip.div_duration_f32(self.tick).ceil();
            self.repeat_ticks = (round_trip_ticks as u32).saturating_add(REPEAT_TICKS);
        }
        reason
    }

    /// Whether the avatar is in the world.
    pub fn is_inside(&self) -> bool {
        self.is_inside
    }

    /// What the server expects of the client; `None` before it is in the world.
    pub fn state(&self) -> Option<ReportingState> {
        match self.tbv {
            _ if !self.is_inside => None,
            _ if self.is_asked => Some(ReportingState::Asked),
            Some(_) => Some(ReportingState::Quiet),
            None => Some(ReportingState::Live),
        }
    }

    /// The region in which silence is expected; `None` while live.
    pub fn tbv(&self) -> Option<Tbv> {
        self.tbv
    }

    /// For how long silence was expected, up to now.
    pub fn quiet_time(&self, now: Duration) -> Duration {
        let current = self.quiet_since.map_or(Duration::ZERO, |since| now.saturating_sub(since));
        self.quiet_before + current
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_world::{
        geometry::{Aabb, Axes},
        motion::Body,
    };

    use super::*;

    const TICK: Duration = Duration::from_millis(50);

    fn reporter() -> Reporter {
        Reporter::new(TICK, Agility::of(&Body::PERSON, 4.0))
    }

    fn tbv(radius: f32) -> Tbv {
        let within = Aabb::around(Vec3::ZERO, radius);
        let (expiry, notice) = (Duration::from_secs(1), Duration::ZERO);
        Tbv { within, axes: Axes::WORLD, expiry, notice }
    }

    fn pose(x: f32) -> Pose {
        Pose { eye: Vec3::X * x, ..Pose::default() }
    }

    #[test]
    fn nothing_is_due_outside_the_world() {
        let mut reporter = reporter();
        reporter.ask();
        assert_eq!((reporter.due(&pose(0.0)), reporter.take_ask()), (None, false));
        reporter.enter();
        assert_eq!(reporter.tick(&pose(0.0), TICK), Some(ReportReason::Asked));
        assert_eq!(reporter.tick(&pose(0.0), TICK), Some(ReportReason::Live));
    }

    #[test]
    fn a_report_that_leaves_the_tbv_waits_for_its_answer() {
        let mut reporter = reporter();
        reporter.enter();
        reporter.expect_silence(tbv(1.0), TICK);
        assert_eq!(reporter.tick(&pose(0.9), TICK), None);
        let reasons = [(); 7].map(|()| reporter.tick(&pose(1.1), TICK));
        let leaving = Some(ReportReason::Leaving);
        assert_eq!(reasons, [leaving, None, None, leaving, None, None, leaving]);
        assert_eq!(reporter.due(&pose(1.1)), leaving, "it is due all the time");
        reporter.expect_silence(tbv(2.0), TICK);
        assert_eq!(reporter.tick(&pose(2.1), TICK), leaving, "a new TBV waits for nothing");
    }

    #[test]
    fn an_ask_is_settled_once() {
        let mut reporter = reporter();
        reporter.enter();
        reporter.expect_silence(tbv(1.0), TICK);
        reporter.ask();
        assert_eq!(reporter.due(&pose(0.0)), Some(ReportReason::Asked));
        assert_eq!((reporter.take_ask(), reporter.take_ask()), (true, false));
        assert_eq!(reporter.tick(&pose(0.0), TICK), None);
    }
}
