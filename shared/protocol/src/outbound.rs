//! The engine's output for one client, as messages and datagrams. Needs the feature `engine`.
//!
//! `serve` and `replay` both convert by this module, so that `replay` counts what `serve` sends.

use std::time::Duration;

use sightline_engine::Output;
use sightline_world::motion::{AvatarId, Pose};

use crate::{
    message::ServerMessage,
    pose_stream::{Ack, PoseEncoder},
    quantise::WireTbv,
    text::{ChatLine, Name},
};

/// Converts the engine's output for one client, and keeps the server's end of its pose stream.
///
/// Poses wait here until [`Outbound::encode_poses`]. They do not queue: a newer pose of an avatar
/// replaces the one that waits, so at most one waits for each avatar that the client holds.
#[derive(Debug)]
pub struct Outbound {
    interval: Duration,
    encoder: PoseEncoder,
    /// The poses that wait, in ascending order of id, one for each avatar, and the tick of each.
    waiting: Vec<(AvatarId, u32, Pose)>,
}

impl Outbound {
    /// The output of an engine with this time from tick to tick.
    pub fn new(interval: Duration) -> Self {
        Self { interval, encoder: PoseEncoder::new(interval), waiting: Vec::new() }
    }

    /// Takes in an output of the engine at the server's time `now`. Returns the control message for
    /// it, or `None` for poses, which wait.
    pub fn convert(&mut self, output: &Output, now: Duration) -> Option<ServerMessage> {
        Some(match output {
            Output::Entered { pose, tick, .. } => {
                self.encoder.tell_clock();
                ServerMessage::Entered { pose: pose.into(), tick: *tick }
            }
            Output::Appear { avatar, name, colour, pose, tick, .. } => ServerMessage::Appear {
                avatar: *avatar,
                name: Name::clipped(name),
                colour: *colour,
                pose: pose.into(),
                tick: *tick,
                since_sequence: self.encoder.next_sequence(),
            },
            Output::Vanish { avatar, .. } => {
                self.waiting.retain(|(id, ..)| id != avatar);
                self.encoder.forget(*avatar);
                ServerMessage::Vanish { avatar: *avatar }
            }
            Output::Poses { poses, tick, .. } => {
                self.wait(*tick, poses);
                return None;
            }
            Output::Live { tolerance, .. } => ServerMessage::Live { tolerance: tolerance.into() },
            Output::Quiet { tbv, .. } => ServerMessage::Quiet { tbv: WireTbv::new(tbv, now) },
            Output::Ask { .. } => ServerMessage::Ask,
            Output::Correct { pose, .. } => ServerMessage::Correct { pose: pose.into() },
            Output::Chat { from, text, .. } => {
                ServerMessage::Chat { from: *from, text: ChatLine::clipped(text) }
            }
            Output::Drop { reason, .. } => {
                ServerMessage::Goodbye { reason: ChatLine::clipped(reason), may_return: false }
            }
        })
    }

    /// Whether there may be datagrams to send at a tick. Call it at every tick.
    pub fn has_poses(&mut self, tick: u32) -> bool {
        let has_open = self.encoder.has_open(tick);
        has_open || !self.waiting.is_empty()
    }

    /// Drops what waits and forgets all avatars: the client leaves one world for another.
    pub fn leave_world(&mut self) {
        self.waiting.clear();
        self.encoder.forget_all();
    }

    /// Takes the datagrams with the poses that wait, and with those that were lost on the way.
    /// Call it once in each tick in which [there are some](Outbound::has_poses) and datagrams can be
    /// sent.
    pub fn encode_poses(&mut self, tick: u32) -> Vec<Vec<u8>> {
        debug_assert!(self.waiting.is_sorted_by_key(|(id, ..)| *id), "poses are sorted by id");
        let on_course = |(id, at, pose): (AvatarId, u32, Pose)| {
            (id, pose.straight_on(self.interval * tick.saturating_sub(at)))
        };
        let poses: Vec<(AvatarId, Pose)> = self.waiting.drain(..).map(on_course).collect();
        self.encoder.encode(tick, &poses)
    }

