//! Parcels that were held up on their way: what they say is old.

use std::time::Duration;

/// A parcel that takes this much longer than the quickest is too late. After a break of a link the
/// words of many seconds may come at once.
const LATE: Duration = Duration::from_secs(1);
/// The quickest of the last one to two of these spans counts, since clocks drift.
const SPAN: Duration = Duration::from_secs(15);

/// How long the parcels of one station take, as the difference of two clocks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lateness {
    /// When the present span began.
    began: Duration,
    /// The least difference of the present span and of the one before, in microseconds.
    least_us: [Option<i64>; 2],
}

impl Lateness {
    /// Takes in a parcel that arrived at a time of this station's clock, and was sent at a time of
    /// the other's. Returns whether it is too late to be taken in.
    pub fn is_late(&mut self, arrived: Duration, sent: Duration) -> bool {
        let us = |time: Duration| i64::try_from(time.as_micros()).unwrap_or(i64::MAX);
        let took_us = us(arrived).saturating_sub(us(sent));
        if arrived >= self.began + SPAN {
            self.began = arrived;
            self.least_us = [None, self.least_us[0]];
        }
        self.least_us[0] = Some(self.least_us[0].map_or(took_us, |least| least.min(took_us)));
        let least_us = self.least_us.into_iter().flatten().min().unwrap_or(took_us);
        took_us.saturating_sub(least_us) > us(LATE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_held_up_is_late_and_a_clock_that_jumps_is_forgiven() {
        let ms = Duration::from_millis;
        let mut lateness = Lateness::default();
        assert!((0..100).all(|i| !lateness.is_late(ms(5_000 + 50 * i), ms(50 * i))));
        assert!(lateness.is_late(ms(13_000), ms(5_000)), "three seconds more");
        assert!(!lateness.is_late(ms(13_000), ms(7_900)));
        for at in 14..60 {
            let is_late = lateness.is_late(ms(1_000 * at), ms(1_000 * at - 13_000));
            assert_eq!(is_late, at < 30, "a new clock counts after two spans");
        }
    }
}
