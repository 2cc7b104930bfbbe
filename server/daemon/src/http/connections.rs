//! How many connections there are, in all and from each network.

use std::{
    collections::HashMap,
    net::IpAddr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::Reason;
use crate::address::network;

/// The connections of a listener, or others that are counted alike.
#[derive(Clone)]
pub(crate) struct Connections {
    max: (usize, Reason),
    max_of_network: (usize, Reason),
    of: Arc<Mutex<HashMap<IpAddr, usize>>>,
}

/// A connection that counts until this is dropped.
pub(crate) struct ConnectionPlace {
    connections: Connections,
    network: IpAddr,
}

impl Connections {
    /// No connections yet. Of each limit: how many, and what is counted beyond it.
    pub(crate) fn new(max: (usize, Reason), max_of_network: (usize, Reason)) -> Self {
        Self { max, max_of_network, of: Arc::default() }
    }

    /// Counts a connection, or says which limit it is beyond. This machine's own are limited only
    /// in all.
    pub(crate) fn begin(&self, address: IpAddr) -> Result<ConnectionPlace, Reason> {
        let most =
            if address.to_canonical().is_loopback() { usize::MAX } else { self.max_of_network.0 };
        self.begin_within(address, most)
    }

    /// Counts a connection that is limited only in all.
    #[cfg(feature = "web")]
    pub(crate) fn begin_unlimited(&self, address: IpAddr) -> Result<ConnectionPlace, Reason> {
        self.begin_within(address, usize::MAX)
    }

    fn begin_within(&self, address: IpAddr, most: usize) -> Result<ConnectionPlace, Reason> {
        let network = network(address);
        let mut of = self.of();
        if of.values().sum::<usize>() >= self.max.0 {
            return Err(self.max.1);
        }
        let own = of.get(&network).copied().unwrap_or_default();
        if own >= most {
            return Err(self.max_of_network.1);
        }
        of.insert(network, own + 1);
        Ok(ConnectionPlace { connections: self.clone(), network })
    }

    fn of(&self) -> MutexGuard<'_, HashMap<IpAddr, usize>> {
        self.of.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for ConnectionPlace {
    fn drop(&mut self) {
        let mut of = self.connections.of();
        let own = of.entry(self.network).or_default();
        *own = own.saturating_sub(1);
        if *own == 0 {
            of.remove(&self.network);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_are_limited_in_all_and_for_each_network() {
        let limits = [(4, Reason::HttpConnections), (2, Reason::HttpOfAddress)];
        let connections = Connections::new(limits[0], limits[1]);
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
