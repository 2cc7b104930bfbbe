//! Visitors come in, come back, and go.

use std::{net::IpAddr, num::NonZeroU32, sync::Arc, time::Duration};

use sightline_protocol::{VERSION, fingerprint::KeyFingerprint, message::Refusal, text::ChatLine};
use sightline_world::motion::AvatarId;
use tokio::sync::oneshot;

use super::{
    admission::{ConnectionId, NoPlace},
    client::{ConnectedClient, Hello, Visit},
    engine_task::EngineEvent,
    kept_name::KeptName,
    names::forms_of,
    session::SessionEnd,
    state::{Registry, ServerState},
    transport::{CloseCode, Transport},
};
use crate::{
    operate::Reason,
    people::{Access, Role},
};

/// What the client before is told when another one takes its place.
const REPLACED: &str = "somebody else came in with your key";

/// A connection whose client has said hello.
pub struct Arrival {
    pub id: ConnectionId,
    pub transport: Arc<Transport>,
    pub hello: Hello,
}

/// A client that was let in.
struct Admitted {
    client: Arc<ConnectedClient>,
    /// The client whose avatar it takes over.
    before: Option<Arc<ConnectedClient>>,
}

/// Lets a client in and welcomes it, if it speaks this version, has a key, and there is room. The
/// owner of a key that is here already gets its avatar back.
pub async fn admit(state: &ServerState, arrival: Arrival) -> Result<Arc<ConnectedClient>, Refusal> {
    let refusals = &state.metrics.refusals;
    if arrival.hello.is_foreign {
        refusals.count(Reason::Version);
        return Err(Refusal::Version { server: VERSION });
    }
    if *state.closing.borrow() {
        refusals.count(Reason::Closing);
        return Err(Refusal::Closing);
    }
    let Some(key) = arrival.hello.key else {
        refusals.count(Reason::NoKey);
        return Err(Refusal::NoKey);
    };
    check_access(state, key, &arrival)?;
    if let Some(avatar) = end_earlier_visit(state, key, &arrival.hello) {
        state.tell_engine(EngineEvent::Leave(avatar)).await;
    }
    // Who is here already has a name.
    let is_here = state.registry().visitors.get(key).is_some();
    let mut name = match is_here {
        true => None,
        false => Some(KeptName::find(state, key, &arrival.hello.name).await),
    };
    let Admitted { client, before } = let_in(state, key, arrival, name.as_mut())?;
    if let Some(client) = before {
        let (noted, is_noted) = oneshot::channel();
        state.tell_engine(EngineEvent::Absent { client, noted: Some(noted) }).await;
        // The client goes on where the one before was, so that must be known when it asks to enter.
        // The engine's thread may have ended already.
        let _ = is_noted.await;
    }
    let interval_us = state.config.tick_interval().as_micros() as u32;
    let interval_us = NonZeroU32::new(interval_us).unwrap_or(NonZeroU32::MIN);
    state.offers.welcome(&client, interval_us);
    Ok(client)
}

/// Whether the owner of a key may come in at all.
fn check_access(
    state: &ServerState,
    key: KeyFingerprint,
    arrival: &Arrival,
) -> Result<(), Refusal> {
    check_ban(state, key, arrival.transport.remote_address().ip())?;
    let standing = state.people.standing(key);
    let is_listed = standing.is_allowed || standing.role > Role::Visitor;
    let invitation = arrival.hello.invitation.as_ref().map(ChatLine::as_str);
    let is_invited = || invitation.is_some_and(|text| state.people.accept_invitation(key, text));
    let may_enter = match state.config.access {
        Access::Open => true,
        Access::AllowList => is_listed,
        Access::Invitation => is_listed || is_invited(),
    };
    if may_enter {
        return Ok(());
    }
    state.metrics.refusals.count(Reason::NotInvited);
    Err(Refusal::NotInvited)
}

fn check_ban(state: &ServerState, key: KeyFingerprint, address: IpAddr) -> Result<(), Refusal> {
    if state.people.is_banned(key, address) {
        state.metrics.refusals.count(Reason::Banned);
        return Err(Refusal::Banned);
    }
    Ok(())
}

/// Ends the visit of a key's owner who comes again with another name or colour, and so begins anew.
/// A page that closes its link at once may lose its goodbye. Returns the avatar that has left.
fn end_earlier_visit(state: &ServerState, key: KeyFingerprint, hello: &Hello) -> Option<AvatarId> {
    let mut registry = state.registry();
    let before = registry.visitors.get(key)?.clone();
    if before.visit.goes_on_with(hello) {
        return None;
    }
    before.replace(REPLACED);
    leave(&mut registry, &before);
    Some(before.avatar())
}

