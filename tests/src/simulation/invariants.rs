//! What must hold at every tick, worked out naively from outside of the engine.

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

/// Breaches that are told one by one.
const BREACHES_TOLD: usize = 5;
/// Delays are rounded up to a multiple of this, so that viewers share regions.
const DELAY_STEP: Duration = Duration::from_millis(25);
/// Whoever would need a longer TBV is not silenced.
const SILENT_MAX: Duration = Duration::from_secs(1);
/// What a fault leaves of a TBV.
pub const SMALL: f32 = 0.9;
/// Places are rounded on the wire and in sums, in metres.
const ROUNDING_M: f32 = 0.02;
/// Directions in which it is tried how far a straight walk leads.
const DIRECTIONS: u16 = 16;
/// What people can do at once, in metres a second, and then, in metres a second squared.
const DASH: f32 = 1.4;
const ACCELERATION: f32 = 6.0;

/// Something that must not be.
#[derive(Clone, Debug, PartialEq)]
pub enum Violation {
    /// Somebody was told of an avatar that it cannot come to see within the horizon.
    Leak,
    /// Something was said to or of an avatar while its TBV lasted.
    Noise,
    /// An avatar was outside of its TBV.
    Outside,
    /// A place that a straight walk leads to in time, or that a body can come to otherwise, is outside of a TBV.
    Small,
    /// A TBV that lasts until it is left has too short a notice for what follows to be told.
    Short,
    /// A TBV was not asked in time for what follows to come before its expiry.
    Late,
    /// An honest claim was refused.
    Refused,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leak => "told of whom it cannot come to see",
            Self::Noise => "noise while a TBV lasts",
            Self::Outside => "outside of its TBV",
            Self::Small => "a TBV smaller than what a body can do",
            Self::Short => "too short a notice",
            Self::Late => "asked too late",
            Self::Refused => "an honest claim refused",
        })
    }
}

/// Where an eye was, and a box that it cannot have left since, in own axes.
struct EyeRegion {
    from: Vec3,
    within: Aabb,
}

/// Watches a simulation.
pub struct InvariantChecker {
    world: Arc<World>,
    sight: Oracle,
    speed_max: f32,
    tick: Duration,
    /// What regions have to spare on each side at most, in metres.
    spare_m: f32,
    /// What messages of clients of whom nothing is known may take longer than half of the round trip.
    margin: Duration,
    cap: Duration,
    /// The TBV of each hidden avatar at the last tick, and until when it must have been asked.
    hidden: BTreeMap<AvatarId, (Tbv, bool, Duration)>,
    seen: Observations,
}

/// What was seen of a simulation.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// What was wrong, the first few.
    pub breaches: Vec<String>,
    /// Ticks of avatars that were hidden in a TBV.
    pub hidden_ticks: u64,
    /// TBVs that last until they are left.
    pub stays: u64,
    /// TBVs that would be too small with nine tenths of their size.
    pub tight: u64,
    /// Avatars of which viewers were told, over all ticks.
    pub told: u64,
}

impl InvariantChecker {
    /// Watches a simulation of a world.
    pub fn new(world: &Arc<World>, options: &ReplayOptions) -> Self {
        let config = &options.config;
        Self {
            world: Arc::clone(world),
            sight: Oracle::new(&world.mesh),
            speed_max: config.speed_max.unwrap_or(world.speed_max),
            tick: config.tick,
            spare_m: 2.0 * config.spare_m,
            margin: config.margin.first(),
            cap: config.horizon_max,
            hidden: BTreeMap::new(),
            seen: Observations::default(),
        }
    }

    /// Looks at the end of a tick.
    pub fn look(&mut self, moment: &TickView<'_>) {
        self.look_for_noise(moment);
        self.look_for_refusals(moment);
        self.look_for_leaks(moment);
        self.look_at_tbvs(moment);
    }

    /// What was seen.
    pub fn end(self) -> Observations {
        self.seen
    }

