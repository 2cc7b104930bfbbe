//! Percentiles by nearest rank: always a value that was measured, never one in between.

/// The rank of a percentile among `count` sorted values, counted from 1. At least `percent` in a
/// hundred values are at this rank or below it. It is 0 when there are no values.
///
/// # Panics
/// When `percent` is above 100.
pub fn rank(count: u64, percent: u64) -> u64 {
    assert!(percent <= 100, "{percent} is no percentage");
    let rank = u128::from(count) * u128::from(percent);
    // At most `count`, so it fits again.
    (rank.div_ceil(100) as u64).max(count.min(1))
}

/// A percentile of values in ascending order; `None` when there are no values.
///
/// # Panics
/// When `percent` is above 100.
pub fn percentile<T: Copy + PartialOrd>(sorted: &[T], percent: u64) -> Option<T> {
    debug_assert!(sorted.is_sorted(), "percentiles need values in ascending order");
    let place = rank(sorted.len() as u64, percent).checked_sub(1)?;
    sorted.get(place as usize).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_percentile_is_the_nearest_rank() {
        let check = |values: &[u32], percent, expected| {
            assert_eq!(percentile(values, percent), expected, "{percent} % of {values:?}");
        };
        check(&[], 50, None);
        check(&[7], 0, Some(7));
        check(&[7], 100, Some(7));
        check(&[1, 2, 3, 4], 50, Some(2));
        check(&[1, 2, 3, 4], 51, Some(3));
        check(&[1, 2, 3, 4], 99, Some(4));
        let hundred: Vec<u32> = (1..=100).collect();
        check(&hundred, 99, Some(99));
        check(&hundred, 100, Some(100));
    }

    #[test]
    fn ranks_of_huge_counts_do_not_overflow() {
        assert_eq!(rank(u64::MAX, 100), u64::MAX);
        assert_eq!(rank(0, 99), 0);
    }
}
