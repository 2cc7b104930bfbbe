//! A session: a client in a world, which listens, answers and reports by itself.

mod driver;
mod state;

use std::{
    sync::{Arc, atomic::Ordering::Relaxed},
    time::Duration,
};

use quinn::VarInt;
use sightline_client_core::{
    arriving::ArrivingWorld,
    presence::{Link, Presence},
    replica::{AvatarSource, Event, HeldAvatar, ShownAvatar, Update},
    reporting::ReportingCounts,
};
use sightline_protocol::text::{ChatLine, TextError};
use sightline_world::{
    World,
    geometry::Aabb,
    motion::{AvatarId, Pose, ReportingState},
};
use tokio::{sync::mpsc, task::JoinHandle, time::timeout};

use self::{
    driver::{COMMANDS_MAX, Driver, FAREWELL_DEADLINE, SessionCommand},
    state::SharedState,
};
use super::{
    cache::WorldCache,
    control_stream::ControlStream,
    error::ConnectError,
    passage::{ArrivedOffer, Ways, offered_world},
    piece_traffic::PieceTraffic,
    returning::Caller,
};

/// A client that has been welcomed, and has no world yet.
pub(super) struct Welcomed {
    pub(super) control: ControlStream,
    pub(super) avatar: AvatarId,
    pub(super) tick_interval: Duration,
}

/// How a client stands with its server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SessionState {
    /// It is in the world.
    Present,
    /// The server has replaced the world, and the client is not in the new one yet.
    MovingOver,
    /// The link broke. The client tries to come back, for up to ten minutes.
    Returning {
        /// Why the link broke, to show to people.
        reason: String,
        /// For how long it has been broken.
        lost_for: Duration,
    },
    /// The session ended, for this reason.
    Ended(String),
}

/// A client in a world. Its methods never wait for the network, and may be called from any thread.
/// When its link breaks, it comes back by itself.
/// Dropping it ends the connection; [`Session::leave`] says goodbye first.
pub struct Session {
    shared: Arc<SharedState>,
    commands: mpsc::Sender<SessionCommand>,
    task: JoinHandle<()>,
}

/// What a session counted and measured up to now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SessionStats {
    /// What the server expects of this client; `None` before it is in the world, and while the link
    /// is broken.
    pub reporting_state: Option<ReportingState>,
    /// The number of avatars that the replica holds.
    pub visible: usize,
    /// Application messages received: control messages and datagrams.
    pub messages_in: u64,
    /// Application messages sent: control messages and datagrams.
    pub messages_out: u64,
    /// How many datagrams with poses have arrived on this connection, and how many the server has
    /// sent by then.
    pub delivered: [u32; 2],
    /// Bytes of the received messages, without QUIC's own.
    pub bytes_in: u64,
    /// Bytes of the sent messages, without QUIC's own.
    pub bytes_out: u64,
    /// UDP payload received, in bytes, with QUIC's own and the download of the world.
    pub udp_bytes_in: u64,
    /// UDP payload sent, in bytes, with QUIC's own.
    pub udp_bytes_out: u64,
    /// UDP payload received in the last second, in bytes per second.
    pub udp_rate_in: f64,
    /// UDP payload sent in the last second, in bytes per second.
    pub udp_rate_out: f64,
    /// For how many of its ticks this client was quiet, or on course.
    pub reporting: ReportingCounts,
    /// The time since the session started.
    pub elapsed: Duration,
    /// QUIC's estimate of the round trip.
    pub round_trip: Duration,
    /// How often the link broke and the client came back.
    pub returns: u32,
}

