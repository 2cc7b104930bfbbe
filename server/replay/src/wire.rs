//! The network between simulated clients and the server, and what goes wrong in it.

use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_world::motion::AvatarId;

use super::{
    ReplayOptions,
    clients::{Order, Request, Uplink},
};

/// A lost piece of a stream is sent again after a round trip and so much more.
const RETRANSMISSION: Duration = Duration::from_millis(25);
/// Losses that are older than this explain nothing any more.
const MEMORY: Duration = Duration::from_secs(5);
/// A client of which so many reports in a row are lost is not heard of for too long.
const STREAK_MAX: u32 = 3;

/// What the network does to messages. The default delivers all of them after half a round trip.
///
/// Reports of live clients and poses travel in datagrams: they can be lost, come twice or overtake each
/// other. All else travels on streams, one each way for each client: a loss delays it and all that
/// was sent after it by a round trip and 25 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NetworkConditions {
    /// Each client's round trip is longer than [`ReplayOptions::round_trip`] by up to this.
    pub spread: Duration,
    /// Besides, each client's is longer by up to this, from second to second by another part of it. The engine
    /// is told what it was in the second before.
    pub drift: Duration,
    /// Each message takes longer than half a round trip by up to this.
    pub jitter: Duration,
    /// The share of messages that is lost, from 0 to less than 1.
    pub loss: f64,
    /// The share of datagrams that comes twice, from 0 to 1.
    pub duplication: f64,
    /// Of all chance.
    pub seed: u64,
}

/// A message on its way.
#[derive(Clone, Debug)]
pub(super) enum Packet {
    Up(Uplink),
    Down(AvatarId, Order),
}

impl Packet {
    fn client(&self) -> AvatarId {
        match self {
            Self::Up(uplink) => uplink.avatar,
            Self::Down(to, _) => *to,
        }
    }

    fn is_up(&self) -> bool {
        matches!(self, Self::Up(_))
    }

    fn is_datagram(&self) -> bool {
        match self {
            Self::Up(uplink) => matches!(uplink.request, Request::Report { on_stream: false, .. }),
            Self::Down(_, order) => matches!(order, Order::Poses { .. }),
        }
    }
}

/// All messages on their way, and what became of earlier ones.
pub(super) struct Wire {
    network: NetworkConditions,
    round_trip: Duration,
    tick: Duration,
    /// Whole seconds that have begun.
    second: u64,
    rng: SmallRng,
    /// By arrival, then in the order of sending.
    packets: BTreeMap<(Duration, u64), Packet>,
    sent: u64,
    links: BTreeMap<(AvatarId, bool), Link>,
    late_until: BTreeMap<AvatarId, Duration>,
}

/// One way of one client.
#[derive(Default)]
struct Link {
    /// When the last message of its stream arrives.
    stream: Duration,
    /// When datagrams were lost that were sent.
    lost: VecDeque<Duration>,
    /// How many datagrams in a row were lost last.
    streak: u32,
}

impl Wire {
    pub(super) fn new(options: &ReplayOptions) -> Self {
        Self {
            network: options.network,
            round_trip: options.round_trip,
            tick: options.config.tick,
            second: 0,
            rng: SmallRng::seed_from_u64(options.network.seed),
            packets: BTreeMap::new(),
            sent: 0,
            links: BTreeMap::new(),
            late_until: BTreeMap::new(),
        }
    }

    /// Goes on to a moment. Gives whether round trips are not what they were.
    pub(super) fn go_on(&mut self, now: Duration) -> bool {
        let before = std::mem::replace(&mut self.second, now.as_secs());
        !self.network.drift.is_zero() && before != self.second
    }

    /// A client's, without jitter and loss.
    pub(super) fn round_trip(&self, client: AvatarId) -> Duration {
        self.round_trip_in(self.second, client)
    }

    /// What the engine knows of it.
    pub(super) fn known(&self, client: AvatarId) -> Duration {
        self.round_trip_in(self.second.saturating_sub(1), client)
    }

    fn round_trip_in(&self, second: u64, client: AvatarId) -> Duration {
        let seed = self.network.seed ^ (u64::from(client.0) << 32 | 0x5eed);
        let share = |of: Duration, seed: u64| match of {
            Duration::ZERO => Duration::ZERO,
            most => most.mul_f64(SmallRng::seed_from_u64(seed).random::<f64>()),
        };
        let drift = share(self.network.drift, seed ^ (second + 1) << 16);
        self.round_trip + share(self.network.spread, seed) + drift
    }

