//! `sightline-server`: compile, inspect, serve, replay.
fn main() {}
