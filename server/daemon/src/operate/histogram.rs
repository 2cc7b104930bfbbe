//! Times by their length.

use std::time::Duration;

/// The greatest time of each bucket but the last, in microseconds: 1, 2 and 5 of each power of ten
/// from a tenth of a millisecond to a second.
const BOUNDS_US: [u64; 13] = [
    100, 200, 500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000,
    1_000_000,
];

/// How many times were how long.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Histogram {
    buckets: [u64; BOUNDS_US.len() + 1],
    sum: Duration,
}

impl Histogram {
    /// Counts a time.
    pub(crate) fn record(&mut self, time: Duration) {
        let us = time.as_micros();
        let bucket = BOUNDS_US.partition_point(|bound| u128::from(*bound) < us);
        self.buckets[bucket] += 1;
        self.sum = self.sum.saturating_add(time);
    }

    /// How many times there were.
    pub fn count(&self) -> u64 {
        self.buckets.iter().sum()
    }

    /// All times together.
    pub fn sum(&self) -> Duration {
        self.sum
    }

    /// The greatest time of each bucket in seconds, and how many times are in it. The last bucket
    /// has no greatest time, which is written as [`f64::MAX`].
    pub fn buckets(&self) -> [(f64, u64); BOUNDS_US.len() + 1] {
        let bound = |i: usize| BOUNDS_US.get(i).map_or(f64::MAX, |us| *us as f64 / 1e6);
        std::array::from_fn(|i| (bound(i), self.buckets[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_counted_by_their_length() {
        let mut histogram = Histogram::default();
        for us in [0, 100, 101, 1_000_000, 1_000_001] {
            histogram.record(Duration::from_micros(us));
        }
        let buckets = histogram.buckets();
        assert_eq!((buckets[0], buckets[1]), ((0.0001, 2), (0.0002, 1)));
        assert_eq!((buckets[12], buckets[13]), ((1.0, 1), (f64::MAX, 1)));
        assert_eq!(histogram.count(), 5);
        assert_eq!(histogram.sum(), Duration::from_micros(2_000_202));
    }
}
