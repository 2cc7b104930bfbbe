//! Coming back: a client whose link broke connects again by itself.

use std::{
    hash::{BuildHasher, RandomState},
    net::SocketAddr,
    time::Duration,
};

use quinn::Connection;
use sightline_protocol::message::{Refusal, StationAddress};
use tokio::{
    task::JoinSet,
    time::{Instant, sleep_until, timeout_at},
};

use super::{
    dialer::{ConnectOptions, Dialer},
    error::ConnectError,
    session::Welcomed,
    trust::Trust,
};

/// The pauses before the first attempts, in milliseconds. Later ones are as long as the last.
const PAUSES_MS: [u64; 5] = [0, 250, 500, 1_000, 1_500];
/// Pauses differ by up to this part of them, so that those who were lost together come back apart.
const SPREAD: u64 = 4;
/// The most attempts that are under way at a time. An attempt that takes long may still succeed
/// where the round trip is long, and a new one soon does where the server has just come back.
const ATTEMPTS_MAX: usize = 4;
/// How long a client whose link broke tries to come back.
pub(super) const PATIENCE: Duration = Duration::from_secs(600);

/// What a client needs to connect again.
pub(super) struct Caller {
    pub(super) dialer: Dialer,
    /// Its server.
    pub(super) address: SocketAddr,
    pub(super) options: ConnectOptions,
    /// Other servers of the same building, to which it may go.
    pub(super) others: Vec<StationAddress>,
}

/// The pauses of a client that comes for the first time. The server may have more to do than it
/// can.
const FIRST_PAUSES_MS: [u64; 2] = [0, 3_000];

/// How long to pause before each attempt.
#[derive(Debug)]
pub(super) struct Pauses {
    pauses_ms: &'static [u64],
    taken: usize,
    random: RandomState,
}

impl Pauses {
    /// The pauses of a client that comes for the first time.
    pub(super) fn first() -> Self {
        Self { pauses_ms: &FIRST_PAUSES_MS, taken: 0, random: RandomState::new() }
    }

    /// The pauses of a client that comes back.
    pub(super) fn returning() -> Self {
        Self { pauses_ms: &PAUSES_MS, ..Self::first() }
    }

    fn next(&mut self) -> Duration {
        let last = self.pauses_ms.len() - 1;
        let pause_ms = self.pauses_ms[self.taken.min(last)];
        let spread_ms = self.random.hash_one(self.taken) % (pause_ms / SPREAD).max(1);
        self.taken += 1;
        Duration::from_millis(pause_ms + spread_ms)
    }

    /// Begins with short pauses again.
    pub(super) fn reset(&mut self) {
        self.taken = 0;
    }
}

impl Caller {
    /// A client of a server.
    pub(super) fn new(dialer: Dialer, address: SocketAddr, options: ConnectOptions) -> Self {
        Self { dialer, address, options, others: Vec::new() }
    }

    /// Connects until its server, or another one of the same building, welcomes this client, or its
    /// own refuses it for good. The server that welcomes it is its own from then on.
    ///
    /// # Errors
    /// When it is refused for good, or it is time to give up.
    pub(super) async fn call(
        &mut self,
        pauses: &mut Pauses,
        give_up: Instant,
    ) -> Result<Welcomed, ConnectError> {
        loop {
            let (other, connection) = self.reach(pauses, give_up, ConnectError::may_pass).await?;
            let (address, options) = match other {
                Some(StationAddress { address, fingerprint }) => {
                    let trust = Trust::Pinned(fingerprint);
                    (address, ConnectOptions { trust, ..self.options.clone() })
                }
                None => (self.address, self.options.clone()),
            };
            let error = match self.dialer.greet(connection, address, &options).await {
                Ok(welcomed) => {
                    (self.address, self.options) = (address, options);
                    return Ok(welcomed);
                }
                Err(error) => error,
            };
            if other.is_some() && !error.may_pass() {
                // The others, and its own server, may still take it in.
                self.others.retain(|known| Some(*known) != other);
            } else if !error.may_pass() || Instant::now() >= give_up {
                return Err(error);
            }
            tracing::debug!(%error, "not back yet");
            if let ConnectError::Refused(Refusal::Busy { retry_ms }) = error {
                let retry = Duration::from_millis(retry_ms.into());
                sleep_until((Instant::now() + retry).min(give_up)).await;
            }
        }
    }

