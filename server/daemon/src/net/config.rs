//! The configuration of a server: limits, intervals and places.

use std::{
    fmt::Display,
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr},
    path::PathBuf,
    str::FromStr,
    time::Duration,
};

use serde::{Deserialize, Deserializer, de};
use sightline_cli::flags::{listen_address, local_address};
use sightline_engine::{Config, TbvShape, Validity};

/// The address for operators, unless the configuration says otherwise: this machine's own.
const HTTP_DEFAULT: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 4778);
/// Avatars that the engine keeps beyond the clients: those of clients that have just left.
const AVATARS_SPARE: usize = 64;

/// The configuration of a server. A TOML file may leave out any field. An unknown one is an error.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ServeConfig {
    /// The UDP address for clients; port 0 picks a free one.
    #[serde(deserialize_with = "listened")]
    pub listen: SocketAddr,
    /// The TCP address for operators: metrics and a live page, without a password.
    #[serde(deserialize_with = "parsed")]
    pub http: HttpAddress,
    /// Ticks in a second: 1 to 128.
    pub tick_hz: u32,
    /// The most clients: 1 to 16,384. Each may occupy up to 640 KiB of memory.
    pub clients_max: usize,
    /// The most connections from one address: 1 to 16,384. The server's own machine has no limit.
    pub clients_per_address_max: usize,
    /// The greatest horizon, in milliseconds: 50 to 2000. Clients with longer round trips may see
    /// others late.
    pub horizon_max_ms: u32,
    /// How long TBVs are made to last: `until-left`, `maximal`, `adaptive`, or a number of
    /// milliseconds.
    #[serde(deserialize_with = "parsed")]
    pub validity: Validity,
    /// What bounds TBVs in space: `reach` or `sphere`.
    #[serde(deserialize_with = "parsed")]
    pub shape: TbvShape,
    /// What all sight tests between regions may cost in a tick, in units of which 100,000 take one to
    /// five milliseconds: 0 to 100,000,000. A pair that the budget does not decide is sent.
    #[serde(alias = "look_budget")]
    pub sight_test_budget: u32,
    /// The longest validity of a TBV, in seconds: 0.1 to 60.
    pub validity_max_s: f64,
    /// Threads that share a tick of the engine: 1 to 64. A second thread pays from about a thousand
    /// clients on.
    pub threads: usize,
    /// How long a client may take for its first message, in seconds: 0.1 to 600.
    pub hello_s: f64,
    /// How long a client may be silent after its TBV has expired, in seconds: 0.1 to 3600.
    pub silence_s: f64,
    /// Whether clients may enter anywhere, as recorded walks do. Otherwise they enter at spawn
    /// points only, since a client that chooses freely could look into every room, one after the
    /// other.
    pub free_entry: bool,
    /// The folder for the certificate and compiled buildings; the user's data folder when `None`.
    pub data: Option<PathBuf>,
    /// The building or world file to serve; the demo building when `None`.
    pub world: Option<PathBuf>,
}

/// Where operators reach a server by HTTP: `off`, a port of this machine's own address, or an address
/// with a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HttpAddress {
    /// Nowhere.
    Off,
    /// At this address; port 0 picks a free one.
    At(SocketAddr),
}

impl HttpAddress {
    /// Whether nobody has chosen another address.
    pub fn is_default(self) -> bool {
        self == Self::At(HTTP_DEFAULT)
    }
}

impl FromStr for HttpAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "off" {
            return Ok(Self::Off);
        }
        local_address(text).map(Self::At).map_err(|error| format!("{error}; or off"))
    }
}

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The text is no TOML, or a field is unknown or of the wrong kind.
    #[error("{0}")]
    Toml(String),
    /// A number is out of its range.
    #[error("{field} must be {range}")]
    Range {
        /// The field.
        field: &'static str,
        /// Its range.
        range: &'static str,
    },
}

impl Default for ServeConfig {
    fn default() -> Self {
        Self {
            listen: (Ipv6Addr::UNSPECIFIED, 4777).into(),
            http: HttpAddress::At(HTTP_DEFAULT),
            tick_hz: 20,
            clients_max: 256,
            clients_per_address_max: 8,
            horizon_max_ms: 400,
            validity: Validity::UntilLeft,
            shape: TbvShape::Reach,
            sight_test_budget: Config::default().sight_test_budget,
            validity_max_s: 8.0,
            threads: 1,
            hello_s: 10.0,
            silence_s: 30.0,
            free_entry: false,
            data: None,
            world: None,
        }
    }
}

