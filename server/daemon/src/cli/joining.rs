//! How people join, in words.

use std::net::{IpAddr, UdpSocket};

use sightline_server::net::Server;

/// Where the server listens, and the command by which clients join.
pub(super) fn how_to_join(server: &Server) -> anyhow::Result<String> {
    let (address, fingerprint) = (server.local_addr()?, server.fingerprint());
    let port = address.port();
    let mut text = format!("listening on UDP {address}\nfingerprint {fingerprint}\n");
    let mut row = |from: &str, host: String| {
        text += &format!("{from:<27}sightline-client walk {host}:{port}\n");
    };
    if !address.ip().is_unspecified() {
        row("join:", host(address.ip()));
        return Ok(text);
    }
    row("join from this machine:", "localhost".to_owned());
    if let Some(own) = own_address() {
        row("join from others:", host(own));
    }
    Ok(text)
}

/// An address in front of a port.
pub(super) fn host(address: IpAddr) -> String {
    if address.is_loopback() {
        return "localhost".to_owned();
    }
    match address {
        IpAddr::V4(v4) => v4.to_string(),
        IpAddr::V6(v6) => format!("[{v6}]"),
    }
}

/// The address of this machine in its network, by which others reach it. No packet is sent: the
/// system only chooses a route.
pub(super) fn own_address() -> Option<IpAddr> {
    let socket = UdpSocket::bind("0.0.0.0:0").ok()?;
    socket.connect("192.0.2.1:9").ok()?;
    let address = socket.local_addr().ok()?.ip();
    (!address.is_loopback() && !address.is_unspecified()).then_some(address)
}
