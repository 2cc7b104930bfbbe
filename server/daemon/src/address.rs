//! The networks that addresses stand for.

use std::net::{IpAddr, Ipv6Addr};

/// The network that an address stands for: the /64 of an IPv6 address, since one subscriber has at
/// least that.
pub fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => {
            let [a, b, c, d, ..] = v6.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        v4 => v4,
    }
}
