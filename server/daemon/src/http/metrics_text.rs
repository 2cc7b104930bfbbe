//! The metrics as text, as Prometheus reads it.

use std::fmt;

use prometheus_client::{
    collector::Collector,
    encoding::{DescriptorEncoder, MetricEncoder, NoLabelSet, text},
    metrics::MetricType,
    registry::Registry,
};

use crate::{
    net::Observer,
    operate::{BusCounters, Histogram, Metrics, Overview},
};

/// The kind of the text.
pub(super) const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// All metrics of a server. Those of the present moment come from its overview, if there is one.
pub(super) fn metrics_text(observer: &Observer, overview: Option<&Overview>) -> String {
    let mut rows = Rows::default();
    counters(&mut rows, observer.metrics());
    engine(&mut rows, observer);
    load(&mut rows, observer);
    if let Some(counters) = &observer.metrics().bus {
        bus(&mut rows, counters);
    }
    if let Some(overview) = overview {
        present(&mut rows, overview);
    }
    let mut registry = Registry::with_prefix("sightline");
    registry.register_collector(Box::new(rows));
    let mut said = String::new();
    text::encode(&mut said, &registry).expect("writing into a string does not fail");
    said
}

fn counters(rows: &mut Rows, metrics: &Metrics) {
    let received = metrics.traffic.received().map(|(kind, tally)| ("in", kind, tally));
    let sent = metrics.traffic.sent().map(|(kind, tally)| ("out", kind, tally));
    let all: Vec<_> = received.chain(sent).collect();
    let messages = all.iter().map(|(way, kind, tally)| (*way, *kind, tally.messages));
    let bytes = all.iter().map(|(way, kind, tally)| (*way, *kind, tally.bytes));
    let by_kind = |of: &mut dyn Iterator<Item = (&'static str, &'static str, u64)>| {
        of.map(|(way, kind, n)| (vec![("direction", way), ("kind", kind)], n as f64)).collect()
    };
    let help = "Application messages, by direction and kind";
    rows.counters("messages", help, by_kind(&mut messages.into_iter()));
    let help = "Bytes of application messages, without what QUIC adds";
    rows.counters("bytes", help, by_kind(&mut bytes.into_iter()));
    let refused = metrics.refusals.counts();
    let refused = refused.map(|(reason, n)| (vec![("reason", reason)], n as f64)).collect();
    rows.counters("refused", "What was refused, by limit or reason", refused);
    let asks = metrics.traffic.sent().find(|(kind, _)| *kind == "ask");
    rows.counter("asks", "Asks for a report", asks.map_or(0, |(_, tally)| tally.messages));
    let (stages, round_trips) = metrics.ticks.histograms();
    rows.histograms(
        "tick_seconds",
        "How long the stages of ticks took",
        vec![
            (vec![("stage", "take")], stages.take),
            (vec![("stage", "engine")], stages.engine),
            (vec![("stage", "tell")], stages.tell),
        ],
    );
    let help = "Round trips of all clients in the world, each once a second";
    rows.histograms("round_trip_seconds", help, vec![(vec![], round_trips)]);
}

fn engine(rows: &mut Rows, observer: &Observer) {
    let stats = observer.stats().engine;
    for (name, help, count) in [
        ("expiries", "TBVs that ended", stats.expiries),
        ("reveals", "TBVs that came into view", stats.reveals),
        ("asks_repeated", "Asks because an answer or a report did not come", stats.repeats),
        ("reports", "Reports that were accepted", stats.reports),
        ("departures", "Reports of live clients that departed", stats.departures),
        ("claims_refused", "Reports that were not believed", stats.refusals),
        ("claims_through_walls", "Refused reports of places beyond a wall", stats.walls),
        ("expelled", "Clients dropped by the engine", stats.drops),
    ] {
        rows.counter(name, help, count);
    }
    let faults = observer.metrics().engine_faults();
    rows.counter(
        "engine_faults",
        "Faults of the engine, each of which began its world anew",
        faults,
    );
}

