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
    admission::{Answer, TokenBucket},
    client::ConnectedClient,
    engine_task::EngineEvent,
    session::{self, SessionEnd},
    state::{ServerState, connections_max},
};

/// The QUIC error code of a server that accepts no more connections (RFC 9000, section 20.1).
const CONNECTION_REFUSED: u32 = 2;
/// With this number of handshakes under way, all newcomers must first prove their address.
const HANDSHAKES_BEFORE_RETRY: usize = 32;
/// How many refused connections are logged in a second at most.
const LOG_LINES_PER_SECOND: f64 = 10.0;
/// How often the log says how many lines about a peer were left out.
const SUMMARY_INTERVAL: Duration = Duration::from_secs(10);

/// Accepts connections until the server closes, then waits for all sessions to end.
pub async fn accept(endpoint: Endpoint, state: Arc<ServerState>) {
    let mut sessions = JoinSet::new();
    let mut closing = state.closing.clone();
    let mut log = TokenBucket::new(LOG_LINES_PER_SECOND, LOG_LINES_PER_SECOND, state.now());
    let mut summaries = tokio::time::interval(SUMMARY_INTERVAL);
    let connections_max = connections_max(state.config.clients_max);
    loop {
        let incoming = tokio::select! {
            incoming = endpoint.accept() => incoming,
            _ = closing.wait_for(|closing| *closing) => break,
            Some(_) = sessions.join_next() => continue,
            _ = summaries.tick() => {
                log_summaries(&state);
                continue;
            }
        };
        let Some(incoming) = incoming else { break };
        let address = incoming.remote_address().ip();
        let Some((avatar, answer)) =
            (sessions.len() < connections_max).then(|| begin(&state, &incoming, address))
        else {
            incoming.refuse();
            continue;
        };
        match answer {
            Answer::Accept => drop(sessions.spawn(supervise(state.clone(), incoming, avatar))),
            // A client that has just proved its address may not have to again.
            Answer::ProveAddress if incoming.may_retry() => drop(incoming.retry()),
            Answer::ProveAddress | Answer::Refuse => {
                if log.take(1.0, state.now()) {
                    tracing::info!(%address, "too many connections: refused");
                }
                incoming.refuse();
            }
        }
    }
    while sessions.join_next().await.is_some() {}
}

/// Decides on an attempt to connect, which has an id from now on if it is accepted.
fn begin(state: &ServerState, incoming: &Incoming, address: IpAddr) -> (AvatarId, Answer) {
    let is_proven = incoming.remote_address_validated();
    let mut registry = state.registry();
    let avatar = registry.ids.draw();
    let answer = if !is_proven && state.handshakes.load(Relaxed) >= HANDSHAKES_BEFORE_RETRY {
        Answer::ProveAddress
    } else {
        registry.places.begin(avatar, address, is_proven)
    };
    if answer != Answer::Accept {
        registry.ids.release(avatar);
    }
    (avatar, answer)
}

fn log_summaries(state: &ServerState) {
    let summaries = state.registry().log.summaries(state.now());
    for (network, lines) in summaries {
        tracing::info!(%network, lines, "more joined and left than are logged");
    }
}

/// Runs a session in a task of its own, so that a panic ends only that session. Cleans up after it.
async fn supervise(state: Arc<ServerState>, incoming: Incoming, avatar: AvatarId) {
    let address = incoming.remote_address().ip();
    let end = tokio::spawn(converse(state.clone(), incoming, avatar)).await;
    let was_admitted = {
        let mut registry = state.registry();
        registry.places.end(avatar);
        registry.names.release(avatar);
        registry.clients.remove(&avatar).is_some()
    };
    state.offers.release(avatar);
    match end {
        Ok(Some(end)) if was_admitted => {
            if state.may_log(address) {
                tracing::info!(avatar = avatar.0, end = ?end.to_string(), "left");
            }
        }
        Ok(end) => {
            let end = end.map(|end| end.to_string());
            tracing::debug!(avatar = avatar.0, ?end, "a connection was not admitted");
        }
        Err(panic) => tracing::error!(avatar = avatar.0, %panic, "a session panicked"),
    }
    // The engine's thread may have ended already.
    state.tell_engine(EngineEvent::Leave(avatar)).await;
    state.registry().ids.release(avatar);
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
    let address = connection.remote_address().ip();
    if !state.registry().places.prove(avatar, address) {
        connection.close(CONNECTION_REFUSED.into(), b"too many connections from this address");
        return None;
    }
    let client = Arc::new(ConnectedClient::new(avatar, connection, state.config.tick_interval()));
    Some(session::run(&state, client).await)
}
