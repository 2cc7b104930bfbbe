//! Limits on the connections of each network. No sockets and no clocks are needed here.

use std::{collections::HashMap, net::IpAddr};

use crate::address::network;

/// The number of a connection, which no other one ever has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ConnectionId(pub u64);

/// What a connection has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Its handshake is under way, and its address may be forged.
    Unproven,
    /// Its address is its own.
    Proven,
    /// It has said hello, and does not have its avatar yet.
    Joining,
    /// It has an avatar.
    Entered,
    /// It broke, and its avatar is kept.
    Absent,
}

/// How many stages there are.
const STAGES: usize = 5;

/// The limits of [`Places`].
#[derive(Clone, Copy, Debug)]
pub struct PlaceLimits {
    /// The most connections of one network, among those with a proven address. An avatar is kept
    /// only while its network has no more avatars than that.
    pub per_network: usize,
    /// The most clients of one network that join at a time. They may download the world.
    pub joining_per_network: usize,
    /// The most clients that join at a time.
    pub joining: usize,
    /// The most clients with an avatar.
    pub entered: usize,
}

/// How an attempt to connect is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The handshake goes on.
    Accept,
    /// The client must first prove its address.
    ProveAddress,
    /// There are too many connections from there.
    Refuse,
}

/// Why a client cannot join.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPlace {
    /// All avatars are taken.
    Full,
    /// Too many others join just now.
    Joining,
    /// Too many others of its network join just now.
    JoiningOfNetwork,
}

/// The connections of a server, by their networks. An IPv6 address stands for its /64 network,
/// since one subscriber has at least that. An address counts only once it is proven, or anybody
/// could use up the places of another by forged packets. The server's own machine has no limits of
/// its own. There are at most as many entries as connections and kept avatars.
#[derive(Debug)]
pub struct Places {
    limits: PlaceLimits,
    /// The address and the stage of each connection.
    connections: HashMap<ConnectionId, (IpAddr, Stage)>,
    /// How many connections each network has at each stage.
    networks: HashMap<IpAddr, [usize; STAGES]>,
    /// How many connections there are at each stage.
    all: [usize; STAGES],
}

impl Places {
    /// No connections yet.
    pub fn new(limits: PlaceLimits) -> Self {
        let (connections, networks) = Default::default();
        Self { limits, connections, networks, all: [0; STAGES] }
    }

    /// Decides on an attempt to connect. The connection counts from now on if it is accepted.
    pub fn begin(&mut self, id: ConnectionId, address: IpAddr, is_proven: bool) -> Answer {
        let stages = self.stages(address);
        if !is_own_machine(address) {
            if !is_proven && stages[Stage::Unproven as usize] > 0 {
                return Answer::ProveAddress;
            }
            if is_proven && !self.has_room(&stages) {
                return Answer::Refuse;
            }
        }
        let stage = if is_proven { Stage::Proven } else { Stage::Unproven };
        let before = self.connections.insert(id, (address, stage));
        debug_assert!(before.is_none(), "a connection begins once");
        self.count(address, stage, true);
        Answer::Accept
    }

    /// Takes in that a handshake is done, which proves the address. Returns whether the connection
    /// may stay.
    pub fn prove(&mut self, id: ConnectionId, address: IpAddr) -> bool {
        if self.stage(id) == Some(Stage::Unproven) {
            if !is_own_machine(address) && !self.has_room(&self.stages(address)) {
                return false;
            }
            self.set_stage(id, Stage::Proven);
        }
        true
    }

    /// Takes in that a client has said hello. It may then download the world, and enter.
    pub fn join(&mut self, id: ConnectionId, address: IpAddr) -> Result<(), NoPlace> {
        let joining = self.stages(address)[Stage::Joining as usize];
        if avatars(&self.all) >= self.limits.entered {
            return Err(NoPlace::Full);
        }
        if joining >= self.limits.joining_per_network && !is_own_machine(address) {
            return Err(NoPlace::JoiningOfNetwork);
        }
        if self.all[Stage::Joining as usize] >= self.limits.joining {
            return Err(NoPlace::Joining);
        }
        self.set_stage(id, Stage::Joining);
        Ok(())
    }

    /// Takes in that a client wants its avatar. Returns whether there is one for it.
    pub fn enter(&mut self, id: ConnectionId) -> bool {
        if self.stage(id) == Some(Stage::Entered) {
            return true;
        }
        let has_place = avatars(&self.all) < self.limits.entered;
        if has_place {
            self.set_stage(id, Stage::Entered);
        }
        has_place
    }

    /// Takes in that a connection with an avatar broke. Returns whether the avatar is kept, until
    /// the connection [ends](Self::end): its network might have too many.
    pub fn part(&mut self, id: ConnectionId) -> bool {
        let Some((address, _)) = self.connections.get(&id).copied() else { return false };
        let is_kept =
            is_own_machine(address) || avatars(&self.stages(address)) <= self.limits.per_network;
        if is_kept {
            self.set_stage(id, Stage::Absent);
        }
        is_kept
    }

