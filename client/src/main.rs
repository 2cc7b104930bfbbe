//! `sightline-client`: walk, shot, swarm.
fn main() {}
