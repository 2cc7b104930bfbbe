//! A UDP proxy between clients and a server, which loses packets by a seed, cuts the way, or changes
//! the address that the server sees.

use std::{
    collections::HashMap,
    net::{SocketAddr, UdpSocket},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed},
    },
    thread,
    time::Duration,
};

use rand::{Rng, SeedableRng, rngs::SmallRng};

/// How often a thread looks whether it is to end.
const LOOK: Duration = Duration::from_millis(50);
/// The most bytes of a packet.
const PACKET_BYTES_MAX: usize = 2_048;

/// What the proxy does to packets.
#[derive(Default)]
struct Treatment {
    /// Whether no packet passes.
    is_cut: AtomicBool,
    /// The share of packets that are lost, in thousandths.
    loss: AtomicU32,
    /// Packets that passed, both ways.
    passed: AtomicU64,
    /// Whether each client is given another address at the server.
    moves: AtomicBool,
    ends: AtomicBool,
}

/// A proxy on a thread of its own, which ends with this.
pub struct Proxy {
    pub address: SocketAddr,
    treatment: Arc<Treatment>,
    thread: Option<thread::JoinHandle<()>>,
}

impl Proxy {
    /// A proxy in front of a server.
    pub fn new(server: SocketAddr, seed: u64) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = socket.local_addr().unwrap();
        let treatment = Arc::new(Treatment::default());
        let treated = treatment.clone();
        let thread = thread::spawn(move || run(&socket, server, &treated, seed));
        Self { address, treatment, thread: Some(thread) }
    }

    /// Cuts the way, or opens it again.
    pub fn cut(&self, is_cut: bool) {
        self.treatment.is_cut.store(is_cut, Relaxed);
    }

    /// Loses this share of packets each way, from 0 to 1.
    pub fn lose(&self, share: f64) {
        self.treatment.loss.store((share * 1_000.0) as u32, Relaxed);
    }

    /// Gives each client another address at the server.
    pub fn change_addresses(&self) {
        self.treatment.moves.store(true, Relaxed);
    }

    /// How many packets have passed.
    pub fn passed(&self) -> u64 {
        self.treatment.passed.load(Relaxed)
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.treatment.ends.store(true, Relaxed);
        let _ = self.thread.take().unwrap().join();
    }
}

/// Passes packets on. Each client has a socket towards the server, as behind a router.
fn run(socket: &UdpSocket, server: SocketAddr, treatment: &Arc<Treatment>, seed: u64) {
    socket.set_read_timeout(Some(LOOK)).unwrap();
    let mut random = SmallRng::seed_from_u64(seed);
    let mut ways: HashMap<SocketAddr, Arc<UdpSocket>> = HashMap::new();
    let mut returns = Vec::new();
    let mut packet = [0; PACKET_BYTES_MAX];
    while !treatment.ends.load(Relaxed) {
        if treatment.moves.swap(false, Relaxed) {
            ways.clear();
        }
        let Ok((bytes, client)) = socket.recv_from(&mut packet) else { continue };
        let way = ways.entry(client).or_insert_with(|| {
            let way = Arc::new(UdpSocket::bind("127.0.0.1:0").unwrap());
            let (back, socket, treatment) =
                (way.clone(), socket.try_clone().unwrap(), treatment.clone());
            let seed = random.random();
            returns
                .push(thread::spawn(move || bring_back(&back, &socket, client, &treatment, seed)));
            way
        });
        if treatment.lets_pass(&mut random) {
            let _ = way.send_to(&packet[..bytes], server);
        }
    }
    returns.into_iter().for_each(|thread| thread.join().unwrap());
}

/// Passes on what the server sends to a client.
fn bring_back(
    way: &UdpSocket,
    socket: &UdpSocket,
    client: SocketAddr,
    treatment: &Treatment,
    seed: u64,
) {
    way.set_read_timeout(Some(LOOK)).unwrap();
    let mut random = SmallRng::seed_from_u64(seed);
    let mut packet = [0; PACKET_BYTES_MAX];
    while !treatment.ends.load(Relaxed) {
        let Ok((bytes, _)) = way.recv_from(&mut packet) else { continue };
        if treatment.lets_pass(&mut random) {
            let _ = socket.send_to(&packet[..bytes], client);
        }
    }
}

impl Treatment {
    fn lets_pass(&self, random: &mut SmallRng) -> bool {
        let is_lost = random.random_range(0..1_000) < self.loss.load(Relaxed);
        let passes = !is_lost && !self.is_cut.load(Relaxed);
        self.passed.fetch_add(u64::from(passes), Relaxed);
        passes
    }
}
