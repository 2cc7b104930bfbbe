//! The configuration of a server: settings, and limits on what peers may take.

mod bounds;
mod documented;
mod limits;
mod printed;
mod web;

use std::{
    fmt::{self, Display},
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr},
    path::{Path, PathBuf},
    str::FromStr,
    time::Duration,
};

use serde::{Deserialize, Deserializer, Serializer, de};
use sightline_cli::flags::{listen_address, local_address};
use sightline_engine::{Config, TbvShape, Validity};
use toml::{Table, Value};

use bounds::Bound;
use documented::documented;
use limits::LIMIT_COMMENTS;
pub use limits::Limits;
pub use web::{Origin, WebAddress};

use crate::people::Access;

/// The address for operators, unless the configuration says otherwise: this machine's own.
const HTTP_DEFAULT: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 4778);
/// Avatars that the engine keeps beyond the clients: those of clients that have just left.
const AVATARS_SPARE: usize = 64;

documented! {
    /// The configuration of a server. A TOML file may leave out any field. An unknown one is an
    /// error.
    ServeConfig, COMMENTS {
        /// The UDP address for clients; port 0 picks a free one.
        #[serde(deserialize_with = "listened")]
        listen: SocketAddr,
        /// The TCP address for operators: metrics and a live page, without a password.
        #[serde(serialize_with = "shown", deserialize_with = "parsed")]
        http: HttpAddress,
        /// Where browsers find the page and the world: `same` (the address of `listen`, by TCP), an
        /// address and a port, or `off`.
        #[serde(serialize_with = "shown", deserialize_with = "parsed")]
        web: WebAddress,
        /// Origins whose pages may visit beside the server's own, and by which a reverse proxy has
        /// this server called: `["https://house.example"]`.
        web_origins: Vec<Origin>,
        /// Addresses of reverse proxies. What they say in X-Forwarded-For and X-Forwarded-Proto is
        /// believed.
        web_proxies: Vec<IpAddr>,
        /// The certificate for browsers on the open internet, with those of its issuers, in PEM.
        /// Pages then come by HTTPS. It is read again when it changes.
        tls_certificate: Option<PathBuf>,
        /// Its key, in PEM.
        tls_key: Option<PathBuf>,
        /// Ticks in a second.
        tick_hz: u32,
        /// The most clients.
        clients_max: usize,
        /// The most connections from one address. The server's own machine has no limit.
        clients_per_address_max: usize,
        /// The greatest horizon, in milliseconds. Clients with longer round trips may see others
        /// late.
        horizon_max_ms: u32,
        /// How long TBVs are made to last: `until-left`, `maximal`, `adaptive`, or a number of
        /// milliseconds.
        #[serde(serialize_with = "shown", deserialize_with = "parsed")]
        validity: Validity,
        /// What bounds TBVs in space: `reach` or `sphere`.
        #[serde(serialize_with = "shown", deserialize_with = "parsed")]
        shape: TbvShape,
        /// What all sight tests between regions may cost in a tick, in units of which 100,000 take
        /// one to five milliseconds. A pair that the budget does not decide is sent.
        #[serde(alias = "look_budget")]
        sight_test_budget: u32,
        /// The longest validity of a TBV, in seconds.
        validity_max_s: f64,
        /// Threads that share a tick of the engine. A second thread pays from about a thousand
        /// clients on.
        threads: usize,
        /// How long a client may take for its first message, in seconds.
        hello_s: f64,
        /// How long a client may be silent after its TBV has expired, in seconds.
        silence_s: f64,
        /// Whether clients may enter anywhere, as recorded walks do. Otherwise they enter at spawn
        /// points only, since a client that chooses freely could look into every room, one after
        /// the other.
        free_entry: bool,
        /// Who is let in: `open` (everybody), `allow-list`, or `invitation`.
        #[serde(serialize_with = "shown", deserialize_with = "parsed")]
        access: Access,
        /// For how many days chat is kept, for whoever runs the server to read; 0 when it is not.
        chat_days: u32,
        /// The folder for the certificate, the database of visitors, compiled buildings and their
        /// pieces; the user's data folder when there is none.
        data: Option<PathBuf>,
        /// A world file of at least this many bytes is also handed out in pieces, of which a
        /// visitor needs few to see what is around it. A smaller one arrives as a whole at once.
        pieces_from_bytes: u64,
        /// Whether visitors get only those pieces of the world that may be seen from where their
        /// bodies can be. Nobody gets its file or its plans then.
        private_geometry: bool,
        /// The bus on which this server is one of several in the building:
        /// `nats://[USER:PASSWORD@]HOST[:PORT]` or `tls://…` of a NATS server; a server alone when
        /// there is none.
        bus: Option<String>,
        /// A file of NATS credentials for the bus.
        bus_credentials: Option<PathBuf>,
        /// The UDP address by which visitors of other servers on the bus come here when theirs is
        /// lost; that of `listen` when there is none, if it is a certain one.
        bus_address: Option<SocketAddr>,
        /// The building or world file to serve; the demo building when there is none.
        world: Option<PathBuf>,
        /// Limits on what peers may take.
        limits: Limits,
    }
}

