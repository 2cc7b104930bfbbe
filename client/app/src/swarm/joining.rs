//! How visitors come in.

use std::{collections::VecDeque, net::SocketAddr, sync::Arc, time::Duration};

use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_cli::{
    identity::{Identity, IdentityError},
    trace::{Trace, Track},
};
use sightline_protocol::text::Name;
use tokio::{
    task::JoinSet,
    time::{Instant, MissedTickBehavior, timeout_at},
};

use super::{
    ConnectedVisitor, SwarmError, SwarmOptions,
    grounds::Grounds,
    report::Joining,
    visitor::{Visitor, Wanderer},
};
use crate::net::{ConnectOptions, Session};

/// The largest number of visitors that connect at the same time.
const CONNECTING_MAX: usize = 16;
/// The time between two visitors who set out to connect.
const JOIN_INTERVAL: Duration = Duration::from_millis(10);
/// After this time in which nobody has come in, the others are given up.
const STALLED: Duration = Duration::from_secs(30);

/// Connects all visitors: the first one alone, because it downloads the world, then the others.
/// Also returns the grounds, and how they came in.
pub(super) async fn connect_visitors(
    address: SocketAddr,
    options: &SwarmOptions,
) -> Result<(Vec<ConnectedVisitor>, Arc<Grounds>, Joining), SwarmError> {
    let tracks: Option<Vec<Track>> = options.trace.as_ref().map(Trace::tracks);
    let tracks = tracks.as_deref();
    if let Some(tracks) = tracks
        && tracks.len() < options.clients
    {
        return Err(SwarmError::TraceTooSmall { tracks: tracks.len(), clients: options.clients });
    }
    let start = |i: usize| tracks.and_then(|tracks| Some(tracks.get(i)?.at(0.0).eye));
    let dialer = options.dialer.clone();
    // The first visitor starts at a spawn point: nothing else is known of the building yet.
    let first = dialer.connect(address, &connect_options(options, 0, start(0))?).await?;
    let world = first.world();
    let grounds = Grounds::find(world.clone(), tracks.is_none()).await?;
    let mut random = SmallRng::seed_from_u64(options.seed);
    let options_by_number = (1..options.clients)
        .map(|i| {
            let place = start(i).or_else(|| grounds.navigation.random(&mut random));
            Ok((i, connect_options(options, i, place)?))
        })
        .collect::<Result<_, IdentityError>>()?;
    let servers: Vec<SocketAddr> = [address].iter().chain(&options.others).copied().collect();
    let (mut sessions, joining) = connect_all(options, &servers, options_by_number).await;
    sessions.insert(0, (0, first));
    let members = sessions.into_iter().map(|(i, session)| {
        let pose = session.pose();
        let visitor = match tracks.and_then(|tracks| tracks.get(i)) {
            Some(track) => Visitor::Recorded(track.clone()),
            None => {
                let seed = options.seed.wrapping_mul(0x9e37_79b9).wrapping_add(i as u64);
                Visitor::Wandering(Box::new(Wanderer::new(&world, pose.eye, seed)))
            }
        };
        let world = session.world();
        // It begins where it has just entered.
        session.events();
        ConnectedVisitor { session, visitor, world, pose, leapt: None, has_ended: false }
    });
    Ok((members.collect(), grounds, joining))
}

/// Connects with each of the options, a few at a time and one after the other, to the servers in
/// turns. Gives up those who are not in when nobody has come in for a while. Returns the sessions in
/// order, and how they came in.
async fn connect_all(
    options: &SwarmOptions,
    servers: &[SocketAddr],
    mut options_by_number: VecDeque<(usize, ConnectOptions)>,
) -> (Vec<(usize, Session)>, Joining) {
    let (mut sessions, mut joining) = (Vec::new(), Joining::default());
    let mut connecting = JoinSet::new();
    let mut give_up = Instant::now() + STALLED;
    let begin = Instant::now();
    let mut turns = tokio::time::interval(JOIN_INTERVAL);
    turns.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        while connecting.len() < CONNECTING_MAX
            && let Some((i, hello)) = options_by_number.pop_front()
        {
            turns.tick().await;
            let (dialer, begin) = (options.dialer.clone(), Instant::now());
            let address = servers[i % servers.len()];
            connecting.spawn(async move {
                let session = dialer.connect(address, &hello).await;
                (i, session, begin.elapsed())
            });
        }
        match timeout_at(give_up, connecting.join_next()).await {
            Ok(Some(Ok((i, Ok(session), time)))) => {
                sessions.push((i, session));
                joining.times.push(time);
                give_up = Instant::now() + STALLED;
                // The first visitor is in already.
                options.on_join.iter().for_each(|told| told(sessions.len() + 1));
            }
            Ok(Some(Ok((i, Err(error), _)))) => {
                tracing::warn!(visitor = i + 1, %error, "a visitor could not come in");
                joining.refused += 1;
            }
            Ok(Some(Err(_))) => joining.refused += 1,
            Ok(None) => break,
            Err(_) => {
                let left = connecting.len() + options_by_number.len();
                tracing::warn!(left, "nobody has come in for {STALLED:?}: the others stay out");
                joining.refused += left;
                break;
            }
        }
    }
    joining.whole = begin.elapsed();
    sessions.sort_by_key(|(i, _)| *i);
    (sessions, joining)
}

/// The options of a visitor, which has a key of its own.
fn connect_options(
    options: &SwarmOptions,
    i: usize,
    place: Option<glam::Vec3>,
) -> Result<ConnectOptions, IdentityError> {
    let mut random = SmallRng::seed_from_u64(options.seed ^ i as u64);
    // Bright colours, seldom twice the same.
    let mut colour = [255, random.random_range(40..=255), 40];
    colour.rotate_right(random.random_range(0..3));
    if random.random_bool(0.5) {
        colour.swap(0, 1);
    }
    Ok(ConnectOptions {
        name: Name::clipped(&format!("Visitor {}", i + 1)),
        colour,
        place,
        trust: options.trust.clone(),
        identity: Arc::new(Identity::generate()?),
        invitation: None,
        in_pieces: false,
        progress: None,
    })
}
