//! What clients hold, compared with what rays say is visible.

use std::{collections::BTreeMap, time::Duration};

use glam::Vec3;
use rayon::prelude::*;
use sightline_shared::{
    motion::{AvatarId, Body},
    world::World,
};

use super::{Options, OracleReport, OracleStride, clients::Clients};
use crate::{sight::Sight, trace::Trace};

/// Points looked for on each axis of a body's box.
const SAMPLES: u32 = 3;
/// Pairs that the oracle looks at in a run when it chooses the stride itself: about 20 s of CPU.
const PAIRS_MAX: u64 = 1_000_000;

/// Looks at every pair from time to time.
pub(super) struct Oracle {
    sight: Sight,
    body: Body,
    stride: Duration,
    next: Duration,
    /// For so long after coming or jumping nobody can be expected to be known, or to know.
    unsettled: Duration,
    tally: OracleReport,
    age_sum: Duration,
}

struct Looker<'a> {
    avatar: AvatarId,
    eye: Vec3,
    settled: bool,
    replica: &'a BTreeMap<AvatarId, Duration>,
}

/// What one viewer's pairs add up to.
#[derive(Default)]
struct Sums {
    visible: u64,
    held: u64,
    misses: u64,
    misses_after_jumps: u64,
    age_sum: Duration,
    age_worst: Duration,
}

impl Oracle {
    pub(super) fn new(world: &World, trace: &Trace, options: &Options) -> Option<Self> {
        let stride = match options.oracle {
            OracleStride::Off => return None,
            OracleStride::Every(stride) => stride,
            OracleStride::Auto => stride(trace, options),
        };
        let tick = options.config.tick;
        Some(Self {
            sight: Sight::new(&world.mesh),
            body: world.body,
            stride,
            next: Duration::ZERO,
            unsettled: 2 * options.round_trip + 4 * tick,
            tally: OracleReport {
                stride_ms: stride.as_secs_f64() * 1e3,
                age_bound_ms: (options.round_trip + 2 * tick).as_secs_f64() * 1e3,
                ..OracleReport::default()
            },
            age_sum: Duration::ZERO,
        })
    }

    /// Compares, if it is time to.
    pub(super) fn look(&mut self, now: Duration, clients: &Clients<'_>) {
        if now < self.next {
            return;
        }
        self.next = now + self.stride;
        let lookers: Vec<Looker<'_>> = clients
            .present()
            .map(|client| Looker {
                avatar: client.avatar,
                eye: client.eye,
                settled: client.settled + self.unsettled <= now,
                replica: &client.replica,
            })
            .collect();
        let sums: Vec<Sums> =
            lookers.par_iter().map(|viewer| self.look_from(now, viewer, &lookers)).collect();
        self.tally.instants += 1;
        sums.iter().for_each(|sums| self.add(sums));
    }

    fn look_from(&self, now: Duration, viewer: &Looker<'_>, all: &[Looker<'_>]) -> Sums {
        let mut sums = Sums::default();
        for other in all.iter().filter(|other| other.avatar != viewer.avatar) {
            let held = viewer.replica.get(&other.avatar);
            let settled = viewer.settled && other.settled;
            let body = self.body.around(other.eye);
            let visible = self.sight.of_box(viewer.eye, &body, SAMPLES);
            match (visible, held) {
                (true, None) if settled => sums.misses += 1,
                (true, None) => sums.misses_after_jumps += 1,
                (true, Some(sampled)) if settled => {
                    let age = now.saturating_sub(*sampled);
                    sums.age_sum += age;
                    sums.age_worst = sums.age_worst.max(age);
                }
                _ => {}
            }
            if settled {
                sums.visible += u64::from(visible);
                sums.held += u64::from(held.is_some());
            }
        }
        sums
    }

    fn add(&mut self, sums: &Sums) {
        let tally = &mut self.tally;
        tally.pairs_visible += sums.visible;
        tally.pairs_held += sums.held;
        tally.misses += sums.misses;
        tally.misses_after_jumps += sums.misses_after_jumps;
        tally.age_worst_ms = tally.age_worst_ms.max(sums.age_worst.as_secs_f64() * 1e3);
        self.age_sum += sums.age_sum;
    }

    pub(super) fn report(self) -> OracleReport {
        let seen = self.tally.pairs_visible - self.tally.misses.min(self.tally.pairs_visible);
        let age_mean_ms = self.age_sum.as_secs_f64() * 1e3 / seen.max(1) as f64;
        let over_send = self.tally.pairs_held as f64 / self.tally.pairs_visible.max(1) as f64;
        OracleReport { over_send, age_mean_ms, ..self.tally }
    }
}

/// Once a second, or less often for large crowds.
fn stride(trace: &Trace, options: &Options) -> Duration {
    let (first, last) = trace.span();
    let length = last.saturating_sub(first).min(options.length.unwrap_or(Duration::MAX));
    let people = trace.ids().count() as u64;
    let instants_max = (PAIRS_MAX / (people * people).max(1)).max(4);
    let wanted = length / u32::try_from(instants_max).unwrap_or(u32::MAX);
    wanted.max(Duration::from_secs(1))
}
