//! The engine's output for one client, as messages and datagrams. Needs the feature `engine`.
//!
//! `serve` and `replay` both convert by this module, so that `replay` counts what `serve` sends.

use std::time::Duration;

use sightline_engine::Output;
use sightline_world::motion::AvatarId;

use crate::{
    message::ServerMessage,
    pose_stream::{Ack, PoseEncoder},
    quantise::WireTbv,
    text::{ChatLine, Name},
};

/// A client that was told of this number of avatars in poses is in a crowd: there is news at almost
/// every tick. It gets datagrams at every second tick, and half of such clients at each.
const CROWD: usize = 64;
/// With this number of courses that wait, a client in a crowd gets a datagram at every tick.
const MANY_WAITING: usize = 64;

/// Converts the engine's output for one client, and keeps the server's end of its pose stream.
///
/// Poses wait here until [`Outbound::encode_poses`]. They do not queue: a newer pose of an avatar
/// replaces the one that waits, so at most one waits for each avatar that the client holds.
#[derive(Debug)]
pub struct Outbound {
    encoder: PoseEncoder,
    /// Whether the client's turn is at odd ticks, where it gets datagrams at every second tick.
    is_odd: bool,
    /// The tick of the last call of [`has_poses`](Self::has_poses).
    last_tick: u32,
}

impl Outbound {
    /// The output for a client of an engine with this time from tick to tick.
    pub fn new(to: AvatarId, interval: Duration) -> Self {
        Self { encoder: PoseEncoder::new(interval), is_odd: to.0 % 2 == 1, last_tick: 0 }
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
                self.encoder.forget(*avatar);
                ServerMessage::Vanish { avatar: *avatar }
            }
            Output::Poses { from, poses, tick, .. } => {
                self.encoder.tell(*tick, *from, poses);
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

    /// Whether there may be a datagram to send at a tick. Call it at every tick.
    pub fn has_poses(&mut self, tick: u32) -> bool {
        // A server that cannot keep up skips numbers of ticks. They may then all be odd, or all
        // even.
        let is_after_skipped = tick.saturating_sub(self.last_tick) > 1;
        self.last_tick = tick;
        let is_turn = self.encoder.told_len() < CROWD
            || self.encoder.waiting_len() >= MANY_WAITING
            || is_after_skipped
            || (tick % 2 == 1) == self.is_odd;
        is_turn && self.encoder.has_due(tick)
    }

    /// How many poses wait.
    pub fn waiting_len(&self) -> usize {
        self.encoder.waiting_len()
    }

    /// Drops what waits and forgets all avatars: the client leaves one world for another.
    pub fn leave_world(&mut self) {
        self.encoder.forget_all();
    }

    /// Takes the datagram of a tick, with poses that wait and those that were lost on the way. What
    /// does not fit waits on. Call it once in each tick in which [there is
    /// one](Outbound::has_poses) and it can be sent.
    pub fn encode_poses(&mut self, tick: u32) -> Option<Vec<u8>> {
        self.encoder.encode(tick)
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
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_world::motion::Pose;

    use super::*;
    use crate::pose_stream::PoseDecoder;

    const ME: AvatarId = AvatarId(1);
    const NOW: Duration = Duration::ZERO;
    const TICK: Duration = Duration::from_millis(50);

    fn poses(all: &[(u32, f32)]) -> Output {
        let pose = |x: f32| Pose { eye: Vec3::X * x, ..Pose::default() };
        let poses = all.iter().map(|(id, x)| (AvatarId(*id), pose(*x))).collect();
        Output::Poses { to: ME, from: Vec3::ZERO, tick: 0, poses }
    }

    fn decoded(datagram: &Option<Vec<u8>>, of: u32) -> Option<f32> {
        let mut decoder = PoseDecoder::new(TICK);
        if let Some(bytes) = datagram {
            let update = decoder.decode(bytes).unwrap().unwrap();
            if let Some(pose) = update.pose(AvatarId(of)) {
                return Some(Pose::from(pose).eye.x);
            }
        }
        None
    }

    #[test]
    fn a_newer_pose_replaces_the_one_that_waits() {
        let mut outbound = Outbound::new(ME, TICK);
        assert_eq!(outbound.convert(&poses(&[(2, 1.0), (5, 2.0)]), NOW), None);
        assert_eq!(outbound.convert(&poses(&[(3, 3.0), (5, 4.0)]), NOW), None);
        let datagram = outbound.encode_poses(1);
        let x = [2, 3, 5].map(|id| decoded(&datagram, id));
        assert_eq!(x, [Some(1.0), Some(3.0), Some(4.0)]);
        assert!(outbound.encode_poses(2).is_none(), "nothing waits any more");
    }

    #[test]
    fn the_poses_of_a_vanished_avatar_are_never_sent() {
        let mut outbound = Outbound::new(ME, TICK);
        outbound.convert(&poses(&[(2, 1.0), (3, 1.0)]), NOW);
        let vanish = Output::Vanish { to: ME, avatar: AvatarId(2) };
        let message = outbound.convert(&vanish, NOW);
        assert_eq!(message, Some(ServerMessage::Vanish { avatar: AvatarId(2) }));
        let datagram = outbound.encode_poses(1);
        assert_eq!((decoded(&datagram, 2), decoded(&datagram, 3)), (None, Some(1.0)));
    }

    /// The ticks, of some in a row, at which a client in a crowd gets a datagram. There is news of
    /// one avatar at each.
    fn ticks_with_poses(to: AvatarId, ticks: impl Iterator<Item = u32>) -> Vec<u32> {
        let mut outbound = Outbound::new(to, TICK);
        let crowd: Vec<(u32, f32)> = (10..10 + CROWD as u32).map(|id| (id, 1.0)).collect();
        outbound.convert(&poses(&crowd), NOW);
        outbound.encode_poses(0);
        let sends = |tick: &u32| {
            outbound.convert(&poses(&[(10, 1.0 + *tick as f32)]), NOW);
            outbound.has_poses(*tick) && outbound.encode_poses(*tick).is_some()
        };
        ticks.filter(sends).collect()
    }

    #[test]
    fn a_client_in_a_crowd_has_its_turn_at_every_second_tick() {
        assert_eq!(ticks_with_poses(AvatarId(1), 1..7), [1, 3, 5]);
        assert_eq!(ticks_with_poses(AvatarId(2), 1..7), [2, 4, 6]);
    }

    #[test]
    fn a_client_in_a_crowd_has_its_turn_although_ticks_are_skipped() {
        for to in [1, 2].map(AvatarId) {
            for step in [2, 4] {
                let ticks: Vec<u32> = (step..40).step_by(step as usize).collect();
                assert_eq!(ticks_with_poses(to, ticks.iter().copied()), ticks, "{to:?}, {step}");
            }
        }
    }

    #[test]
    fn an_appearance_counts_from_the_next_datagram() {
        let mut outbound = Outbound::new(ME, TICK);
        outbound.convert(&poses(&[(2, 1.0)]), NOW);
        assert!(outbound.encode_poses(1).is_some());
        let (avatar, name, pose) = (AvatarId(3), "Bo".to_owned(), Pose::default());
        let appear = Output::Appear { to: ME, avatar, name, colour: [1, 2, 3], pose, tick: 1 };
        let message = outbound.convert(&appear, NOW);
        assert!(matches!(message, Some(ServerMessage::Appear { since_sequence: 2, .. })));
    }
}
