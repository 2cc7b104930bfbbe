//! How far ahead the engine decides, and how unevenly clients' messages arrive.

mod arrivals;
mod horizon;

pub(crate) use arrivals::{Arrivals, LastKnown};
pub(crate) use horizon::{Abroad, Horizons, Link, SILENT_MAX};
