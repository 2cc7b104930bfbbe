//! Whole-system pieces: what only server and client together can show.
//!
//! * [`simulation`]: the engine in random buildings, with faults, against brute force.
//! * [`demo`]: a server, simulated visitors, a window or pictures, and a table of what it cost.

pub mod demo;
pub mod simulation;
