//! Parsers for the values of flags, and for addresses.

use std::{
    net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs},
    time::Duration,
};

use anyhow::Context;
use glam::Vec3;
use sightline_world::Spawn;

/// Parses a point in metres, such as `1.5,1.6,-2`.
///
/// # Errors
/// When the text is anything but three finite numbers.
pub fn point(text: &str) -> Result<Vec3, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(number).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Vec3::new(x, y, z)),
        _ => Err("a point is three numbers with commas between them, such as 1.5,1.6,-2".into()),
    }
}

/// Parses a spawn point: the eye in metres and, if given, the heading in degrees, anticlockwise
/// from -z. Such as `1.5,1.6,-2` or `1.5,1.6,-2,90`.
///
/// # Errors
/// When the text is anything but three or four finite numbers.
pub fn spawn(text: &str) -> Result<Spawn, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(number).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Spawn { eye: Vec3::new(x, y, z), yaw: 0.0 }),
        Some(&[x, y, z, yaw]) => Ok(Spawn { eye: Vec3::new(x, y, z), yaw: yaw.to_radians() }),
        _ => Err("a spawn point is X,Y,Z of the eye in metres or X,Y,Z,YAW with the heading in \
                  degrees, such as 1.5,1.6,-2,90"
            .into()),
    }
}

/// A finite number.
fn number(text: &str) -> Option<f32> {
    text.trim().parse().ok().filter(|x: &f32| x.is_finite())
}

/// Parses a time in seconds, such as `12.5`.
///
/// # Errors
/// When the text is no number, or the number is negative, not finite or too large.
pub fn time(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    seconds.ok_or_else(|| "a time is a number of seconds, such as 12.5".into())
}

/// Parses the width and height of a picture in pixels, such as `960x540`. Both are from 1 to
/// `side_max`.
///
/// # Errors
/// When the text is no such size.
pub fn size(text: &str, side_max: usize) -> Result<(usize, usize), String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let fits = |&(w, h): &(usize, usize)| [w, h].iter().all(|s| (1..=side_max).contains(s));
    let wrong = || format!("a size is WIDTHxHEIGHT, such as 960x540, each at most {side_max}");
    sides.filter(fits).ok_or_else(wrong)
}

/// Looks up a server's address, given as `host:port`. An IPv4 address is preferred.
///
/// # Errors
/// When the text has no port, or the name is unknown.
pub fn resolve(address: &str) -> anyhow::Result<SocketAddr> {
    let wrong = || format!("no such address: {address}; give it as host:port");
    let mut found: Vec<SocketAddr> = address.to_socket_addrs().with_context(wrong)?.collect();
    found.sort_by_key(SocketAddr::is_ipv6);
    found.first().copied().with_context(wrong)
}

/// Parses the address that a server listens on: a port, which stands for every address of the
/// machine, or an address or name with a port, such as `4777`, `0.0.0.0:4777` or `localhost:4777`.
///
/// # Errors
/// When the text is no such address, or the name is unknown.
pub fn listen_address(text: &str) -> Result<SocketAddr, String> {
    let port = text.strip_prefix(':').unwrap_or(text);
    if let Ok(port) = port.parse() {
        return Ok((Ipv6Addr::UNSPECIFIED, port).into());
    }
    let wrong =
        "use a port, or an address and a port, such as 4777, 0.0.0.0:4777 or localhost:4777";
    resolve(text).map_err(|_| wrong.to_owned())
}

/// Parses an address at which only this machine is meant unless another one is named: a port of
/// 127.0.0.1, or an address or name with a port.
///
/// # Errors
/// When the text is no such address, or the name is unknown.
pub fn local_address(text: &str) -> Result<SocketAddr, String> {
    let port = text.strip_prefix(':').unwrap_or(text);
    if let Ok(port) = port.parse() {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    let wrong = "use a port, or an address and a port, such as 4778 or localhost:4778";
    resolve(text).map_err(|_| wrong.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_times_and_sizes_are_parsed() {
        assert_eq!(point("1,-2.5, 3"), Ok(Vec3::new(1.0, -2.5, 3.0)));
        for wrong in ["", "1,2", "1,2,3,4", "a,b,c", "1,2,nan", "1,2,inf"] {
            assert!(point(wrong).is_err(), "{wrong}");
        }
        assert_eq!(spawn("1,-2.5, 3"), Ok(Spawn { eye: Vec3::new(1.0, -2.5, 3.0), yaw: 0.0 }));
        assert_eq!(spawn("0,0,0,180").map(|s| s.yaw), Ok(std::f32::consts::PI));
        for wrong in ["", "1,2", "1,2,3,4,5", "1,2,3,north", "1,2,3,inf"] {
            assert!(spawn(wrong).is_err(), "{wrong}");
        }
        assert_eq!(time("1.5"), Ok(Duration::from_millis(1_500)));
        for wrong in ["", "a", "-1", "nan", "inf", "1e300"] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
        assert_eq!(size("640x360", 8_192), Ok((640, 360)));
        for wrong in ["", "640", "0x9", "9x0", "-1x5", "99999x2", "2x99999"] {
            assert!(size(wrong, 8_192).is_err(), "{wrong}");
        }
    }

    #[test]
    fn addresses_are_resolved() {
        assert_eq!(resolve("127.0.0.1:4777").ok(), Some(([127, 0, 0, 1], 4777).into()));
        for wrong in ["", "127.0.0.1", "a b:c"] {
            assert!(resolve(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_server_listens_on_a_port_or_an_address() {
        let parsed = |text: &str| listen_address(text).map(|address| address.to_string());
        for (text, expected) in [
            ("4777", "[::]:4777"),
            (":4777", "[::]:4777"),
            ("0.0.0.0:0", "0.0.0.0:0"),
            ("localhost:4777", "127.0.0.1:4777"),
            ("[::1]:9", "[::1]:9"),
        ] {
            assert_eq!(parsed(text).as_deref(), Ok(expected));
        }
        let local = |text: &str| local_address(text).map(|address| address.to_string());
        assert_eq!(local("4778").as_deref(), Ok("127.0.0.1:4778"));
        assert_eq!(local("[::]:9").as_deref(), Ok("[::]:9"));
        for wrong in ["", "99999", "localhost", "1.2.3.4", "a b:c", "-1"] {
            assert!(parsed(wrong).is_err(), "{wrong}");
            assert!(local_address(wrong).is_err(), "{wrong}");
        }
    }
}
