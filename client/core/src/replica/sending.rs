//! What a client sends: reports and acknowledgements.
//!
//! A report that is made at every tick goes in a datagram, because the next one replaces a lost
//! one. All other reports go on the stream: a departure that is lost must not pass for silence. But
//! the stream repeats a lost report only a round trip later, and holds up all that follow. So of
//! reports that follow each other closely the third and later ones go in datagrams, and the last of
//! them on the stream as well. While the path loses messages all reports do, and sooner. The server
//! ignores what it knows already.

use std::time::Duration;

use sightline_protocol::{
    message::ClientMessage,
    pose_stream::{Ack, ClientDatagram},
    quantise::WireReport,
};
use sightline_world::motion::{Pose, Report};

use super::Replica;
use crate::reporting::ReportReason;

/// An acknowledgement waits for a report to go with for no more than this number of ticks, unless a
/// datagram is missing.
pub(super) const ACK_TICKS: u32 = 6;
/// While datagrams are lost on the way to this client, it waits for this number of ticks, so that
/// the server learns sooner what was lost.
pub(super) const ACK_TICKS_LOSSY: u32 = 2;
/// How long after a loss the path counts as one that loses messages.
const LOSSY_FOR: Duration = Duration::from_secs(10);
/// It takes this number of losses within that time: a single one may be an accident.
const LOSSES_MIN: u64 = 2;
/// Reports follow each other closely when there are three within this number of ticks.
const CLOSE_TICKS: u32 = 2;
/// A report that went in a datagram goes on the stream after this number of ticks without another
/// one; where the path loses messages, after one.
const RESEND_AFTER_TICKS: u32 = 2;

/// What to send to the server.
#[derive(Clone, Debug, PartialEq)]
pub enum Outgoing {
    /// Bytes to send as a datagram.
    Datagram(Vec<u8>),
    /// A message to send on the stream.
    Message(ClientMessage),
}

/// The own avatar.
#[derive(Clone, Debug, Default)]
pub(super) struct OwnAvatar {
    pub(super) pose: Pose,
    /// In how many ticks what has arrived must be acknowledged; `None` when all of it is.
    ack_due: Option<u32>,
    /// When the last report was sent, and the one before.
    sent_at: [Option<Duration>; 2],
    /// The last report, if it must go once more.
    resend: Option<Resend>,
    /// The losses of what this client sends.
    losses: Losses,
    /// The number of the newest datagram that has arrived, and how many were missing when it did.
    newest: u32,
    missing: u64,
    /// The losses of what is sent to this client.
    losses_in: Losses,
}

/// A report that goes once more, the other way.
#[derive(Clone, Copy, Debug)]
struct Resend {
    report: WireReport,
    is_on_stream: bool,
    /// In how many ticks it goes, unless another report goes before.
    ticks: u32,
}

/// Losses on the path, in one direction.
#[derive(Clone, Copy, Debug, Default)]
struct Losses {
    /// How many are known.
    known: u64,
    /// How many have followed each other closely, and when the last one became known.
    recent: u64,
    last: Duration,
}

impl OwnAvatar {
    /// The last report must not go once more.
    pub(super) fn forget_resend(&mut self) {
        self.resend = None;
    }

    fn note_sent(&mut self, now: Duration) {
        self.sent_at = [Some(now), self.sent_at[0]];
    }

    /// Takes in that a datagram has arrived. A gap is told at once, so that the server
    /// sends lost poses again.
    pub(super) fn owe_ack(&mut self, now: Duration, ack: Ack) {
        self.missing += u64::from(ack.newest.saturating_sub(self.newest + 1));
        self.newest = ack.newest.max(self.newest);
        self.losses_in.hear(now, self.missing);
        let wait = match self.losses_in.are_many() {
            _ if ack.has_gap() => 0,
            true => ACK_TICKS_LOSSY,
            false => ACK_TICKS,
        };
        self.ack_due = Some(self.ack_due.map_or(wait, |due| due.min(wait)));
    }
}

