//! The outbox of one client: control messages in order, and the newest poses.

use std::{
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use sightline_engine::Output;
use sightline_protocol::{
    frame, message::ServerMessage, outbound::Outbound, pose_stream::Ack, text::ChatLine,
};
use sightline_world::motion::{AvatarId, ReportingState};
use tokio::sync::Notify;

use super::budget::SendBudget;
use crate::operate::SentFrames;

/// With less room than this in a client's budget, its poses wait.
const DATAGRAM_BYTES_MIN: usize = 256;

/// The messages that wait to be sent to one client. The engine's thread fills the outbox and never
/// waits; the client's own task empties it. Poses do not queue: a newer one replaces an older one.
#[derive(Debug)]
pub struct Outbox {
    waiting: Mutex<Waiting>,
    filled: Notify,
    ended: Notify,
}

/// What is to be sent now.
#[derive(Debug, Default)]
pub struct Batch {
    /// Whole frames, for the stream.
    pub control: Vec<u8>,
    /// These frames, counted by kind.
    pub frames: SentFrames,
    /// A datagram with poses.
    pub datagram: Option<Vec<u8>>,
    /// Whether the client's budget left too little for poses that waited.
    pub is_short: bool,
    /// Whether this is the last batch. Then the connection is to be closed.
    pub is_last: bool,
    /// Whether more waited than may, so that nothing of it is sent.
    pub overflowed: bool,
}

#[derive(Debug)]
struct Waiting {
    /// Whole frames: at most `control_bytes_max`.
    control: Vec<u8>,
    /// The most control messages that may wait, in bytes. A client for which more wait does not
    /// read, and is dropped.
    control_bytes_max: usize,
    frames: SentFrames,
    outbound: Outbound,
    budget: SendBudget,
    /// The engine's newest tick.
    tick: u32,
    /// The tick at which poses were last encoded.
    encoded_tick: u32,
    /// How the client is expected to report; `None` before it has entered.
    reporting: Option<ReportingState>,
    has_ended: bool,
    /// Whether more waited than may.
    overflowed: bool,
}

impl Outbox {
    /// The outbox of a client that has not entered, for its avatar, at a server with this time from
    /// tick to tick.
    pub fn new(avatar: AvatarId, tick_interval: Duration, control_bytes_max: usize) -> Self {
        let waiting = Waiting {
            control: Vec::new(),
            control_bytes_max,
            frames: SentFrames::default(),
            outbound: Outbound::new(avatar, tick_interval),
            budget: SendBudget::new(tick_interval),
            tick: 0,
            encoded_tick: 0,
            reporting: None,
            has_ended: false,
            overflowed: false,
        };
        Self { waiting: Mutex::new(waiting), filled: Notify::new(), ended: Notify::new() }
    }

    /// Adds a message.
    pub fn push(&self, message: &ServerMessage) {
        self.add(&mut self.waiting(), message);
        self.filled.notify_one();
    }

    fn add(&self, waiting: &mut Waiting, message: &ServerMessage) {
        waiting.push(message);
        if waiting.has_ended {
            self.ended.notify_one();
        }
    }

    /// Adds the offer of another world. Poses of the one before are dropped; messages that wait go
    /// before the offer.
    pub fn leave_world(&self, offer: &ServerMessage) {
        let mut waiting = self.waiting();
        waiting.outbound.leave_world();
        waiting.reporting = None;
        self.add(&mut waiting, offer);
        drop(waiting);
        self.filled.notify_one();
    }

    /// Adds an output of the engine. The client's task is not woken before [`Outbox::flush`].
    pub fn tell(&self, output: &Output, now: Duration) {
        let mut waiting = self.waiting();
        if let Some(message) = waiting.outbound.convert(output, now) {
            self.add(&mut waiting, &message);
        }
    }

    /// Adds a goodbye, and whether the client may come back by itself. Nothing can be added after
    /// it.
    pub fn end(&self, reason: &str, may_return: bool) {
        self.push(&ServerMessage::Goodbye { reason: ChatLine::clipped(reason), may_return });
    }

    /// Wakes the client's task, once every output of a tick is there, if it has something to send.
    /// It may be sent this number of bytes in a second.
    pub fn flush(&self, tick: u32, bytes_per_s: f64) {
        let mut waiting = self.waiting();
        waiting.tick = tick;
        waiting.budget.pass(tick, bytes_per_s);
        let has_poses = waiting.has_poses();
        let has_something = has_poses || waiting.has_ended || !waiting.control.is_empty();
        drop(waiting);
        if has_something {
            self.filled.notify_one();
        }
    }

    /// Takes in which datagrams the client has received.
    pub fn acknowledge(&self, ack: Ack) {
        self.waiting().outbound.acknowledge(ack);
    }

    /// How the client is expected to report; `None` before it has entered.
    pub fn reporting_state(&self) -> Option<ReportingState> {
        self.waiting().reporting
    }

    /// Waits until there may be something to send. Only one task may wait.
    pub async fn filled(&self) {
        self.filled.notified().await;
    }

    /// Waits until nothing can be added any more: after a goodbye, or because too much waits. Only
    /// one task may wait.
    pub async fn ended(&self) {
        self.ended.notified().await;
    }

    /// Takes what is to be sent now. Poses are among it once a tick, and only when the path has
    /// room for datagrams; `datagram_bytes_max` is then their greatest length.
    pub fn take(&self, datagram_bytes_max: Option<usize>) -> Batch {
        let mut waiting = self.waiting();
        let control = std::mem::take(&mut waiting.control);
        waiting.budget.spend(control.len());
        let (mut datagram, mut is_short) = (None, false);
        if let Some(bytes_max) = datagram_bytes_max
            && waiting.has_poses()
        {
            let room = waiting.budget.room();
            is_short = room < DATAGRAM_BYTES_MIN;
            if !is_short {
                datagram = waiting.encode(bytes_max.min(room));
            }
        }
        Batch {
            control,
            frames: std::mem::take(&mut waiting.frames),
            datagram,
            is_short,
            is_last: waiting.has_ended,
            overflowed: waiting.overflowed,
        }
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        // No panic while the lock is held leaves this half changed.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waiting {
    /// Whether there may be a datagram to send at this tick.
    fn has_poses(&mut self) -> bool {
        self.tick != self.encoded_tick && self.outbound.has_poses(self.tick)
    }

    /// The datagram of the tick, of at most this length.
    fn encode(&mut self, bytes_max: usize) -> Option<Vec<u8>> {
        self.encoded_tick = self.tick;
        self.outbound.set_datagram_bytes_max(bytes_max);
        let datagram = self.outbound.encode_poses(self.tick)?;
        self.budget.spend_datagram(datagram.len());
        Some(datagram)
    }

    fn push(&mut self, message: &ServerMessage) {
        if self.has_ended {
            return;
        }
        self.reporting = reporting_after(message).or(self.reporting);
        let frame = frame::encode(message);
        if self.control.len() + frame.len() > self.control_bytes_max {
            // The client does not read, so there is no point in telling it why it is dropped.
            self.control.clear();
            self.frames = SentFrames::default();
            (self.has_ended, self.overflowed) = (true, true);
            return;
        }
        self.control.extend_from_slice(&frame);
        self.frames.add(&frame);
        self.has_ended = matches!(message, ServerMessage::Goodbye { .. });
        assert!(self.control.len() <= self.control_bytes_max, "the outbox has a limit");
    }
}

/// How a client reports once it has received a message; `None` when that does not change.
fn reporting_after(message: &ServerMessage) -> Option<ReportingState> {
    match message {
        ServerMessage::Entered { .. } | ServerMessage::Live { .. } => Some(ReportingState::Live),
        ServerMessage::Quiet { .. } => Some(ReportingState::Quiet),
        ServerMessage::Ask => Some(ReportingState::Asked),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_protocol::{frame::FrameBuffer, pose_stream::PoseDecoder};
    use sightline_world::motion::{Pose, Tolerance};

    use super::*;

    const TICK: Duration = Duration::from_millis(50);
    const CONTROL_BYTES_MAX: usize = 256 * 1_024;
    const BYTES_PER_S: f64 = 64_000.0;
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
        Output::Poses { to: ME, from: Vec3::ZERO, tick: 0, poses: vec![(OTHER, pose)] }
    }

    fn appear() -> Output {
        let (name, pose) = ("Bo".to_owned(), Pose::default());
        Output::Appear { to: ME, avatar: OTHER, name, colour: [1, 2, 3], pose, tick: 0 }
    }

    #[test]
    fn a_newer_pose_replaces_one_that_waits() {
        let outbox = Outbox::new(ME, TICK, CONTROL_BYTES_MAX);
        for tick in 1..=100 {
            outbox.tell(&poses(tick as f32), Duration::ZERO);
            outbox.flush(tick, BYTES_PER_S);
            assert!(outbox.take(None).datagram.is_none(), "the path is full");
        }
        let batch = outbox.take(Some(1_200));
        let mut decoder = PoseDecoder::new(TICK);
        let update = decoder.decode(&batch.datagram.unwrap()).unwrap().unwrap();
        let pose = Pose::from(update.pose(OTHER).unwrap());
        assert_eq!((update.tick, pose.eye.x), (100, 100.0));
        assert!(outbox.take(Some(1_200)).datagram.is_none());
    }

    #[test]
    fn poses_wait_while_control_messages_take_all_that_a_client_may_be_sent() {
        let outbox = Outbox::new(ME, TICK, CONTROL_BYTES_MAX);
        let mut waited = 0;
        for tick in 1..=40 {
            let appears = if tick == 1 { 5_000 } else { 0 };
            (0..appears).for_each(|_| outbox.tell(&appear(), Duration::ZERO));
            outbox.tell(&poses(tick as f32), Duration::ZERO);
            outbox.flush(tick, BYTES_PER_S);
            let batch = outbox.take(Some(1_200));
            assert_eq!(batch.is_short, batch.datagram.is_none());
            waited += usize::from(batch.is_short);
        }
        assert!((5..=21).contains(&waited), "{waited} ticks");
    }

    #[test]
    fn no_pose_of_a_vanished_avatar_is_sent() {
        let outbox = Outbox::new(ME, TICK, CONTROL_BYTES_MAX);
        outbox.tell(&appear(), Duration::ZERO);
        outbox.tell(&poses(1.0), Duration::ZERO);
        outbox.tell(&Output::Vanish { to: ME, avatar: OTHER }, Duration::ZERO);
        for tick in 1..20 {
            outbox.flush(tick, BYTES_PER_S);
            assert!(outbox.take(Some(1_200)).datagram.is_none());
        }
    }

    #[test]
    fn an_appearance_counts_from_the_next_datagram() {
        let outbox = Outbox::new(ME, TICK, CONTROL_BYTES_MAX);
        outbox.tell(&poses(1.0), Duration::ZERO);
        outbox.flush(1, BYTES_PER_S);
        assert!(outbox.take(Some(1_200)).datagram.is_some());
        outbox.tell(&appear(), Duration::ZERO);
        let said = messages(&outbox.take(None));
        assert!(matches!(&said[..], [ServerMessage::Appear { since_sequence: 2, .. }]));
    }

    #[test]
    fn a_client_that_does_not_read_is_dropped_and_its_outbox_stays_bounded() {
        let outbox = Outbox::new(ME, TICK, CONTROL_BYTES_MAX);
        for _ in 0..100_000 {
            outbox.tell(&appear(), Duration::ZERO);
            assert!(outbox.waiting().control.len() <= CONTROL_BYTES_MAX);
        }
        let batch = outbox.take(None);
        assert!(batch.is_last && batch.control.is_empty() && batch.overflowed);
    }

    #[test]
    fn nothing_is_sent_after_a_goodbye() {
        let outbox = Outbox::new(ME, TICK, CONTROL_BYTES_MAX);
        outbox.tell(&Output::Drop { to: ME, reason: "enough\n".to_owned() }, Duration::ZERO);
        outbox.tell(&Output::Live { to: ME, tolerance: Tolerance::NONE }, Duration::ZERO);
        let batch = outbox.take(None);
        assert!(batch.is_last);
        let reason = ChatLine::new("enough").unwrap();
        assert_eq!(messages(&batch), [ServerMessage::Goodbye { reason, may_return: false }]);
    }
}
