//! The client without I/O: no socket, no clock, no window.
//!
//! * [`replica`]: what this client knows of the others, and its own TBV.
//! * [`reporting`]: when this client reports.
//! * [`walker`]: how one's own body walks, climbs and collides.
//! * [`navigation`]: where a body can walk, for simulated visitors.

pub mod navigation;
pub mod replica;
pub mod reporting;
pub mod walker;
