//! Orders: what a client has been told to leave unsaid, and what it is known to have heard.

use sightline_world::motion::Tolerance;

/// The orders to one client, and the tolerance that its silence stands for.
///
/// An order takes effect when the client hears it, and its next report shows that it has. Until
/// then the client may obey this order or one before it. So its avatar may be off course by as much
/// as any of them allows.
#[derive(Clone, Debug)]
pub(crate) struct Orders {
    /// How many orders to be live or quiet were sent.
    sent: u32,
    /// How many of them the client had heard when it made its last report.
    heard: u32,
    /// The number of the first order to be live since the client was quiet, or joined.
    live_since: u32,
    /// The tolerance of the last order.
    told: Tolerance,
    /// What the client may leave unsaid for all that is known.
    in_force: Tolerance,
}

impl Default for Orders {
    fn default() -> Self {
        let (told, in_force) = (Tolerance::NONE, Tolerance::NONE);
        Self { sent: 0, heard: 0, live_since: 1, told, in_force }
    }
}

impl Orders {
    /// Takes in that the client is told to be quiet.
    pub(crate) fn send_quiet(&mut self) {
        self.sent += 1;
        self.live_since = self.sent + 1;
        (self.told, self.in_force) = (Tolerance::NONE, Tolerance::NONE);
    }

    /// Takes in that the client is told to be live.
    pub(crate) fn send_live(&mut self, tolerance: Tolerance) {
        self.sent += 1;
        self.told = tolerance;
        self.in_force = self.in_force.union(&tolerance);
    }

    /// The orders to another station for one of its avatars, which it takes to be live without any.
    pub(crate) fn to_station(told: Tolerance) -> Self {
        Self { live_since: 0, told, ..Self::default() }
    }

    /// Takes in that another station is asked for an avatar. What may be left unsaid follows from
    /// its reports.
    pub(crate) fn send_ask(&mut self, tolerance: Tolerance) {
        self.sent += 1;
        self.told = tolerance;
    }

    /// Whether a report that shows these orders heard was made after the last one was.
    pub(crate) fn are_heard(&self, orders: u32) -> bool {
        orders >= self.sent
    }

    /// Takes in what another station says of an avatar, and that it leaves where it was to stay if
    /// that is the last order.
    pub(crate) fn relay(&mut self, orders: u32, in_force: Tolerance, told: Tolerance) {
        self.heard = orders.min(self.sent);
        self.in_force = in_force;
        if self.is_quiet() && self.heard == self.sent {
            (self.live_since, self.told) = (self.sent, told);
        }
    }

    /// Takes in how many orders the client had heard when it made a report.
    pub(crate) fn hear(&mut self, orders: u32) {
        self.heard = orders.min(self.sent);
        if self.heard == self.sent {
            self.in_force = self.told;
        }
    }

    /// Whether the client knows that it is live and by how much it may be off course, so that its
    /// silence means that it is not farther off.
    pub(crate) fn is_understood(&self) -> bool {
        self.heard >= self.live_since && !self.in_force.is_none()
    }

    /// Whether the last order was to be quiet.
    pub(crate) fn is_quiet(&self) -> bool {
        self.live_since > self.sent && self.sent > 0
    }

    /// The tolerance of the last order.
    pub(crate) fn told(&self) -> Tolerance {
        self.told
    }

    /// By how much the avatar may be off course.
    pub(crate) fn in_force(&self) -> Tolerance {
        self.in_force
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn tolerance(metres: f32) -> Tolerance {
        Tolerance { metres, radians: metres, ahead: Duration::from_millis(200) }
    }

    #[test]
    fn silence_stands_for_the_loosest_order_that_may_be_obeyed() {
        let mut orders = Orders::default();
        orders.send_live(tolerance(0.1));
        assert!(!orders.is_understood(), "the client reports at every tick");
        orders.hear(1);
        assert!(orders.is_understood());
        orders.send_live(tolerance(0.2));
        assert_eq!(orders.in_force(), tolerance(0.2), "it may have heard");
        orders.send_live(tolerance(0.05));
        orders.hear(2);
        assert_eq!(orders.in_force(), tolerance(0.2), "it has not heard the last order");
        orders.hear(3);
        assert_eq!(orders.in_force(), tolerance(0.05));
    }

    #[test]
    fn the_silence_of_a_client_that_was_quiet_means_nothing_before_it_knows_that_it_is_live() {
        let mut orders = Orders::default();
        orders.send_live(tolerance(0.1));
        orders.hear(1);
        orders.send_quiet();
        orders.hear(2);
        assert!(!orders.is_understood());
        orders.send_live(tolerance(0.1));
        orders.hear(2);
        assert!(!orders.is_understood());
        orders.hear(99);
        assert!(orders.is_understood());
    }
}
