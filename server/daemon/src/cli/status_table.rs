//! What `status` shows, as text and as JSON.

use std::{fmt::Write, time::Duration};

use serde::Serialize;
use sightline_server::operate::{Overview, Person, Totals};

use super::printable;

/// The most clients in the table.
const PEOPLE_MAX: usize = 30;
/// The width of the column of names, in characters.
const NAME_CHARS: usize = 20;

/// The state of a server with what follows from it. Tables and JSON show these figures.
#[derive(Serialize)]
pub struct StatusFigures<'a> {
    #[serde(flatten)]
    now: &'a Overview,
    /// The rates of all clients together.
    rates: Rates,
    /// The rates of each client, in the order of the people.
    people_rates: Vec<Rates>,
    /// Messages and bytes in a second from other stations, then those to them.
    bus_rates: [f64; 4],
    /// The share of a core that the process used, in per cent; `None` where the system does not
    /// tell.
    cpu_percent: Option<f64>,
}

/// Messages and bytes in a second.
#[derive(Serialize)]
struct Rates {
    messages_in_per_s: f64,
    bytes_in_per_s: f64,
    messages_out_per_s: f64,
    bytes_out_per_s: f64,
}

impl Rates {
    /// Those between two states.
    fn between(before: &Totals, now: &Totals, seconds: f64) -> Self {
        let rate = |before: u64, now: u64| now.saturating_sub(before) as f64 / seconds.max(1e-3);
        Self {
            messages_in_per_s: rate(before.messages_in, now.messages_in),
            bytes_in_per_s: rate(before.bytes_in, now.bytes_in),
            messages_out_per_s: rate(before.messages_out, now.messages_out),
            bytes_out_per_s: rate(before.bytes_out, now.bytes_out),
        }
    }
}

impl<'a> StatusFigures<'a> {
    /// The figures of a state. Rates are those since an earlier state, this long ago; without one,
    /// those since the start.
    pub fn new(now: &'a Overview, since: Option<(Duration, &Overview)>) -> Self {
        let rates = match since {
            Some((passed, before)) => {
                Rates::between(&before.totals, &now.totals, passed.as_secs_f64())
            }
            None => Rates::between(&Totals::default(), &now.totals, now.uptime_s),
        };
        let people_rates = now.people.iter().map(|person| rates_of(person, since)).collect();
        let bus_rates = bus_rates(now, since);
        Self { now, rates, people_rates, bus_rates, cpu_percent: cpu_percent(now, since) }
    }

    /// One line.
    pub fn line(&self) -> String {
        let Overview { clients, ticks, .. } = self.now;
        let cpu = self.cpu_percent.map_or(String::new(), |share| format!(" cpu={share:.1}%"));
        format!(
            "up={:.0}s clients={} joining={} live={} on_course={} quiet={} asked={} absent={} tick_hz={:.0} \
             tick_p99_us={} in={:.0}B/s out={:.0}B/s refused={}{cpu}\n",
            self.now.uptime_s,
            self.now.people.len(),
            clients.joining,
            clients.live,
            clients.on_course,
            clients.quiet,
            clients.asked,
            clients.absent,
            self.now.tick_hz,
            ticks.p99_us,
            self.rates.bytes_in_per_s,
            self.rates.bytes_out_per_s,
            self.now.refused,
        )
    }

