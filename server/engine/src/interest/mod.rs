//! Interest: who is told of whom.
//!
//! A tick takes a [snapshot] of all live avatars and updates their regions. It then finds
//! [candidates], runs [sight tests](sight_tests) on the pairs that these leave open, and
//! [notifies](mod@notify) the viewers.

mod candidates;
mod certificates;
mod explain;
mod notify;
mod sight_tests;
mod snapshot;

pub(crate) use candidates::{end_pairs, forget_results, update_pairs};
pub(crate) use certificates::{CertificateInputs, find_stale};
pub(crate) use explain::explain;
pub use explain::{Explanation, Reason};
pub(crate) use notify::{count_watchers, notify, update_nearest};
pub(crate) use sight_tests::{SightBudget, test_pairs};
pub(crate) use snapshot::Snapshot;
