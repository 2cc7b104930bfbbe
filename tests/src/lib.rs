//! Tests of the whole system: what only server and client together can show.
//!
//! * [`simulation`]: the engine in random buildings, with random networks and injected faults,
//!   compared with brute force at every tick. [`simulation::run`] runs one seed.
//! * [`demo`]: `cargo demo`. A real server, simulated visitors, a window or pictures, and a table
//!   of what each client was told.
//! * [`streaming`]: a client that fetches a world in pieces over a simulated link.
//! * [`bench_flags`]: what the command lines of all benches have.
//!
//! The folder `tests` has the tests over loopback QUIC, of pictures against rays, and of walls. The
//! folder `benches` has the measurements.
//!
//! # Example
//!
//! Run the simulation of one seed, in the only building of its pool:
//!
//! ```
//! use sightline_tests::simulation::{BuildingPool, Fault, run};
//!
//! let outcome = run(7, &BuildingPool::only(7, 1), Fault::None);
//! assert!(outcome.is_good(), "{outcome}");
//! ```

pub mod bench_flags;
pub mod demo;
pub mod simulation;
pub mod streaming;