impl Session {
    /// Gets the world that the server offers and enters it, then lets the session run by itself.
    pub(super) async fn start(
        welcomed: Welcomed,
        caller: Caller,
        cache: Arc<WorldCache>,
    ) -> Result<Self, ConnectError> {
        let Welcomed { mut control, avatar, tick_interval } = welcomed;
        let ways = Ways {
            cache: &cache,
            in_pieces: caller.options.in_pieces,
            present: None,
            progress: caller.options.progress.as_ref(),
        };
        let ArrivedOffer { number, world, pieces } =
            offered_world(&mut control, ways, None).await?;
        let (name, place) = (caller.options.name.clone(), caller.options.place);
        let presence = Presence::new(avatar, tick_interval, world, name);
        let traffic = pieces.as_ref().map(|(traffic, _)| traffic.clone());
        let shared = Arc::new(SharedState::new(control.connection.clone(), presence, traffic));
        let mut driver = Driver::new(control, caller, cache, shared.clone());
        driver.carry(number, pieces);
        driver.enter(number, place).await?;
        let (commands, inbox) = mpsc::channel(COMMANDS_MAX);
        let task = tokio::spawn(driver.run(inbox));
        Ok(Self { shared, commands, task })
    }

    /// The building. The server may replace it: each [`Event::Entered`] may be in another one.
    /// Where it arrives in pieces, it has no voxels and no mesh: see [`Session::building`].
    pub fn world(&self) -> Arc<World> {
        self.shared.lock().presence.world().clone()
    }

    /// The building with what is here of it, for one who goes on to ask for the pieces that are
    /// missing. To be called once for each building.
    pub fn building(&self) -> ArrivingWorld {
        let state = self.shared.lock();
        match state.pieces.as_ref().and_then(|pieces| pieces.take_head()) {
            Some(head) => ArrivingWorld::from_head(head),
            None => ArrivingWorld::whole(state.presence.world().clone()),
        }
    }

    /// Asks for pieces of a building, the most urgent first, unless another one has taken its
    /// place. They come however often the link breaks meanwhile.
    pub fn ask_for_pieces(&self, building: &ArrivingWorld, numbers: &[usize]) {
        if let Some(pieces) = self.pieces_of(building) {
            pieces.ask(numbers);
        }
    }

    /// The pieces of a building that have come since the last call, with their numbers.
    pub fn arrived_pieces(&self, building: &ArrivingWorld) -> Vec<(usize, Vec<u8>)> {
        self.pieces_of(building).map(|pieces| pieces.take_arrived()).unwrap_or_default()
    }

    /// The pieces of a building that the server did not hand out since the last call.
    pub fn refused_pieces(&self, building: &ArrivingWorld) -> Vec<usize> {
        self.pieces_of(building).map(|pieces| pieces.take_refused()).unwrap_or_default()
    }

    fn pieces_of(&self, building: &ArrivingWorld) -> Option<Arc<PieceTraffic>> {
        self.shared.lock().pieces.clone().filter(|pieces| building.is(&pieces.world))
    }

    /// Ends the session, because the building cannot be used.
    pub fn give_up(&self, reason: String) {
        let _ = self.commands.try_send(SessionCommand::GiveUp(reason));
    }

    /// How the client stands with its server.
    pub fn state(&self) -> SessionState {
        let now = self.shared.now();
        let state = self.shared.lock();
        match (&state.end, state.presence.link()) {
            (Some(reason), _) => SessionState::Ended(reason.clone()),
            (None, Link::Present) => SessionState::Present,
            (None, Link::MovingOver) => SessionState::MovingOver,
            (None, Link::Broken(at, reason)) => {
                let (reason, lost_for) = (reason.clone(), now.saturating_sub(*at));
                SessionState::Returning { reason, lost_for }
            }
        }
    }

    /// Whether the client is in the world. Otherwise its avatar stands still.
    pub fn is_present(&self) -> bool {
        self.state() == SessionState::Present
    }

    /// The server's time from tick to tick.
    pub fn tick_interval(&self) -> Duration {
        self.shared.lock().presence.replica.tick_interval()
    }

    /// The id of this client's avatar.
    pub fn avatar(&self) -> AvatarId {
        self.shared.lock().presence.replica.avatar()
    }

    /// Sets the pose of this client's avatar, once per frame. The session reports it when it must:
    /// as it is at the client's tick, between two frames or straight on from the last one.
    pub fn set_pose(&self, pose: Pose) {
        let now = self.shared.now();
        self.shared.lock().presence.set_pose(now, pose);
    }

