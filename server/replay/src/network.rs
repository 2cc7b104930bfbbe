//! The simulated network between clients and the server: delay, jitter, loss and duplication.

use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_client_core::replica::BLEND;
use sightline_protocol::pose_stream::RESEND_TICKS;
use sightline_world::motion::AvatarId;

use super::packets::{Packet, ReportKind};

/// A lost piece of a stream arrives this much later than one more round trip.
const RETRANSMISSION: Duration = Duration::from_millis(25);
/// How long a loss is remembered, to explain an old position.
const LOSS_MEMORY: Duration = Duration::from_secs(5);
/// After this number of lost datagrams in a row, a client counts as late.
const LOST_IN_A_ROW_MAX: u32 = 3;
/// Salt of the random numbers from which each client's own round trip follows.
const ROUND_TRIP_SALT: u64 = 0x5eed;

/// What the network does to messages. The default delivers each after half a round trip.
///
/// Poses travel in datagrams, and so do the reports of clients that report at every tick. Datagrams
/// can be lost, duplicated or reordered. Everything else travels on streams, one for each client
/// and direction. A loss on a
/// stream delays the message, and every later message of that stream, by a round trip and 25 ms.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NetworkConditions {
    /// Each client adds a constant part of this to
    /// [`ReplayOptions::round_trip`](super::ReplayOptions::round_trip).
    pub spread: Duration,
    /// Each client adds a part of this to its round trip, a different part in each second. The
    /// engine is told the round trip of the second before.
    pub drift: Duration,
    /// Each message adds a random part of this to half of its client's round trip.
    pub jitter: Duration,
    /// The share of messages that are lost, from 0 to less than 1.
    pub loss: f64,
    /// The share of datagrams that arrive twice, from 0 to 1.
    pub duplication: f64,
    /// The seed of all randomness here.
    pub seed: u64,
}

/// All messages on their way, and which clients' earlier messages were late.
pub(super) struct SimulatedNetwork {
    conditions: NetworkConditions,
    round_trip: Duration,
    tick: Duration,
    /// Whether departures that are lost never arrive: a fault for tests of the tests.
    departures_lost: bool,
    /// How many whole seconds have begun.
    second: u64,
    rng: SmallRng,
    /// By arrival, then in the order of sending.
    packets: BTreeMap<(Duration, u64), Packet>,
    /// How many packets were sent.
    sent: u64,
    links: BTreeMap<LinkId, Link>,
    /// Until when each client counts as late.
    late_until: BTreeMap<AvatarId, Duration>,
    /// Until when a message of each client is overdue.
    overdue_until: BTreeMap<AvatarId, Duration>,
}

/// One direction of one client's connection.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct LinkId {
    client: AvatarId,
    is_up: bool,
}

impl LinkId {
    fn of(packet: &Packet) -> Self {
        Self { client: packet.client(), is_up: packet.is_up() }
    }
}

/// How old a position may be that a viewer shows.
#[derive(Clone, Copy)]
pub(super) struct AgeBound {
    /// The greatest age.
    pub(super) age: Duration,
    /// The part of it that losses allow for.
    pub(super) lost: Duration,
}

/// The state of one direction of one client's connection.
#[derive(Default)]
struct Link {
    /// When the last message of its stream arrives.
    stream_arrival: Duration,
    /// What was lost, oldest first.
    losses: VecDeque<Loss>,
    /// How many packets were lost in all.
    lost: u64,
    /// How many of the newest datagrams were lost in a row.
    lost_in_a_row: u32,
    /// Whether the second copy of a report must be lost, too: by an injected fault.
    copy_is_lost: bool,
    /// When what was in the last lost datagram is sent again.
    repeats_at: Option<Duration>,
    /// The shortest time that a message took.
    way_min: Option<Duration>,
    /// When the last jump arrives. It is an act of the host, so the server knows of it when it
    /// hears from the avatar at its new place.
    jump_arrival: Duration,
}

/// A lost datagram, or a lost piece of a stream.
#[derive(Clone, Copy)]
struct Loss {
    /// When it was sent.
    sent: Duration,
    /// By how much it makes positions older: until the next report, or the retransmission.
    delay: Duration,
}

