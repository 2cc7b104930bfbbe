//! Misses: visitors in sight of others that do not hold them.

use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

use sightline_world::motion::AvatarId;

use super::{SwarmSnapshot, VisitorView, sight::Sight};

/// A visitor that is in sight and not held counts as missed after this time. The server promises
/// that it is held at once. This time, a round trip of 400 ms and two ticks, is for what the server
/// itself hears late: that somebody has left a sealed room, or a message that was sent again.
const UNTOLD_MAX: Duration = Duration::from_millis(500);
/// The pairs that are looked at in one snapshot, in turn. Their rays take a few milliseconds.
const PAIRS_MAX: usize = 1_000;
/// While this number of pairs are in sight and not held, only these are looked at.
const UNHELD_MAX: usize = 4_000;

/// Counts misses.
#[derive(Default)]
pub struct Misses {
    /// The pairs of a viewer and an avatar in its sight that it does not hold.
    unheld: BTreeMap<Pair, Unheld>,
    /// The viewer whose turn is next.
    turn: AvatarId,
    count: usize,
    looks: u64,
}

/// A viewer and another avatar.
type Pair = (AvatarId, AvatarId);

/// Since when an avatar has been in sight and not held.
#[derive(Clone, Copy)]
struct Unheld {
    since: Duration,
    is_counted: bool,
}

impl Misses {
    /// How often a visitor was missed. As long as it stays in sight and is not held, it counts
    /// once.
    pub fn count(&self) -> usize {
        self.count
    }

    /// How often a pair was looked at.
    pub fn looks(&self) -> u64 {
        self.looks
    }

    /// Looks at the pairs whose turn it is, and at those that were in sight and not held before.
    pub fn observe(&mut self, snapshot: &SwarmSnapshot, sight: &Sight) {
        let now = snapshot.elapsed;
        let visitors = snapshot.settled();
        let before = std::mem::take(&mut self.unheld);
        let mut pairs: BTreeSet<Pair> = before.keys().copied().collect();
        if pairs.len() < UNHELD_MAX {
            pairs.extend(self.pairs_in_turn(&visitors));
        }
        for pair in pairs {
            let both = visitors.get(&pair.0).zip(visitors.get(&pair.1));
            self.looks += u64::from(both.is_some());
            if !both.is_some_and(|(viewer, other)| is_unheld(viewer, other, sight)) {
                continue;
            }
            let first = Unheld { since: now, is_counted: false };
            let Unheld { since, is_counted } = before.get(&pair).copied().unwrap_or(first);
            let is_missed = now.saturating_sub(since) > UNTOLD_MAX;
            self.count += usize::from(is_missed && !is_counted);
            self.unheld.insert(pair, Unheld { since, is_counted: is_missed });
        }
    }

    /// The pairs of the next viewers, and passes the turn on.
    fn pairs_in_turn(&mut self, visitors: &BTreeMap<AvatarId, &VisitorView>) -> Vec<Pair> {
        let viewers_max = (PAIRS_MAX / visitors.len().max(1)).clamp(1, visitors.len().max(1));
        let from_turn = visitors.range(self.turn..).chain(visitors.range(..self.turn));
        let mut ids = from_turn.map(|(id, _)| *id);
        let viewers: Vec<AvatarId> = ids.by_ref().take(viewers_max).collect();
        self.turn = ids.next().or(viewers.first().copied()).unwrap_or_default();
        let pairs_of = |viewer| visitors.keys().map(move |other| (viewer, *other));
        viewers.into_iter().flat_map(pairs_of).filter(|(viewer, other)| viewer != other).collect()
    }
}