    fn note(&mut self, moment: &TickView<'_>, breach: &Violation, who: AvatarId, more: &str) {
        if self.seen.breaches.len() < BREACHES_TOLD {
            let (t_ms, walker) = (moment.now.as_millis(), moment.trace_id(who));
            self.seen.breaches.push(format!("{t_ms} ms, walker {walker}: {breach}{more}"));
        }
    }

    /// Whoever is quiet in the same TBV as a tick ago is neither spoken to nor spoken of. What was refused is an
    /// answer to its own word, and looked at for itself.
    fn look_for_noise(&mut self, moment: &TickView<'_>) {
        let is_quiet = |id| moment.engine.state(id) == Some(ReportingState::Quiet);
        let lasting = |id: &AvatarId| match (self.hidden.get(id), moment.engine.tbv(*id)) {
            (Some((before, true, _)), Some(tbv)) => *before == tbv && is_quiet(*id),
            _ => false,
        };
        let mut noisy = Vec::new();
        let is_answer =
            |output: &&Output| matches!(output, Output::Correct { .. } | Output::Drop { .. });
        for output in moment.outputs.iter().filter(|output| !is_answer(output)) {
            let (to, of) = concerned(output);
            noisy.extend([to].into_iter().chain(of).filter(lasting));
        }
        for id in noisy {
            self.note(moment, &Violation::Noise, id, "");
        }
    }

    /// All clients are honest. Those whose messages are held up for long may seem too fast, and what somebody
    /// said before it was put elsewhere may come after that.
    fn look_for_refusals(&mut self, moment: &TickView<'_>) {
        for output in moment.outputs {
            if let Output::Correct { to, .. } | Output::Drop { to, .. } = output
                && !moment.is_late(*to)
                && !self.is_on_the_way(moment, *to)
            {
                self.note(moment, &Violation::Refused, *to, "");
            }
        }
    }

    /// Whether what somebody said before it was put elsewhere, or that it was, may still be on its way.
    fn is_on_the_way(&self, moment: &TickView<'_>, id: AvatarId) -> bool {
        // Whoever has just come says nothing before it knows that it is in.
        let way = 3 * moment.round_trip(id) / 2 + 3 * self.margin_of(moment, id) + 2 * self.tick;
        moment.settled_at(id).is_some_and(|settled| moment.now <= settled + way)
    }

    /// Nobody is told of whom it cannot come to see until the next tick's word stands.
    fn look_for_leaks(&mut self, moment: &TickView<'_>) {
        for output in moment.outputs {
            if matches!(output, Output::Vanish { .. }) {
                continue;
            }
            let (to, avatars) = concerned(output);
            self.seen.told += avatars.len() as u64;
            for avatar in avatars {
                if self.could_see(moment, to, avatar) == Some(false) {
                    let more = format!(" (walker {})", moment.trace_id(avatar));
                    self.note(moment, &Violation::Leak, to, &more);
                }
            }
        }
    }

    /// Whether a viewer's eye could see an avatar's body wherever these can be by what bodies can do and by where
    /// portals lead, as far as cells and the PVS tell; nothing of those who are not known. What looks leave undecided is
    /// told all the same, but never of whom cells hide.
    fn could_see(&self, moment: &TickView<'_>, viewer: AvatarId, avatar: AvatarId) -> Option<bool> {
        let cells = &self.world.cells;
        let one_way = moment.round_trip(viewer).min(self.cap) / 2;
        let steps = one_way.as_nanos().div_ceil(DELAY_STEP.as_nanos());
        let delay = DELAY_STEP * u32::try_from(steps).ok()?;
        let agility = moment.engine.agility();
        let eyes = self.region(moment, viewer, delay, &agility)?;
        // Who moves otherwise than it says may be anywhere that top speed leads to.
        let is_doubted = moment.engine.is_doubted(moment.now, avatar);
        let dash = if is_doubted { agility.speed_max } else { agility.dash };
        let others = self.region(moment, avatar, delay, &Agility { dash, ..agility })?;
        let body = self.world.body.in_axes(&cells.axes);
        let [eyes, others] = [eyes, others].map(|region| self.flooded(&region));
        let mut bodies = Vec::new();
        let parts = others.iter().map(|(_, part)| body.around_box(part));
        parts.for_each(|part| cells.overlapping(&part, &mut bodies));
        let sees = |from: CellId| bodies.iter().any(|to| cells.sees(from, *to));
        Some(eyes.iter().any(|(cell, _)| sees(*cell)))
    }

