//! How many connections there are, in all and from each address.

use std::{
    collections::HashMap,
    net::IpAddr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{Limits, Reason};

/// The connections of a listener.
#[derive(Clone)]
pub(super) struct Connections {
    max: usize,
    max_of_address: usize,
    of: Arc<Mutex<HashMap<IpAddr, usize>>>,
}

/// A connection that counts until this is dropped.
pub(super) struct ConnectionPlace {
    connections: Connections,
    address: IpAddr,
}

impl Connections {
    pub(super) fn new(limits: &Limits) -> Self {
        let max_of_address = limits.http_connections_per_address_max;
        Self { max: limits.http_connections_max, max_of_address, of: Arc::default() }
    }

    /// Counts a connection, or says which limit it is beyond.
    pub(super) fn begin(&self, address: IpAddr) -> Result<ConnectionPlace, Reason> {
        let address = address.to_canonical();
        let mut of = self.of();
        if of.values().sum::<usize>() >= self.max {
            return Err(Reason::HttpConnections);
        }
        let own = of.entry(address).or_default();
        if *own >= self.max_of_address && !address.is_loopback() {
            return Err(Reason::HttpOfAddress);
        }
        *own += 1;
        Ok(ConnectionPlace { connections: self.clone(), address })
    }

    fn of(&self) -> MutexGuard<'_, HashMap<IpAddr, usize>> {
        self.of.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for ConnectionPlace {
    fn drop(&mut self) {
        let mut of = self.connections.of();
        let own = of.entry(self.address).or_default();
        *own = own.saturating_sub(1);
        if *own == 0 {
            of.remove(&self.address);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_are_limited_in_all_and_for_each_address() {
        let limits = Limits {
            http_connections_max: 4,
            http_connections_per_address_max: 2,
            ..Limits::default()
        };
        let connections = Connections::new(&limits);
        let begin = |address: &str| connections.begin(address.parse().unwrap());
        let mut places: Vec<_> = (0..2).map(|_| begin("203.0.113.9").ok().unwrap()).collect();
        assert_eq!(begin("203.0.113.9").err(), Some(Reason::HttpOfAddress));
        assert_eq!(begin("::ffff:203.0.113.9").err(), Some(Reason::HttpOfAddress));
        places.push(begin("198.51.100.7").ok().unwrap());
        places.push(begin("127.0.0.1").ok().unwrap());
        assert_eq!(begin("127.0.0.1").err(), Some(Reason::HttpConnections));
        places.truncate(1);
        let own: Vec<_> = (0..3).map(|_| begin("127.0.0.1").ok().unwrap()).collect();
        drop((own, places));
        assert!(connections.of().is_empty(), "connections that end leave no entry");
    }
}