fn let_in(
    state: &ServerState,
    key: KeyFingerprint,
    arrival: Arrival,
    kept: Option<&mut KeptName>,
) -> Result<Admitted, Refusal> {
    let Arrival { id, transport, hello } = arrival;
    let address = transport.remote_address().ip();
    let mut registry = state.registry();
    // Whoever bans looks here afterwards for those to remove.
    check_ban(state, key, address)?;
    let before = registry.visitors.get(key).cloned();
    let visit = match &before {
        Some(before) => {
            before.replace(REPLACED);
            registry.places.take_over(id, before.connection_id);
            before.visit.clone()
        }
        None => {
            let refuse = |reason, refusal| {
                state.metrics.refusals.count(reason);
                Err(refusal)
            };
            let busy = |retry: Duration| Refusal::Busy { retry_ms: retry.as_millis() as u32 };
            if let Some((reason, retry)) = state.load.refuses() {
                return refuse(reason, busy(retry));
            }
            match registry.places.join(id, address) {
                Ok(()) => {}
                Err(NoPlace::Full) => return refuse(Reason::Clients, Refusal::Full),
                Err(NoPlace::Joining) => return refuse(Reason::Joining, busy(state.load.refuse())),
                Err(NoPlace::JoiningOfNetwork) => {
                    return refuse(Reason::JoiningOfNetwork, busy(state.load.refuse()));
                }
            }
            let avatar = registry.ids.draw();
            let name = match kept.and_then(KeptName::take) {
                Some(name) => {
                    registry.names.give(avatar, &name);
                    name
                }
                // It was here a moment ago.
                None => {
                    let name = registry.names.claim(avatar, &hello.name);
                    if let Some(claims) = registry.names.claims() {
                        claims.claim_given(forms_of(&name), key);
                    }
                    name
                }
            };
            Arc::new(Visit::new(key, avatar, name, &hello))
        }
    };
    let (config, metrics) = (&state.config, state.metrics.clone());
    let client = Arc::new(ConnectedClient::new(id, transport, visit, config, metrics));
    state.people.note_name(key, &client.visit.name);
    registry.visitors.arrive(client.clone());
    registry.clients.insert(id, client.clone());
    let is_logged = registry.log.allows(address, state.now());
    drop(registry);
    if state.counts_line(is_logged) {
        let Visit { avatar, name, key, .. } = &*client.visit;
        let what = if before.is_some() { "came back" } else { "joined" };
        tracing::info!(avatar = avatar.0, name = ?name.as_str(), %key, "{what}");
    }
    Ok(Admitted { client, before })
}

/// Cleans up after a connection. The avatar of a client whose link broke is kept for a while.
pub async fn part(state: &ServerState, id: ConnectionId, end: Option<&SessionEnd>) {
    state.offers.release(id);
    let Some((client, is_kept)) = part_registered(state, id, end) else { return };
    if matches!(end, Some(SessionEnd::Failed)) {
        client.transport.close(CloseCode::Failed, "a fault of the server ended your session");
    }
    if let Some(end) = end
        && state.may_log(client.address())
    {
        tracing::info!(avatar = client.avatar().0, end = ?end.to_string(), "left");
    }
    // The engine's thread may have ended already.
    let event = match is_kept {
        true => EngineEvent::Absent { client, noted: None },
        false => EngineEvent::Leave(client.avatar()),
    };
    state.tell_engine(event).await;
}

/// The client that a connection belonged to, if it had its avatar until now, and whether the avatar
/// is kept.
fn part_registered(
    state: &ServerState,
    id: ConnectionId,
    end: Option<&SessionEnd>,
) -> Option<(Arc<ConnectedClient>, bool)> {
    let mut registry = state.registry();
    let client = registry.clients.remove(&id);
    let Some(client) = client.filter(|client| registry.visitors.has_avatar(client)) else {
        registry.places.end(id);
        return None;
    };
    let may_return = end.is_some_and(SessionEnd::may_return) && client.visit.has_entered();
    let is_kept = may_return && registry.places.part(id);
    if is_kept {
        registry.visitors.part(&client, state.now());
    } else {
        leave(&mut registry, &client);
    }
    Some((client, is_kept))
}

/// Lets those go who have not come back in time.
pub async fn part_overdue(state: &ServerState) {
    let overdue = {
        let mut registry = state.registry();
        let overdue = registry.visitors.overdue(state.now());
        overdue.iter().for_each(|client| leave(&mut registry, client));
        overdue
    };
    for client in overdue {
        if state.may_log(client.address()) {
            tracing::info!(avatar = client.avatar().0, "did not come back");
        }
        state.tell_engine(EngineEvent::Leave(client.avatar())).await;
    }
}

fn leave(registry: &mut Registry, client: &ConnectedClient) {
    registry.visitors.leave(client.visit.key);
    registry.places.end(client.connection_id);
    registry.names.release(client.avatar());
    registry.ids.release(client.avatar());
}
