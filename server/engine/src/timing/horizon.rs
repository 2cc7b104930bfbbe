//! How far ahead visibility is decided. The argument is in `horizon.md`, which is a part of the
//! crate's front page.

use std::{collections::BTreeMap, sync::OnceLock, time::Duration};

use crate::config::{Config, Validity};

/// Delays to viewers are rounded up to a multiple of this, so that viewers share regions.
const DELAY_STEP: Duration = Duration::from_millis(25);
/// The time that messages to other stations take is rounded up to a multiple of this, so that it
/// changes seldom.
const BUS_STEP: Duration = Duration::from_millis(5);
/// The longest TBV that a client may need to be asked in time. A client that needs a longer one is
/// not silenced, because one slow silent client widens the footprints of all live avatars.
pub(crate) const SILENT_MAX: Duration = Duration::from_secs(1);

/// How long a client's messages take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Link {
    pub(crate) round_trip: Duration,
    /// By how much one message may take longer than half of the round trip.
    pub(crate) margin: Duration,
}

/// How far away other stations are, and how slow their clients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Abroad {
    /// How long a message to or from a station takes at most.
    pub(crate) bus: Duration,
    /// The longest round trip of their clients.
    pub(crate) slowest: Duration,
    /// The longest round trip of those that may be silent.
    pub(crate) silent: Duration,
}

/// The times that regions must hold for, given the round trips of all clients that are present.
#[derive(Clone, Debug)]
pub(crate) struct Horizons {
    tick: Duration,
    /// The margin of a client of which nothing is known yet.
    margin: Duration,
    cap: Duration,
    /// A client that needs a longer TBV than this is not silenced.
    silent_max: Duration,
    /// How many clients have each round trip.
    round_trips: BTreeMap<Duration, usize>,
    /// How many clients have each delay.
    delays: BTreeMap<Duration, usize>,
    /// The longest round trip of clients that may be silent, once it was asked for.
    round_trip_silent_max: OnceLock<Duration>,
    /// The longest round trip of clients that are silent, at least where they may not be any more.
    round_trip_silent: Duration,
    /// The other stations, if there are any.
    abroad: Option<Abroad>,
    /// Whether clients say that they leave their TBVs.
    is_until_left: bool,
}