impl Link {
    fn lose(&mut self, loss: Loss) {
        while self.losses.front().is_some_and(|old| old.sent + LOSS_MEMORY < loss.sent) {
            self.losses.pop_front();
        }
        self.losses.push_back(loss);
        self.lost += 1;
    }
}

impl SimulatedNetwork {
    /// A network without packets. `round_trip` is the least of all clients', `tick` the server's
    /// tick interval.
    pub(super) fn new(conditions: NetworkConditions, round_trip: Duration, tick: Duration) -> Self {
        assert!((0.0..1.0).contains(&conditions.loss), "a share that is lost: {conditions:?}");
        assert!((0.0..=1.0).contains(&conditions.duplication), "a share: {conditions:?}");
        assert!(!tick.is_zero(), "ticks take time");
        Self {
            conditions,
            round_trip,
            tick,
            departures_lost: false,
            second: 0,
            rng: SmallRng::seed_from_u64(conditions.seed),
            packets: BTreeMap::new(),
            sent: 0,
            links: BTreeMap::new(),
            late_until: BTreeMap::new(),
            overdue_until: BTreeMap::new(),
        }
    }

    /// The network with a fault that a test may inject: whether a departure that is lost is never
    /// sent again.
    pub(super) fn with_departures_lost(self, departures_lost: bool) -> Self {
        Self { departures_lost, ..self }
    }

    /// Moves the clock on. Returns whether clients' round trips have changed.
    pub(super) fn advance(&mut self, now: Duration) -> bool {
        debug_assert!(now.as_secs() >= self.second, "time does not go back");
        let before = std::mem::replace(&mut self.second, now.as_secs());
        !self.conditions.drift.is_zero() && before != self.second
    }

    /// A client's round trip at present, without jitter and loss.
    pub(super) fn round_trip(&self, client: AvatarId) -> Duration {
        self.round_trip_in(self.second, client)
    }

    /// A client's round trip as the engine knows it: that of the second before.
    pub(super) fn known_round_trip(&self, client: AvatarId) -> Duration {
        self.round_trip_in(self.second.saturating_sub(1), client)
    }

    fn round_trip_in(&self, second: u64, client: AvatarId) -> Duration {
        let seed = self.conditions.seed ^ (u64::from(client.0) << 32 | ROUND_TRIP_SALT);
        let share = |of: Duration, seed: u64| match of {
            Duration::ZERO => Duration::ZERO,
            most => most.mul_f64(SmallRng::seed_from_u64(seed).random::<f64>()),
        };
        let drift = share(self.conditions.drift, seed ^ (second + 1) << 16);
        let round_trip = self.round_trip + share(self.conditions.spread, seed) + drift;
        debug_assert!(round_trip <= self.round_trip_max(), "{round_trip:?} is bounded");
        round_trip
    }

    /// The greatest round trip that any client can have.
    pub(super) fn round_trip_max(&self) -> Duration {
        self.round_trip + self.conditions.spread + self.conditions.drift
    }

    /// The greatest age of any position that a viewer shows, however much was lost.
    pub(super) fn age_bound_max(&self) -> Duration {
        let no_loss = self.round_trip_max() + 2 * (self.conditions.jitter + self.tick);
        if self.conditions.loss > 0.0 { no_loss.max(LOSS_MEMORY) } else { no_loss }
    }

    /// By how much a message from a client, or to it, may take longer than the quickest one before,
    /// if it is not lost: by jitter, and by how much the round trip has grown. Server and replica
    /// measure time by the quickest messages.
    pub(super) fn lateness(&self, client: AvatarId, is_up: bool) -> Duration {
        let link = self.links.get(&LinkId { client, is_up });
        let quickest = link.and_then(|link| link.way_min).unwrap_or(Duration::MAX);
        (self.way_max(client) + self.conditions.jitter).saturating_sub(quickest)
    }

    /// How old an avatar's position may be that a viewer shows.
    pub(super) fn age_bound(&self, now: Duration, viewer: AvatarId, avatar: AvatarId) -> AgeBound {
        let age_max = self.age_max(viewer, avatar);
        let mut bound = age_max;
        // The older a position may be, the more losses bear on it. A course that came late is
        // joined within a short while.
        loop {
            let since = now.saturating_sub(bound + BLEND);
            let longer = age_max + self.loss_delay(since, viewer, avatar);
            let longer = longer.min(self.age_bound_max());
            if longer <= bound {
                return AgeBound { age: bound, lost: bound.saturating_sub(age_max) };
            }
            bound = longer;
        }
    }