    /// The whole table.
    pub fn whole(&self) -> String {
        let Overview { clients, ticks, overload, .. } = self.now;
        let world = match &self.now.world {
            Some(world) => format!("world {}: {}", world.number, printable(&world.title)),
            None => "the world is being loaded".to_owned(),
        };
        let mut text = format!("{world}, up {}\n", span(self.now.uptime_s));
        let mut row = |name: &str, value: String| {
            let _ = writeln!(text, "{name:<10}{value}");
        };
        row(
            "clients",
            format!(
                "{}: {} live, {} on course, {} quiet, {} asked, {} absent, {} joining",
                self.now.people.len(),
                clients.live,
                clients.on_course,
                clients.quiet,
                clients.asked,
                clients.absent,
                clients.joining
            ),
        );
        row(
            "ticks",
            format!(
                "{:.0} a second; median {} us, p99 {} us, longest {} us",
                self.now.tick_hz, ticks.median_us, ticks.p99_us, ticks.max_us
            ),
        );
        row(
            "overload",
            format!(
                "{} of 2 steps down; {} down and {} up so far; {} wait to enter, {} put off",
                overload.step,
                overload.steps_down,
                overload.steps_up,
                overload.joins_waiting,
                overload.joins_refused
            ),
        );
        let Rates { messages_in_per_s, bytes_in_per_s, messages_out_per_s, bytes_out_per_s } =
            self.rates;
        row("in", format!("{messages_in_per_s:.0} messages/s, {bytes_in_per_s:.0} bytes/s"));
        row("out", format!("{messages_out_per_s:.0} messages/s, {bytes_out_per_s:.0} bytes/s"));
        row("refused", format!("{} since the start", self.now.refused));
        if let Some(bus) = &self.now.bus {
            let lost = if bus.is_connected { "" } else { "lost; " };
            row(
                "bus",
                format!(
                    "{lost}{} stations, {} cut off, {:.1} ms away; {} guests, {} live; {} of {} \
                     sectors",
                    bus.stations,
                    bus.cut,
                    bus.delay_ms,
                    bus.guests,
                    bus.guests_live,
                    bus.subscribed,
                    bus.sectors
                ),
            );
            let [messages_in, bytes_in, messages_out, bytes_out] = self.bus_rates;
            let people = match bus.is_sharing {
                true => format!("bans, mutes and roles of {} are shared", bus.rulings),
                false => "nothing is shared at present: see the log".to_owned(),
            };
            row("people", people);
            row("bus in", format!("{messages_in:.0} messages/s, {bytes_in:.0} bytes/s"));
            row("bus out", format!("{messages_out:.0} messages/s, {bytes_out:.0} bytes/s"));
        }
        if let Some(used) = &self.now.process {
            let share = self.cpu_percent.map_or(String::new(), |share| format!("{share:.1} %, "));
            let megabytes = used.resident_bytes as f64 / 1e6;
            row("process", format!("{share}{:.1} s of processor, {megabytes:.0} MB", used.cpu_s));
        }
        text + &self.people()
    }

    fn people(&self) -> String {
        if self.now.people.is_empty() {
            return String::new();
        }
        let mut text = format!(
            "\n{:<NAME_CHARS$}  {:<9}  {:>8}  {:>8}  {:>5}  {:>9}  {:>9}  {}\n",
            "name", "state", "time", "trip ms", "holds", "in B/s", "out B/s", "address"
        );
        for (person, rates) in self.now.people.iter().zip(&self.people_rates).take(PEOPLE_MAX) {
            let name: String = printable(&person.name).chars().take(NAME_CHARS).collect();
            let held = person.place.as_ref().map_or(0, |place| place.held);
            let _ = writeln!(
                text,
                "{name:<NAME_CHARS$}  {:<9}  {:>8}  {:>8.1}  {held:>5}  {:>9.0}  {:>9.0}  {}",
                person.state.name(),
                span(person.connected_s),
                person.round_trip_ms,
                rates.bytes_in_per_s,
                rates.bytes_out_per_s,
                printable(&person.address),
            );
        }
        let more = self.now.people.len().saturating_sub(PEOPLE_MAX);
        if more > 0 {
            let _ = writeln!(text, "and {more} more; --json FILE has all");
        }
        text
    }
}

/// The rates of a client since an earlier state; without one, those since it came.
fn rates_of(person: &Person, since: Option<(Duration, &Overview)>) -> Rates {
    let before = since.and_then(|(passed, before)| {
        let before = before.people.iter().find(|other| other.avatar == person.avatar)?;
        Some((passed, before))
    });
    match before {
        Some((passed, before)) => {
            Rates::between(&before.totals, &person.totals, passed.as_secs_f64())
        }
        None => Rates::between(&Totals::default(), &person.totals, person.connected_s),
    }
}

/// Messages and bytes in a second from other stations, then those to them, since an earlier state
/// or since the start.
fn bus_rates(now: &Overview, since: Option<(Duration, &Overview)>) -> [f64; 4] {
    let counts = |overview: &Overview| {
        let bus = overview.bus.unwrap_or_default();
        [bus.messages_in, bus.bytes_in, bus.messages_out, bus.bytes_out]
    };
    let (before, passed_s) = match since {
        Some((passed, before)) => (counts(before), passed.as_secs_f64()),
        None => ([0; 4], now.uptime_s),
    };
    let mut rates = counts(now).into_iter().zip(before);
    let rate = |(now, before): (u64, u64)| now.saturating_sub(before) as f64 / passed_s.max(1e-3);
    [(); 4].map(|()| rates.next().map_or(0.0, rate))
}

/// The share of a core that was used since an earlier state, or since the start, in per cent.
fn cpu_percent(now: &Overview, since: Option<(Duration, &Overview)>) -> Option<f64> {
    let used = now.process?;
    let (used_s, passed_s) = match since {
        Some((passed, before)) => (used.cpu_s - before.process?.cpu_s, passed.as_secs_f64()),
        None => (used.cpu_s, now.uptime_s),
    };
    Some(100.0 * used_s / passed_s.max(1e-3))
}

