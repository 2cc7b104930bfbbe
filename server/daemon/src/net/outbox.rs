//! What is to be sent to one client: control messages in order, and the newest poses.

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use sightline_protocol::{
    frame, message::ServerMessage, outbound::Outbound, pose_stream::Ack, text::ChatLine,
};
use sightline_world::motion::ReportingState;
use tokio::sync::Notify;

use sightline_engine::Output;

/// A client for which more control messages wait is too slow to be served, in bytes.
const CONTROL_BYTES_MAX: usize = 256 * 1_024;

/// What is to be sent to one client. The engine's task fills it and never waits; the client's own
/// task empties it. Poses do not queue: a newer one takes the place of an older one.
#[derive(Debug, Default)]
pub struct Outbox {
    state: Mutex<State>,
    filled: Notify,
}

/// What to send now.
#[derive(Debug, Default)]
pub struct Batch {
    /// Whole frames, for the stream.
    pub control: Vec<u8>,
    /// How many frames these are.
    pub frames: u64,
    /// Poses.
    pub datagrams: Vec<Vec<u8>>,
    /// Nothing comes after this batch; the connection is to be closed.
    pub is_last: bool,
}

#[derive(Debug, Default)]
struct State {
    control: Vec<u8>,
    frames: u64,
    outbound: Outbound,
    tick: u32,
    /// Counts up to `tick` when poses were encoded.
    encoded_tick: u32,
    /// What the server expects of the client; `None` before it is in the world.
    reporting: Option<ReportingState>,
    has_ended: bool,
}

impl Outbox {
    /// Takes in a message for the client.
    pub fn push(&self, message: &ServerMessage) {
        self.state().push(message);
        self.filled.notify_one();
    }

    /// Takes in an output of the engine for the client.
    pub fn tell(&self, output: &Output, now: Duration) {
        let mut state = self.state();
        if let Some(message) = state.outbound.convert(output, now) {
            state.push(&message);
        }
    }

    /// Says goodbye: nothing can be added any more.
    pub fn end(&self, reason: &str) {
        self.state().push(&ServerMessage::Goodbye { reason: ChatLine::clipped(reason) });
        self.filled.notify_one();
    }

    /// All that the engine had to tell at a tick was told: the client's task may send it.
    pub fn flush(&self, tick: u32) {
        self.state().tick = tick;
        self.filled.notify_one();
    }

    /// What the client says that it has received.
    pub fn acknowledge(&self, ack: Ack) {
        self.state().outbound.acknowledge(ack);
    }

    /// What the server expects of the client; `None` before it is in the world.
    pub fn reporting_state(&self) -> Option<ReportingState> {
        self.state().reporting
    }

    /// Waits until there may be something to send. One task may wait.
    pub async fn filled(&self) {
        self.filled.notified().await;
    }