    /// How old an avatar's position may be that a viewer shows, if no message is lost.
    fn age_max(&self, viewer: AvatarId, avatar: AvatarId) -> Duration {
        self.delay(viewer, avatar) + 2 * (self.conditions.jitter + self.tick)
    }

    /// How long what an avatar's client says takes to its viewer, without jitter and loss.
    pub(super) fn delay(&self, viewer: AvatarId, avatar: AvatarId) -> Duration {
        self.way_max(viewer) + self.way_max(avatar)
    }

    /// Half of a client's round trip, at present or in the second before: the newest position that
    /// a viewer holds may have been sent then.
    fn way_max(&self, client: AvatarId) -> Duration {
        self.round_trip(client).max(self.known_round_trip(client)) / 2
    }

    /// By how much losses make an avatar's position older for a viewer: those from the avatar's
    /// client and those of datagrams to the viewer. Losses that were made good before a time do not
    /// count.
    fn loss_delay(&self, since: Duration, viewer: AvatarId, avatar: AvatarId) -> Duration {
        let up = self.links.get(&LinkId { client: avatar, is_up: true });
        let down = self.links.get(&LinkId { client: viewer, is_up: false });
        let after = |link: &Link| {
            let counts = |loss: &&Loss| loss.sent + loss.delay >= since;
            link.losses.iter().filter(counts).map(|loss| loss.delay).sum::<Duration>()
        };
        [up, down].into_iter().flatten().map(after).sum()
    }

    /// How many of the packets that a client has sent were lost, as far as it knows. It learns of a
    /// loss when later packets are acknowledged.
    pub(super) fn known_losses(&self, now: Duration, client: AvatarId) -> u64 {
        let Some(link) = self.links.get(&LinkId { client, is_up: true }) else { return 0 };
        let wait = self.round_trip(client) + RETRANSMISSION;
        let unknown = link.losses.iter().filter(|loss| loss.sent + wait > now).count() as u64;
        debug_assert!(unknown <= link.lost, "all losses are counted");
        link.lost - unknown
    }

    /// Whether one of a client's messages recently took longer than its margin allows. Then the
    /// client may know less, or the server may know less of it, than the promises say.
    pub(super) fn is_late(&self, now: Duration, client: AvatarId) -> bool {
        self.late_until.get(&client).is_some_and(|until| now <= *until)
    }

    /// Whether a message of a client is on its way that takes longer than its quickest one, by more
    /// than its margin allows. Then the server may take the client's silence for word of it.
    pub(super) fn is_overdue(&self, now: Duration, client: AvatarId) -> bool {
        self.overdue_until.get(&client).is_some_and(|until| now <= *until)
    }

    /// When the next packet arrives.
    pub(super) fn next_arrival(&self) -> Option<Duration> {
        self.packets.first_key_value().map(|((at, _), _)| *at)
    }

    /// Takes the next packet that has arrived, with its time of arrival.
    pub(super) fn receive(&mut self, now: Duration) -> Option<(Duration, Packet)> {
        let entry = self.packets.first_entry()?;
        let at = entry.key().0;
        (at <= now).then(|| (at, entry.remove()))
    }

    /// Sends a packet. It counts as late when it takes longer than half of its client's round trip
    /// and the margin.
    pub(super) fn send(&mut self, now: Duration, margin: Duration, packet: Packet) {
        if packet.is_datagram() {
            self.send_datagram(now, margin, packet);
        } else {
            self.send_on_stream(now, margin, packet);
        }
    }

