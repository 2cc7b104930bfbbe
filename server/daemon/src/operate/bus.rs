//! What a station says and hears on its bus.

use std::{
    sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed},
    time::Duration,
};

use serde::{Deserialize, Serialize};
use sightline_engine::StationWord;

use super::traffic::{SharedTally, Tally};

/// How many kinds of messages stations have.
const KINDS: usize = StationWord::KINDS.len();

/// Why a parcel was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BusDrop {
    /// Too many waited.
    Full,
    /// The bus was lost.
    Lost,
    /// It was held up on its way.
    Late,
}

impl BusDrop {
    const NAMES: [&'static str; 3] = ["full", "lost", "late"];
}

/// Counters of a station's messages on the bus.
#[derive(Debug, Default)]
pub(crate) struct BusCounters {
    sent: [SharedTally; KINDS],
    received: [SharedTally; KINDS],
    dropped: [AtomicU64; BusDrop::NAMES.len()],
    is_lost: AtomicBool,
    stations: AtomicUsize,
    cut: AtomicUsize,
    guests: AtomicUsize,
    guests_live: AtomicUsize,
    sectors: AtomicUsize,
    subscribed: AtomicUsize,
    delay_us: AtomicU64,
    is_sharing: AtomicBool,
    rulings: AtomicUsize,
    rulings_in: AtomicU64,
    rulings_out: AtomicU64,
    rulings_again: AtomicU64,
    rulings_broken: AtomicU64,
    names_claimed: AtomicU64,
    names_taken: AtomicU64,
}

/// What happened to a ruling on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BusRuling {
    /// Another station's counts here, too.
    In,
    /// This station's counts at others, too.
    Out,
    /// Another station ruled at the same time, so it was merged and written again.
    Again,
    /// It was none, and is ignored.
    Broken,
}

/// What a station knows of others at a tick.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BusGauges {
    pub(crate) stations: usize,
    pub(crate) cut: usize,
    pub(crate) guests: usize,
    pub(crate) guests_live: usize,
    pub(crate) sectors: usize,
    pub(crate) subscribed: usize,
    pub(crate) delay: Duration,
}

/// A station on its bus at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BusStats {
    /// Whether the bus is there.
    pub is_connected: bool,
    /// How many other stations take in what this one says.
    pub stations: usize,
    /// How many were cut off, because they lied or flooded.
    pub cut: usize,
    /// How many avatars of other stations this one knows of.
    pub guests: usize,
    /// How many of them it follows.
    pub guests_live: usize,
    /// How many sectors the building has.
    pub sectors: usize,
    /// To how many of them the station subscribes.
    pub subscribed: usize,
    /// How long a message to or from the farthest station takes at most, in milliseconds.
    pub delay_ms: f64,
    /// Messages sent since the start.
    pub messages_out: u64,
    /// Their bytes, without what NATS adds.
    pub bytes_out: u64,
    /// Messages received since the start.
    pub messages_in: u64,
    /// Their bytes, without what NATS adds.
    pub bytes_in: u64,
    /// Parcels dropped since the start.
    pub dropped: u64,
    /// Whether bans, mutes and roles are shared with other stations at present.
    #[serde(default)]
    pub is_sharing: bool,
    /// About how many something was ruled, as far as the stations share it.
    #[serde(default)]
    pub rulings: usize,
}

impl BusCounters {
    /// Counts a message that is sent.
    pub(crate) fn sent(&self, kind: usize, bytes: usize) {
        add(&self.sent, kind, bytes);
    }

    /// Counts a message that came in.
    pub(crate) fn received(&self, kind: usize, bytes: usize) {
        add(&self.received, kind, bytes);
    }

    /// Counts a parcel that was dropped.
    pub(crate) fn drop_parcel(&self, why: BusDrop) {
        self.dropped[why as usize].fetch_add(1, Relaxed);
    }

    /// Takes in whether the bus is lost. Returns whether it was.
    pub(crate) fn set_lost(&self, is_lost: bool) -> bool {
        self.is_lost.swap(is_lost, Relaxed)
    }

