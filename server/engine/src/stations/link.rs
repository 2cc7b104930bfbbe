//! Links: what a station knows of a neighbour, and how long messages between the two take.

use std::{
    collections::{BTreeSet, VecDeque},
    time::Duration,
};

use sightline_world::motion::AvatarId;

use crate::{
    bit_set::BitSet,
    bus::{HeardOf, Heartbeat, StationId, StationMessage, StationWord},
    config::Margin,
    timing::{Arrivals, LastKnown},
};

/// How many measured round trips are kept. The least of them counts.
const TRIPS_MAX: usize = 16;
/// The longest way to a neighbour that is allowed for.
const ONE_WAY_MAX: Duration = Duration::from_secs(1);
/// A neighbour may say this many things in a second, and as many more for each of its avatars and
/// for each of this station's that it asks about.
const WORDS_MAX: usize = 1_000;
const WORDS_EACH: usize = 100;
const WORDS_WINDOW: Duration = Duration::from_secs(1);
/// Stations may speak at any time, so their silence speaks for any moment.
const INSTANT: Duration = Duration::from_micros(1);

/// What a message from a neighbour means for the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Receipt {
    /// It is none of this link.
    Stale,
    /// It counts.
    Good,
    /// The neighbour begins anew: all that was known of it is void.
    Void,
    /// Messages were lost, so both must begin anew.
    Lost,
    /// There are too many.
    Flood,
}

/// One end of the link between two stations.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    pub(super) epoch: u32,
    their_epoch: Option<u32>,
    /// Whether the neighbour knows this end's epoch, so that it takes in what is sent.
    pub(super) is_ready: bool,
    /// Whether the whole subscription must be sent.
    pub(super) owes_whole: bool,
    sent: u32,
    received: u32,
    /// When it was last heard.
    pub(super) heard: Duration,
    arrivals: Arrivals,
    trips: VecDeque<Duration>,
    /// When its last heartbeat was sent, on its clock, and when it came in.
    beat: (Duration, Duration),
    pub(super) slowest: Duration,
    pub(super) silent: Duration,
    /// The sectors that the neighbour subscribes to.
    pub(crate) wants: BitSet,
    /// Whether they have changed since they were last looked at, and with which number.
    pub(crate) asked: Option<u32>,
    /// Up to which number the neighbour has answered the subscription of this station.
    pub(crate) synced: u32,
    /// The neighbour's avatars that are known.
    pub(crate) guests: BTreeSet<AvatarId>,
    window: (Duration, usize),
}

impl Link {
    pub(super) fn new(epoch: u32, now: Duration, margin: Margin) -> Self {
        Self {
            epoch,
            their_epoch: None,
            is_ready: false,
            owes_whole: false,
            sent: 0,
            received: 0,
            heard: now,
            arrivals: Arrivals::new(margin),
            trips: VecDeque::new(),
            beat: (Duration::ZERO, now),
            slowest: Duration::ZERO,
            silent: Duration::ZERO,
            wants: BitSet::default(),
            asked: None,
            synced: 0,
            guests: BTreeSet::new(),
            window: (now, 0),
        }
    }

    /// Takes in that a message has come.
    pub(super) fn receive(
        &mut self,
        now: Duration,
        own: StationId,
        margin: Margin,
        message: &StationMessage,
    ) -> Receipt {
        if self.is_flood(now) {
            return Receipt::Flood;
        }
        if let StationWord::Heartbeat(heartbeat) = &message.word {
            return self.beat(now, own, margin, message, heartbeat);
        }
        if self.their_epoch != Some(message.epoch) || message.known != self.epoch {
            return Receipt::Stale;
        }
        if message.number != self.received {
            return Receipt::Lost;
        }
        self.received += 1;
        self.hear(now, message.sent);
        Receipt::Good
    }

    fn beat(
        &mut self,
        now: Duration,
        own: StationId,
        margin: Margin,
        message: &StationMessage,
        heartbeat: &Heartbeat,
    ) -> Receipt {
        let mut receipt = Receipt::Good;
        if self.their_epoch != Some(message.epoch) {
            if self.their_epoch.is_some() {
                receipt = Receipt::Void;
            }
            *self = Self::new(self.epoch, now, margin);
            self.their_epoch = Some(message.epoch);
        }
        (self.slowest, self.silent) = (heartbeat.slowest, heartbeat.silent);
        let of_own = |heard: &&HeardOf| heard.station == own && heard.epoch == self.epoch;
        if let Some(heard) = heartbeat.heard.iter().find(of_own) {
            if heard.messages > self.received {
                return Receipt::Lost;
            }
            self.owes_whole |= !self.is_ready;
            self.is_ready = true;
            let trip = now.saturating_sub(heard.sent).saturating_sub(heard.held);
            self.trips.push_back(trip.min(2 * ONE_WAY_MAX));
            if self.trips.len() > TRIPS_MAX {
                self.trips.pop_front();
            }
        }
        self.beat = (message.sent, now);
        self.hear(now, message.sent);
        receipt
    }

    fn hear(&mut self, now: Duration, sent: Duration) {
        self.heard = now;
        self.arrivals.hear(now, sent, INSTANT, self.one_way());
    }

    fn is_flood(&mut self, now: Duration) -> bool {
        if now >= self.window.0 + WORDS_WINDOW {
            self.window = (now, 0);
        }
        self.window.1 += 1;
        self.window.1 > WORDS_MAX + WORDS_EACH * self.guests.len()
    }

    /// The head of the next message.
    pub(super) fn next(&mut self, now: Duration, word: StationWord) -> Option<StationMessage> {
        let known = self.their_epoch.filter(|_| self.is_ready)?;
        let number = self.sent;
        self.sent += 1;
        Some(StationMessage { epoch: self.epoch, known, number, sent: now, word })
    }

    /// What this end has heard of the neighbour.
    pub(super) fn heard_of(&self, now: Duration, station: StationId) -> Option<HeardOf> {
        let epoch = self.their_epoch?;
        let held = now.saturating_sub(self.beat.1);
        Some(HeardOf { station, epoch, sent: self.beat.0, held, messages: self.sent })
    }

    fn one_way(&self) -> Duration {
        self.trips.iter().min().copied().unwrap_or_default() / 2
    }

    /// How long a message to or from the neighbour takes at most.
    pub(crate) fn delay(&self) -> Duration {
        self.one_way() + self.arrivals.margin()
    }

    /// The moment, on the neighbour's clock, up to which all that it said has been heard, and how
    /// long ago that is at most.
    pub(crate) fn known_until(&self, now: Duration) -> (Duration, Duration) {
        let LastKnown { after, age } = self.arrivals.last_known(now, Duration::ZERO, INSTANT);
        (after, age)
    }
}