    fn send_datagram(&mut self, now: Duration, margin: Duration, packet: Packet) {
        let id = LinkId::of(&packet);
        if self.happens(self.conditions.loss) {
            self.lose_datagram(now, margin, &packet);
            return;
        }
        let link = self.links.entry(id).or_default();
        (link.lost_in_a_row, link.copy_is_lost) = (0, false);
        let jump_arrival = link.jump_arrival;
        if self.happens(self.conditions.duplication) {
            let arrival = now + self.next_way(id.client);
            self.put(arrival.max(jump_arrival), packet.clone());
        }
        let arrival = (now + self.next_way(id.client)).max(jump_arrival);
        // A late pose is only older. A late report may keep the engine from telling in time.
        if id.is_up && arrival > now + self.known_round_trip(id.client) / 2 + margin {
            self.note_late(arrival, margin, id.client);
        }
        self.note_way(id, [now, arrival], margin);
        self.put(arrival, packet);
    }

    fn lose_datagram(&mut self, now: Duration, margin: Duration, packet: &Packet) {
        let id = LinkId::of(packet);
        let next_arrival = now + self.tick + self.next_way(id.client);
        let link = self.links.entry(id).or_default();
        // Each course is sent twice. When both are lost, it comes again much later, and for a
        // viewer so it does when it is lost then.
        let is_repetition = link.repeats_at.is_some_and(|at| at + 2 * self.tick >= now);
        let delay = if is_repetition { RESEND_TICKS } else { 2 } * self.tick;
        link.repeats_at = Some(now + if id.is_up { 2 * self.tick } else { delay });
        link.lose(Loss { sent: now, delay });
        link.lost_in_a_row += 1;
        link.copy_is_lost = self.departures_lost && packet.kind() == ReportKind::Departure;
        let is_long = link.lost_in_a_row >= LOST_IN_A_ROW_MAX;
        if packet.kind() != ReportKind::Routine {
            // The server takes the client for silent until the next tick's report arrives.
            self.note_late(next_arrival, margin, id.client);
            self.note_overdue(next_arrival, id.client);
        } else if is_long {
            self.note_late(now, margin, id.client);
        }
    }

    fn send_on_stream(&mut self, now: Duration, margin: Duration, packet: Packet) {
        let id = LinkId::of(&packet);
        let mut arrival = now + self.next_way(id.client);
        let is_departure = packet.kind() == ReportKind::Departure;
        if is_departure && self.links.entry(id).or_default().copy_is_lost {
            return;
        }
        while self.happens(self.conditions.loss) {
            if self.departures_lost && is_departure {
                return;
            }
            let delay = self.round_trip(id.client) + RETRANSMISSION;
            arrival += delay;
            self.links.entry(id).or_default().lose(Loss { sent: now, delay });
        }
        let link = self.links.entry(id).or_default();
        link.stream_arrival = link.stream_arrival.max(arrival);
        let arrival = link.stream_arrival;
        if packet.is_jump() {
            link.jump_arrival = arrival;
        }
        if arrival > now + self.known_round_trip(id.client) / 2 + margin {
            self.note_late(arrival, margin, id.client);
        }
        self.note_way(id, [now, arrival], margin);
        self.put(arrival, packet);
    }

    /// Takes in when a message was sent and when it arrives.
    fn note_way(&mut self, id: LinkId, [sent, arrival]: [Duration; 2], margin: Duration) {
        debug_assert!(sent <= arrival, "a message takes time");
        let way = arrival.saturating_sub(sent);
        let way_min = self.links.entry(id).or_default().way_min.get_or_insert(way);
        *way_min = way.min(*way_min);
        if id.is_up && way > *way_min + margin {
            self.note_overdue(arrival, id.client);
        }
    }

    /// Takes in that the server hears a client late, until a time.
    fn note_overdue(&mut self, until: Duration, client: AvatarId) {
        let overdue = self.overdue_until.entry(client).or_default();
        *overdue = until.max(*overdue);
    }

    /// Marks a client as late until the server has answered the late message, the client has acted
    /// on the answer, and the slowest viewer has been told.
    fn note_late(&mut self, arrival: Duration, margin: Duration, client: AvatarId) {
        let until = arrival + 2 * self.round_trip_max() + 4 * self.tick + 2 * margin;
        let late = self.late_until.entry(client).or_default();
        *late = until.max(*late);
    }

    /// The one-way delay of a client's next message, if it is not lost.
    fn next_way(&mut self, client: AvatarId) -> Duration {
        let delay = self.round_trip(client) / 2;
        if self.conditions.jitter.is_zero() {
            return delay;
        }
        delay + self.conditions.jitter.mul_f64(self.rng.random::<f64>())
    }

