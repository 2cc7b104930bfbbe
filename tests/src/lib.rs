//! Whole-system pieces: what only server and client together can show.
//!
//! * [`demo`]: a server, simulated visitors, a window or pictures, and a table of what it cost.

pub mod demo;
