//! How far ahead visibility is decided. Why that is far enough is in `horizon.md`, which the engine's docs end with.

use std::{collections::BTreeMap, sync::OnceLock, time::Duration};

use crate::Config;

/// Delays to viewers are rounded up to a multiple of this.
const DELAY_STEP: Duration = Duration::from_millis(25);
/// One slow client that is silent widens what all live ones reveal, so slow ones are not.
pub(crate) const SILENT_MAX: Duration = Duration::from_secs(1);

/// How long a client's messages take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Link {
    pub(crate) round_trip: Duration,
    /// What one may take longer than half of that.
    pub(crate) margin: Duration,
}

/// The times above, for everyone present.
#[derive(Clone, Debug)]
pub(crate) struct Horizons {
    tick: Duration,
    /// For a client of whom nothing is known yet.
    margin: Duration,
    cap: Duration,
    /// No client that needs a longer TBV to be silent is silenced.
    silent_max: Duration,
    /// How many clients have each round trip.
    round_trips: BTreeMap<Duration, usize>,
    /// How many have each delay.
    delays: BTreeMap<Duration, usize>,
    /// The longest round trip of those that may be silent, once it was asked for.
    round_trip_silent_max: OnceLock<Duration>,
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
        }
    }

    /// Takes in the round trip of one client more.
    pub(crate) fn add(&mut self, round_trip: Duration) {
        self.round_trip_silent_max = OnceLock::new();
        *self.round_trips.entry(round_trip).or_insert(0) += 1;
        *self.delays.entry(self.delay(round_trip)).or_insert(0) += 1;
    }

    /// Forgets a round trip that was taken in.
    pub(crate) fn remove(&mut self, round_trip: Duration) {
        self.round_trip_silent_max = OnceLock::new();
        let delay = self.delay(round_trip);
        for (counts, key) in [(&mut self.round_trips, round_trip), (&mut self.delays, delay)] {
            if let Some(count) = counts.get_mut(&key) {
                *count -= 1;
                if *count == 0 {
                    counts.remove(&key);
                }
            }
        }
    }

    /// Each [`Horizons::delay`] that some client has, ascending.
    pub(crate) fn delays(&self) -> impl Iterator<Item = Duration> + '_ {
        self.delays.keys().copied()
    }

    /// How long a message to a client takes.
    pub(crate) fn one_way(&self, round_trip: Duration) -> Duration {
        round_trip.min(self.cap) / 2
    }

    /// The same for the slowest client.
    pub(crate) fn one_way_max(&self) -> Duration {
        self.round_trips.last_key_value().map_or(Duration::ZERO, |(trip, _)| self.one_way(*trip))
    }

    /// The same, rounded up to a step that many viewers share.
    pub(crate) fn delay(&self, round_trip: Duration) -> Duration {
        let steps = self.one_way(round_trip).as_nanos().div_ceil(DELAY_STEP.as_nanos());
        DELAY_STEP * u32::try_from(steps).unwrap_or(u32::MAX)
    }

    /// How long after its last report was made a live avatar's region must hold for the next
    /// tick's word to stand at a viewer with that delay.
    pub(crate) fn near(&self, age: Duration, link: Link, delay: Duration) -> Duration {
        self.unheard(age, link) + self.tick + delay
    }

    /// The same, until a hidden avatar that it reveals can be told of, or told.
    pub(crate) fn far(&self, age: Duration, link: Link) -> Duration {
        let answer = self.unheard(age, link) + 2 * self.tick + self.round_trip_silent_max();
        answer + self.one_way_max()
    }

    /// When a report that came in at a moment was made, at the latest and at the earliest alike.
    pub(crate) fn made_at(&self, heard: Duration, link: Link) -> Duration {
        heard.saturating_sub(self.one_way(link.round_trip) + link.margin)
    }

    /// How long before its expiry a hidden client must be asked.
    pub(crate) fn lead(&self, link: Link) -> Duration {
        2 * link.round_trip.min(self.cap) + self.one_way_max() + 2 * self.tick + link.margin
    }

    /// From the last tick of a hidden client at which it was not about to leave its place, until what its
    /// next one says is known to all whom it may concern.
    pub(crate) fn notice(&self, link: Link) -> Duration {
        let heard = self.one_way(link.round_trip) + link.margin + 2 * self.tick;
        heard + self.round_trip_silent_max() + self.tick + self.one_way_max()
    }

    /// Whether a client answers fast enough to be silent in between, for two ticks at least.
    pub(crate) fn may_be_silent(&self, link: Link) -> bool {
        // Whom the slowest silent one is found among has at least this margin.
        let link = Link { margin: link.margin.max(self.margin), ..link };
        let made = self.one_way(link.round_trip) + link.margin;
        link.round_trip <= self.cap && made + self.lead(link) + 2 * self.tick <= self.silent_max
    }

    fn round_trip_silent_max(&self) -> Duration {
        // All live avatars ask for it at each tick, and there may be many who are too slow.
        *self.round_trip_silent_max.get_or_init(|| {
            let mut trips = self.round_trips.keys().rev();
            let link = |trip: &Duration| Link { round_trip: *trip, margin: self.margin };
            trips.find(|trip| self.may_be_silent(link(trip))).copied().unwrap_or(Duration::ZERO)
        })
    }

    fn unheard(&self, age: Duration, link: Link) -> Duration {
        (age + self.one_way(link.round_trip) + link.margin).min(self.cap)
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
    fn each_delay_counts_once() {
        let two = horizons(&[100, 60]);
        assert_eq!(two.near(ms(20), link(60), ms(50)), ms(20 + 30 + 10 + 50 + 50));
        assert_eq!(two.far(ms(20), link(60)), ms(20 + 30 + 10 + 100 + 100 + 50));
        assert_eq!(two.delays().collect::<Vec<_>>(), [ms(50)]);
        assert_eq!(two.lead(link(60)), ms(120 + 50 + 100 + 10));
    }

    #[test]
    fn one_slow_client_is_not_silenced_and_widens_only_what_is_sent_to_it() {
        let mut all = horizons(&[100, 100, 390]);
        assert!(!all.may_be_silent(link(390)));
        assert!(all.may_be_silent(link(100)));
        assert_eq!(all.far(ms(0), link(100)), ms(50 + 10 + 100 + 100 + 195));
        all.remove(ms(390));
        assert_eq!(all.far(ms(0), link(100)), ms(50 + 10 + 100 + 100 + 50));
        all.remove(ms(100));
        assert_eq!(all.one_way_max(), ms(50));
    }

    #[test]
    fn beyond_the_cap_nothing_grows() {
        let slow = horizons(&[10_000]);
        assert_eq!(slow.near(ms(60_000), link(10_000), slow.delay(ms(10_000))), ms(400 + 50 + 200));
        assert!(!slow.may_be_silent(link(10_000)));
    }
}