    /// Whether a random event of a given probability happens.
    fn happens(&mut self, share: f64) -> bool {
        share > 0.0 && self.rng.random_bool(share.min(0.99))
    }

    fn put(&mut self, arrival: Duration, packet: Packet) {
        self.sent += 1;
        let replaced = self.packets.insert((arrival, self.sent), packet);
        debug_assert!(replaced.is_none(), "each packet has its own number");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sightline_world::motion::Pose;

    use crate::packets::{Payload, Request, Uplink};

    const CLIENT: AvatarId = AvatarId(7);

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn network(conditions: NetworkConditions) -> SimulatedNetwork {
        SimulatedNetwork::new(conditions, ms(100), ms(50))
    }

    fn report(number: u32, on_stream: bool) -> Packet {
        let bytes = number.to_le_bytes().to_vec();
        let payload = if on_stream { Payload::Frame(bytes) } else { Payload::Datagram(bytes) };
        let request = Request::Bytes(payload);
        Packet::Up(Uplink { avatar: CLIENT, sent: ms(0), kind: ReportKind::Routine, request })
    }

    /// Sends a report every 50 ms. Returns the number and the delay of each that arrives.
    fn delays(network: &mut SimulatedNetwork, on_stream: bool) -> Vec<(u32, Duration)> {
        for i in 0..1_000 {
            network.send(ms(50) * i, ms(0), report(i, on_stream));
        }
        let mut delays = Vec::new();
        while let Some((at, packet)) = network.receive(Duration::MAX) {
            let Packet::Up(Uplink { request: Request::Bytes(payload), .. }) = packet else {
                unreachable!("only reports are sent")
            };
            let (Payload::Frame(bytes) | Payload::Datagram(bytes)) = payload;
            let number = u32::from_le_bytes(bytes.try_into().unwrap());
            delays.push((number, at - ms(50) * number));
        }
        delays
    }

    #[test]
    fn an_even_network_delays_by_half_a_round_trip() {
        for on_stream in [false, true] {
            let expected: Vec<_> = (0..1_000).map(|i| (i, ms(50))).collect();
            assert_eq!(delays(&mut network(NetworkConditions::default()), on_stream), expected);
        }
    }

    #[test]
    fn round_trips_drift_and_the_engine_knows_them_a_second_later() {
        let mut network =
            network(NetworkConditions { drift: ms(80), ..NetworkConditions::default() });
        let (mut before, mut changes) = (network.round_trip(CLIENT), 0);
        for tick in 1..200 {
            let has_changed = network.advance(ms(50) * tick);
            assert_eq!(has_changed, tick % 20 == 0);
            if has_changed {
                assert_eq!(network.known_round_trip(CLIENT), before);
                changes += u32::from(network.round_trip(CLIENT) != before);
            }
            before = network.round_trip(CLIENT);
            assert!((ms(100)..=network.round_trip_max()).contains(&before));
        }
        assert_eq!(changes, 9);
    }

    #[test]
    fn a_message_is_late_by_jitter_and_by_what_the_round_trip_has_grown() {
        let (jitter, drift) = (ms(20), ms(80));
        let mut network =
            network(NetworkConditions { jitter, drift, ..NetworkConditions::default() });
        assert_eq!(network.lateness(CLIENT, true), Duration::ZERO, "nothing to compare with");
        let (mut quickest, mut grown) = (Duration::MAX, false);
        for tick in 0..200 {
            let now = ms(50) * tick;
            network.advance(now);
            network.send(now, ms(0), report(tick, false));
            let (arrival, _) = network.packets.keys().max_by_key(|(_, number)| *number).unwrap();
            quickest = quickest.min(*arrival - now);
            let late = network.lateness(CLIENT, true);
            assert_eq!(late, network.way_max(CLIENT) + jitter - quickest);
            grown |= late > jitter;
        }
        assert!(grown, "round trips grow");
        assert_eq!(network.lateness(CLIENT, false), Duration::ZERO, "nothing was sent to it");
    }

    #[test]
    fn datagrams_are_lost_duplicated_and_reordered() {
        let (jitter, loss, duplication) = (ms(80), 0.1, 0.05);
        let mut network = network(NetworkConditions {
            jitter,
            loss,
            duplication,
            ..NetworkConditions::default()
        });
        let delays = delays(&mut network, false);
        let mut arrived: Vec<u32> = delays.iter().map(|(sequence, _)| *sequence).collect();
        assert!(!arrived.is_sorted(), "some are reordered");
        arrived.sort_unstable();
        let all = arrived.len();
        arrived.dedup();
        assert!((850..950).contains(&arrived.len()), "{} of 1000 arrive", arrived.len());
        assert!((20..80).contains(&(all - arrived.len())), "{} arrive twice", all - arrived.len());
        assert!(delays.iter().all(|(_, delay)| (ms(50)..=ms(130)).contains(delay)));
        let lost: Vec<u32> = (0..1_000).filter(|i| arrived.binary_search(i).is_err()).collect();
        // A loss soon after another one takes longer to mend.
        let is_second = |i: &u32| lost.iter().any(|before| before < i && i - before <= 4);
        let ticks = |i: &u32| if is_second(i) { RESEND_TICKS } else { 2 };
        let counts = |i: &&u32| **i + ticks(i) >= 950;
        let expected: u32 = lost.iter().filter(counts).map(ticks).sum();
        let delay = network.loss_delay(ms(50) * 950, AvatarId(1), CLIENT);
        assert_eq!(delay, ms(50) * expected);
    }

    #[test]
    fn nothing_overtakes_a_jump() {
        let conditions = NetworkConditions {
            jitter: ms(80),
            loss: 0.3,
            duplication: 0.3,
            ..NetworkConditions::default()
        };
        let mut network = network(conditions);
        for i in 0..1_000 {
            let request = Request::Relocate { pose: Pose::default(), ack: None };
            let (avatar, kind) = (CLIENT, ReportKind::Routine);
            let jump = Uplink { avatar, sent: ms(50) * i, kind, request };
            let is_jump = i % 10 == 0;
            let packet = if is_jump { Packet::Up(jump) } else { report(i, false) };
            network.send(ms(50) * i, ms(0), packet);
        }
        let mut jumps = 0;
        while let Some((_, packet)) = network.receive(Duration::MAX) {
            let Packet::Up(Uplink { request, .. }) = packet else { unreachable!("all go up") };
            match request {
                Request::Relocate { .. } => jumps += 1,
                Request::Bytes(Payload::Frame(bytes) | Payload::Datagram(bytes)) => {
                    let number = u32::from_le_bytes(bytes.try_into().unwrap());
                    assert!(number / 10 < jumps, "{number} came after {jumps} jumps");
                }
            }
        }
        assert_eq!(jumps, 100);
    }

    #[test]
    fn a_course_comes_late_again_when_its_repetition_is_lost_too() {
        let mut network = network(NetworkConditions::default());
        let poses = Packet::Down(CLIENT, Payload::Datagram(vec![1, 1]));
        for (tick, ticks_lost) in [(0, 2), (2, 2 + 12), (14, 2 + 12 + 12), (60, 2 + 12 + 12 + 2)] {
            network.lose_datagram(ms(50) * tick, ms(0), &poses);
            assert_eq!(network.loss_delay(ms(0), CLIENT, AvatarId(1)), ms(50) * ticks_lost);
        }
    }

    #[test]
    fn streams_keep_their_order_and_clients_with_late_messages_are_known() {
        let mut network = network(NetworkConditions { loss: 0.1, ..NetworkConditions::default() });
        let delays = delays(&mut network, true);
        assert!(delays.iter().map(|(sequence, _)| *sequence).eq(0..1_000));
        assert!(delays.iter().any(|(_, delay)| *delay > ms(150)));
        assert!(network.is_late(ms(0), CLIENT) && !network.is_late(ms(60_000), CLIENT));
        assert!(!network.is_late(ms(0), AvatarId(1)));
        let delay = network.loss_delay(ms(50) * 900, AvatarId(1), CLIENT);
        assert!(!delay.is_zero() && delay.as_millis().is_multiple_of(125), "{delay:?}");
    }
}
