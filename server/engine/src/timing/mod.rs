//! How far ahead the engine decides, and how unevenly clients' messages arrive.

mod horizon;
mod jitter;

pub(crate) use horizon::{Horizons, Link, SILENT_MAX};
pub(crate) use jitter::Jitter;
