//! What must hold at every tick, computed naively from outside the engine.

use std::{collections::BTreeMap, fmt, sync::Arc, time::Duration};

use glam::Vec3;
use sightline_engine::Output;
use sightline_oracle::Oracle;
use sightline_replay::{ReplayOptions, TickView};
use sightline_world::{
    CellId, World,
    geometry::Aabb,
    motion::{Agility, AvatarId, ReportingState, Tbv},
    tolerance::POKE_M,
};

/// The number of violations that are described one by one.
const VIOLATIONS_DESCRIBED: usize = 5;
/// Delays are rounded up to a multiple of this, so that viewers share regions.
const DELAY_STEP: Duration = Duration::from_millis(25);
/// The longest period for which an avatar is silenced: those that would need more stay live.
const SILENT_MAX: Duration = Duration::from_secs(1);
/// The share of a TBV that the fault of small TBVs leaves.
pub const SMALL_TBV_SCALE: f32 = 0.9;
/// The rounding of positions on the wire and in sums, in metres.
const ROUNDING_M: f32 = 0.02;
/// The number of directions in which straight walks are tried.
const DIRECTIONS: u16 = 16;
/// The speed that a person reaches at once, in metres per second; and the acceleration beyond it,
/// in metres per second squared.
const DASH: f32 = 1.4;
const ACCELERATION: f32 = 6.0;

/// A violated invariant.
#[derive(Clone, Debug, PartialEq)]
pub enum Violation {
    /// A viewer was told of an avatar that it cannot come to see within the horizon.
    Leak,
    /// A message went to or about an avatar while its TBV lasted.
    Noise,
    /// An avatar was outside its TBV.
    Outside,
    /// A place that a straight walk reaches in time, or that a body can reach otherwise, is outside
    /// the TBV.
    Small,
    /// The notice of a TBV that lasts until it is left is too short: the viewers cannot be told in
    /// time.
    Short,
    /// The avatar was not asked early enough before the expiry of its TBV.
    Late,
    /// An honest claim was refused.
    Refused,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leak => "told of an avatar that it cannot come to see",
            Self::Noise => "a message while a TBV lasts",
            Self::Outside => "outside its TBV",
            Self::Small => "a TBV smaller than the reach of the body",
            Self::Short => "the notice is too short",
            Self::Late => "asked too late",
            Self::Refused => "an honest claim refused",
        })
    }
}

/// Where an eye was, and a box that it cannot have left since then, in the world's own axes.
struct EyeRegion {
    from: Vec3,
    within: Aabb,
}

/// Checks the invariants of a simulation, tick by tick.
pub struct InvariantChecker {
    world: Arc<World>,
    oracle: Oracle,
    speed_max: f32,
    tick: Duration,
    /// The greatest extra width of the engine's regions on each side, in metres.
    spare_m: f32,
    /// The delay beyond half the round trip that is allowed for new clients.
    margin: Duration,
    horizon_max: Duration,
    /// For each avatar hidden at the last tick: its TBV, whether it was quiet, and when it must be
    /// asked at the latest.
    hidden: BTreeMap<AvatarId, (Tbv, bool, Duration)>,
    seen: Observations,
}

/// What was observed in a simulation.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// The first violations, in words.
    pub violations: Vec<String>,
    /// The number of ticks of avatars that were hidden in a TBV, summed over avatars.
    pub hidden_ticks: u64,
    /// TBVs that last until they are left.
    pub stays: u64,
    /// TBVs that would be too small at nine tenths of their size.
    pub tight: u64,
    /// Avatars sent to viewers, summed over all ticks.
    pub told: u64,
}

impl InvariantChecker {
    /// A checker for a simulation of a world.
    pub fn new(world: &Arc<World>, options: &ReplayOptions) -> Self {
        let config = &options.config;
        Self {
            world: Arc::clone(world),
            oracle: Oracle::new(&world.mesh),
            speed_max: config.speed_max.unwrap_or(world.speed_max),
            tick: config.tick,
            spare_m: 2.0 * config.spare_m,
            margin: config.margin.first(),
            horizon_max: config.horizon_max,
            hidden: BTreeMap::new(),
            seen: Observations::default(),
        }
    }

    /// Checks the state at the end of a tick.
    pub fn check(&mut self, moment: &TickView<'_>) {
        self.check_silence(moment);
        self.check_refusals(moment);
        self.check_leaks(moment);
        self.check_tbvs(moment);
    }

    /// What was observed.
    pub fn end(self) -> Observations {
        self.seen
    }