    /// Takes in that a client takes over from another connection: its avatar, or its turn to join.
    /// The other one counts for its network until it [ends](Self::end), unless it broke before.
    pub fn take_over(&mut self, id: ConnectionId, former: ConnectionId) {
        let before = self.stage(former);
        match before {
            Some(Stage::Absent) => self.end(former),
            _ => self.set_stage(former, Stage::Proven),
        }
        let has_avatar = matches!(before, Some(Stage::Entered | Stage::Absent));
        self.set_stage(id, if has_avatar { Stage::Entered } else { Stage::Joining });
    }

    /// Takes in that a connection has ended, and that its avatar is not kept.
    pub fn end(&mut self, id: ConnectionId) {
        if let Some((address, stage)) = self.connections.remove(&id) {
            self.count(address, stage, false);
        }
    }

    fn has_room(&self, stages: &[usize; STAGES]) -> bool {
        let connected = [Stage::Proven, Stage::Joining, Stage::Entered];
        connected.map(|stage| stages[stage as usize]).iter().sum::<usize>()
            < self.limits.per_network
    }

    fn stages(&self, address: IpAddr) -> [usize; STAGES] {
        self.networks.get(&network(address)).copied().unwrap_or_default()
    }

    fn stage(&self, id: ConnectionId) -> Option<Stage> {
        self.connections.get(&id).map(|(_, stage)| *stage)
    }

    fn set_stage(&mut self, id: ConnectionId, stage: Stage) {
        let Some((address, before)) = self.connections.get(&id).copied() else { return };
        self.connections.insert(id, (address, stage));
        self.count(address, before, false);
        self.count(address, stage, true);
    }

    fn count(&mut self, address: IpAddr, stage: Stage, is_more: bool) {
        let network = network(address);
        let stages = self.networks.entry(network).or_default();
        for count in [&mut stages[stage as usize], &mut self.all[stage as usize]] {
            *count = if is_more { *count + 1 } else { count.saturating_sub(1) };
        }
        if *stages == [0; STAGES] {
            self.networks.remove(&network);
        }
    }
}

/// How many avatars there are, kept ones among them.
fn avatars(stages: &[usize; STAGES]) -> usize {
    stages[Stage::Entered as usize] + stages[Stage::Absent as usize]
}