/// Where operators reach a server by HTTP: `off`, a port of this machine's own address, or an
/// address with a port.
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

impl Display for HttpAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::At(address) => address.fmt(f),
        }
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
    /// A certificate without its key, or the other way round.
    #[error("tls_certificate and tls_key belong together: give both or none")]
    TlsPair,
    /// A number is out of its range.
    #[error("{field} must be {min} to {max}")]
    Range {
        /// The field.
        field: &'static str,
        /// The least value.
        min: f64,
        /// The greatest value.
        max: f64,
    },
}

impl Default for ServeConfig {
    fn default() -> Self {
        Self {
            listen: (Ipv6Addr::UNSPECIFIED, 4777).into(),
            http: HttpAddress::At(HTTP_DEFAULT),
            web: WebAddress::Same,
            web_origins: Vec::new(),
            web_proxies: Vec::new(),
            tls_certificate: None,
            tls_key: None,
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
            access: Access::Open,
            chat_days: 0,
            data: None,
            pieces_from_bytes: 512 * 1_024,
            private_geometry: false,
            bus: None,
            bus_credentials: None,
            bus_address: None,
            world: None,
            limits: Limits::default(),
        }
    }
}

impl ServeConfig {
    /// Reads the text of a TOML file.
    ///
    /// # Errors
    /// When it is no TOML, or a field is unknown, of the wrong kind or out of its range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text).map_err(|error| wrong_toml(text, &error))?;
        config.check()?;
        Ok(config)
    }

    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// When one is not.
    pub fn check(&self) -> Result<(), ConfigError> {
        if self.tls_certificate.is_some() != self.tls_key.is_some() {
            return Err(ConfigError::TlsPair);
        }
        let values = Table::try_from(self).map_err(|error| ConfigError::Toml(error.to_string()))?;
        check_bounds(&values, bounds::SETTINGS)?;
        match values.get("limits").and_then(Value::as_table) {
            Some(limits) => check_bounds(limits, bounds::LIMITS),
            None => Ok(()),
        }
    }

    /// The files of the certificate for browsers, and of its key.
    pub fn tls_files(&self) -> Option<[&Path; 2]> {
        Some([self.tls_certificate.as_deref()?, self.tls_key.as_deref()?])
    }

    /// Whether pages of an origin may visit: those that are own ones, and those that are listed.
    pub fn allows_origin(&self, origin: &str, is_own: impl Fn(&Origin) -> bool) -> bool {
        let Ok(origin) = origin.parse::<Origin>() else { return false };
        is_own(&origin) || self.web_origins.contains(&origin)
    }

    /// The most connections: of clients with an avatar, of those that join, and of others.
    pub fn connections_max(&self) -> usize {
        self.clients_max + self.limits.joining_max + self.limits.connections_spare
    }

    /// The interval between ticks.
    pub fn tick_interval(&self) -> Duration {
        // Clients are told whole microseconds, and must reckon with the same time.
        Duration::from_micros(u64::from(1_000_000 / self.tick_hz.max(1)))
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

/// Checks that every number is within its bounds.
fn check_bounds(values: &Table, bounds: &[Bound]) -> Result<(), ConfigError> {
    let is_outside = |bound: &&Bound| {
        let value = values.get(bound.name).and_then(number);
        !value.is_some_and(|value| (bound.min..=bound.max).contains(&value))
    };
    match bounds.iter().find(is_outside) {
        Some(&Bound { name: field, min, max, .. }) => Err(ConfigError::Range { field, min, max }),
        None => Ok(()),
    }
}

/// The number that a value is.
fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|integer| integer as f64))
}

