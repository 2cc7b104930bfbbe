//! Relays: what another station has been told of an avatar, and what it wants to be told.

use std::time::Duration;

use sightline_world::motion::Tolerance;

use crate::{
    bus::{StationId, Stay},
    generation::Generation,
};

/// What another station has to do with an avatar. To that station, this one is what a client is to
/// a server: it says what departs from what was said before, as it was ordered.
#[derive(Clone, Debug)]
pub(crate) struct Relay {
    pub(crate) station: StationId,
    /// How many orders came from there.
    pub(crate) orders: u32,
    pub(crate) order: RelayOrder,
    /// What was last told; `None` when a report is owed.
    pub(crate) told: Option<RelayKey>,
    /// Since when the avatar cannot be where the other station subscribes.
    pub(crate) outside_since: Option<Duration>,
}

/// What another station wants to be told of an avatar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RelayOrder {
    /// Each departure from its course. The finest tolerance that the other station asked for, if it
    /// has.
    Live(Option<Tolerance>),
    /// When it may leave this box.
    Quiet(Stay),
}

/// What a report depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RelayKey {
    /// Counts accepted poses.
    pub(crate) version: Generation,
    pub(crate) tolerance: Tolerance,
    pub(crate) is_believed: bool,
    pub(crate) is_absent: bool,
    pub(crate) round_trip: Duration,
}

/// What is known of an avatar that belongs to another station.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Guest {
    /// The station that it belongs to.
    pub(crate) station: StationId,
    /// The moment, on that station's clock, up to which all that it said has been heard.
    pub(crate) until: Duration,
    /// How long ago that is at most.
    pub(crate) age: Duration,
}
