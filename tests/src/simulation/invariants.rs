//! What must hold at every tick, computed naively from outside the engine.

use std::{collections::BTreeMap, fmt, sync::Arc, time::Duration};

use glam::Vec3;
use sightline_engine::{Engine, Output};
use sightline_oracle::Oracle;
use sightline_replay::{ReplayOptions, TickView};
use sightline_world::{
    CellId, World,
    geometry::Aabb,
    motion::{Agility, AvatarId, Pose, ReportingState, Tbv, Tolerance},
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
/// The rounding of courses, in metres.
const COURSE_ROUNDING_M: f32 = 0.005;
/// The number of ticks of a client from which the engine may count where it is.
const COURSE_TICKS: u32 = 12;
/// A station knows of another one's avatars, and of newcomers, after this time and some messages on
/// the bus.
const KNOWN_AFTER: Duration = Duration::from_millis(1_500);
/// The number of directions in which straight walks are tried.
const DIRECTIONS: u16 = 16;
/// The speed that a person reaches at once, in metres per second.
const DASH: f32 = 1.4;
/// The acceleration beyond that speed, in metres per second squared.
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
    /// A pair counted as hidden although what was found of it did not hold any more.
    Stale,
    /// The silence of a client was taken to mean that its avatar was on course, and it was not.
    OffCourse,
    /// A station does not know of an avatar of another one that may be in sight of one of its own.
    Unknown,
    /// An avatar is silent, and another station follows its course.
    Unasked,
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
            Self::Stale => "hidden by what does not hold any more",
            Self::OffCourse => "off the course that its silence stands for",
            Self::Unknown => "does not know of an avatar of another station that may be in sight",
            Self::Unasked => "silent while another station follows it",
        })
    }
}

