//! The task that accepts connections, and gives each a session of its own.

use std::{
    net::IpAddr,
    sync::{Arc, atomic::Ordering::Relaxed},
    time::Duration,
};

#[cfg(feature = "web")]
use quinn::{Connection, crypto::rustls::HandshakeData};
use quinn::{Endpoint, Incoming};
use tokio::{sync::mpsc, task::JoinSet, time::timeout};

use super::{
    admission::{Answer, ConnectionId},
    budget::TokenBucket,
    entrance,
    session::{self, SessionEnd},
    state::ServerState,
    transport::{CloseCode, QuicTransport, Transport},
};
#[cfg(feature = "web")]
use super::{certificates::HTTP3, transport::WebTransport};
use crate::operate::Reason;

/// How many refused connections are logged in a second at most.
const LOG_LINES_PER_SECOND: f64 = 10.0;
/// How often the log says how many lines about a peer were left out.
const SUMMARY_INTERVAL: Duration = Duration::from_secs(10);
/// How often avatars whose clients have not come back in time are looked for.
const OVERDUE_INTERVAL: Duration = Duration::from_secs(1);

/// Accepts connections until the server closes, then waits for all sessions to end. Other listeners
/// bring some, too.
pub async fn accept(
    endpoint: Endpoint,
    mut arriving: mpsc::Receiver<Transport>,
    state: Arc<ServerState>,
) {
    let mut sessions = JoinSet::new();
    let mut closing = state.closing.clone();
    let mut log = TokenBucket::new(LOG_LINES_PER_SECOND, LOG_LINES_PER_SECOND, state.now());
    let mut summaries = tokio::time::interval(SUMMARY_INTERVAL);
    let connections_max = state.config.connections_max();
    let parting = tokio::spawn(part_overdue(state.clone()));
    loop {
        let incoming = tokio::select! {
            incoming = endpoint.accept() => incoming,
            () = async { drop(closing.wait_for(|closing| *closing).await) } => break,
            Some(transport) = arriving.recv() => {
                let has_room = sessions.len() < connections_max;
                if let Some(id) = begin_proven(&state, &transport, has_room) {
                    let session = converse_on(state.clone(), transport, id);
                    sessions.spawn(supervise(state.clone(), id, session));
                }
                continue;
            }
            Some(_) = sessions.join_next() => continue,
            _ = summaries.tick() => {
                log_summaries(&state);
                continue;
            }
        };
        let Some(incoming) = incoming else { break };
        let address = incoming.remote_address().ip();
        let Some((id, answer)) =
            (sessions.len() < connections_max).then(|| begin(&state, &incoming, address))
        else {
            state.metrics.refusals.count(Reason::Connections);
            incoming.refuse();
            continue;
        };
        match answer {
            Answer::Accept => {
                let session = converse(state.clone(), incoming, id);
                sessions.spawn(supervise(state.clone(), id, session));
            }
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
    let _ = parting.await;
}

/// Lets those go who do not come back in time, until the server closes. It waits for the engine,
/// and new connections do not.
async fn part_overdue(state: Arc<ServerState>) {
    let mut closing = state.closing.clone();
    let mut overdue = tokio::time::interval(OVERDUE_INTERVAL);
    loop {
        tokio::select! {
            () = async { drop(closing.wait_for(|closing| *closing).await) } => return,
            _ = overdue.tick() => entrance::part_overdue(&state).await,
        }
    }
}

/// Decides on an attempt to connect, which has a number from now on.
fn begin(state: &ServerState, incoming: &Incoming, address: IpAddr) -> (ConnectionId, Answer) {
    let is_proven = incoming.remote_address_validated();
    let before_retry = state.config.limits.handshakes_before_retry;
    let mut registry = state.registry();
    let id = registry.number();
    let answer = if !is_proven && state.handshakes.load(Relaxed) >= before_retry {
        Answer::ProveAddress
    } else {
        registry.places.begin(id, address, is_proven)
    };
    match answer {
        Answer::Accept => {}
        Answer::ProveAddress => state.metrics.refusals.count(Reason::Unproven),
        Answer::Refuse => state.metrics.refusals.count(Reason::ConnectionsOfNetwork),
    }
    (id, answer)
}

/// Decides on a connection of another listener, whose handshake proved its address. `None` when it
/// is refused.
fn begin_proven(
    state: &ServerState,
    transport: &Transport,
    has_room: bool,
) -> Option<ConnectionId> {
    let begun = {
        let mut registry = state.registry();
        let id = registry.number();
        let address = transport.remote_address().ip();
        let answer = has_room.then(|| registry.places.begin(id, address, true));
        (answer == Some(Answer::Accept)).then_some(id)
    };
    if begun.is_none() {
        let reason = if has_room { Reason::ConnectionsOfNetwork } else { Reason::Connections };
        state.metrics.refusals.count(reason);
        transport.close(CloseCode::Refused, "too many connections");
    }
    begun
}

/// Runs a session on a connection whose handshake is done.
async fn converse_on(
    state: Arc<ServerState>,
    transport: Transport,
    id: ConnectionId,
) -> Option<SessionEnd> {
    Some(session::run(&state, transport, id).await)
}

fn log_summaries(state: &ServerState) {
    let summaries = state.registry().log.summaries(state.now());
    for (network, lines) in summaries {
        tracing::info!(%network, lines, "more joined and left than are logged");
    }
}

/// Runs a session in a task of its own, so that a panic ends only that session. Cleans up after it.
async fn supervise(
    state: Arc<ServerState>,
    id: ConnectionId,
    session: impl Future<Output = Option<SessionEnd>> + Send + 'static,
) {
    let end = match tokio::spawn(session).await {
        Ok(end) => end,
        Err(panic) => {
            tracing::error!(connection = id.0, %panic, "a session panicked");
            Some(SessionEnd::Failed)
        }
    };
    entrance::part(&state, id, end.as_ref()).await;
}

/// Does the handshake of a native client, or of a browser with HTTP/3 behind it.
async fn shake_hands(state: &ServerState, incoming: Incoming) -> Option<Transport> {
    let connection = incoming.await.ok()?;
    #[cfg(feature = "web")]
    if is_browser(&connection) {
        let web = WebTransport::accept(connection, &state.config).await?;
        return Some(Transport::WebTransport(web));
    }
    #[cfg(not(feature = "web"))]
    let _ = state;
    Some(Transport::Quic(QuicTransport::new(connection)))
}

/// Whether a connection speaks HTTP/3.
#[cfg(feature = "web")]
fn is_browser(connection: &Connection) -> bool {
    let data = connection.handshake_data().and_then(|data| data.downcast::<HandshakeData>().ok());
    data.and_then(|data| data.protocol).is_some_and(|protocol| protocol == HTTP3)
}

/// Runs a session from its handshake to its end. `None` when the handshake failed.
async fn converse(
    state: Arc<ServerState>,
    incoming: Incoming,
    id: ConnectionId,
) -> Option<SessionEnd> {
    state.handshakes.fetch_add(1, Relaxed);
    let deadline = Duration::from_secs_f64(state.config.hello_s);
    let connection = timeout(deadline, shake_hands(&state, incoming)).await;
    let before = state.handshakes.fetch_sub(1, Relaxed);
    debug_assert!(before > 0, "this handshake was counted");
    if connection.is_err() {
        state.metrics.refusals.count(Reason::Hello);
    }
    let transport = connection.ok()??;
    let address = transport.remote_address().ip();
    if !state.registry().places.prove(id, address) {
        state.metrics.refusals.count(Reason::ConnectionsOfNetwork);
        transport.close(CloseCode::Refused, "too many connections from this address");
        return None;
    }
    Some(session::run(&state, transport, id).await)
}

#[cfg(test)]
mod tests;