fn load(rows: &mut Rows, observer: &Observer) {
    let load = observer.stats().overload;
    rows.gauge(
        "overload_step",
        "Steps that the tick rate is below the full rate",
        load.step as f64,
    );
    let steps = [("down", load.steps_down), ("up", load.steps_up)];
    let steps = steps.map(|(way, n)| (vec![("direction", way)], n as f64)).to_vec();
    rows.counters("overload_steps", "Steps of the tick rate", steps);
    let waiting = load.joins_waiting as f64;
    rows.gauge("joins_waiting", "Clients that wait to enter", waiting);
    let handshakes = observer.handshakes() as f64;
    let of = observer.transports();
    let kinds = ["quic", "web_transport", "web_socket"]
        .map(|kind| (vec![("transport", kind)], of.get(kind).copied().unwrap_or_default() as f64));
    rows.gauges("connections", "Clients that are connected, by transport", kinds.to_vec());
    rows.gauge("handshakes", "Handshakes under way", handshakes);
}

fn bus(rows: &mut Rows, counters: &BusCounters) {
    let received = counters.received_by_kind().map(|(kind, tally)| ("in", kind, tally));
    let sent = counters.sent_by_kind().map(|(kind, tally)| ("out", kind, tally));
    let all: Vec<_> = received.chain(sent).collect();
    let labels = |way: &'static str, kind: &'static str| vec![("direction", way), ("kind", kind)];
    let messages = all.iter().map(|(way, kind, tally)| (labels(way, kind), tally.messages as f64));
    let help = "Messages from and to other stations, by direction and kind";
    rows.counters("bus_messages", help, messages.collect());
    let bytes = all.iter().map(|(way, kind, tally)| (labels(way, kind), tally.bytes as f64));
    rows.counters("bus_bytes", "Bytes of these messages, without what NATS adds", bytes.collect());
    let dropped = counters.dropped_by_reason().map(|(why, n)| (vec![("reason", why)], n as f64));
    rows.counters("bus_dropped", "Parcels of messages that were dropped", dropped.collect());
    let now = counters.stats();
    let is_connected = if now.is_connected { 1.0 } else { 0.0 };
    rows.gauge("bus_connected", "Whether the bus is there", is_connected);
    rows.gauge("bus_delay_seconds", "The longest way to another station", now.delay_ms / 1e3);
    let stations = [("heard", now.stations), ("cut", now.cut)];
    let stations = stations.map(|(state, n)| (vec![("state", state)], n as f64)).to_vec();
    rows.gauges(
        "bus_stations",
        "Other stations: those that take part, and those cut off",
        stations,
    );
    let live = now.guests_live;
    let guests = [("live", live), ("quiet", now.guests.saturating_sub(live))];
    let guests = guests.map(|(state, n)| (vec![("state", state)], n as f64)).to_vec();
    rows.gauges("bus_guests", "Known avatars of other stations, by state", guests);
    rows.gauge("bus_sectors", "Sectors of the building", now.sectors as f64);
    rows.gauge("bus_sectors_subscribed", "Sectors subscribed to", now.subscribed as f64);
    let is_sharing = if now.is_sharing { 1.0 } else { 0.0 };
    rows.gauge("bus_sharing", "Whether bans, mutes and roles are shared", is_sharing);
    let help = "Visitors and networks about whom something is ruled at all stations";
    rows.gauge("bus_rulings", help, now.rulings as f64);
    let results = counters.rulings_by_result().map(|(what, n)| (vec![("result", what)], n as f64));
    rows.counters("bus_rulings_shared", "Rulings on the bus, by result", results.to_vec());
    let results = counters.names_by_result().map(|(what, n)| (vec![("result", what)], n as f64));
    let help = "Names that were asked for at all stations, by result";
    rows.counters("bus_names", help, results.to_vec());
}

