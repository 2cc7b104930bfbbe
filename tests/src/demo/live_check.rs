//! The live run, compared with rays against the building's original triangles.

use std::time::Duration;

use rayon::prelude::*;
use sightline_client::swarm::{SwarmSnapshot, VisitorView};
use sightline_oracle::Oracle;
use sightline_world::{World, motion::AvatarId};

/// The time between two checks of all pairs.
pub(super) const CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// Sampled points along each edge of a body's box.
const BODY_SAMPLES: u32 = 3;

/// How what the clients held compares with what rays say they saw, over all checks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LiveCheck {
    /// Pairs of a viewer and an avatar in its sight.
    pub(super) visible: u64,
    /// Pairs of a viewer and an avatar that its replica held.
    pub(super) held: u64,
    /// Pairs in sight that were not held, neither at a check nor at the snapshot after it.
    pub(super) missed: u64,
}

impl LiveCheck {
    /// Checks all pairs of visitors, once per [`CHECK_INTERVAL`]. The news about a visible avatar
    /// may be on its way at one moment, so a pair counts as missed only when the next snapshot
    /// misses it too.
    pub(super) fn of(world: &World, snapshots: &[SwarmSnapshot]) -> Self {
        let oracle = Oracle::new(&world.mesh);
        let checked = every(snapshots, CHECK_INTERVAL);
        let checks = checked.par_iter().map(|&index| {
            let next = snapshots.get(index + 1);
            Self::at(world, &oracle, &snapshots[index], next)
        });
        let sum = checks.reduce(Self::default, |a, b| Self {
            visible: a.visible + b.visible,
            held: a.held + b.held,
            missed: a.missed + b.missed,
        });
        assert!(sum.missed <= sum.visible, "every missed pair is visible: {sum:?}");
        sum
    }

    /// Avatars held for each avatar in sight.
    pub(super) fn over_send(&self) -> f64 {
        self.held as f64 / self.visible.max(1) as f64
    }

    fn at(
        world: &World,
        oracle: &Oracle,
        snapshot: &SwarmSnapshot,
        next: Option<&SwarmSnapshot>,
    ) -> Self {
        let mut check = Self::default();
        for (viewer, other) in pairs(snapshot) {
            let is_held = holds(viewer, other.avatar);
            check.held += u64::from(is_held);
            if !sees(world, oracle, viewer, other) {
                continue;
            }
            check.visible += 1;
            let is_missed = !is_held
                && next
                    .is_some_and(|next| misses(world, oracle, next, viewer.avatar, other.avatar));
            check.missed += u64::from(is_missed);
        }
        check
    }
}

fn holds(viewer: &VisitorView, avatar: AvatarId) -> bool {
    viewer.held.iter().any(|held| held.id == avatar)
}

/// Whether a ray from the viewer's eye reaches a sampled point of the other's body.
fn sees(world: &World, oracle: &Oracle, viewer: &VisitorView, other: &VisitorView) -> bool {
    oracle.of_box(viewer.pose.eye, &world.body.around(other.pose.eye), BODY_SAMPLES)
}

/// Whether a viewer sees an avatar in a snapshot, and does not hold it.
fn misses(
    world: &World,
    oracle: &Oracle,
    snapshot: &SwarmSnapshot,
    viewer: AvatarId,
    other: AvatarId,
) -> bool {
    pairs(snapshot).any(|(v, o)| {
        (v.avatar, o.avatar) == (viewer, other) && !holds(v, other) && sees(world, oracle, v, o)
    })
}

/// All ordered pairs of two visitors: the viewer first.
fn pairs(snapshot: &SwarmSnapshot) -> impl Iterator<Item = (&VisitorView, &VisitorView)> {
    let visitors = &snapshot.visitors;
    visitors.iter().flat_map(move |viewer| {
        visitors.iter().filter(|o| o.avatar != viewer.avatar).map(move |other| (viewer, other))
    })
}

/// The indices of snapshots at least an interval apart. The first interval is left out.
fn every(snapshots: &[SwarmSnapshot], interval: Duration) -> Vec<usize> {
    let mut next = interval;
    let mut chosen = Vec::new();
    for (index, snapshot) in snapshots.iter().enumerate() {
        if snapshot.elapsed >= next {
            chosen.push(index);
            next = snapshot.elapsed + interval;
        }
    }
    chosen
}