impl Losses {
    fn hear(&mut self, now: Duration, known: u64) {
        let more = known.saturating_sub(self.known);
        self.known = known;
        if now.saturating_sub(self.last) > LOSSY_FOR {
            self.recent = 0;
        }
        if more > 0 {
            self.recent += more;
            self.last = now;
        }
    }

    fn are_many(&self) -> bool {
        self.recent >= LOSSES_MIN
    }
}

impl Replica {
    /// Takes in how many of the packets that this client has sent were lost, as far as is known.
    /// To be called before each tick.
    pub fn hear_losses(&mut self, now: Duration, packets: u64) {
        self.own.losses.hear(now, packets);
    }

    /// The report that the server asked for, if it did. It must be sent at once.
    pub fn answer(&mut self, now: Duration) -> Option<ClientMessage> {
        let report = self.reporter.answer(now, &self.own.pose)?;
        let report = WireReport::new(&report, self.tick_interval);
        let resend = Resend { report, is_on_stream: false, ticks: 1 };
        self.own.resend = self.own.losses.are_many().then_some(resend);
        self.own.note_sent(now);
        Some(self.message_with(report))
    }

    /// The host has put the own avatar elsewhere: its course begins anew.
    pub fn forget_course(&mut self) {
        self.own.forget_resend();
        self.reporter.forget_course();
    }

    /// What to send at a tick, for a measured round trip: a report where [`Reporter::tick`] has a
    /// reason for one, or the last one once more, or else an acknowledgement that is owed.
    ///
    /// [`Reporter::tick`]: crate::reporting::Reporter::tick
    pub fn tick(&mut self, now: Duration, round_trip: Duration) -> Option<Outgoing> {
        if !self.reporter.is_inside() {
            return None;
        }
        let ack_is_due = self.own.ack_due == Some(0);
        self.own.ack_due = self.own.ack_due.map(|due| due.saturating_sub(1));
        let report = self.reporter.tick(now, &self.own.pose, round_trip);
        if let Some((reason, report)) = report {
            return Some(self.send(now, reason, &report));
        }
        if let Some(resend) = &mut self.own.resend {
            resend.ticks = resend.ticks.saturating_sub(1);
        }
        match self.own.resend.take_if(|resend| resend.ticks == 0) {
            Some(Resend { report, is_on_stream: true, .. }) => {
                Some(Outgoing::Message(self.message_with(report)))
            }
            Some(Resend { report, .. }) => Some(self.datagram_with(Some(report))),
            None => ack_is_due.then(|| self.datagram_with(None)),
        }
    }

    /// A datagram that only acknowledges what has come, for a client that wants to know whether the
    /// server is still there.
    pub fn probe(&self) -> Vec<u8> {
        ClientDatagram { ack: self.decoder.ack(), report: None }.encode()
    }

    fn send(&mut self, now: Duration, reason: ReportReason, report: &Report) -> Outgoing {
        let report = WireReport::new(report, self.tick_interval);
        let closely = self.tick_interval * CLOSE_TICKS;
        let is_close = self.own.sent_at[1].is_some_and(|before| now <= before + closely);
        self.own.note_sent(now);
        self.own.resend = None;
        if reason == ReportReason::EveryTick {
            return self.datagram_with(Some(report));
        }
        let is_lossy = self.own.losses.are_many();
        if is_lossy || is_close {
            let ticks = if is_lossy { 1 } else { RESEND_AFTER_TICKS };
            self.own.resend = Some(Resend { report, is_on_stream: true, ticks });
            return self.datagram_with(Some(report));
        }
        Outgoing::Message(self.message_with(report))
    }

    /// A report for the stream, with an acknowledgement.
    fn message_with(&mut self, report: WireReport) -> ClientMessage {
        self.own.ack_due = None;
        ClientMessage::Report { report, ack: self.decoder.ack() }
    }

    /// A datagram with an acknowledgement, and a report if there is one.
    fn datagram_with(&mut self, report: Option<WireReport>) -> Outgoing {
        self.own.ack_due = None;
        Outgoing::Datagram(ClientDatagram { ack: self.decoder.ack(), report }.encode())
    }
}