    fn note(&mut self, moment: &TickView<'_>, violation: &Violation, who: AvatarId, more: &str) {
        if self.seen.violations.len() < VIOLATIONS_DESCRIBED {
            let (t_ms, walker) = (moment.now.as_millis(), moment.trace_id(who));
            self.seen.violations.push(format!("{t_ms} ms, walker {walker}: {violation}{more}"));
        }
    }

    /// An avatar that stays quiet in the same TBV receives no messages, and none are sent about it.
    /// Corrections are excluded: they answer the avatar's own report, and are checked elsewhere.
    fn check_silence(&mut self, moment: &TickView<'_>) {
        let is_quiet = |id| moment.engine.state(id) == Some(ReportingState::Quiet);
        let lasting = |id: &AvatarId| match (self.hidden.get(id), moment.engine.tbv(*id)) {
            (Some((before, true, _)), Some(tbv)) => *before == tbv && is_quiet(*id),
            _ => false,
        };
        let mut noisy = Vec::new();
        let is_answer =
            |output: &&Output| matches!(output, Output::Correct { .. } | Output::Drop { .. });
        for output in moment.outputs.iter().filter(|output| !is_answer(output)) {
            let (to, of) = addressed(output);
            noisy.extend([to].into_iter().chain(of).filter(lasting));
        }
        for id in noisy {
            self.note(moment, &Violation::Noise, id, "");
        }
    }

    /// All clients are honest, so none is refused. A client whose messages are delayed for long may
    /// seem too fast, and reports from before a jump may arrive after it: both are excused.
    fn check_refusals(&mut self, moment: &TickView<'_>) {
        for output in moment.outputs {
            if let Output::Correct { to, .. } | Output::Drop { to, .. } = output
                && !moment.is_late(*to)
                && !self.is_on_the_way(moment, *to)
            {
                self.note(moment, &Violation::Refused, *to, "");
            }
        }
    }

    /// Whether reports from before an avatar was put elsewhere, or the notice of it, may still be
    /// on their way.
    fn is_on_the_way(&self, moment: &TickView<'_>, id: AvatarId) -> bool {
        // A new client reports nothing before it knows that it is in.
        let way = 3 * moment.round_trip(id) / 2 + 3 * self.margin_of(moment, id) + 2 * self.tick;
        moment.settled_at(id).is_some_and(|settled| moment.now <= settled + way)
    }

    /// No viewer is told of an avatar that it cannot come to see before the next tick's message
    /// takes effect.
    fn check_leaks(&mut self, moment: &TickView<'_>) {
        for output in moment.outputs {
            if matches!(output, Output::Vanish { .. }) {
                continue;
            }
            let (to, avatars) = addressed(output);
            self.seen.told += avatars.len() as u64;
            for avatar in avatars {
                if self.could_see(moment, to, avatar) == Some(false) {
                    let more = format!(" (walker {})", moment.trace_id(avatar));
                    self.note(moment, &Violation::Leak, to, &more);
                }
            }
        }
    }

    /// Whether a viewer's eye could see an avatar's body from anywhere both can reach. Reach
    /// follows from what bodies can do and from portals; sight follows from cells and the PVS.
    /// `None` when one of them is unknown. Pairs that sight tests leave undecided are sent, but
    /// never pairs that cells hide.
    fn could_see(&self, moment: &TickView<'_>, viewer: AvatarId, avatar: AvatarId) -> Option<bool> {
        let cells = &self.world.cells;
        let one_way = moment.round_trip(viewer).min(self.horizon_max) / 2;
        let steps = one_way.as_nanos().div_ceil(DELAY_STEP.as_nanos());
        let delay = DELAY_STEP * u32::try_from(steps).ok()?;
        let agility = moment.engine.agility();
        let eyes = self.region(moment, viewer, delay, &agility)?;
        // An avatar that departs from its course may be anywhere within reach of the top speed.
        let is_doubted = moment.engine.is_doubted(moment.now, avatar);
        let dash = if is_doubted { agility.speed_max } else { agility.dash };
        let others = self.region(moment, avatar, delay, &Agility { dash, ..agility })?;
        let body = self.world.body.in_axes(&cells.axes);
        let [eyes, others] = [eyes, others].map(|region| self.cells_within(&region));
        let mut bodies = Vec::new();
        let parts = others.iter().map(|(_, part)| body.around_box(part));
        parts.for_each(|part| cells.overlapping(&part, &mut bodies));
        let sees = |from: CellId| bodies.iter().any(|to| cells.sees(from, *to));
        Some(eyes.iter().any(|(cell, _)| sees(*cell)))
    }