    /// Where somebody's eye can be by what bodies can do, until a word that takes so long to its viewer does not
    /// stand any more.
    fn region(
        &self,
        moment: &TickView<'_>,
        id: AvatarId,
        delay: Duration,
        agility: &Agility,
    ) -> Option<EyeRegion> {
        let (pose, axes) = (moment.engine.pose(id)?, &self.world.cells.axes);
        let unheard = moment.now.saturating_sub(self.made(moment, id)?).min(self.cap);
        let (from, velocity) = (axes.own(pose.eye), axes.own(pose.velocity));
        let able = agility.eyes(from, velocity, unheard + self.tick + delay);
        Some(EyeRegion { from, within: able.grown(self.spare_m + ROUNDING_M) })
    }

    /// The cells that are come to from a place without leaving a box, and what of them is in it.
    fn flooded(&self, EyeRegion { from, within }: &EyeRegion) -> Vec<(CellId, Aabb)> {
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

    /// When the last report of an avatar was made, at the earliest, as far as the engine can know.
    fn made(&self, moment: &TickView<'_>, id: AvatarId) -> Option<Duration> {
        let way = moment.round_trip(id).min(self.cap) / 2 + self.margin_of(moment, id);
        Some(moment.last_report(id)?.saturating_sub(way))
    }

    fn margin_of(&self, moment: &TickView<'_>, id: AvatarId) -> Duration {
        moment.engine.margin(id).unwrap_or(self.margin)
    }

    /// Whoever is hidden is in its TBV, which was large enough and is asked in time.
    fn look_at_tbvs(&mut self, moment: &TickView<'_>) {
        let before = std::mem::take(&mut self.hidden);
        for (id, eye) in moment.eyes() {
            let Some(tbv) = moment.engine.tbv(id) else { continue };
            self.seen.hidden_ticks += 1;
            let is_quiet = moment.engine.state(id) == Some(ReportingState::Quiet);
            let known = before.get(&id).filter(|(known, ..)| *known == tbv);
            let ask_by =
                known.map_or_else(|| self.ask_by(moment, id, &tbv), |(.., ask_by)| *ask_by);
            if known.is_none() {
                self.look_at_new(moment, id, &tbv);
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

    /// When a hidden avatar must be asked at the latest: so that it answers, is told to stay, and what
    /// it then does is told to the slowest.
    fn ask_by(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> Duration {
        let told = self.slowest(moment, &|_| true) / 2;
        let lead = 2 * moment.round_trip(id).min(self.cap) + told + 2 * self.tick;
        tbv.expiry.saturating_sub(lead + self.margin_of(moment, id))
    }

    /// How long a hidden avatar must be sure to stay in its TBV when it was about to leave it at a tick of its
    /// client and was not at the one before: it is heard, another that is or falls silent meanwhile is asked, and
    /// its answer is told.
    fn notice(&self, moment: &TickView<'_>, id: AvatarId) -> Duration {
        let way = moment.round_trip(id).min(self.cap) / 2 + self.margin_of(moment, id);
        let asked = self.slowest(moment, &|id| self.may_fall_silent(moment, id));
        self.tick + way + self.tick + asked + self.tick + self.slowest(moment, &|_| true) / 2
    }

    /// Whether it can be asked and heard again in the time for which people are silenced.
    fn may_fall_silent(&self, moment: &TickView<'_>, id: AvatarId) -> bool {
        let (trip, margin) = (moment.round_trip(id), self.margin_of(moment, id).max(self.margin));
        let told = self.slowest(moment, &|_| true) / 2;
        let asked_and_told = 2 * trip + told + 2 * self.tick + margin;
        trip <= self.cap && trip / 2 + margin + asked_and_told + 2 * self.tick <= SILENT_MAX
    }

    /// The longest round trip of some.
    fn slowest(&self, moment: &TickView<'_>, is_counted: &dyn Fn(AvatarId) -> bool) -> Duration {
        let ids = moment.engine.avatars().filter(|id| is_counted(*id));
        ids.map(|id| moment.round_trip(id).min(self.cap)).max().unwrap_or_default()
    }

    /// A TBV that has just been made.
    fn look_at_new(&mut self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) {
        if !tbv.notice.is_zero() {
            self.seen.stays += 1;
            if tbv.notice < self.notice(moment, id) {
                self.note(moment, &Violation::Short, id, "");
            }
        }
        if !self.is_large_enough(moment, id, tbv) || !self.holds_all(moment, id, tbv) {
            self.note(moment, &Violation::Small, id, "");
        }
        self.seen.tight += u64::from(!self.holds_all(moment, id, &self.small(moment, id, tbv)));
    }

    /// What a fault would have made of a TBV.
    fn small(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> Tbv {
        let Some(pose) = moment.engine.pose(id) else { return *tbv };
        let (eye, Aabb { min, max }) = (tbv.axes.own(pose.eye), tbv.within);
        let within = Aabb::new(eye + (min - eye) * SMALL, eye + (max - eye) * SMALL);
        Tbv { within, ..*tbv }
    }

    /// How long after its last report was made a TBV must hold its avatar: until it expires, or until its
    /// client has been told of it and could leave it by a notice later.
    fn lasts(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> Option<Duration> {
        let made = self.made(moment, id)?;
        if tbv.notice.is_zero() {
            return Some(tbv.expiry.saturating_sub(made));
        }
        let told = moment.round_trip(id).min(self.cap) / 2 + self.tick;
        Some(moment.now.saturating_sub(made) + told + tbv.notice)
    }

    /// Whether a TBV holds all that its avatar can do, whatever walls are there.
    fn holds_all(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> bool {
        let (Some(pose), Some(time)) = (moment.engine.pose(id), self.lasts(moment, id, tbv)) else {
            return true;
        };
        let (eye, velocity) = (tbv.axes.own(pose.eye), tbv.axes.own(pose.velocity));
        tbv.within.contains_box(&moment.engine.agility().eyes(eye, velocity, time))
    }

    /// Whether straight walks from the last place known end inside.
    fn is_large_enough(&self, moment: &TickView<'_>, id: AvatarId, tbv: &Tbv) -> bool {
        let (Some(pose), Some(time)) = (moment.engine.pose(id), self.lasts(moment, id, tbv)) else {
            return true;
        };
        let way_m = sprint_m(self.speed_max, time.as_secs_f32()) - ROUNDING_M;
        (0..DIRECTIONS).all(|i| {
            let angle = f32::from(i) / f32::from(DIRECTIONS) * std::f32::consts::TAU;
            let direction = Vec3::new(angle.cos(), 0.0, angle.sin());
            let wall_m = self.sight.distance(pose.eye, direction).unwrap_or(f32::INFINITY);
            let free_m = (wall_m - self.world.body.half_width).max(0.0);
            tbv.contains(pose.eye + direction * way_m.min(free_m))
        })
    }
}

/// How far one gets in some time who stood, in metres.
fn sprint_m(speed_max: f32, time_s: f32) -> f32 {
    let dash = DASH.min(speed_max);
    let gaining_s = ((speed_max - dash) / ACCELERATION).min(time_s);
    let gained_m = dash * gaining_s + 0.5 * ACCELERATION * gaining_s * gaining_s;
    gained_m + speed_max * (time_s - gaining_s)
}

/// To whom an output goes, and of whom it tells.
fn concerned(output: &Output) -> (AvatarId, Vec<AvatarId>) {
    let of = match output {
        Output::Appear { avatar, .. } | Output::Vanish { avatar, .. } => vec![*avatar],
        Output::Poses { poses, .. } => poses.iter().map(|(id, _)| *id).collect(),
        _ => Vec::new(),
    };
    (output.to(), of)
}
