//! Reports: what a client says of its own avatar.

use std::time::Duration;

use super::Pose;

/// What a client says of its own avatar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// When it was made, on the client's own clock. Zero is one of the client's ticks. Each report
    /// is made later than the one before.
    pub made: Duration,
    /// How many orders to be live or quiet the client had received.
    pub orders: u32,
    /// The pose.
    pub pose: Pose,
}
