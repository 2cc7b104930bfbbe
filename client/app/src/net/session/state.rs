//! What a session's methods and its task share.

use std::{
    collections::VecDeque,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use quinn::Connection;
use sightline_client_core::replica::{Event, Replica};
use sightline_protocol::text::Name;
use sightline_world::{
    World,
    motion::{Agility, AvatarId, Pose},
};

/// Who is put no farther away than this, in metres, goes on where it was.
const GOES_ON_M: f32 = 1.0;
/// The own avatar is not moved on by itself for longer than this.
const MOVE_ON_MAX: Duration = Duration::from_millis(50);
/// The number of events kept for the caller. Beyond it, the oldest are dropped.
const EVENTS_MAX: usize = 1_024;

/// The state of a session, shared by its methods and its task.
pub(super) struct SharedState {
    started: Instant,
    /// The name of this client, as the server knows it.
    pub(super) name: Name,
    locked: Mutex<LockedState>,
    pub(super) messages_in: AtomicU64,
    pub(super) messages_out: AtomicU64,
    pub(super) bytes_in: AtomicU64,
    pub(super) bytes_out: AtomicU64,
}

/// How the client stands with the server. Unless it is present, its avatar stands still.
#[derive(Clone, Debug)]
pub(super) enum Link {
    /// It is in the world.
    Present,
    /// It is on its way into another world.
    MovingOver,
    /// The link broke at a time, for a reason.
    Broken(Duration, String),
}

/// The part of the state behind a lock.
pub(super) struct LockedState {
    pub(super) connection: Connection,
    pub(super) replica: Replica,
    /// The world that the client is in, or was in last.
    pub(super) world: Arc<World>,
    pub(super) link: Link,
    /// How often the link broke and the client came back.
    pub(super) returns: u32,
    /// The pose of the own avatar as it was last set, and when.
    pub(super) posed: Option<(Duration, Pose)>,
    pub(super) events: VecDeque<Event>,
    /// Why the session ended; `None` while it runs.
    pub(super) end: Option<String>,
    pub(super) meter: RateMeter,
    /// The UDP bytes received and sent on connections that broke.
    udp_before: [u64; 2],
}

/// Measures UDP bytes per second in both directions, once a second.
#[derive(Default)]
pub(super) struct RateMeter {
    /// When the current second began.
    at: Duration,
    /// The bytes received and sent until then.
    bytes: [u64; 2],
    /// The bytes received and sent in the second before it, per second.
    rate: [f64; 2],
}

impl SharedState {
    /// The state of a session that starts now.
    pub(super) fn new(
        connection: Connection,
        replica: Replica,
        world: Arc<World>,
        name: Name,
    ) -> Self {
        Self {
            started: Instant::now(),
            name,
            locked: Mutex::new(LockedState::new(connection, replica, world)),
            messages_in: AtomicU64::new(0),
            messages_out: AtomicU64::new(0),
            bytes_in: AtomicU64::new(0),
            bytes_out: AtomicU64::new(0),
        }
    }

    /// The time since the session started.
    pub(super) fn now(&self) -> Duration {
        self.started.elapsed()
    }

    /// Locks the state. A panic elsewhere leaves it usable: no holder of the lock stops half way.
    pub(super) fn lock(&self) -> MutexGuard<'_, LockedState> {
        self.locked.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a received message.
    pub(super) fn count_received(&self, bytes: usize) {
        self.messages_in.fetch_add(1, Relaxed);
        self.bytes_in.fetch_add(bytes as u64, Relaxed);
    }

    /// Counts a sent message.
    pub(super) fn count_sent(&self, bytes: usize) {
        self.messages_out.fetch_add(1, Relaxed);
        self.bytes_out.fetch_add(bytes as u64, Relaxed);
    }
}

impl LockedState {
    fn new(connection: Connection, replica: Replica, world: Arc<World>) -> Self {
        Self {
            connection,
            replica,
            world,
            link: Link::Present,
            returns: 0,
            posed: None,
            events: VecDeque::new(),
            end: None,
            meter: RateMeter::default(),
            udp_before: [0; 2],
        }
    }

    /// The UDP bytes received and sent so far.
    pub(super) fn udp_bytes(&self) -> [u64; 2] {
        let stats = self.connection.stats();
        [self.udp_before[0] + stats.udp_rx.bytes, self.udp_before[1] + stats.udp_tx.bytes]
    }

    /// Stands still until the client is in a world again.
    pub(super) fn stand(&mut self, now: Duration, link: Link) {
        self.move_on(now);
        self.posed = None;
        self.link = link;
    }

    /// Begins anew on another connection, and in a world. Returns as
    /// [`leave_world`](Self::leave_world).
    pub(super) fn reconnect(
        &mut self,
        welcomed: (Connection, AvatarId, Duration),
        world: Arc<World>,
    ) -> (Pose, u32) {
        let (connection, avatar, tick_interval) = welcomed;
        self.udp_before = self.udp_bytes();
        self.connection = connection;
        let agility = Agility::of(&world.body, world.speed_max);
        let reports_from = self.replica.reconnect(avatar, tick_interval, agility);
        self.world = world;
        self.returns += 1;
        (self.replica.pose(), reports_from)
    }

    /// Leaves the world for another one, whose world file is here. Returns where the client asks to
    /// go on, and from when its reports are about the other world.
    pub(super) fn leave_world(&mut self, world: Arc<World>) -> (Pose, u32) {
        let reports_from = self.replica.leave_world(Agility::of(&world.body, world.speed_max));
        self.world = world;
        (self.replica.pose(), reports_from)
    }

    /// Moves over into another world: the client is given a place there. Who goes on near its
    /// former place looks where it looked.
    pub(super) fn move_over(&mut self, from: &Pose, given: Pose) -> Pose {
        let goes_on = from.eye.distance(given.eye) < GOES_ON_M;
        let (yaw, pitch) = if goes_on { (from.yaw, from.pitch) } else { (given.yaw, given.pitch) };
        let pose = Pose { yaw, pitch, ..given };
        self.replica.set_pose(pose);
        self.link = Link::Present;
        pose
    }

    /// Moves the own avatar on to where it is now, straight on from where it was last set.
    pub(super) fn move_on(&mut self, now: Duration) {
        if let Some((at, pose)) = self.posed {
            self.replica.set_pose(moved_on(pose, now.saturating_sub(at)));
        }
    }

    /// Keeps an event for the caller. Drops the oldest one when too many wait.
    pub(super) fn push_event(&mut self, event: Event) {
        if self.events.len() >= EVENTS_MAX {
            self.events.pop_front();
        }
        self.events.push_back(event);
        debug_assert!(self.events.len() <= EVENTS_MAX, "the queue is bounded");
    }
}

/// A pose so long after it was set: straight on, for a short while.
fn moved_on(pose: Pose, after: Duration) -> Pose {
    pose.straight_on(after.min(MOVE_ON_MAX))
}

impl RateMeter {
    /// Takes in the bytes received and sent since the connection opened.
    pub(super) fn read(&mut self, now: Duration, bytes: [u64; 2]) {
        let passed = now.saturating_sub(self.at).as_secs_f64();
        if passed >= 1.0 {
            let rate = |i: usize| bytes[i].saturating_sub(self.bytes[i]) as f64 / passed;
            self.rate = [rate(0), rate(1)];
            (self.at, self.bytes) = (now, bytes);
        }
    }

    /// The bytes received and sent in the last second, per second.
    pub(super) fn rate(&self) -> [f64; 2] {
        self.rate
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn between_two_frames_the_own_avatar_goes_straight_on_for_a_short_while() {
        let posed = Pose { eye: Vec3::X, velocity: Vec3::X, ..Pose::default() };
        let places = [0, 20, 50, 800].map(|ms| moved_on(posed, Duration::from_millis(ms)).eye.x);
        assert!(places.iter().zip([1.0, 1.02, 1.05, 1.05]).all(|(x, at)| (x - at).abs() < 1e-5));
    }
}