/// Where an avatar was, by what its client has said or not said, and when.
struct Known {
    pose: Pose,
    at: Duration,
    /// By how much it may have been elsewhere.
    tolerance: Tolerance,
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
    /// How much older what one station knows of another's avatars may be.
    bus: Duration,
    horizon_max: Duration,
    /// For each avatar hidden at the last tick: its TBV, whether it was quiet, and when it must be
    /// asked at the latest.
    hidden: BTreeMap<AvatarId, (Tbv, bool, Duration)>,
    /// The tolerance of each avatar at the last tick.
    tolerances: BTreeMap<AvatarId, Tolerance>,
    /// The tolerance in the last order to each client to be live, up to the last tick.
    ordered: BTreeMap<AvatarId, Tolerance>,
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
            bus: options.stations.delay + 3 * options.stations.jitter,
            horizon_max: config.horizon_max,
            hidden: BTreeMap::new(),
            tolerances: BTreeMap::new(),
            ordered: BTreeMap::new(),
            seen: Observations::default(),
        }
    }

    /// Checks what the engine decided at a tick.
    pub fn check(&mut self, moment: &TickView<'_>) {
        self.check_silence(moment);
        self.check_refusals(moment);
        self.check_courses(moment);
        self.check_leaks(moment);
        self.check_stale(moment);
        self.check_tbvs(moment);
        self.check_guests(moment);
        let tolerance = |id| Some((id, moment.engine_of(id).tolerance(id)?));
        self.tolerances = moment.avatars().filter_map(tolerance).collect();
        self.ordered.extend(moment.outputs.iter().filter_map(|output| match output {
            Output::Live { to, tolerance } => Some((*to, *tolerance)),
            _ => None,
        }));
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
        let is_quiet = |id| moment.engine_of(id).state(id) == Some(ReportingState::Quiet);
        let lasting = |id: &AvatarId| match (self.hidden.get(id), moment.engine_of(*id).tbv(*id)) {
            (Some((before, true, _)), Some(tbv)) => *before == tbv && is_quiet(*id),
            _ => false,
        };
        let mut noisy = Vec::new();
        let is_answer =
            |output: &&Output| matches!(output, Output::Correct { .. } | Output::Drop { .. });
        for output in moment.outputs.iter().filter(|output| !is_answer(output)) {
            let (to, of) = addressed(output);
            // A station that does not hear another one forgets that one's avatars sometime.
            let of = of.into_iter().filter(|id| moment.are_linked(to, *id));
            noisy.extend([to].into_iter().chain(of).filter(lasting));
        }
        for id in noisy {
            self.note(moment, &Violation::Noise, id, "");
        }
    }

    /// All clients are honest, so none is refused. A client whose messages are delayed for long may
    /// seem too fast, and reports from before a jump may arrive after it: both are excused. A
    /// movement budget counts from the last accepted claim. So the claim after a late one is
    /// excused, however long the client is silent in between.
    fn check_refusals(&mut self, moment: &TickView<'_>) {
        for output in moment.outputs {
            if let Output::Correct { to, .. } | Output::Drop { to, .. } = output
                && !moment.was_late_when_heard(*to)
                && !self.is_on_the_way(moment, *to)
            {
                self.note(moment, &Violation::Refused, *to, "");
            }
        }
    }

    /// What keeps a viewer from being told of an avatar holds at this tick.
    fn check_stale(&mut self, moment: &TickView<'_>) {
        let stale: Vec<[AvatarId; 2]> =
            moment.engines().filter_map(|engine| engine.stale_pair()).collect();
        for [viewer, avatar] in stale {
            let more = format!(" from walker {}", moment.trace_id(viewer));
            self.note(moment, &Violation::Stale, avatar, &more);
        }
    }

    /// Where the engine takes silence to mean that an avatar was on course, it truly was.
    fn check_courses(&mut self, moment: &TickView<'_>) {
        for id in moment.avatars() {
            let is_late = moment.is_late(id) || moment.is_overdue(id);
            let is_excused = is_late || self.is_on_the_way(moment, id);
            if !is_excused && self.is_on_course(moment, id, id) == Some(false) {
                self.note(moment, &Violation::OffCourse, id, "");
            }
        }
    }

    /// Whether an avatar was on course at its client's last tick that the engine counts. `None`
    /// when the engine counts none since the last report.
    fn is_on_course(&self, moment: &TickView<'_>, viewer: AvatarId, id: AvatarId) -> Option<bool> {
        let engine = moment.engine_of(viewer);
        let known = engine.known_course(id)?;
        let metres = known.tolerance.metres + COURSE_ROUNDING_M;
        let tolerance = Tolerance { metres, ..known.tolerance };
        // Clients act at the server's ticks. The time that a report carries may be later than its
        // own by a part of a tick. Client and engine both count the course from that, not from when
        // the pose was true.
        let made = moment.last_sampled_by(viewer, id)?;
        let until = made + known.after + self.tick / 32;
        let at = self.tick * u32::try_from(until.as_nanos() / self.tick.as_nanos()).ok()?;
        let agility = moment.engine.agility();
        let elapsed = known.after.min(at.checked_sub(made)?);
        let course = engine.pose(id)?.on_course(elapsed, &agility);
        let truth = moment.pose_at(id, at)?;
        let before = moment.pose_at(id, at.saturating_sub(self.tick))?;
        // A client takes the mean over its last tick for its velocity, if that is likely.
        let mean = (truth.eye - before.eye) / self.tick.as_secs_f32();
        let holds = |velocity| tolerance.holds(&course, &Pose { velocity, ..truth }, &agility);
        Some(holds(mean) || holds(truth.velocity))
    }

    /// What a viewer's station knows of the avatars of others: those that may be in sight by the
    /// cells that both are in, where they are on course or in which boxes, and who is silent.
    fn check_guests(&mut self, moment: &TickView<'_>) {
        let cells = &self.world.cells;
        let all: Vec<(AvatarId, Option<CellId>)> = moment
            .eyes()
            .filter(|(id, _)| moment.engine_of(*id).pose(*id).is_some())
            .map(|(id, eye)| (id, cells.at(eye)))
            .collect();
        let mut found = Vec::new();
        for (viewer, from) in &all {
            for (id, to) in &all {
                if moment.are_together(*viewer, *id) || !self.is_known_well(moment, *viewer, *id) {
                    continue;
                }
                let engine = moment.engine_of(*viewer);
                let sees = from.zip(*to).is_some_and(|(from, to)| self.world.cells.sees(from, to));
                if sees && engine.pose(*id).is_none() {
                    found.push((Violation::Unknown, *viewer, *id));
                }
                if self.is_on_course(moment, *viewer, *id) == Some(false) {
                    found.push((Violation::OffCourse, *viewer, *id));
                }
                let home = moment.engine_of(*id);
                let state = |engine: &Engine| engine.state(*id);
                if state(home) == Some(ReportingState::Quiet)
                    && state(engine) == Some(ReportingState::Live)
                {
                    found.push((Violation::Unasked, *viewer, *id));
                }
                let is_outside = |tbv: &Tbv| {
                    let eye = moment.pose_at(*id, moment.now).map(|pose| pose.eye);
                    eye.is_some_and(|eye| !tbv.grown(ROUNDING_M).contains(eye))
                };
                if engine.tbv(*id).as_ref().is_some_and(is_outside) {
                    found.push((Violation::Outside, *viewer, *id));
                }
            }
        }
        for (violation, viewer, id) in found {
            let more = format!(" (known to the station of walker {})", moment.trace_id(viewer));
            self.note(moment, &violation, id, &more);
        }
    }

    /// Whether a viewer's station must know an avatar of another one by now: both have been there
    /// for long enough, their stations have heard each other for long enough, and no message is
    /// late.
    fn is_known_well(&self, moment: &TickView<'_>, viewer: AvatarId, id: AvatarId) -> bool {
        let settling = KNOWN_AFTER + 4 * self.bus;
        let linked = moment.linked_since(viewer, id);
        let since = |at: Option<Duration>| at.is_some_and(|at| at + settling <= moment.now);
        since(linked)
            && [viewer, id].into_iter().all(|id| {
                let is_late = moment.is_late(id) || moment.is_overdue(id);
                since(moment.settled_at(id)) && !is_late && !self.is_on_the_way(moment, id)
            })
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
        let eyes = self.regions(moment, [viewer; 2], delay, &agility)?;
        // An avatar that departs from its course may be anywhere within reach of the top speed.
        let is_doubted = moment.engine_of(viewer).is_doubted(moment.now, avatar);
        let dash = if is_doubted { agility.speed_max } else { agility.dash };
        let others = self.regions(moment, [viewer, avatar], delay, &Agility { dash, ..agility })?;
        let body = self.world.body.in_axes(&cells.axes);
        let cells_within = |region: &EyeRegion| self.cells_within(region);
        let [eyes, others]: [Vec<(CellId, Aabb)>; 2] =
            [eyes, others].map(|regions| regions.iter().flat_map(cells_within).collect());
        let mut bodies = Vec::new();
        let parts = others.iter().map(|(_, part)| body.around_box(part));
        parts.for_each(|part| cells.overlapping(&part, &mut bodies));
        let sees = |from: CellId| bodies.iter().any(|to| cells.sees(from, *to));
        Some(eyes.iter().any(|(cell, _)| sees(*cell)))
    }

    /// Where an eye can be until a message sent to its viewer after this delay takes effect: from
    /// each moment at which the engine may take it to be known.
    fn regions(
        &self,
        moment: &TickView<'_>,
        [viewer, id]: [AvatarId; 2],
        delay: Duration,
        agility: &Agility,
    ) -> Option<Vec<EyeRegion>> {
        let axes = &self.world.cells.axes;
        let known = self.known_to(moment, viewer, id)?;
        let bus = if moment.are_together(viewer, id) { Duration::ZERO } else { self.bus };
        let region = |known: &Known| {
            let margin = self.margin_of(moment, id) + bus;
            let unheard = (moment.now.saturating_sub(known.at) + margin).min(self.horizon_max);
            let time = unheard + self.tick + delay;
            let Pose { eye, velocity, .. } = known.pose;
            let (from, velocity) = (axes.own(eye), axes.own(velocity));
            let spare_m = self.spare_m + ROUNDING_M + known.tolerance.growth_m(time);
            EyeRegion { from, within: agility.eyes(from, velocity, time).grown(spare_m) }
        };
        Some(known.iter().map(region).collect())
    }

    /// The moments from which the engine may count: that of an avatar's last report, and some ticks
    /// of its client by which it would have reported a departure. Which of them is the last depends
    /// on jitter.
    fn known(&self, moment: &TickView<'_>, id: AvatarId) -> Option<Vec<Known>> {
        self.known_to(moment, id, id)
    }

    /// The same, as the station of a viewer knows it.
    fn known_to(
        &self,
        moment: &TickView<'_>,
        viewer: AvatarId,
        id: AvatarId,
    ) -> Option<Vec<Known>> {
        let engine = moment.engine_of(viewer);
        let (pose, made) = (engine.pose(id)?, moment.last_sampled_by(viewer, id)?);
        let last_heard = moment.last_report_by(viewer, id)?;
        let agility = moment.engine.agility();
        // Who has just fallen silent was on course before.
        let before = self.tolerances.get(&id).copied().unwrap_or(Tolerance::NONE);
        let tolerance = engine.tolerance(id)?.union(&before);
        // A report that came since the last tick may show that the client obeys a smaller one.
        let is_news = last_heard + self.tick > moment.now;
        let narrowed = self.ordered.get(&id).copied().filter(|_| is_news);
        let way = moment.round_trip(id).min(self.horizon_max) / 2 + self.margin_of(moment, id);
        let heard = moment.now.saturating_sub(way) + self.tick;
        let newest = self.tick * u32::try_from(heard.as_nanos() / self.tick.as_nanos()).ok()?;
        let ticks = (0..COURSE_TICKS).filter_map(|back| newest.checked_sub(self.tick * back));
        let on_course = ticks.filter(|at| !tolerance.is_none() && *at > made && *at <= moment.now);
        let on_course = on_course.flat_map(|at| {
            let pose = pose.on_course(at.saturating_sub(made), &agility);
            let within =
                move |tolerance: Tolerance| Known { pose, at, tolerance: tolerance.along(&pose) };
            [Some(tolerance), narrowed].into_iter().flatten().map(within)
        });
        // The engine may not know that a message took longer than it allows for.
        let reported = [made, made.max(last_heard.saturating_sub(way))];
        let reported = reported.map(|at| Known { pose, at, tolerance: Tolerance::NONE });
        Some(on_course.chain(reported).collect())
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

    fn margin_of(&self, moment: &TickView<'_>, id: AvatarId) -> Duration {
        moment.engine_of(id).margin(id).unwrap_or(self.margin)
    }

    /// A hidden avatar is inside its TBV, the TBV was large enough, and it is asked in time.
    fn check_tbvs(&mut self, moment: &TickView<'_>) {
        let before = std::mem::take(&mut self.hidden);
        for (id, eye) in moment.eyes() {
            let Some(tbv) = moment.engine_of(id).tbv(id) else { continue };
            self.seen.hidden_ticks += 1;
            let is_quiet = moment.engine_of(id).state(id) == Some(ReportingState::Quiet);
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
        let told = self.longest_round_trip(moment, id, &|_| true) / 2;
        let lead = 2 * moment.round_trip(id).min(self.horizon_max) + told + 2 * self.tick;
        tbv.expiry.saturating_sub(lead + self.margin_of(moment, id))
    }

    /// How long a hidden avatar must stay inside its TBV after it first reports that it is about to
    /// leave. In this time the report arrives, another avatar that is or becomes silent is asked,
    /// and its answer is sent out.
    fn notice(&self, moment: &TickView<'_>, id: AvatarId) -> Duration {
        let way = moment.round_trip(id).min(self.horizon_max) / 2 + self.margin_of(moment, id);
        let asked = self.longest_round_trip(moment, id, &|id| self.may_fall_silent(moment, id));
        self.tick
            + way
            + self.tick
            + asked
            + self.tick
            + self.longest_round_trip(moment, id, &|_| true) / 2
    }

    /// Whether the avatar can be asked and heard again within [`SILENT_MAX`].
    fn may_fall_silent(&self, moment: &TickView<'_>, id: AvatarId) -> bool {
        let (trip, margin) = (moment.round_trip(id), self.margin_of(moment, id).max(self.margin));
        let told = self.longest_round_trip(moment, id, &|_| true) / 2;
        let asked_and_told = 2 * trip + told + 2 * self.tick + margin;
        trip <= self.horizon_max && trip / 2 + margin + asked_and_told + 2 * self.tick <= SILENT_MAX
    }

    /// The longest round trip of the counted avatars of an avatar's station.
    fn longest_round_trip(
        &self,
        moment: &TickView<'_>,
        of: AvatarId,
        is_counted: &dyn Fn(AvatarId) -> bool,
    ) -> Duration {
        // Stations hear of each other's slowest clients a little later.
        let ids = moment.engine_of(of).avatars().filter(|id| is_counted(*id));
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
        if !self.is_large_enough(moment, id, tbv) {
            self.note(moment, &Violation::Small, id, "");
        }
        let shrunk = self.shrunk(moment, id, tbv);
        self.seen.tight += u64::from(!self.is_large_enough(moment, id, &shrunk));
    }

    /// A TBV as the fault of small TBVs would make it.
    fn shrunk(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> Tbv {
        let known = self.known(moment, id);
        let Some(known) = known.as_ref().and_then(|all| all.first()) else { return *tbv };
        let (eye, Aabb { min, max }) = (tbv.axes.own(known.pose.eye), tbv.within);
        let within =
            Aabb::new(eye + (min - eye) * SMALL_TBV_SCALE, eye + (max - eye) * SMALL_TBV_SCALE);
        Tbv { within, ..*tbv }
    }

    /// Whether a TBV holds all that its avatar can do, from one of the moments at which it is
    /// known.
    fn is_large_enough(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> bool {
        let agility = moment.engine.agility();
        let known = self.known(moment, id);
        known.is_none_or(|known| {
            known.iter().any(|known| {
                let time = self.must_hold_for(moment, id, tbv, known);
                Self::holds_reach(tbv, known, &agility, time)
                    && self.holds_straight_walks(tbv, known, time)
            })
        })
    }

    /// How long after a moment a TBV must hold its avatar: until it expires; or until the client
    /// has received it, plus the notice. When all reports were slower than the known round trip has
    /// it, the engine takes the moment to be later than it was.
    fn must_hold_for(
        &self,
        moment: &TickView<'_>,
        id: AvatarId,
        tbv: &Tbv,
        known: &Known,
    ) -> Duration {
        let taken_at = known.at + moment.least_lateness(id);
        if tbv.notice.is_zero() {
            return tbv.expiry.saturating_sub(taken_at);
        }
        let told = moment.round_trip(id).min(self.horizon_max) / 2 + self.tick;
        moment.now.saturating_sub(taken_at) + told + tbv.notice
    }

    /// Whether a TBV holds everything that its avatar can do in a time, even through walls.
    fn holds_reach(tbv: &Tbv, known: &Known, agility: &Agility, time: Duration) -> bool {
        let (eye, velocity) = (tbv.axes.own(known.pose.eye), tbv.axes.own(known.pose.velocity));
        let able = agility.eyes(eye, velocity, time).grown(known.tolerance.growth_m(time));
        tbv.within.contains_box(&able)
    }

    /// Whether straight walks from a known place end inside the TBV.
    fn holds_straight_walks(&self, tbv: &Tbv, known: &Known, time: Duration) -> bool {
        let eye = known.pose.eye;
        let way_m = sprint_m(self.speed_max, time.as_secs_f32()) - ROUNDING_M;
        (0..DIRECTIONS).all(|i| {
            let angle = f32::from(i) / f32::from(DIRECTIONS) * std::f32::consts::TAU;
            let direction = Vec3::new(angle.cos(), 0.0, angle.sin());
            let wall_m = self.oracle.distance(eye, direction).unwrap_or(f32::INFINITY);
            let free_m = (wall_m - self.world.body.half_width).max(0.0);
            tbv.contains(eye + direction * way_m.min(free_m))
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
