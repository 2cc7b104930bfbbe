//! Settings about visitors with a browser.

use std::{
    fmt::{self, Display},
    net::SocketAddr,
    str::FromStr,
};

use serde::{Deserialize, Serialize};
use sightline_cli::flags::listen_address;

/// Where browsers reach a server by HTTP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WebAddress {
    /// Nowhere.
    Off,
    /// At the address and the port number for clients, by TCP.
    Same,
    /// At this address.
    At(SocketAddr),
}

impl WebAddress {
    /// The TCP address of a server with this address for clients.
    pub fn beside(self, listen: SocketAddr) -> Option<SocketAddr> {
        match self {
            Self::Off => None,
            Self::Same => Some(listen),
            Self::At(address) => Some(address),
        }
    }
}

impl Display for WebAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Same => f.write_str("same"),
            Self::At(address) => address.fmt(f),
        }
    }
}

impl FromStr for WebAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "off" => Ok(Self::Off),
            "same" => Ok(Self::Same),
            text => listen_address(text)
                .map(Self::At)
                .map_err(|error| format!("{error}; or same, or off")),
        }
    }
}

/// Where pages come from: a scheme and a host, with its port unless that is the scheme's own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Origin {
    is_secure: bool,
    host: String,
}

impl Origin {
    /// Whether its pages belong to a host of this name, whatever the port.
    pub fn is_at(&self, name: &str) -> bool {
        let rest = self.host.strip_prefix(&name.to_ascii_lowercase());
        rest.is_some_and(|port| port.is_empty() || port.starts_with(':'))
    }

    /// Whether its pages belong to a host.
    pub fn is_of(&self, host: &str) -> bool {
        self.host.eq_ignore_ascii_case(host)
    }
}

impl FromStr for Origin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_host = |c: char| c.is_ascii_alphanumeric() || ".-:[]".contains(c);
        let secure = text.strip_prefix("https://");
        match secure.or_else(|| text.strip_prefix("http://")) {
            Some(host) if !host.is_empty() && host.chars().all(is_host) => {
                Ok(Self { is_secure: secure.is_some(), host: host.to_ascii_lowercase() })
            }
            _ => Err("use an origin, such as https://house.example".to_owned()),
        }
    }
}

impl TryFrom<String> for Origin {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse().map_err(|error| format!("{text}: {error}"))
    }
}

impl From<Origin> for String {
    fn from(origin: Origin) -> Self {
        let scheme = if origin.is_secure { "https" } else { "http" };
        format!("{scheme}://{}", origin.host)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_origin_is_a_scheme_and_a_host() {
        let origin: Origin = "http://House.example:4777".parse().unwrap();
        assert!(origin.is_of("house.example:4777") && !origin.is_of("house.example"));
        assert!(origin.is_at("House.example") && !origin.is_at("house.exam"));
        assert_eq!(String::from(origin), "http://house.example:4777");
        for wrong in ["null", "house.example", "https://", "https://a/b", "https://a;b", "ftp://a"]
        {
            assert!(wrong.parse::<Origin>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn browsers_come_to_the_port_of_clients_unless_another_one_is_chosen() {
        let listen: SocketAddr = "192.0.2.1:4777".parse().unwrap();
        let beside = |text: &str| text.parse::<WebAddress>().unwrap().beside(listen);
        assert_eq!((beside("same"), beside("off")), (Some(listen), None));
        assert_eq!(beside("127.0.0.1:8080"), Some("127.0.0.1:8080".parse().unwrap()));
        for text in ["same", "off", "127.0.0.1:8080"] {
            assert_eq!(text.parse::<WebAddress>().unwrap().to_string(), text);
        }
        assert!("nowhere".parse::<WebAddress>().unwrap_err().ends_with("or off"));
    }
}