impl ServeConfig {
    /// Reads the text of a TOML file.
    ///
    /// # Errors
    /// When it is no TOML, or a field is unknown, of the wrong kind or out of its range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self =
            toml::from_str(text).map_err(|error| ConfigError::Toml(error.message().to_owned()))?;
        config.check()?;
        Ok(config)
    }

    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// When one is not.
    pub fn check(&self) -> Result<(), ConfigError> {
        let seconds = |s: f64, max: f64| (0.1..=max).contains(&s);
        let per_address = (1..=16_384).contains(&self.clients_per_address_max);
        for (holds, field, range) in [
            ((1..=128).contains(&self.tick_hz), "tick_hz", "1 to 128"),
            ((1..=16_384).contains(&self.clients_max), "clients_max", "1 to 16384"),
            (per_address, "clients_per_address_max", "1 to 16384"),
            ((50..=2_000).contains(&self.horizon_max_ms), "horizon_max_ms", "50 to 2000"),
            (self.sight_test_budget <= 100_000_000, "sight_test_budget", "0 to 100000000"),
            (seconds(self.validity_max_s, 60.0), "validity_max_s", "0.1 to 60"),
            ((1..=64).contains(&self.threads), "threads", "1 to 64"),
            (seconds(self.hello_s, 600.0), "hello_s", "0.1 to 600"),
            (seconds(self.silence_s, 3_600.0), "silence_s", "0.1 to 3600"),
        ] {
            if !holds {
                return Err(ConfigError::Range { field, range });
            }
        }
        Ok(())
    }

    /// The interval between ticks.
    pub fn tick_interval(&self) -> Duration {
        Duration::from_secs(1) / self.tick_hz.max(1)
    }

    /// The engine's configuration.
    pub fn engine(&self) -> Config {
        debug_assert!(self.check().is_ok(), "the configuration was checked");
        let usual = Config::default().with_sight_test_budget(self.sight_test_budget);
        Config {
            tick: self.tick_interval(),
            horizon_max: Duration::from_millis(self.horizon_max_ms.into()),
            validity: self.validity,
            shape: self.shape,
            validity_max: Duration::from_secs_f64(self.validity_max_s),
            avatars_max: self.clients_max + AVATARS_SPARE,
            threads: self.threads,
            ..usual
        }
    }
}

/// Deserialises an address to listen on.
fn listened<'de, D: Deserializer<'de>>(deserializer: D) -> Result<SocketAddr, D::Error> {
    let text = String::deserialize(deserializer)?;
    listen_address(&text).map_err(|error| de::Error::custom(format!("listen: {error}")))
}

/// Deserialises a value that is written as on the command line.
fn parsed<'de, D, T>(deserializer: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr<Err: Display>,
{
    let text = String::deserialize(deserializer)?;
    text.parse().map_err(|error| de::Error::custom(format!("{text}: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_may_leave_fields_out_but_not_name_unknown_ones_or_absurd_numbers() {
        let config = ServeConfig::from_toml("tick_hz = 30\nlisten = '127.0.0.1:0'").unwrap();
        assert_eq!((config.tick_hz, config.listen.port()), (30, 0));
        let http = |text: &str| ServeConfig::from_toml(&format!("http = '{text}'")).unwrap().http;
        assert!(http("4778").is_default() && http("127.0.0.1:4778").is_default());
        assert_eq!((http("off"), http("[::1]:0").is_default()), (HttpAddress::Off, false));
        let by_port = ServeConfig::from_toml("listen = '4777'").unwrap().listen;
        assert_eq!(by_port, ServeConfig::default().listen);
        assert_eq!(config.clients_max, ServeConfig::default().clients_max);
        let text = "horizon_max_ms = 250\nvalidity = '500'\nshape = 'sphere'";
        let engine = ServeConfig::from_toml(text).unwrap().engine();
        assert_eq!(engine.horizon_max, Duration::from_millis(250));
        assert_eq!(engine.validity, Validity::Constant(Duration::from_millis(500)));
        assert_eq!(engine.shape, TbvShape::Sphere);
        let (plain, usual) = (ServeConfig::default().engine(), Config::default());
        assert_eq!((plain.validity, plain.shape), (usual.validity, usual.shape));
        assert_eq!(plain.horizon_max, usual.horizon_max);
        let budget = |config: &Config| (config.sight_test_budget, config.sight_test_max);
        assert_eq!(budget(&plain), budget(&usual));
        let double = ServeConfig::from_toml("sight_test_budget = 600000").unwrap().engine();
        assert_eq!(budget(&double), (2 * usual.sight_test_budget, 2 * usual.sight_test_max));
        let by_old_name = ServeConfig::from_toml("look_budget = 600000").unwrap().engine();
        assert_eq!(by_old_name, double);
        for (text, expected) in [
            ("ticks = 3", "unknown field `ticks`"),
            ("tick_hz = 0", "tick_hz must be 1 to 128"),
            ("threads = 0", "threads must be 1 to 64"),
            ("horizon_max_ms = 10", "horizon_max_ms must be 50 to 2000"),
            ("validity = 'long'", "long: use until-left, maximal, adaptive"),
            ("shape = 'cube'", "cube: use sphere or reach"),
            ("validity_max_s = nan", "validity_max_s must be 0.1 to 60"),
            ("validity_max_s = 1e300", "validity_max_s must be 0.1 to 60"),
            ("clients_max = -1", "invalid"),
            ("listen = 'nowhere'", "listen: use a port"),
            ("http = 'nowhere'", "nowhere: use a port"),
            ("tick_hz = ", ""),
        ] {
            let error = ServeConfig::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