    /// Limits the size of datagrams from now on, in bytes; see
    /// [`PoseEncoder::set_datagram_bytes_max`].
    pub fn set_datagram_bytes_max(&mut self, bytes_max: usize) {
        self.encoder.set_datagram_bytes_max(bytes_max);
    }

    /// The number that the next datagram will have.
    pub fn next_sequence(&self) -> u32 {
        self.encoder.next_sequence()
    }

    /// Takes in which datagrams the client has received.
    pub fn acknowledge(&mut self, ack: Ack) {
        self.encoder.acknowledge(ack);
    }

    fn wait(&mut self, tick: u32, poses: &[(AvatarId, Pose)]) {
        let is_empty = self.waiting.is_empty();
        self.waiting.extend(poses.iter().map(|(id, pose)| (*id, tick, *pose)));
        if !is_empty {
            // The sort is stable. In reverse order the newest pose of each avatar comes first.
            self.waiting.reverse();
            self.waiting.sort_by_key(|(id, ..)| *id);
            self.waiting.dedup_by_key(|(id, ..)| *id);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::pose_stream::PoseDecoder;

    const ME: AvatarId = AvatarId(1);
    const NOW: Duration = Duration::ZERO;
    const TICK: Duration = Duration::from_millis(50);

    fn poses(all: &[(u32, f32)]) -> Output {
        let pose = |x: f32| Pose { eye: Vec3::X * x, ..Pose::default() };
        let poses = all.iter().map(|(id, x)| (AvatarId(*id), pose(*x))).collect();
        Output::Poses { to: ME, tick: 0, poses }
    }

    fn decoded(datagrams: &[Vec<u8>], of: u32) -> Option<f32> {
        let mut decoder = PoseDecoder::new(TICK);
        for bytes in datagrams {
            let update = decoder.decode(bytes).unwrap().unwrap();
            if let Some(pose) = update.pose(AvatarId(of)) {
                return Some(Pose::from(pose).eye.x);
            }
        }
        None
    }

    #[test]
    fn a_newer_pose_replaces_the_one_that_waits() {
        let mut outbound = Outbound::new(TICK);
        assert_eq!(outbound.convert(&poses(&[(2, 1.0), (5, 2.0)]), NOW), None);
        assert_eq!(outbound.convert(&poses(&[(3, 3.0), (5, 4.0)]), NOW), None);
        let datagrams = outbound.encode_poses(1);
        assert_eq!(datagrams.len(), 1);
        let x = [2, 3, 5].map(|id| decoded(&datagrams, id));
        assert_eq!(x, [Some(1.0), Some(3.0), Some(4.0)]);
        assert!(outbound.encode_poses(2).is_empty(), "nothing waits any more");
    }

    #[test]
    fn the_poses_of_a_vanished_avatar_are_never_sent() {
        let mut outbound = Outbound::new(TICK);
        outbound.convert(&poses(&[(2, 1.0), (3, 1.0)]), NOW);
        let vanish = Output::Vanish { to: ME, avatar: AvatarId(2) };
        let message = outbound.convert(&vanish, NOW);
        assert_eq!(message, Some(ServerMessage::Vanish { avatar: AvatarId(2) }));
        let datagrams = outbound.encode_poses(1);
        assert_eq!((decoded(&datagrams, 2), decoded(&datagrams, 3)), (None, Some(1.0)));
    }

    #[test]
    fn an_appearance_counts_from_the_next_datagram() {
        let mut outbound = Outbound::new(TICK);
        outbound.convert(&poses(&[(2, 1.0)]), NOW);
        assert_eq!(outbound.encode_poses(1).len(), 1);
        let (avatar, name, pose) = (AvatarId(3), "Bo".to_owned(), Pose::default());
        let appear = Output::Appear { to: ME, avatar, name, colour: [1, 2, 3], pose, tick: 1 };
        let message = outbound.convert(&appear, NOW);
        assert!(matches!(message, Some(ServerMessage::Appear { since_sequence: 2, .. })));
    }
}