    /// Connects with one attempt after the other, in turns to its own server and to others, until
    /// one succeeds or fails with an error that may not pass, or it is time to give up. Returns the
    /// other server, if it is one.
    pub(super) async fn reach(
        &self,
        pauses: &mut Pauses,
        give_up: Instant,
        may_pass: fn(&ConnectError) -> bool,
    ) -> Result<(Option<StationAddress>, Connection), ConnectError> {
        let reached = timeout_at(give_up, self.attempt(pauses, may_pass)).await;
        reached.unwrap_or(Err(ConnectError::NoAnswer(self.address)))
    }

    async fn attempt(
        &self,
        pauses: &mut Pauses,
        may_pass: fn(&ConnectError) -> bool,
    ) -> Result<(Option<StationAddress>, Connection), ConnectError> {
        type Attempt = (Option<StationAddress>, Result<Connection, ConnectError>);
        let mut attempts: JoinSet<Attempt> = JoinSet::new();
        let servers = std::iter::once(None).chain(self.others.iter().copied().map(Some));
        for other in servers.cycle() {
            let due = Instant::now() + pauses.next();
            loop {
                tokio::select! {
                    () = sleep_until(due) => break,
                    Some(Ok((other, attempt))) = attempts.join_next() => match attempt {
                        Err(error) if other.is_some() || may_pass(&error) => {}
                        finished => return finished.map(|connection| (other, connection)),
                    },
                }
            }
            if attempts.len() < ATTEMPTS_MAX {
                let (dialer, options) = (self.dialer.clone(), self.options.clone());
                let address = other.map_or(self.address, |other| other.address);
                attempts.spawn(async move { (other, dialer.open(address, &options).await) });
            }
        }
        Err(ConnectError::NoAnswer(self.address))
    }
}

#[cfg(test)]
mod tests {
    use std::{net::UdpSocket, sync::Arc};

    use sightline_cli::identity::Identity;
    use sightline_protocol::text::Name;

    use super::*;

    #[test]
    fn pauses_grow_and_are_short_again_after_success() {
        let mut pauses = Pauses::returning();
        let taken: Vec<Duration> = (0..20).map(|_| pauses.next()).collect();
        assert!(taken[0] < Duration::from_millis(1), "the first attempt is made at once");
        assert!(taken[..5].is_sorted());
        assert!(taken.iter().all(|pause| *pause < Duration::from_secs(2)));
        pauses.reset();
        assert_eq!(pauses.next(), taken[0]);
    }

    #[tokio::test]
    async fn who_calls_again_has_no_more_time_than_was_left() {
        let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = silent.local_addr().unwrap();
        let identity = Arc::new(Identity::generate().unwrap());
        let options = ConnectOptions {
            name: Name::new("Ada").unwrap(),
            colour: [0; 3],
            place: None,
            trust: Trust::Pinned(identity.fingerprint()),
            identity,
            invitation: None,
            in_pieces: false,
            progress: None,
        };
        let mut caller = Caller::new(Dialer::new(None), address, options);
        let give_up = Instant::now() + Duration::from_millis(50);
        for _ in 0..3 {
            let called = caller.call(&mut Pauses::returning(), give_up).await;
            assert!(matches!(called, Err(ConnectError::NoAnswer(_))));
            assert!(Instant::now() >= give_up);
        }
        assert!(give_up.elapsed() < Duration::from_secs(5), "{:?}", give_up.elapsed());
    }
}