    /// Takes in what is known of others.
    pub(crate) fn set(&self, now: &BusGauges) {
        self.stations.store(now.stations, Relaxed);
        self.cut.store(now.cut, Relaxed);
        self.guests.store(now.guests, Relaxed);
        self.guests_live.store(now.guests_live, Relaxed);
        self.sectors.store(now.sectors, Relaxed);
        self.subscribed.store(now.subscribed, Relaxed);
        self.delay_us.store(u64::try_from(now.delay.as_micros()).unwrap_or(u64::MAX), Relaxed);
    }

    /// Takes in whether rulings are shared, and how many there are.
    pub(crate) fn set_sharing(&self, is_sharing: bool, rulings: usize) {
        self.is_sharing.store(is_sharing, Relaxed);
        self.rulings.store(rulings, Relaxed);
    }

    /// Counts a ruling on the bus.
    pub(crate) fn count_ruling(&self, what: BusRuling) {
        self.ruling_counter(what).fetch_add(1, Relaxed);
    }

    /// Counts a name that was claimed at all stations: whether another station's visitor has it.
    pub(crate) fn count_name(&self, is_taken: bool) {
        let counter = if is_taken { &self.names_taken } else { &self.names_claimed };
        counter.fetch_add(1, Relaxed);
    }

    /// How many names were claimed at all stations, by what came of it.
    pub(crate) fn names_by_result(&self) -> [(&'static str, u64); 2] {
        [("claimed", &self.names_claimed), ("taken", &self.names_taken)]
            .map(|(name, counter)| (name, counter.load(Relaxed)))
    }

    /// How many rulings there were on the bus, by what happened to them.
    pub(crate) fn rulings_by_result(&self) -> [(&'static str, u64); 4] {
        let named = [
            ("in", BusRuling::In),
            ("out", BusRuling::Out),
            ("again", BusRuling::Again),
            ("broken", BusRuling::Broken),
        ];
        named.map(|(name, what)| (name, self.ruling_counter(what).load(Relaxed)))
    }

    fn ruling_counter(&self, what: BusRuling) -> &AtomicU64 {
        match what {
            BusRuling::In => &self.rulings_in,
            BusRuling::Out => &self.rulings_out,
            BusRuling::Again => &self.rulings_again,
            BusRuling::Broken => &self.rulings_broken,
        }
    }

    /// What was sent, by kind.
    pub(crate) fn sent_by_kind(&self) -> impl Iterator<Item = (&'static str, Tally)> + '_ {
        StationWord::KINDS.into_iter().zip(self.sent.iter().map(SharedTally::tally))
    }

    /// What came in, by kind.
    pub(crate) fn received_by_kind(&self) -> impl Iterator<Item = (&'static str, Tally)> + '_ {
        StationWord::KINDS.into_iter().zip(self.received.iter().map(SharedTally::tally))
    }

    /// What was dropped, by reason.
    pub(crate) fn dropped_by_reason(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        BusDrop::NAMES.into_iter().zip(self.dropped.iter().map(|count| count.load(Relaxed)))
    }

    /// The station at present.
    pub(crate) fn stats(&self) -> BusStats {
        let sum = |tallies: &[SharedTally]| {
            tallies.iter().map(SharedTally::tally).fold([0; 2], |[messages, bytes], tally| {
                [messages + tally.messages, bytes + tally.bytes]
            })
        };
        let [messages_out, bytes_out] = sum(&self.sent);
        let [messages_in, bytes_in] = sum(&self.received);
        let is_connected = !self.is_lost.load(Relaxed);
        BusStats {
            is_connected,
            stations: self.stations.load(Relaxed),
            cut: self.cut.load(Relaxed),
            guests: self.guests.load(Relaxed),
            guests_live: self.guests_live.load(Relaxed),
            sectors: self.sectors.load(Relaxed),
            subscribed: self.subscribed.load(Relaxed),
            delay_ms: self.delay_us.load(Relaxed) as f64 / 1e3,
            messages_out,
            bytes_out,
            messages_in,
            bytes_in,
            dropped: self.dropped_by_reason().map(|(_, count)| count).sum(),
            is_sharing: is_connected && self.is_sharing.load(Relaxed),
            rulings: self.rulings.load(Relaxed),
        }
    }
}

fn add(tallies: &[SharedTally], kind: usize, bytes: usize) {
    if let Some(tally) = tallies.get(kind) {
        tally.add(Tally { messages: 1, bytes: bytes as u64 });
    }
}