    /// All that is to be sent now; poses only when the path has room for them, in datagrams of so
    /// many bytes.
    pub fn take(&self, datagram_bytes_max: Option<usize>) -> Batch {
        let mut state = self.state();
        let mut datagrams = Vec::new();
        if let Some(bytes_max) = datagram_bytes_max
            && state.tick != state.encoded_tick
        {
            state.encoded_tick = state.tick;
            state.outbound.set_datagram_bytes_max(bytes_max);
            let tick = state.tick;
            datagrams = state.outbound.encode_poses(tick);
        }
        Batch {
            control: std::mem::take(&mut state.control),
            frames: std::mem::take(&mut state.frames),
            datagrams,
            is_last: state.has_ended,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Nothing that holds the lock leaves the state half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn push(&mut self, message: &ServerMessage) {
        if self.has_ended {
            return;
        }
        self.reporting = reporting_after(message).or(self.reporting);
        let frame = frame::encode(message);
        if self.control.len() + frame.len() > CONTROL_BYTES_MAX {
            // It does not read: there is no use in telling it why.
            self.control.clear();
            self.has_ended = true;
            return;
        }
        self.control.extend_from_slice(&frame);
        self.frames += 1;
        self.has_ended = matches!(message, ServerMessage::Goodbye { .. });
    }
}

/// How a client reports once it has received a message; `None` when that changes nothing.
fn reporting_after(message: &ServerMessage) -> Option<ReportingState> {
    match message {
        ServerMessage::Entered { .. } | ServerMessage::Live => Some(ReportingState::Live),
        ServerMessage::Quiet { .. } => Some(ReportingState::Quiet),
        ServerMessage::Ask => Some(ReportingState::Asked),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_engine::Output;
    use sightline_protocol::{frame::FrameBuffer, pose_stream::PoseDecoder};
    use sightline_world::motion::{AvatarId, Pose};

    use super::*;

    const ME: AvatarId = AvatarId(1);
    const OTHER: AvatarId = AvatarId(2);

    fn messages(batch: &Batch) -> Vec<ServerMessage> {
        let mut buffer = FrameBuffer::default();
        buffer.push(&batch.control);
        let mut messages = Vec::new();
        while let Some(frame) = buffer.next_frame().unwrap() {
            messages.push(ServerMessage::decode(frame).unwrap());
        }
        messages
    }

    fn poses(x: f32) -> Output {
        let pose = Pose { eye: Vec3::X * x, ..Pose::default() };
        Output::Poses { to: ME, tick: 0, poses: vec![(OTHER, pose)] }
    }

    fn appear() -> Output {
        let (name, pose) = ("Bo".to_owned(), Pose::default());
        Output::Appear { to: ME, avatar: OTHER, name, colour: [1, 2, 3], pose }
    }

    #[test]
    fn a_newer_pose_takes_the_place_of_one_that_waits() {
        let outbox = Outbox::default();
        for tick in 1..=100 {
            outbox.tell(&poses(tick as f32), Duration::ZERO);
            outbox.flush(tick);
            assert!(outbox.take(None).datagrams.is_empty(), "the path is full");
        }
        let batch = outbox.take(Some(1_200));
        assert_eq!(batch.datagrams.len(), 1);
        let mut decoder = PoseDecoder::default();
        let update = decoder.decode(&batch.datagrams[0]).unwrap().unwrap();
        let pose = Pose::from(update.pose(OTHER).unwrap());
        assert_eq!((update.tick, pose.eye.x), (100, 100.0));
        assert!(outbox.take(Some(1_200)).datagrams.is_empty());
    }

    #[test]
    fn nothing_is_sent_about_the_vanished() {
        let outbox = Outbox::default();
        outbox.tell(&appear(), Duration::ZERO);
        outbox.tell(&poses(1.0), Duration::ZERO);
        outbox.tell(&Output::Vanish { to: ME, avatar: OTHER }, Duration::ZERO);
        for tick in 1..20 {
            outbox.flush(tick);
            assert!(outbox.take(Some(1_200)).datagrams.is_empty());
        }
    }

    #[test]
    fn an_appearance_counts_from_the_next_datagram() {
        let outbox = Outbox::default();
        outbox.tell(&poses(1.0), Duration::ZERO);
        outbox.flush(1);
        assert_eq!(outbox.take(Some(1_200)).datagrams.len(), 1);
        outbox.tell(&appear(), Duration::ZERO);
        let said = messages(&outbox.take(None));
        assert!(matches!(&said[..], [ServerMessage::Appear { since_sequence: 2, .. }]));
    }

    #[test]
    fn one_that_does_not_read_is_given_up_with_bounded_memory() {
        let outbox = Outbox::default();
        for _ in 0..100_000 {
            outbox.tell(&appear(), Duration::ZERO);
            assert!(outbox.state().control.len() <= CONTROL_BYTES_MAX);
        }
        let batch = outbox.take(None);
        assert!(batch.is_last && batch.control.is_empty());
    }

    #[test]
    fn goodbye_is_the_last_word() {
        let outbox = Outbox::default();
        outbox.tell(&Output::Drop { to: ME, reason: "enough\n".to_owned() }, Duration::ZERO);
        outbox.tell(&Output::Live { to: ME }, Duration::ZERO);
        let batch = outbox.take(None);
        assert!(batch.is_last);
        let reason = ChatLine::new("enough").unwrap();
        assert_eq!(messages(&batch), [ServerMessage::Goodbye { reason }]);
    }
}