fn is_own_machine(address: IpAddr) -> bool {
    address.to_canonical().is_loopback()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: PlaceLimits =
        PlaceLimits { per_network: 3, joining_per_network: 2, joining: 4, entered: 5 };

    /// A server's connections, each with the next id.
    struct Door {
        places: Places,
        newest: u64,
    }

    impl Door {
        fn new() -> Self {
            Self { places: Places::new(LIMITS), newest: 0 }
        }

        fn begin(&mut self, address: &str, is_proven: bool) -> (ConnectionId, Answer) {
            self.newest += 1;
            let id = ConnectionId(self.newest);
            (id, self.places.begin(id, address.parse().unwrap(), is_proven))
        }

        /// Whether a connection with a proven address is accepted.
        fn accepts(&mut self, address: &str) -> bool {
            self.begin(address, true).1 == Answer::Accept
        }

        fn join(&mut self, address: &str) -> (ConnectionId, Result<(), NoPlace>) {
            let (id, answer) = self.begin(address, true);
            assert_eq!(answer, Answer::Accept);
            (id, self.places.join(id, address.parse().unwrap()))
        }

        fn enter(&mut self, address: &str) -> ConnectionId {
            let (id, joined) = self.join(address);
            assert!(joined.is_ok() && self.places.enter(id));
            id
        }
    }

    #[test]
    fn connections_are_limited_for_each_network_but_not_for_the_own_machine() {
        let mut door = Door::new();
        let first = door.begin("203.0.113.9", true).0;
        assert!(door.accepts("::ffff:203.0.113.9") && door.accepts("203.0.113.9"));
        assert!(!door.accepts("203.0.113.9"));
        door.places.end(first);
        assert!(door.accepts("203.0.113.9"));
        assert!((0..3).all(|_| door.accepts("2001:db8::1")));
        assert!(!door.accepts("2001:db8::2:0:0:0") && door.accepts("2001:db8:0:1::1"));
        assert!((0..100).all(|_| door.accepts("127.0.0.1") && door.accepts("::1")));
        (0..=door.newest).for_each(|id| door.places.end(ConnectionId(id)));
        assert!(door.places.networks.is_empty(), "connections that end leave no entry");
        assert_eq!((door.places.connections.len(), door.places.all), (0, [0; STAGES]));
    }

    #[test]
    fn forged_handshakes_do_not_lock_out_the_owner_of_an_address() {
        let mut door = Door::new();
        let owner = "203.0.113.9";
        assert_eq!(door.begin(owner, false).1, Answer::Accept);
        for _ in 0..1_000 {
            assert_eq!(door.begin(owner, false).1, Answer::ProveAddress);
        }
        assert!((0..3).all(|_| door.accepts(owner)), "who proves it gets all places");
    }

    #[test]
    fn a_handshake_proves_the_address_and_counts_from_then_on() {
        let mut door = Door::new();
        let (other, address) = ("198.51.100.7", "198.51.100.7".parse().unwrap());
        let (late, _) = door.begin(other, false);
        assert!((0..3).all(|_| door.accepts(other)));
        assert!(!door.places.prove(late, address), "three others were faster");
        door.places.end(late);
        let (early, _) = door.begin("192.0.2.1", false);
        assert!(door.places.prove(early, "192.0.2.1".parse().unwrap()));
        assert!(door.accepts("192.0.2.1") && door.accepts("192.0.2.1"));
        assert!(!door.accepts("192.0.2.1"));
    }

    #[test]
    fn who_joins_takes_no_avatar_from_others_and_few_of_a_network_join_at_a_time() {
        let mut door = Door::new();
        let (one, joined) = door.join("203.0.113.9");
        assert_eq!((joined, door.join("203.0.113.9").1), (Ok(()), Ok(())));
        assert_eq!(door.join("203.0.113.9").1, Err(NoPlace::JoiningOfNetwork));
        assert!(door.places.enter(one));
        let ids: Vec<ConnectionId> = (0..3).map(|_| door.join("127.0.0.1").0).collect();
        assert_eq!(door.join("127.0.0.1").1, Err(NoPlace::Joining), "four join");
        assert!(ids.into_iter().all(|id| door.places.enter(id)));
        let (last, joined) = door.join("192.0.2.1");
        assert!(joined.is_ok() && door.places.enter(last));
        assert_eq!(door.join("192.0.2.2").1, Err(NoPlace::Full));
        door.places.end(one);
        assert_eq!(door.join("192.0.2.3").1, Ok(()));
    }

    /// The avatar of a connection that broke is kept for its visitor, and keeps others out. The
    /// connection itself takes no place from its network.
    #[test]
    fn who_comes_back_has_a_place() {
        let mut door = Door::new();
        let ids = ["192.0.2.1"; 3].map(|address| door.enter(address));
        door.enter("127.0.0.1");
        door.enter("127.0.0.1");
        assert!(!door.accepts("192.0.2.1"));
        assert!(door.places.part(ids[0]));
        assert_eq!(door.join("198.51.100.1").1, Err(NoPlace::Full), "the avatar is there");
        let (back, answer) = door.begin("192.0.2.1", true);
        assert_eq!(answer, Answer::Accept);
        door.places.take_over(back, ids[0]);
        assert!(door.places.enter(back));
        assert_eq!(door.join("198.51.100.1").1, Err(NoPlace::Full));
        assert!(door.places.part(back));
        door.places.end(back);
        assert_eq!(door.join("198.51.100.1").1, Ok(()));
    }

    #[test]
    fn a_network_keeps_no_more_avatars_than_it_may_have_connections() {
        let mut door = Door::new();
        let mut parts = |address| {
            let id = door.enter(address);
            let is_kept = door.places.part(id);
            if !is_kept {
                door.places.end(id);
            }
            is_kept
        };
        assert!((0..3).all(|_| parts("192.0.2.1")), "as many as it may have connections");
        assert!(!parts("192.0.2.1"));
        assert!(parts("198.51.100.1"), "another network");
        assert!(parts("::1"), "the own machine");
        let (back, former) = (door.begin("192.0.2.1", true).0, ConnectionId(1));
        door.places.take_over(back, former);
        assert!(door.places.part(back), "a client that came back may lose its link again");
    }

    #[test]
    fn who_is_replaced_counts_for_its_network_until_its_connection_ends() {
        let mut door = Door::new();
        let former = door.enter("192.0.2.1");
        let (second, _) = door.begin("198.51.100.1", true);
        door.places.take_over(second, former);
        assert!((0..2).all(|_| door.accepts("192.0.2.1")));
        assert!(!door.accepts("192.0.2.1"), "the first connection is still there");
        door.places.end(former);
        assert!(door.accepts("192.0.2.1"));
    }

    #[test]
    fn who_takes_over_from_a_client_that_joins_joins() {
        let mut door = Door::new();
        let former = door.join("192.0.2.1").0;
        let _ids = ["127.0.0.1"; 5].map(|address| door.enter(address));
        let (second, _) = door.begin("192.0.2.1", true);
        door.places.take_over(second, former);
        assert!(!door.places.enter(second), "all avatars are taken");
        let stages = door.places.stages("192.0.2.1".parse().unwrap());
        assert_eq!(stages[Stage::Joining as usize], 1);
    }
}
