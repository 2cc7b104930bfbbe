//! What must hold at every tick, worked out naively from outside of the engine.

use std::{collections::BTreeMap, fmt, sync::Arc, time::Duration};

use glam::Vec3;
use sightline_server::{
    engine::{ClientState, Output},
    replay::{Moment, Options},
    sight::Sight,
};
use sightline_shared::{
    geometry::Aabb,
    motion::{AvatarId, Tbv},
    world::{CellId, World},
};

/// Breaches that are told one by one.
const BREACHES_TOLD: usize = 5;
/// Regions may be so much larger than they must, in metres: they are made to last for a few ticks.
const SPARE_M: f32 = 0.3;
/// Delays may be rounded up by so much, so that viewers share regions.
const SPARE: Duration = Duration::from_millis(25);
/// Places are rounded on the wire and in sums, in metres.
const ROUNDING_M: f32 = 0.02;
/// Directions in which it is tried how far a straight walk leads.
const DIRECTIONS: u16 = 16;
/// What people can do at once, in metres a second, and then, in metres a second squared.
const DASH: f32 = 1.4;
const ACCELERATION: f32 = 6.0;

/// Something that must not be.
#[derive(Clone, Debug, PartialEq)]
pub enum Breach {
    /// Somebody was told of an avatar that it cannot come to see within the horizon.
    Leak,
    /// Something was said to or of an avatar while its TBV lasted.
    Noise,
    /// An avatar was outside of its TBV.
    Outside,
    /// A place that a straight walk leads to in time is outside of a TBV.
    Small,
    /// A TBV was not asked in time for what follows to come before its expiry.
    Late,
    /// An honest claim was refused.
    Refused,
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leak => "told of whom it cannot come to see",
            Self::Noise => "noise while a TBV lasts",
            Self::Outside => "outside of its TBV",
            Self::Small => "a TBV smaller than a straight walk",
            Self::Late => "asked too late",
            Self::Refused => "an honest claim refused",
        })
    }
}

/// Watches a simulation.
pub struct Watch {
    world: Arc<World>,
    sight: Sight,
    speed_max: f32,
    tick: Duration,
    margin: Duration,
    cap: Duration,
    /// The TBV of each hidden avatar at the last tick, and until when it must have been asked.
    hidden: BTreeMap<AvatarId, (Tbv, bool, Duration)>,
    breaches: Vec<String>,
    hidden_ticks: u64,
}

impl Watch {
    /// Watches a simulation of a world.
    pub fn new(world: &Arc<World>, options: &Options) -> Self {
        let config = &options.config;
        Self {
            world: Arc::clone(world),
            sight: Sight::new(&world.mesh),
            speed_max: config.speed_max.unwrap_or(world.speed_max),
            tick: config.tick,
            margin: config.margin.first(),
            cap: config.horizon_max,
            hidden: BTreeMap::new(),
            breaches: Vec::new(),
            hidden_ticks: 0,
        }
    }

    /// Looks at the end of a tick.
    pub fn look(&mut self, moment: &Moment<'_>) {
        self.look_for_noise(moment);
        self.look_for_refusals(moment);
        self.look_for_leaks(moment);
        self.look_at_tbvs(moment);
    }

    /// What was wrong, and the ticks of avatars that were hidden.
    pub fn end(self) -> (Vec<String>, u64) {
        (self.breaches, self.hidden_ticks)
    }

    fn note(&mut self, moment: &Moment<'_>, breach: &Breach, who: AvatarId, more: &str) {
        if self.breaches.len() < BREACHES_TOLD {
            let (t_ms, walker) = (moment.now.as_millis(), moment.walker(who));
            self.breaches.push(format!("{t_ms} ms, walker {walker}: {breach}{more}"));
        }
    }

    /// Whoever is quiet in the same TBV as a tick ago is neither spoken to nor spoken of. What was refused is an
    /// answer to its own word, and looked at for itself.
    fn look_for_noise(&mut self, moment: &Moment<'_>) {
        let lasting = |id: &AvatarId| match (self.hidden.get(id), moment.engine.state(*id)) {
            (Some((before, true, _)), Some(ClientState::Quiet(tbv))) => *before == tbv,
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
            self.note(moment, &Breach::Noise, id, "");
        }
    }

    /// All clients are honest. Those whose messages are held up for long may seem too fast.
    fn look_for_refusals(&mut self, moment: &Moment<'_>) {
        for output in moment.outputs {
            if let Output::Correct { to, .. } | Output::Drop { to, .. } = output
                && !moment.is_late(*to)
            {
                self.note(moment, &Breach::Refused, *to, "");
            }
        }
    }

    /// Nobody is told of whom it cannot come to see until the next tick's word stands, by the
    /// PVS of all cells within straight ways.
    fn look_for_leaks(&mut self, moment: &Moment<'_>) {
        for output in moment.outputs {
            if matches!(output, Output::Vanish { .. }) {
                continue;
            }
            let (to, avatars) = concerned(output);
            for avatar in avatars {
                if !self.could_see(moment, to, avatar) {
                    let more = format!(" (walker {})", moment.walker(avatar));
                    self.note(moment, &Breach::Leak, to, &more);
                }
            }
        }
    }