    /// Where an eye can be until a message sent to its viewer after this delay takes effect.
    fn region(
        &self,
        moment: &TickView<'_>,
        id: AvatarId,
        delay: Duration,
        agility: &Agility,
    ) -> Option<EyeRegion> {
        let (pose, axes) = (moment.engine.pose(id)?, &self.world.cells.axes);
        let unheard =
            moment.now.saturating_sub(self.earliest_report(moment, id)?).min(self.horizon_max);
        let (from, velocity) = (axes.own(pose.eye), axes.own(pose.velocity));
        let able = agility.eyes(from, velocity, unheard + self.tick + delay);
        Some(EyeRegion { from, within: able.grown(self.spare_m + ROUNDING_M) })
    }

    /// The cells reached from a place without leaving a box, and the part of each inside the box.
    fn cells_within(&self, EyeRegion { from, within }: &EyeRegion) -> Vec<(CellId, Aabb)> {
        let cells = &self.world.cells;
        let mut found = Vec::new();
        cells.overlapping(&Aabb::around(*from, POKE_M), &mut found);
        found.extend(cells.near_own(*from).filter(|_| found.is_empty()));
        let mut done = 0;
        while let Some(id) = found.get(done).copied() {
            done += 1;
            for portal in &cells.cells[id.0 as usize].portals {
                let portal = &cells.portals[*portal as usize];
                let leads = portal.polygon.bounds().intersects(within);
                let beyond = portal.cells.into_iter().filter(|cell| leads && !found.contains(cell));
                let beyond: Vec<CellId> = beyond.collect();
                found.extend(beyond);
            }
        }
        let part = |id: CellId| cells.cells[id.0 as usize].bounds.intersection(within);
        found.into_iter().map(|id| (id, part(id))).collect()
    }

    /// The earliest time at which the last report of an avatar can have been made, as far as the
    /// engine knows.
    fn earliest_report(&self, moment: &TickView<'_>, id: AvatarId) -> Option<Duration> {
        let way = moment.round_trip(id).min(self.horizon_max) / 2 + self.margin_of(moment, id);
        Some(moment.last_report(id)?.saturating_sub(way))
    }

    fn margin_of(&self, moment: &TickView<'_>, id: AvatarId) -> Duration {
        moment.engine.margin(id).unwrap_or(self.margin)
    }

    /// A hidden avatar is inside its TBV, the TBV was large enough, and it is asked in time.
    fn check_tbvs(&mut self, moment: &TickView<'_>) {
        let before = std::mem::take(&mut self.hidden);
        for (id, eye) in moment.eyes() {
            let Some(tbv) = moment.engine.tbv(id) else { continue };
            self.seen.hidden_ticks += 1;
            let is_quiet = moment.engine.state(id) == Some(ReportingState::Quiet);
            let known = before.get(&id).filter(|(known, ..)| *known == tbv);
            let ask_by =
                known.map_or_else(|| self.ask_by(moment, id, &tbv), |(.., ask_by)| *ask_by);
            if known.is_none() {
                self.check_new_tbv(moment, id, &tbv);
            }
            let grown = tbv.grown(ROUNDING_M);
            let is_excused = moment.is_late(id) || self.is_on_the_way(moment, id);
            if moment.now <= tbv.expiry && !grown.contains(eye) && !is_excused {
                self.note(moment, &Violation::Outside, id, "");
            }
            if is_quiet && moment.now + self.tick > ask_by {
                self.note(moment, &Violation::Late, id, "");
            }
            self.hidden.insert(id, (tbv, is_quiet, ask_by));
        }
    }