    /// The pose of this client's avatar: the last one set, entered with or corrected to, or
    /// straight on from there.
    pub fn pose(&self) -> Pose {
        self.shared.lock().presence.replica.pose()
    }

    /// The avatars that may be in view, with the poses to draw now.
    pub fn shown_avatars(&self) -> Vec<ShownAvatar> {
        let now = self.shared.now();
        self.shared.lock().presence.replica.shown_avatars(now)
    }

    /// The server's time of the moment that is drawn now: see
    /// [`sightline_client_core::replica::Replica::server_time`].
    pub fn server_time(&self) -> Duration {
        let now = self.shared.now();
        self.shared.lock().presence.replica.server_time(now)
    }

    /// The avatars that may be in view, as the server last described them.
    pub fn held(&self) -> Vec<HeldAvatar> {
        let now = self.shared.now();
        self.shared.lock().presence.replica.held(now).collect()
    }

    /// Says something to the clients that may see this avatar. Drops the line when too many wait.
    ///
    /// # Errors
    /// When the text is empty, too long, or has characters that cannot be shown.
    pub fn chat(&self, text: &str) -> Result<(), TextError> {
        let line = ChatLine::new(text)?;
        let _ = self.commands.try_send(SessionCommand::Say(line));
        Ok(())
    }

    /// Asks the server to put this avatar back to a spawn point. [`Event::Corrected`] follows,
    /// unless the client asks too often.
    pub fn respawn(&self) {
        let _ = self.commands.try_send(SessionCommand::Respawn);
    }

    /// The events since the last call, oldest first.
    pub fn events(&self) -> Vec<Event> {
        self.shared.lock().presence.take_events()
    }

    /// Why the session ended; `None` while it runs.
    pub fn end(&self) -> Option<String> {
        self.shared.lock().end.clone()
    }

    /// What was counted and measured up to now.
    pub fn stats(&self) -> SessionStats {
        let now = self.shared.now();
        let state = self.shared.lock();
        let [udp_rate_in, udp_rate_out] = state.meter.rate();
        let [udp_bytes_in, udp_bytes_out] = state.udp_bytes();
        let is_heard = !matches!(state.presence.link(), Link::Broken(..));
        SessionStats {
            reporting_state: state.presence.replica.reporting_state().filter(|_| is_heard),
            visible: state.presence.replica.held_len(),
            messages_in: self.shared.messages_in.load(Relaxed),
            messages_out: self.shared.messages_out.load(Relaxed),
            delivered: state.presence.replica.delivered(),
            bytes_in: self.shared.bytes_in.load(Relaxed),
            bytes_out: self.shared.bytes_out.load(Relaxed),
            udp_bytes_in,
            udp_bytes_out,
            udp_rate_in,
            udp_rate_out,
            reporting: state.presence.replica.reporting_counts(),
            elapsed: now,
            round_trip: state.connection.rtt(),
            returns: state.presence.returns(),
        }
    }

    /// Says goodbye, and waits until it has arrived, for at most two seconds.
    pub async fn leave(mut self) {
        let _ = self.commands.try_send(SessionCommand::Leave);
        let _ = timeout(FAREWELL_DEADLINE, &mut self.task).await;
    }
}

impl AvatarSource for &Session {
    fn updates(&mut self) -> Vec<(AvatarId, Update)> {
        self.shared.lock().presence.replica.updates()
    }

    fn path(&self, avatar: AvatarId, now: Duration, until: Duration) -> Option<(Pose, Aabb)> {
        self.shared.lock().presence.replica.path(avatar, now, until)
    }

    fn shown(&self, avatar: AvatarId, now: Duration) -> Option<ShownAvatar> {
        self.shared.lock().presence.replica.shown(avatar, now)
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.task.abort();
        self.shared.lock().connection.close(VarInt::from_u32(0), b"");
    }
}
