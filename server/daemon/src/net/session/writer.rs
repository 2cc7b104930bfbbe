//! The task that empties a client's outbox into its connection.

use std::time::Duration;

use sightline_protocol::{
    frame,
    message::{Refusal, ServerMessage},
};
use tokio::time::{Instant, timeout, timeout_at};

use super::{
    super::{client::ConnectedClient, outbox::Batch, transport::ControlWriter},
    SessionEnd,
};
use crate::operate::{Reason, SentFrames, TrafficCounters};

/// When the session ends, for example because too much waits, it may take no longer than this.
const LAST_WRITE_DEADLINE: Duration = Duration::from_secs(2);

/// Empties an outbox. May be cancelled at any point: the next call goes on from there.
pub(super) struct OutboxWriter {
    stream: ControlWriter,
    /// Frames that were taken from the outbox.
    unsent: Vec<u8>,
    /// How much of them is written.
    written: usize,
    /// A client whose stream takes longer for what was to be sent at one time is dropped, however
    /// many bytes it takes meanwhile.
    patience: Duration,
}

impl OutboxWriter {
    pub(super) fn new(stream: ControlWriter, write_s: f64) -> Self {
        let patience = Duration::from_secs_f64(write_s);
        Self { stream, unsent: Vec::new(), written: 0, patience }
    }

    /// Sends all that comes into the outbox, until the session has to end.
    pub(super) async fn run(&mut self, client: &ConnectedClient) -> SessionEnd {
        loop {
            // While the path is busy, poses wait in the outbox, where newer ones replace them.
            let batch = client.outbox.take(client.transport.datagram_room());
            let (is_last, overflowed) = (batch.is_last, batch.overflowed);
            if batch.is_short {
                client.count_refusal(Reason::SendBudget);
            }
            if let Err(end) = self.send(client, batch).await {
                return end;
            }
            if is_last {
                if overflowed {
                    client.count_refusal(Reason::Outbox);
                }
                return SessionEnd::Dismissed;
            }
            client.outbox.filled().await;
        }
    }

    async fn send(&mut self, client: &ConnectedClient, batch: Batch) -> Result<(), SessionEnd> {
        client.count_frames_out(&batch.frames);
        self.unsent.extend_from_slice(&batch.control);
        if let Some(datagram) = batch.datagram {
            client.count_datagram_out(datagram.len());
            client.transport.send_datagram(datagram)?;
        }
        tokio::select! {
            biased;
            drained = self.drain() => return drained,
            () = client.outbox.ended() => {}
        }
        let drained = timeout(LAST_WRITE_DEADLINE, self.drain()).await;
        drained.unwrap_or(Err(SessionEnd::Limit(Reason::Reading, "it does not read")))
    }

    /// Writes all frames that were taken from the outbox.
    async fn drain(&mut self) -> Result<(), SessionEnd> {
        assert!(self.written <= self.unsent.len(), "only what is there is written");
        let deadline = Instant::now() + self.patience;
        while let Some(rest) = self.unsent.get(self.written..).filter(|rest| !rest.is_empty()) {
            let written = timeout_at(deadline, self.stream.write(rest)).await;
            match written {
                Ok(bytes) => self.written += bytes?,
                Err(_) => return Err(SessionEnd::Limit(Reason::Reading, "it does not read")),
            }
        }
        self.unsent.clear();
        self.written = 0;
        Ok(())
    }

    /// Sends what is left in the outbox, and waits until it has arrived.
    pub(super) async fn finish(&mut self, client: &ConnectedClient) {
        let batch = client.outbox.take(None);
        client.count_frames_out(&batch.frames);
        self.unsent.extend_from_slice(&batch.control);
        self.finish_stream().await;
    }

    async fn finish_stream(&mut self) {
        if self.drain().await.is_ok() {
            self.stream.finish().await;
        }
    }

    /// Tells a client why it is not let in, and waits until that has arrived.
    pub(super) async fn refuse(&mut self, reason: Refusal, counters: &TrafficCounters) {
        self.unsent = frame::encode(&ServerMessage::Refused { reason });
        let mut sent = SentFrames::default();
        sent.add(&self.unsent);
        counters.frames_out(&sent);
        self.finish_stream().await;
    }
}