    /// The latest time to ask a hidden avatar: early enough that it answers, receives its new
    /// state, and the slowest client is told what it does then.
    fn ask_by(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> Duration {
        let told = self.longest_round_trip(moment, &|_| true) / 2;
        let lead = 2 * moment.round_trip(id).min(self.horizon_max) + told + 2 * self.tick;
        tbv.expiry.saturating_sub(lead + self.margin_of(moment, id))
    }

    /// How long a hidden avatar must stay inside its TBV after it first reports that it is about to
    /// leave. In this time the report arrives, another avatar that is or becomes silent is asked,
    /// and its answer is sent out.
    fn notice(&self, moment: &TickView<'_>, id: AvatarId) -> Duration {
        let way = moment.round_trip(id).min(self.horizon_max) / 2 + self.margin_of(moment, id);
        let asked = self.longest_round_trip(moment, &|id| self.may_fall_silent(moment, id));
        self.tick
            + way
            + self.tick
            + asked
            + self.tick
            + self.longest_round_trip(moment, &|_| true) / 2
    }

    /// Whether the avatar can be asked and heard again within [`SILENT_MAX`].
    fn may_fall_silent(&self, moment: &TickView<'_>, id: AvatarId) -> bool {
        let (trip, margin) = (moment.round_trip(id), self.margin_of(moment, id).max(self.margin));
        let told = self.longest_round_trip(moment, &|_| true) / 2;
        let asked_and_told = 2 * trip + told + 2 * self.tick + margin;
        trip <= self.horizon_max && trip / 2 + margin + asked_and_told + 2 * self.tick <= SILENT_MAX
    }

    /// The longest round trip of the counted avatars.
    fn longest_round_trip(
        &self,
        moment: &TickView<'_>,
        is_counted: &dyn Fn(AvatarId) -> bool,
    ) -> Duration {
        let ids = moment.engine.avatars().filter(|id| is_counted(*id));
        ids.map(|id| moment.round_trip(id).min(self.horizon_max)).max().unwrap_or_default()
    }

    /// Checks a TBV that was just made.
    fn check_new_tbv(&mut self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) {
        if !tbv.notice.is_zero() {
            self.seen.stays += 1;
            if tbv.notice < self.notice(moment, id) {
                self.note(moment, &Violation::Short, id, "");
            }
        }
        if !self.holds_straight_walks(moment, id, tbv) || !self.holds_reach(moment, id, tbv) {
            self.note(moment, &Violation::Small, id, "");
        }
        self.seen.tight += u64::from(!self.holds_reach(moment, id, &self.shrunk(moment, id, tbv)));
    }

    /// A TBV as the fault of small TBVs would make it.
    fn shrunk(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> Tbv {
        let Some(pose) = moment.engine.pose(id) else { return *tbv };
        let (eye, Aabb { min, max }) = (tbv.axes.own(pose.eye), tbv.within);
        let within =
            Aabb::new(eye + (min - eye) * SMALL_TBV_SCALE, eye + (max - eye) * SMALL_TBV_SCALE);
        Tbv { within, ..*tbv }
    }

    /// How long after its last report a TBV must hold its avatar: until it expires; or until the
    /// client has received it, plus the notice.
    fn must_hold_for(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> Option<Duration> {
        let made = self.earliest_report(moment, id)?;
        if tbv.notice.is_zero() {
            return Some(tbv.expiry.saturating_sub(made));
        }
        let told = moment.round_trip(id).min(self.horizon_max) / 2 + self.tick;
        Some(moment.now.saturating_sub(made) + told + tbv.notice)
    }

    /// Whether a TBV holds everything that its avatar can do, even through walls.
    fn holds_reach(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> bool {
        let (Some(pose), Some(time)) =
            (moment.engine.pose(id), self.must_hold_for(moment, id, tbv))
        else {
            return true;
        };
        let (eye, velocity) = (tbv.axes.own(pose.eye), tbv.axes.own(pose.velocity));
        tbv.within.contains_box(&moment.engine.agility().eyes(eye, velocity, time))
    }

    /// Whether straight walks from the last known place end inside the TBV.
    fn holds_straight_walks(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> bool {
        let (Some(pose), Some(time)) =
            (moment.engine.pose(id), self.must_hold_for(moment, id, tbv))
        else {
            return true;
        };
        let way_m = sprint_m(self.speed_max, time.as_secs_f32()) - ROUNDING_M;
        (0..DIRECTIONS).all(|i| {
            let angle = f32::from(i) / f32::from(DIRECTIONS) * std::f32::consts::TAU;
            let direction = Vec3::new(angle.cos(), 0.0, angle.sin());
            let wall_m = self.oracle.distance(pose.eye, direction).unwrap_or(f32::INFINITY);
            let free_m = (wall_m - self.world.body.half_width).max(0.0);
            tbv.contains(pose.eye + direction * way_m.min(free_m))
        })
    }
}

/// The distance covered in a time from standing, in metres.
fn sprint_m(speed_max: f32, time_s: f32) -> f32 {
    let dash = DASH.min(speed_max);
    let gaining_s = ((speed_max - dash) / ACCELERATION).min(time_s);
    let gained_m = dash * gaining_s + 0.5 * ACCELERATION * gaining_s * gaining_s;
    gained_m + speed_max * (time_s - gaining_s)
}

/// The receiver of an output, and the avatars that it is about.
fn addressed(output: &Output) -> (AvatarId, Vec<AvatarId>) {
    let of = match output {
        Output::Appear { avatar, .. } | Output::Vanish { avatar, .. } => vec![*avatar],
        Output::Poses { poses, .. } => poses.iter().map(|(id, _)| *id).collect(),
        _ => Vec::new(),
    };
    (output.to(), of)
}