/// Whether a visitor is in a viewer's sight and not held by it.
fn is_unheld(viewer: &VisitorView, other: &VisitorView, sight: &Sight) -> bool {
    !viewer.held.iter().any(|held| held.id == other.avatar) && sight.sees(viewer, other)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;
    use sightline_client_core::replica::HeldAvatar;
    use sightline_fixtures::{boxes::box_triangles, two_rooms};
    use sightline_world::{
        Mesh, World,
        geometry::Aabb,
        motion::{Pose, ReportingState},
    };

    use super::*;

    /// Two rooms, with a wall between them and its door.
    fn world() -> Arc<World> {
        let wall = Aabb::new(Vec3::new(5.95, 0.0, 1.0), Vec3::new(6.05, 3.0, 6.0));
        let positions: Vec<Vec3> = box_triangles(&wall).into_iter().flatten().collect();
        let triangles = (0..positions.len() as u32 / 3).map(|i| [0, 1, 2].map(|k| 3 * i + k));
        let mesh = Mesh { triangles: triangles.collect(), positions };
        Arc::new(World { mesh, ..two_rooms::world() })
    }

    fn visitor(id: u32, x: f32, z: f32, held: &[u32]) -> VisitorView {
        let pose = Pose { eye: Vec3::new(x, 1.6, z), ..Pose::default() };
        let hold = |id: &u32| HeldAvatar {
            id: AvatarId(*id),
            pose,
            age: Duration::ZERO,
            certainty: Duration::ZERO,
        };
        VisitorView {
            avatar: AvatarId(id),
            pose,
            reporting_state: Some(ReportingState::Live),
            leapt: None,
            round_trip: Duration::ZERO,
            held: held.iter().map(hold).collect(),
            shown: Vec::new(),
        }
    }

    /// The misses after each of some snapshots, 200 ms apart.
    fn counts(snapshots: impl IntoIterator<Item = Vec<VisitorView>>) -> Vec<usize> {
        let (mut misses, sight) = (Misses::default(), Sight::new(world()));
        let counts = (0..).zip(snapshots).map(|(i, visitors)| {
            let elapsed = Duration::from_millis(200) * i;
            misses.observe(&SwarmSnapshot { elapsed, visitors, ..Default::default() }, &sight);
            misses.count()
        });
        counts.collect()
    }

    #[test]
    fn who_is_in_sight_and_not_held_for_half_a_second_is_missed_once() {
        let one_way = || vec![visitor(3, 1.0, 3.0, &[]), visitor(7, 5.0, 3.0, &[3])];
        assert_eq!(counts((0..9).map(|_| one_way())), [0, 0, 0, 1, 1, 1, 1, 1, 1]);
        let neither = || vec![visitor(3, 1.0, 3.0, &[]), visitor(7, 5.0, 3.0, &[])];
        assert_eq!(counts((0..5).map(|_| neither())), [0, 0, 0, 2, 2]);
    }

    #[test]
    fn who_is_held_or_hidden_in_time_is_not_missed() {
        let held = |i: u32| if i.is_multiple_of(3) { vec![7] } else { Vec::new() };
        let late = |i| vec![visitor(3, 1.0, 3.0, &held(i)), visitor(7, 5.0, 3.0, &[3])];
        assert_eq!(counts((0..9).map(late)), [0; 9]);
        let hidden = |_| vec![visitor(3, 5.0, 4.0, &[]), visitor(7, 7.0, 4.0, &[])];
        assert_eq!(counts((0..9).map(hidden)), [0; 9]);
        let through_the_door = |_| vec![visitor(3, 5.0, 0.5, &[]), visitor(7, 7.0, 0.5, &[3])];
        assert_eq!(counts((0..4).map(through_the_door)), [0, 0, 0, 1]);
    }

    #[test]
    fn visitors_whom_the_server_may_have_elsewhere_are_left_out() {
        let leapt = |i| {
            let leapt = Some(Duration::from_millis(200) * i);
            let seen = VisitorView { leapt, ..visitor(7, 5.0, 3.0, &[3]) };
            vec![visitor(3, 1.0, 3.0, &[]), seen]
        };
        assert_eq!(counts((0..9).map(leapt)), [0; 9]);
    }

    #[test]
    fn in_a_crowd_everybody_has_a_turn() {
        let crowd = || (0..60).map(|id| visitor(id, 1.0 + id as f32 * 0.05, 3.0, &[])).collect();
        let counts = counts((0..10).map(|_| crowd()));
        assert_eq!(counts.last(), Some(&(60 * 59)));
        let largest = counts.windows(2).map(|pair| pair[1] - pair[0]).max();
        assert!(largest <= Some(PAIRS_MAX), "{largest:?} at once");
    }
}