    fn could_see(&self, moment: &Moment<'_>, viewer: AvatarId, avatar: AvatarId) -> bool {
        let one_way = (moment.round_trip(viewer) / 2).min(self.cap / 2) + SPARE;
        let cells = &self.world.cells;
        let Some((eye, eye_way_m)) = self.ball(moment, viewer, one_way) else { return false };
        let Some((other, other_way_m)) = self.ball(moment, avatar, one_way) else { return false };
        let mut eyes = Vec::new();
        cells.overlapping(&Aabb::around(cells.axes.own(eye), eye_way_m), &mut eyes);
        let body = cells.axes.own_body(&self.world.body);
        let mut bodies = Vec::new();
        let region = body.around_box(&Aabb::around(cells.axes.own(other), other_way_m));
        cells.overlapping(&region, &mut bodies);
        let sees = |from: &CellId| bodies.iter().any(|to| cells.sees(*from, *to));
        eyes.iter().any(sees)
    }

    /// Where an avatar was last, and how far it can have come when a tick's word does not stand any more.
    fn ball(&self, moment: &Moment<'_>, id: AvatarId, one_way: Duration) -> Option<(Vec3, f32)> {
        let age = moment.now.saturating_sub(moment.heard(id)?);
        let unheard = age + (moment.round_trip(id) / 2).min(self.cap / 2) + self.margin;
        let time = unheard.min(self.cap) + self.tick + one_way;
        let way_m = self.speed_max * time.as_secs_f32() + SPARE_M;
        Some((moment.engine.pose(id)?.eye, way_m))
    }

    /// Whoever is hidden is in its TBV, which was large enough and is asked in time.
    fn look_at_tbvs(&mut self, moment: &Moment<'_>) {
        let before = std::mem::take(&mut self.hidden);
        for (id, eye) in moment.eyes() {
            let Some(state) = moment.engine.state(id) else { continue };
            let Some(tbv) = state.tbv().copied() else { continue };
            self.hidden_ticks += 1;
            let is_quiet = matches!(state, ClientState::Quiet(_));
            let known = before.get(&id).filter(|(known, ..)| *known == tbv);
            let ask_by =
                known.map_or_else(|| self.ask_by(moment, id, &tbv), |(.., ask_by)| *ask_by);
            if known.is_none() && !self.is_large_enough(moment, id, &tbv) {
                self.note(moment, &Breach::Small, id, "");
            }
            let grown = tbv.grown(ROUNDING_M);
            if moment.now <= tbv.expiry && !grown.contains(eye) && !moment.is_late(id) {
                self.note(moment, &Breach::Outside, id, "");
            }
            if is_quiet && moment.now + self.tick > ask_by {
                self.note(moment, &Breach::Late, id, "");
            }
            self.hidden.insert(id, (tbv, is_quiet, ask_by));
        }
    }

    /// When a hidden avatar must be asked at the latest: so that it answers, is told to stay, and what
    /// it then does is told to the slowest.
    fn ask_by(&self, moment: &Moment<'_>, id: AvatarId, tbv: &Tbv) -> Duration {
        let slowest = moment.engine.avatars().map(|other| moment.round_trip(other)).max();
        let told = slowest.unwrap_or_default().min(self.cap) / 2;
        let lead = 2 * moment.round_trip(id).min(self.cap) + told + 2 * self.tick + self.margin;
        tbv.expiry.saturating_sub(lead)
    }

    /// How long a hidden avatar must be sure to stay in its TBV when it was about to leave it at a tick of its
    /// client and was not at the one before: it is heard, another hidden one is asked, and its answer is told.
    fn notice(&self, moment: &Moment<'_>, id: AvatarId) -> Duration {
        let round_trips = |is_counted: &dyn Fn(AvatarId) -> bool| {
            let ids = moment.engine.avatars().filter(|id| is_counted(*id));
            ids.map(|id| moment.round_trip(id).min(self.cap)).max().unwrap_or_default()
        };
        let is_hidden = |id| moment.engine.state(id).is_some_and(|state| state.tbv().is_some());
        let heard = self.tick + moment.round_trip(id).min(self.cap) / 2 + self.margin + self.tick;
        heard + round_trips(&is_hidden) + self.tick + round_trips(&|_| true) / 2
    }

    /// Whether straight walks from the last place known end inside.
    fn is_large_enough(&self, moment: &Moment<'_>, id: AvatarId, tbv: &Tbv) -> bool {
        let (Some(pose), Some(heard)) = (moment.engine.pose(id), moment.heard(id)) else {
            return true;
        };
        let made = heard.saturating_sub(moment.round_trip(id) / 2);
        let time = match tbv.notice {
            Duration::ZERO => tbv.expiry.saturating_sub(made),
            notice if notice < self.notice(moment, id) => return false,
            notice => notice,
        };
        let time_s = time.as_secs_f32();
        let way_m = sprint_m(self.speed_max, time_s) - ROUNDING_M;
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