/// A time for people.
fn span(seconds: f64) -> String {
    let seconds = seconds.max(0.0) as u64;
    let (minutes, hours) = (seconds / 60, seconds / 3_600);
    match (hours, minutes) {
        (0, 0) => format!("{seconds} s"),
        (0, _) => format!("{minutes}:{:02} min", seconds % 60),
        _ => format!("{hours}:{:02} h", minutes % 60),
    }
}

#[cfg(test)]
mod tests {
    use sightline_server::operate::BusStats;

    use super::*;

    fn overview(seconds: u32) -> Overview {
        let totals = |n: u32| {
            format!(
                r#"{{"messages_in":{n},"bytes_in":{n}0,"messages_out":{n},"bytes_out":{n}00,
                "world_bytes_out":0}}"#
            )
        };
        let text = format!(
            r#"{{"uptime_s":{seconds}.0,"world":{{"number":1,"title":"House"}},"tick_hz":20.0,
            "ticks":{{"ticks":9,"median_us":100,"p99_us":200,"max_us":300,"take_p99_us":1,
            "engine_p99_us":2,"tell_p99_us":3}},
            "stages":{{"take_s":0.1,"engine_s":0.2,"tell_s":0.1}},
            "overload":{{"step":0,"steps_down":1,"steps_up":1,"joins_refused":4,"joins_waiting":0}},
            "clients":{{"joining":0,"live":1,"on_course":0,"quiet":0,"asked":0,"absent":0}},
            "totals":{},"refused":7,"process":{{"cpu_s":{seconds}.5,"resident_bytes":50000000}},
            "people":[{{"avatar":5,"name":"A\u001b[2J","address":"[::1]:9","role":"visitor",
            "is_muted":false,"state":"live","connected_s":61.0,"round_trip_ms":20.0,"totals":{},"place":null}}]}}"#,
            totals(seconds),
            totals(seconds)
        );
        serde_json::from_str(&text).unwrap()
    }

    #[test]
    fn rates_are_those_since_the_state_before() {
        let (before, now) = (overview(1_000), overview(1_002));
        let figures = StatusFigures::new(&now, Some((Duration::from_secs(2), &before)));
        let line = figures.line();
        for part in ["clients=1", "live=1", "in=10B/s out=100B/s", "refused=7 cpu=100.0%"] {
            assert!(line.contains(part), "{line}");
        }
        let first = StatusFigures::new(&now, None);
        assert!(first.line().contains("in=10B/s"), "since the start: {}", first.line());
    }

    /// What the tables derive from a state is in the JSON, too, beside the state itself.
    #[test]
    fn json_has_the_figures_of_the_tables() {
        let (before, now) = (overview(1_000), overview(1_002));
        let figures = StatusFigures::new(&now, Some((Duration::from_secs(2), &before)));
        let json = serde_json::to_value(&figures).unwrap();
        let number = |path: &str| json.pointer(path).and_then(|value| value.as_f64());
        assert_eq!(number("/rates/bytes_out_per_s"), Some(100.0));
        assert_eq!(number("/people_rates/0/messages_in_per_s"), Some(1.0));
        assert_eq!((number("/cpu_percent"), number("/refused")), (Some(100.0), Some(7.0)));
        let (line, whole) = (figures.line(), figures.whole());
        assert!(line.contains("out=100B/s refused=7 cpu=100.0%"), "{line}");
        assert!(
            whole.contains("1 messages/s, 100 bytes/s") && whole.contains("100.0 %, "),
            "{whole}"
        );
    }

    #[test]
    fn a_station_shows_its_bus() {
        let mut now = overview(10);
        assert!(!StatusFigures::new(&now, None).whole().contains("bus"), "it is alone");
        let (messages_in, is_connected, stations) = (400, true, 3);
        now.bus = Some(BusStats { messages_in, is_connected, stations, ..BusStats::default() });
        let text = StatusFigures::new(&now, None).whole();
        assert!(text.contains("3 stations") && text.contains("40 messages/s"), "{text}");
        assert!(text.contains("nothing is shared"), "{text}");
        now.bus = Some(BusStats { is_sharing: true, rulings: 7, ..BusStats::default() });
        assert!(StatusFigures::new(&now, None).whole().contains("roles of 7 are shared"));
        now.bus = Some(BusStats::default());
        assert!(StatusFigures::new(&now, None).whole().contains("lost"));
    }

    #[test]
    fn a_name_reaches_the_terminal_without_commands() {
        let now = overview(10);
        let text = StatusFigures::new(&now, None).whole();
        assert!(text.contains("A?[2J") && !text.contains('\x1b'), "{text}");
        assert!(text.starts_with("world 1: House, up 10 s\n"), "{text}");
        assert!(text.contains("1:01 min"), "{text}");
    }
}