fn present(rows: &mut Rows, overview: &Overview) {
    let counts = overview.clients;
    let states = [
        ("joining", counts.joining),
        ("live", counts.live),
        ("on_course", counts.on_course),
        ("quiet", counts.quiet),
        ("asked", counts.asked),
        ("absent", counts.absent),
    ];
    let states = states.map(|(state, n)| (vec![("state", state)], n as f64)).to_vec();
    rows.gauges("clients", "Clients, by state", states);
    rows.gauge("tick_hz", "Ticks in a second", overview.tick_hz);
    rows.gauge("uptime_seconds", "Time since the start", overview.uptime_s);
    let world = overview.world.as_ref().map_or(0, |world| world.number);
    rows.gauge("world", "The number of the world, zero before the first", f64::from(world));
    if let Some(used) = overview.process {
        rows.counters("cpu_seconds", "Processor time", vec![(vec![], used.cpu_s)]);
        let resident = used.resident_bytes as f64;
        rows.gauge("resident_memory_bytes", "Memory that is resident", resident);
    }
}

type Labels = Vec<(&'static str, &'static str)>;

/// Metrics with their labels and values.
#[derive(Debug, Default)]
struct Rows(Vec<Row>);

#[derive(Debug)]
struct Row {
    name: &'static str,
    help: &'static str,
    values: Values,
}

#[derive(Debug)]
enum Values {
    Counters(Vec<(Labels, f64)>),
    Gauges(Vec<(Labels, f64)>),
    Histograms(Vec<(Labels, Histogram)>),
}

impl Rows {
    fn counter(&mut self, name: &'static str, help: &'static str, count: u64) {
        self.counters(name, help, vec![(vec![], count as f64)]);
    }

    fn gauge(&mut self, name: &'static str, help: &'static str, value: f64) {
        self.gauges(name, help, vec![(vec![], value)]);
    }

    fn counters(&mut self, name: &'static str, help: &'static str, of: Vec<(Labels, f64)>) {
        self.0.push(Row { name, help, values: Values::Counters(of) });
    }

    fn gauges(&mut self, name: &'static str, help: &'static str, of: Vec<(Labels, f64)>) {
        self.0.push(Row { name, help, values: Values::Gauges(of) });
    }

    fn histograms(&mut self, name: &'static str, help: &'static str, of: Vec<(Labels, Histogram)>) {
        self.0.push(Row { name, help, values: Values::Histograms(of) });
    }
}

impl Collector for Rows {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        for Row { name, help, values } in &self.0 {
            let kind = match values {
                Values::Counters(_) => MetricType::Counter,
                Values::Gauges(_) => MetricType::Gauge,
                Values::Histograms(_) => MetricType::Histogram,
            };
            let mut encoder = encoder.encode_descriptor(name, help, None, kind)?;
            match values {
                Values::Counters(of) => of.iter().try_for_each(|(labels, count)| {
                    labelled(&mut encoder, labels, |encoder| {
                        encoder.encode_counter::<NoLabelSet, _, f64>(count, None)
                    })
                })?,
                Values::Gauges(of) => of.iter().try_for_each(|(labels, value)| {
                    labelled(&mut encoder, labels, |encoder| encoder.encode_gauge(value))
                })?,
                Values::Histograms(of) => of.iter().try_for_each(|(labels, times)| {
                    let (sum, buckets) = (times.sum().as_secs_f64(), times.buckets());
                    labelled(&mut encoder, labels, |encoder| {
                        encoder.encode_histogram::<NoLabelSet>(sum, times.count(), &buckets, None)
                    })
                })?,
            }
        }
        Ok(())
    }
}

/// Encodes a value with its labels, or without braces when it has none.
fn labelled(
    encoder: &mut MetricEncoder<'_>,
    labels: &Labels,
    encode: impl FnOnce(&mut MetricEncoder<'_>) -> fmt::Result,
) -> fmt::Result {
    if labels.is_empty() { encode(encoder) } else { encode(&mut encoder.encode_family(labels)?) }
}
