//! The task that accepts connections, and gives each a session of its own.

use std::{
    net::IpAddr,
    sync::{Arc, atomic::Ordering::Relaxed},
    time::Duration,
};

use quinn::{Endpoint, Incoming};
use sightline_world::motion::AvatarId;
use tokio::{task::JoinSet, time::timeout};

use super::{
    admission::TokenBucket,
    client::ConnectedClient,
    engine_task::EngineEvent,
    session::{self, SessionEnd},
    state::ServerState,
};

/// How many connections may exist beyond those of clients: in their handshake, or about to be
/// refused with a reason.
const CONNECTIONS_SPARE: usize = 64;
/// With this number of handshakes under way, newcomers must first prove their address.
const HANDSHAKES_BEFORE_RETRY: usize = 32;
/// How many refused connections are logged in a second at most.
const LOG_LINES_PER_SECOND: f64 = 10.0;

/// Accepts connections until the server closes, then waits for all sessions to end.
pub async fn accept(endpoint: Endpoint, state: Arc<ServerState>) {
    let mut sessions = JoinSet::new();
    let mut closing = state.closing.clone();
    let mut log = TokenBucket::new(LOG_LINES_PER_SECOND, LOG_LINES_PER_SECOND, state.now());
    let connections_max = state.config.clients_max + CONNECTIONS_SPARE;
    loop {
        let incoming = tokio::select! {
            incoming = endpoint.accept() => incoming,
            _ = closing.wait_for(|closing| *closing) => break,
            Some(_) = sessions.join_next() => continue,
        };
        let Some(incoming) = incoming else { break };
        if must_prove_address(&state, &incoming) {
            let _ = incoming.retry();
            continue;
        }
        let address = incoming.remote_address().ip();
        let per_address = state.config.clients_per_address_max;
        if sessions.len() >= connections_max
            || !state.registry().addresses.admit(address, per_address)
        {
            if log.take(1.0, state.now()) {
                tracing::info!(%address, "too many connections: refused");
            }
            incoming.refuse();
            continue;
        }
        sessions.spawn(supervise(state.clone(), incoming, address));
    }
    while sessions.join_next().await.is_some() {}
}

fn must_prove_address(state: &ServerState, incoming: &Incoming) -> bool {
    state.handshakes.load(Relaxed) >= HANDSHAKES_BEFORE_RETRY
        && !incoming.remote_address_validated()
        && incoming.may_retry()
}

/// Runs a session in a task of its own, so that a panic ends only that session. Cleans up after it.
async fn supervise(state: Arc<ServerState>, incoming: Incoming, address: IpAddr) {
    let avatar = AvatarId(state.newest_avatar.fetch_add(1, Relaxed).wrapping_add(1));
    let end = tokio::spawn(converse(state.clone(), incoming, avatar)).await;
    let was_admitted = {
        let mut registry = state.registry();
        registry.addresses.release(address);
        registry.clients.remove(&avatar).is_some()
    };
    match end {
        Ok(Some(end)) if was_admitted => {
            tracing::info!(avatar = avatar.0, end = ?end.to_string(), "left");
        }
        Ok(end) => {
            let end = end.map(|end| end.to_string());
            tracing::debug!(avatar = avatar.0, ?end, "a connection was not admitted");
        }
        Err(panic) => tracing::error!(avatar = avatar.0, %panic, "a session panicked"),
    }
    // The engine's thread may have ended already.
    state.tell_engine(EngineEvent::Leave(avatar)).await;
}

/// Runs a session from its handshake to its end. `None` when the handshake failed.
async fn converse(
    state: Arc<ServerState>,
    incoming: Incoming,
    avatar: AvatarId,
) -> Option<SessionEnd> {
    state.handshakes.fetch_add(1, Relaxed);
    let deadline = Duration::from_secs_f64(state.config.hello_s);
    let connection = timeout(deadline, incoming).await;
    let before = state.handshakes.fetch_sub(1, Relaxed);
    debug_assert!(before > 0, "this handshake was counted");
    let connection = connection.ok()?.ok()?;
    let client = Arc::new(ConnectedClient::new(avatar, connection, state.config.tick_interval()));
    Some(session::run(&state, client).await)
}