    /// No client's is longer.
    pub(super) fn round_trip_max(&self) -> Duration {
        self.round_trip + self.network.spread + self.network.drift
    }

    /// From tick to tick.
    pub(super) fn tick(&self) -> Duration {
        self.tick
    }

    /// How old a position may be when it stands at a viewer, if nothing is lost in between.
    pub(super) fn age_max(&self, viewer: AvatarId, avatar: AvatarId) -> Duration {
        // What it holds may have been sent in the second before.
        let way = |client: AvatarId| self.round_trip(client).max(self.known(client)) / 2;
        way(viewer) + way(avatar) + 2 * (self.network.jitter + self.tick)
    }

    /// How many datagrams between an avatar's client and a viewer were lost since a moment.
    pub(super) fn lost_since(&self, since: Duration, viewer: AvatarId, avatar: AvatarId) -> usize {
        let links = [self.links.get(&(avatar, true)), self.links.get(&(viewer, false))];
        let after = |link: &Link| link.lost.iter().rev().take_while(|at| **at >= since).count();
        links.into_iter().flatten().map(after).sum()
    }

    /// Whether a client may know less, or be known less of, than it should, because a message
    /// took longer than the margin allows.
    pub(super) fn is_late(&self, now: Duration, client: AvatarId) -> bool {
        self.late_until.get(&client).is_some_and(|until| now <= *until)
    }

    /// The next message that has arrived, and when.
    pub(super) fn next(&mut self, now: Duration) -> Option<(Duration, Packet)> {
        let entry = self.packets.first_entry()?;
        let at = entry.key().0;
        (at <= now).then(|| (at, entry.remove()))
    }

    /// Sends a message that is allowed to take so much longer than half of its client's round trip.
    pub(super) fn send(&mut self, now: Duration, margin: Duration, packet: Packet) {
        if packet.is_datagram() {
            self.send_datagram(now, margin, packet);
        } else {
            self.send_on_stream(now, margin, packet);
        }
    }

    fn send_datagram(&mut self, now: Duration, margin: Duration, packet: Packet) {
        let key = (packet.client(), packet.is_up());
        if self.chance(self.network.loss) {
            let link = self.links.entry(key).or_default();
            while link.lost.front().is_some_and(|at| *at + MEMORY < now) {
                link.lost.pop_front();
            }
            link.lost.push_back(now);
            link.streak += 1;
            if link.is_silent() {
                self.note_late(now, margin, key.0);
            }
            return;
        }
        self.links.entry(key).or_default().streak = 0;
        if self.chance(self.network.duplication) {
            let arrival = now + self.way(key.0);
            self.put(arrival, packet.clone());
        }
        let arrival = now + self.way(key.0);
        // Poses that come late are only older.
        if packet.is_up() && arrival > now + self.known(key.0) / 2 + margin {
            self.note_late(arrival, margin, key.0);
        }
        self.put(arrival, packet);
    }

    fn send_on_stream(&mut self, now: Duration, margin: Duration, packet: Packet) {
        let key = (packet.client(), packet.is_up());
        let mut arrival = now + self.way(key.0);
        while self.chance(self.network.loss) {
            arrival += self.round_trip(key.0) + RETRANSMISSION;
        }
        let link = self.links.entry(key).or_default();
        link.stream = link.stream.max(arrival);
        let arrival = link.stream;
        if arrival > now + self.known(key.0) / 2 + margin {
            self.note_late(arrival, margin, key.0);
        }
        self.put(arrival, packet);
    }

    /// What came late, or not at all, is answered, acted upon and told to the slowest.
    fn note_late(&mut self, arrival: Duration, margin: Duration, client: AvatarId) {
        let until = arrival + 2 * self.round_trip_max() + 4 * self.tick + 2 * margin;
        let late = self.late_until.entry(client).or_default();
        *late = until.max(*late);
    }

    /// How long a message takes that is not lost.
    fn way(&mut self, client: AvatarId) -> Duration {
        let way = self.round_trip(client) / 2;
        if self.network.jitter.is_zero() {
            return way;
        }
        way + self.network.jitter.mul_f64(self.rng.random::<f64>())
    }

