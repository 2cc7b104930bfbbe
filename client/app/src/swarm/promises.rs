//! How far off visitors are shown to those that see them.

use std::time::Duration;

use sightline_cli::pose_error::{DistanceBand, ErrorsByDistance, PoseErrorPercentiles};
use sightline_client_core::replica::ShownAvatar;
use sightline_world::motion::AvatarId;

use super::{SwarmSnapshot, VisitorView, history::Histories, sight::Sight};

/// The pairs that are looked at in one snapshot, in turn. Their rays take a few milliseconds.
const PAIRS_MAX: usize = 1_000;

/// Compares where visitors are shown with where they were one delay and two ticks ago, as promised.
/// Only visitors in sight count, by rays.
#[derive(Default)]
pub struct Promises {
    errors: ErrorsByDistance,
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
                    let promised = snapshot.elapsed.saturating_sub(lag);
                    self.compare(viewer, shown, promised, histories);
                }
            }
        }
        self.turn = from_turn.next().map_or(self.turn, |(id, _)| *id);
    }

    /// The errors up to now.
    pub fn percentiles(&self) -> PoseErrorPercentiles {
        self.errors.percentiles()
    }

    /// The errors up to now, by distance.
    pub fn bands(&self) -> Vec<DistanceBand> {
        self.errors.bands()
    }

    fn compare(
        &mut self,
        viewer: &VisitorView,
        shown: &ShownAvatar,
        promised: Duration,
        histories: &Histories,
    ) {
        if let Some(truth) = histories.of(shown.id).and_then(|history| history.at(promised)) {
            let away_m = viewer.pose.eye.distance(truth.eye);
            self.errors.add(away_m, &shown.pose, &truth);
        }
    }
}

/// How long ago a visitor was where a viewer is promised to see it: the way of a message from one
/// to the other, and two ticks.
fn lag(viewer: &VisitorView, other: &VisitorView, tick: Duration) -> Duration {
    (viewer.round_trip + other.round_trip) / 2 + 2 * tick
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Vec3;
    use sightline_fixtures::two_rooms;
    use sightline_world::motion::{Pose, ReportingState};

    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    /// A visitor that walks at 1 m/s, and is shown where it was this long ago.
    fn errors(shown_ago_ms: u64) -> PoseErrorPercentiles {
        let sight = Sight::new(Arc::new(two_rooms::world()));
        let (mut promises, mut histories) = (Promises::default(), Histories::default());
        let pose_at = |t: u64| Pose {
            eye: Vec3::new(1.0 + t as f32 * 1e-3, 1.6, 3.0),
            yaw: t as f32 * 1e-3,
            ..Pose::default()
        };
        let view = |id: u32, pose: Pose, shown: Vec<ShownAvatar>| VisitorView {
            avatar: AvatarId(id),
            pose,
            reporting_state: Some(ReportingState::Live),
            leapt: None,
            round_trip: ms(100),
            held: Vec::new(),
            shown,
        };
        for t in (0..2_000).step_by(25) {
            histories.push(AvatarId(7), ms(t), pose_at(t));
            let pose = pose_at(t.saturating_sub(shown_ago_ms));
            let shown = ShownAvatar { id: AvatarId(7), name: String::new(), colour: [0; 3], pose };
            let viewer = Pose { eye: Vec3::new(1.0, 1.6, 4.0), ..Pose::default() };
            let visitors = vec![view(3, viewer, vec![shown]), view(7, pose_at(t), Vec::new())];
            if t >= 1_000 {
                let snapshot = SwarmSnapshot { elapsed: ms(t), tick: ms(50), visitors };
                promises.observe(&snapshot, &sight, &histories);
            }
        }
        promises.percentiles()
    }

    #[test]
    fn who_is_shown_as_one_delay_and_two_ticks_ago_is_shown_as_promised() {
        let promised = errors(200);
        assert!(promised.p99_m < 1e-4 && promised.p99_deg < 0.01, "{promised:?}");
        let late = errors(300);
        assert!((late.p50_m - 0.1).abs() < 1e-3, "{late:?}");
        assert!((late.p99_deg - 0.1_f64.to_degrees()).abs() < 0.1, "{late:?}");
    }
}