impl Horizons {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            tick: config.tick,
            margin: config.margin.first(),
            cap: config.horizon_max,
            silent_max: config.validity.max(config.validity_max).min(SILENT_MAX),
            round_trips: BTreeMap::new(),
            delays: BTreeMap::new(),
            round_trip_silent_max: OnceLock::new(),
            round_trip_silent: Duration::ZERO,
            abroad: None,
            is_until_left: config.validity == Validity::UntilLeft,
        }
    }

    /// Takes in how far away other stations are, if there are any.
    pub(crate) fn set_abroad(&mut self, abroad: Option<Abroad>) {
        let abroad = abroad.map(|abroad| {
            let steps = abroad.bus.as_nanos().div_ceil(BUS_STEP.as_nanos());
            let bus = BUS_STEP * u32::try_from(steps).unwrap_or(u32::MAX);
            Abroad { bus: bus.min(self.cap), ..abroad }
        });
        if abroad != self.abroad {
            self.round_trip_silent_max = OnceLock::new();
            self.abroad = abroad;
        }
    }

    /// How much longer than its reveal horizon an avatar's footprint must hold, so that word of who
    /// may see it, or be seen, comes from other stations in time: a subscription and its answer,
    /// and a tick of both stations.
    pub(crate) fn subscription_time(&self) -> Duration {
        self.abroad.map_or(Duration::ZERO, |abroad| 2 * (abroad.bus + self.tick))
    }

    /// The longest round trip of this station's own clients, and of those that may be silent.
    pub(crate) fn own_round_trips(&self) -> [Duration; 2] {
        [self.own_round_trip_max(), self.own_silent_max()]
    }

    /// The round trip of an avatar of another station, whose client's own is given. An order may
    /// wait there for a tick.
    pub(crate) fn guest_round_trip(&self, round_trip: Duration, bus: Duration) -> Duration {
        round_trip + 2 * bus + self.tick
    }

    /// Adds the round trip of one more client.
    pub(crate) fn add(&mut self, round_trip: Duration) {
        self.round_trip_silent_max = OnceLock::new();
        *self.round_trips.entry(round_trip).or_insert(0) += 1;
        *self.delays.entry(self.delay(round_trip)).or_insert(0) += 1;
    }

    /// Removes a round trip that was added.
    pub(crate) fn remove(&mut self, round_trip: Duration) {
        self.round_trip_silent_max = OnceLock::new();
        let delay = self.delay(round_trip);
        for (counts, key) in [(&mut self.round_trips, round_trip), (&mut self.delays, delay)] {
            debug_assert!(counts.contains_key(&key), "only what was added is removed");
            if let Some(count) = counts.get_mut(&key) {
                *count -= 1;
                if *count == 0 {
                    counts.remove(&key);
                }
            }
        }
    }

    /// Each [delay](Horizons::delay) that some client has, ascending.
    pub(crate) fn delays(&self) -> impl Iterator<Item = Duration> + '_ {
        self.delays.keys().copied()
    }

    /// How long a message to or from a client takes.
    pub(crate) fn one_way(&self, round_trip: Duration) -> Duration {
        round_trip.min(self.cap) / 2
    }

    /// How long a message to the slowest client takes.
    fn one_way_max(&self) -> Duration {
        self.one_way(self.round_trip_max())
    }

    fn round_trip_max(&self) -> Duration {
        let abroad = self.abroad.map_or(Duration::ZERO, |abroad| abroad.slowest);
        self.own_round_trip_max().max(abroad)
    }

    fn own_round_trip_max(&self) -> Duration {
        self.round_trips.last_key_value().map_or(Duration::ZERO, |(trip, _)| *trip)
    }

    /// How long a message to or from another station takes at most.
    fn bus(&self) -> Duration {
        self.abroad.map_or(Duration::ZERO, |abroad| abroad.bus)
    }

    /// How long a message to a client takes, rounded up to a step that many viewers share.
    pub(crate) fn delay(&self, round_trip: Duration) -> Duration {
        let steps = self.one_way(round_trip).as_nanos().div_ceil(DELAY_STEP.as_nanos());
        DELAY_STEP * u32::try_from(steps).unwrap_or(u32::MAX)
    }

    /// How long a live avatar's region must hold after the avatar was last known to be somewhere:
    /// until the next tick takes effect at a viewer with this delay.
    pub(crate) fn live_horizon(&self, age: Duration, delay: Duration) -> Duration {
        age.min(self.cap) + self.tick + delay
    }

    /// How long a live avatar's footprint must hold after the avatar was last known to be
    /// somewhere: until a hidden avatar that it reveals can be told of, or be told.
    pub(crate) fn reveal_horizon(&self, age: Duration) -> Duration {
        let answer = age.min(self.cap) + 2 * self.tick + self.round_trip_silent_max();
        answer + self.one_way_max()
    }

    /// For how long regions of a client on course must hold usually. Between two of the client's
    /// ticks its word is up to a tick older.
    pub(crate) fn course_horizon(&self, link: Link) -> Duration {
        let age = self.one_way(link.round_trip) + link.margin + self.tick;
        age + self.tick + self.delay(self.round_trip_max()) + self.bus()
    }

    /// How long before its expiry a hidden client must be asked.
    pub(crate) fn lead_time(&self, link: Link) -> Duration {
        // A TBV that nobody says to be left ends for another station when that has been told.
        let is_unsaid = self.abroad.is_some() && !self.is_until_left;
        let abroad = if is_unsaid { self.notice(link) } else { self.bus() };
        self.answer_time(link) + abroad
    }

    /// The time from an ask until what follows from its answer stands at all viewers of this
    /// station.
    fn answer_time(&self, link: Link) -> Duration {
        let told = 2 * link.round_trip.min(self.cap) + self.one_way_max() + 2 * self.tick;
        told + link.margin
    }

    /// How far ahead a client must foresee that it leaves its TBV: from its last tick at which that
    /// was not so until its word is known to all whom it may concern.
    pub(crate) fn notice(&self, link: Link) -> Duration {
        let heard = self.one_way(link.round_trip) + link.margin + 2 * self.tick + self.bus();
        heard + self.round_trip_silent_max() + self.tick + self.one_way_max()
    }

    /// Whether a client answers fast enough to be silent for two ticks at least.
    pub(crate) fn may_be_silent(&self, link: Link) -> bool {
        // The slowest silent client is found with this margin at least.
        let link = Link { margin: link.margin.max(self.margin), ..link };
        let made = self.one_way(link.round_trip) + link.margin;
        let needed = made + self.answer_time(link) + 2 * self.tick;
        link.round_trip <= self.cap && needed <= self.silent_max
    }

    /// Takes in the round trips of all clients that are silent now.
    ///
    /// A client may have been silenced before it, or the slowest viewer, became slower. It would
    /// not be silenced now, but has still to be asked in time.
    pub(crate) fn count_silent(&mut self, silent: impl Iterator<Item = Duration>) {
        self.round_trip_silent = Duration::ZERO;
        let allowed = self.own_silent_max();
        if self.round_trip_max() > allowed {
            self.round_trip_silent = silent.max().unwrap_or_default().min(self.cap);
        }
    }

    fn round_trip_silent_max(&self) -> Duration {
        let guests = |Abroad { bus, silent, .. }| self.guest_round_trip(silent, bus);
        self.own_silent_max().max(self.abroad.map_or(Duration::ZERO, guests))
    }

    fn own_silent_max(&self) -> Duration {
        // All live avatars ask for this at each tick, and many clients may be too slow.
        let allowed = *self.round_trip_silent_max.get_or_init(|| {
            let mut trips = self.round_trips.keys().rev();
            let link = |trip: &Duration| Link { round_trip: *trip, margin: self.margin };
            trips.find(|trip| self.may_be_silent(link(trip))).copied().unwrap_or(Duration::ZERO)
        });
        allowed.max(self.round_trip_silent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Margin;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn link(round_trip: u64) -> Link {
        Link { round_trip: ms(round_trip), margin: ms(10) }
    }

    fn horizons(round_trips: &[u64]) -> Horizons {
        let config = Config { margin: Margin::Fixed(ms(10)), ..Config::default() };
        let mut horizons = Horizons::new(&config);
        round_trips.iter().for_each(|trip| horizons.add(ms(*trip)));
        horizons
    }

    #[test]
    fn each_part_of_a_delay_counts_once() {
        let two = horizons(&[100, 60]);
        assert_eq!(two.live_horizon(ms(60), ms(50)), ms(60 + 50 + 50));
        assert_eq!(two.reveal_horizon(ms(60)), ms(60 + 100 + 100 + 50));
        assert_eq!(two.course_horizon(link(60)), ms(30 + 10 + 50 + 50 + 50));
        assert_eq!(two.delays().collect::<Vec<_>>(), [ms(50)]);
        assert_eq!(two.lead_time(link(60)), ms(120 + 50 + 100 + 10));
    }

    #[test]
    fn one_slow_client_is_not_silenced_and_widens_only_regions_for_itself() {
        let mut all = horizons(&[100, 100, 390]);
        assert!(!all.may_be_silent(link(390)));
        assert!(all.may_be_silent(link(100)));
        assert_eq!(all.reveal_horizon(ms(60)), ms(60 + 100 + 100 + 195));
        all.remove(ms(390));
        assert_eq!(all.reveal_horizon(ms(60)), ms(60 + 100 + 100 + 50));
        all.remove(ms(100));
        assert_eq!(all.one_way_max(), ms(50));
    }

    #[test]
    fn clients_that_are_silent_count_when_a_slower_one_has_come() {
        let mut all = horizons(&[100, 240]);
        assert_eq!(all.reveal_horizon(ms(60)), ms(60 + 100 + 240 + 120));
        all.add(ms(600));
        assert!(!all.may_be_silent(link(240)));
        all.count_silent([240, 100].into_iter().map(ms));
        assert_eq!(all.reveal_horizon(ms(60)), ms(60 + 100 + 240 + 200));
        all.count_silent([100].into_iter().map(ms));
        assert_eq!(all.reveal_horizon(ms(60)), ms(60 + 100 + 100 + 200));
    }

    #[test]
    fn beyond_the_cap_nothing_grows() {
        let slow = horizons(&[10_000]);
        assert_eq!(slow.live_horizon(ms(60_000), slow.delay(ms(10_000))), ms(400 + 50 + 200));
        assert!(!slow.may_be_silent(link(10_000)));
    }
}