    fn chance(&mut self, share: f64) -> bool {
        share > 0.0 && self.rng.random_bool(share.min(0.99))
    }

    fn put(&mut self, arrival: Duration, packet: Packet) {
        self.sent += 1;
        self.packets.insert((arrival, self.sent), packet);
    }
}

impl Link {
    fn is_silent(&self) -> bool {
        self.streak >= STREAK_MAX
    }
}

#[cfg(test)]
mod tests {
    use sightline_protocol::pose_stream::Ack;
    use sightline_world::motion::Pose;

    use super::*;
    use sightline_engine::Policy;

    const CLIENT: AvatarId = AvatarId(7);

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn wire(network: NetworkConditions) -> Wire {
        Wire::new(&ReplayOptions { network, ..ReplayOptions::new(Policy::Tbv, ms(100)) })
    }

    fn report(sequence: u32, on_stream: bool) -> Packet {
        let request = Request::Report { sequence, pose: Pose::default(), on_stream };
        Packet::Up(Uplink { avatar: CLIENT, sampled: ms(0), ack: Ack::default(), request })
    }

    /// Sends a report every 50 ms and gives each one's number and how long it took.
    fn taken(wire: &mut Wire, on_stream: bool) -> Vec<(u32, Duration)> {
        for i in 0..1_000 {
            wire.send(ms(50) * i, ms(0), report(i, on_stream));
        }
        let mut taken = Vec::new();
        while let Some((at, packet)) = wire.next(Duration::MAX) {
            let Packet::Up(Uplink { request: Request::Report { sequence, .. }, .. }) = packet
            else {
                unreachable!("only reports were sent")
            };
            taken.push((sequence, at - ms(50) * sequence));
        }
        taken
    }

    #[test]
    fn an_even_network_takes_half_a_round_trip() {
        for on_stream in [false, true] {
            let expected: Vec<_> = (0..1_000).map(|i| (i, ms(50))).collect();
            assert_eq!(taken(&mut wire(NetworkConditions::default()), on_stream), expected);
        }
    }

    #[test]
    fn round_trips_drift_and_are_known_a_second_later() {
        let mut wire = wire(NetworkConditions { drift: ms(80), ..NetworkConditions::default() });
        let (mut before, mut changes) = (wire.round_trip(CLIENT), 0);
        for tick in 1..200 {
            let has_changed = wire.go_on(ms(50) * tick);
            assert_eq!(has_changed, tick % 20 == 0);
            if has_changed {
                assert_eq!(wire.known(CLIENT), before);
                changes += u32::from(wire.round_trip(CLIENT) != before);
            }
            before = wire.round_trip(CLIENT);
            assert!((ms(100)..=wire.round_trip_max()).contains(&before));
        }
        assert_eq!(changes, 9);
    }

    #[test]
    fn datagrams_are_lost_doubled_and_overtaken() {
        let (jitter, loss, duplication) = (ms(80), 0.1, 0.05);
        let mut wire =
            wire(NetworkConditions { jitter, loss, duplication, ..NetworkConditions::default() });
        let taken = taken(&mut wire, false);
        let mut came: Vec<u32> = taken.iter().map(|(sequence, _)| *sequence).collect();
        assert!(!came.is_sorted(), "some were overtaken");
        came.sort_unstable();
        let all = came.len();
        came.dedup();
        assert!((850..950).contains(&came.len()), "{} of 1000 came", came.len());
        assert!((20..80).contains(&(all - came.len())), "{} came twice", all - came.len());
        assert!(taken.iter().all(|(_, way)| (ms(50)..=ms(130)).contains(way)));
        let lost_last = (950..1_000).filter(|i| came.binary_search(i).is_err()).count();
        assert_eq!(wire.lost_since(ms(50) * 950, AvatarId(1), CLIENT), lost_last);
    }

    #[test]
    fn streams_keep_their_order_and_late_clients_are_known() {
        let mut wire = wire(NetworkConditions { loss: 0.1, ..NetworkConditions::default() });
        let taken = taken(&mut wire, true);
        assert!(taken.iter().map(|(sequence, _)| *sequence).eq(0..1_000));
        assert!(taken.iter().any(|(_, way)| *way > ms(150)));
        assert!(wire.is_late(ms(0), CLIENT) && !wire.is_late(ms(60_000), CLIENT));
        assert!(!wire.is_late(ms(0), AvatarId(1)));
    }
}
