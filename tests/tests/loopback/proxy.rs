//! A UDP proxy between clients and a server, which loses, delays, reorders and doubles packets by a
//! seed, cuts the way, or changes the address that the server sees.

use std::{
    cmp::Reverse,
    collections::{BinaryHeap, HashMap},
    net::{SocketAddr, UdpSocket},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed},
        mpsc::{self, Receiver, RecvTimeoutError, Sender},
    },
    thread,
    time::{Duration, Instant},
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
    /// How long each packet takes one way, and by up to how much longer, in milliseconds.
    delay_ms: AtomicU32,
    jitter_ms: AtomicU32,
    /// The share of packets that arrive twice, in thousandths.
    doubled: AtomicU32,
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

    /// Delays each packet one way by this time, and by up to `jitter` more, so that packets
    /// overtake each other.
    pub fn delay(&self, one_way: Duration, jitter: Duration) {
        self.treatment.delay_ms.store(one_way.as_millis() as u32, Relaxed);
        self.treatment.jitter_ms.store(jitter.as_millis() as u32, Relaxed);
    }

    /// Delivers this share of packets twice, from 0 to 1.
    pub fn double(&self, share: f64) {
        self.treatment.doubled.store((share * 1_000.0) as u32, Relaxed);
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

/// A packet on its way.
struct Packet {
    due: Instant,
    /// Packets that are due at the same time keep their order.
    number: u64,
    from: Arc<UdpSocket>,
    to: SocketAddr,
    bytes: Vec<u8>,
}

/// Passes packets on. Each client has a socket towards the server, as behind a router.
fn run(socket: &UdpSocket, server: SocketAddr, treatment: &Arc<Treatment>, seed: u64) {
    socket.set_read_timeout(Some(LOOK)).unwrap();
    let own = Arc::new(socket.try_clone().unwrap());
    let (post, waiting) = mpsc::channel();
    let mut threads = vec![thread::spawn(move || deliver(&waiting))];
    let mut random = SmallRng::seed_from_u64(seed);
    let mut ways: HashMap<SocketAddr, Arc<UdpSocket>> = HashMap::new();
    let mut bytes = [0; PACKET_BYTES_MAX];
    while !treatment.ends.load(Relaxed) {
        if treatment.moves.swap(false, Relaxed) {
            ways.clear();
        }
        let Ok((length, client)) = socket.recv_from(&mut bytes) else { continue };
        let way = ways.entry(client).or_insert_with(|| {
            let way = Arc::new(UdpSocket::bind("127.0.0.1:0").unwrap());
            let (back, own, treatment, post) =
                (way.clone(), own.clone(), treatment.clone(), post.clone());
            let random = SmallRng::seed_from_u64(random.random());
            threads.push(thread::spawn(move || {
                bring_back(&back, &own, client, &treatment, &post, random);
            }));
            way
        });
        treatment.pass(&mut random, &post, way, server, &bytes[..length]);
    }
    drop(post);
    threads.into_iter().for_each(|thread| thread.join().unwrap());
}

/// Passes on what the server sends to a client.
fn bring_back(
    way: &UdpSocket,
    own: &Arc<UdpSocket>,
    client: SocketAddr,
    treatment: &Treatment,
    post: &Sender<Packet>,
    mut random: SmallRng,
) {
    way.set_read_timeout(Some(LOOK)).unwrap();
    let mut bytes = [0; PACKET_BYTES_MAX];
    while !treatment.ends.load(Relaxed) {
        let Ok((length, _)) = way.recv_from(&mut bytes) else { continue };
        treatment.pass(&mut random, post, own, client, &bytes[..length]);
    }
}

/// Sends packets when they are due, until nobody posts any more.
fn deliver(post: &Receiver<Packet>) {
    let mut waiting: BinaryHeap<Reverse<Packet>> = BinaryHeap::new();
    loop {
        let next = waiting.peek().map(|Reverse(packet)| packet.due);
        let pause = next.map_or(LOOK, |due| due.saturating_duration_since(Instant::now()));
        match post.recv_timeout(pause) {
            Ok(packet) => waiting.push(Reverse(packet)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        while waiting.peek().is_some_and(|Reverse(packet)| packet.due <= Instant::now())
            && let Some(Reverse(packet)) = waiting.pop()
        {
            let _ = packet.from.send_to(&packet.bytes, packet.to);
        }
    }
}

impl Treatment {
    fn pass(
        &self,
        random: &mut SmallRng,
        post: &Sender<Packet>,
        from: &Arc<UdpSocket>,
        to: SocketAddr,
        bytes: &[u8],
    ) {
        let mut happens = |share: &AtomicU32| random.random_range(0..1_000) < share.load(Relaxed);
        if happens(&self.loss) || self.is_cut.load(Relaxed) {
            return;
        }
        let copies = if happens(&self.doubled) { 2 } else { 1 };
        for _ in 0..copies {
            let jitter_ms = random.random_range(0..=self.jitter_ms.load(Relaxed));
            let delay_ms = self.delay_ms.load(Relaxed) + jitter_ms;
            let due = Instant::now() + Duration::from_millis(delay_ms.into());
            let number = self.passed.fetch_add(1, Relaxed);
            let packet = Packet { due, number, from: from.clone(), to, bytes: bytes.to_vec() };
            // Nobody delivers any more when the proxy ends.
            let _ = post.send(packet);
        }
    }
}

impl Ord for Packet {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.due, self.number).cmp(&(other.due, other.number))
    }
}

impl PartialOrd for Packet {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Packet {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Packet {}
