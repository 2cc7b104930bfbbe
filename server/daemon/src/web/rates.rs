//! How often each network may ask.

use std::{
    collections::HashMap,
    net::{IpAddr, Ipv4Addr},
    sync::{Mutex, PoisonError},
    time::Duration,
};

use crate::{address::network, net::TokenBucket};

/// The requests of each network. This machine's own have no limit.
pub(super) struct Rates {
    per_second: f64,
    networks_max: usize,
    networks: Mutex<HashMap<IpAddr, TokenBucket>>,
}

impl Rates {
    /// Rates of `per_second` requests a second, and twice as many at once. Beyond `networks_max`
    /// networks, all others count as one.
    pub(super) fn new(per_second: u32, networks_max: usize) -> Self {
        Self { per_second: per_second.into(), networks_max, networks: Mutex::default() }
    }

    /// Whether a request is within the rate.
    pub(super) fn allows(&self, address: IpAddr, now: Duration) -> bool {
        if address.to_canonical().is_loopback() {
            return true;
        }
        let mut network = network(address);
        let mut networks = self.networks.lock().unwrap_or_else(PoisonError::into_inner);
        if networks.len() >= self.networks_max && !networks.contains_key(&network) {
            networks.retain(|_, requests| !requests.is_full(now));
            if networks.len() >= self.networks_max {
                network = Ipv4Addr::UNSPECIFIED.into();
            }
        }
        let new = || TokenBucket::new(self.per_second, 2.0 * self.per_second, now);
        networks.entry(network).or_insert_with(new).take(1.0, now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_that_asks_often_keeps_nobody_else_out() {
        let rates = Rates::new(10, 4);
        let allowed = |address: &str, ms: u64| {
            rates.allows(address.parse().unwrap(), Duration::from_millis(ms))
        };
        let loud = (0..100).filter(|_| allowed("203.0.113.9", 0)).count();
        assert_eq!(loud, 20);
        assert!(allowed("198.51.100.7", 0) && allowed("203.0.113.9", 100));
        assert!((0..100).all(|_| allowed("127.0.0.1", 0) && allowed("::1", 0)));
    }

    #[test]
    fn the_memory_for_networks_has_a_limit() {
        let rates = Rates::new(10, 4);
        for i in 0..100_u32 {
            rates.allows(IpAddr::V4((i << 8).to_be_bytes().into()), Duration::ZERO);
        }
        let len = |rates: &Rates| rates.networks.lock().unwrap().len();
        assert!(len(&rates) <= 5);
        rates.allows("203.0.113.9".parse().unwrap(), Duration::from_secs(60));
        assert_eq!(len(&rates), 1, "those that ask no more are forgotten");
    }
}