/// Says where a text is wrong, and which name is like one that is unknown.
fn wrong_toml(text: &str, error: &toml::de::Error) -> ConfigError {
    let before = error.span().and_then(|span| text.get(..span.start));
    let line = before.map_or(1, |before| before.matches('\n').count() + 1);
    let said = error.message();
    let unknown = said.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next());
    let said = match unknown {
        Some(unknown) => format!("unknown field `{unknown}`: {}", advice(unknown)),
        None => said.to_owned(),
    };
    ConfigError::Toml(format!("line {line}: {said}"))
}

/// What to write in place of an unknown name.
fn advice(unknown: &str) -> String {
    const ALIKE: f64 = 0.8;
    let settings = COMMENTS.iter().map(|(name, _)| (*name, ""));
    let limits = LIMIT_COMMENTS.iter().map(|(name, _)| (*name, " in [limits]"));
    let rated = settings.chain(limits).map(|known| (strsim::jaro_winkler(unknown, known.0), known));
    match rated.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((_, (name, ""))) if name == unknown => format!("`{name}` belongs above [limits]"),
        Some((alike, (name, place))) if alike >= ALIKE => format!("did you mean `{name}`{place}?"),
        _ => "`serve --print-config` lists all".to_owned(),
    }
}

/// Serialises a value as it is written on the command line.
fn shown<S: Serializer>(value: &impl Display, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
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
            ("ticks = 3", "line 1: unknown field `ticks`: did you mean `tick_hz`?"),
            (
                "\nchat_per_s = 3",
                "line 2: unknown field `chat_per_s`: did you mean `chat_per_s` in",
            ),
            ("[limits]\nchats_per_s = 3", "line 2: unknown field `chats_per_s`: did you mean"),
            ("[limits]\ntick_hz = 3", "line 2: unknown field `tick_hz`: `tick_hz` belongs above"),
            ("zzz = 3", "unknown field `zzz`: `serve --print-config` lists all"),
            ("[limits]\nchat_per_s = 0", "chat_per_s must be 0.01 to 100"),
            ("tick_hz = 0", "tick_hz must be 1 to 128"),
            ("threads = 0", "threads must be 1 to 64"),
            ("horizon_max_ms = 10", "horizon_max_ms must be 50 to 2000"),
            ("validity = 'long'", "long: use until-left, maximal, adaptive"),
            ("tls_key = 'key.pem'", "belong together"),
            ("access = 'all'", "all: use open, allow-list or invitation"),
            ("shape = 'cube'", "cube: use sphere or reach"),
            ("validity_max_s = nan", "validity_max_s must be 0.1 to 60"),
            ("validity_max_s = 1e300", "validity_max_s must be 0.1 to 60"),
            ("clients_max = -1", "invalid"),
            ("listen = 'nowhere'", "listen: use a port"),
            ("http = 'nowhere'", "nowhere: use a port"),
            ("web = 'nowhere'", "nowhere: use a port"),
            ("web_origins = ['house.example']", "house.example: use an origin"),
            ("web_proxies = ['here']", "invalid IP address"),
            ("tick_hz = ", ""),
        ] {
            let error = ServeConfig::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
