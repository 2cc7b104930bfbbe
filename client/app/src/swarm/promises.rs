//! How far off visitors are shown to those that see them.

use std::time::Duration;

use sightline_cli::pose_error::{PoseErrorPercentiles, PoseErrors};
use sightline_client_core::replica::VisibleAvatar;
use sightline_world::motion::AvatarId;

use super::{SwarmSnapshot, VisitorView, history::Histories, sight::Sight};

/// The pairs that are looked at in one snapshot, in turn. Their rays take a few milliseconds.
const PAIRS_MAX: usize = 1_000;

/// Compares where visitors are shown with where they were one delay and two ticks ago, as promised.
/// Only visitors in sight count, by rays.
#[derive(Default)]
pub struct Promises {
    errors: PoseErrors,
    /// The viewer whose turn is next.
    turn: AvatarId,
}

impl Promises {
    /// Looks at the pairs whose turn it is.
    pub fn observe(&mut self, snapshot: &SwarmSnapshot, sight: &Sight, histories: &Histories) {
        let visitors = snapshot.settled();
        let mut from_turn = visitors.range(self.turn..).chain(visitors.range(..self.turn));
        let mut pairs = 0;
        while pairs < PAIRS_MAX
            && let Some((_, viewer)) = from_turn.next()
        {
            pairs += viewer.shown.len();
            for shown in &viewer.shown {
                let other = visitors.get(&shown.id).filter(|other| sight.sees(viewer, other));
                if let Some(other) = other {
                    let lag = lag(viewer, other, snapshot.tick);
                    self.compare(shown, snapshot.elapsed.saturating_sub(lag), histories);
                }
            }
        }
        self.turn = from_turn.next().map_or(self.turn, |(id, _)| *id);
    }

    /// The errors up to now.
    pub fn percentiles(&self) -> PoseErrorPercentiles {
        self.errors.percentiles()
    }

    fn compare(&mut self, shown: &VisibleAvatar, promised: Duration, histories: &Histories) {
        if let Some(truth) = histories.of(shown.id).and_then(|history| history.at(promised)) {
            self.errors.add(&shown.pose, &truth);
        }
    }
}

/// How long ago a visitor was where a viewer is promised to see it: the way of a message from one
/// to the other, and two ticks.
fn lag(viewer: &VisitorView, other: &VisitorView, tick: Duration) -> Duration {
    (viewer.round_trip + other.round_trip) / 2 + 2 * tick
}
