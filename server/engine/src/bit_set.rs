//! Sets of small numbers, with a lookup that takes no search.

use std::ops::RangeInclusive;

/// A bit for each number up to the greatest: 2 KiB for 16,384 numbers.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(crate) struct BitSet(Vec<u64>);

impl BitSet {
    pub(crate) fn insert(&mut self, number: u32) {
        self.reserve(number as usize / 64 + 1);
        self.0[number as usize / 64] |= 1 << (number % 64);
    }

    /// Inserts all numbers of a range.
    pub(crate) fn insert_range(&mut self, range: RangeInclusive<u32>) {
        let (first, last) = range.into_inner();
        if first > last {
            return;
        }
        let [from, to] = [first, last].map(|number| number as usize / 64);
        self.reserve(to + 1);
        let (above, below) = (u64::MAX << (first % 64), u64::MAX >> (63 - last % 64));
        if from == to {
            self.0[from] |= above & below;
            return;
        }
        self.0[from] |= above;
        self.0[from + 1..to].fill(u64::MAX);
        self.0[to] |= below;
    }

    pub(crate) fn remove(&mut self, number: u32) {
        if let Some(word) = self.0.get_mut(number as usize / 64) {
            *word &= !(1 << (number % 64));
        }
    }

    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    /// Inserts all numbers of another set.
    pub(crate) fn unite(&mut self, other: &Self) {
        self.reserve(other.0.len());
        self.0.iter_mut().zip(&other.0).for_each(|(word, other)| *word |= other);
    }

    pub(crate) fn contains(&self, number: u32) -> bool {
        self.0.get(number as usize / 64).is_some_and(|word| word >> (number % 64) & 1 == 1)
    }

    /// All numbers, ascending.
    pub(crate) fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.shared(self)
    }

    /// The numbers that are in both sets, ascending.
    pub(crate) fn shared<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = u32> + 'a {
        (0..).zip(self.0.iter().zip(&other.0)).flat_map(|(place, (word, other))| {
            let mut left = word & other;
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| left.trailing_zeros())?;
                left &= left - 1;
                Some(place * 64 + bit)
            })
        })
    }

    fn reserve(&mut self, words: usize) {
        if self.0.len() < words {
            self.0.resize(words, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::{collection::btree_set, prelude::*};

    use super::*;

    proptest! {
        #[test]
        fn a_bit_set_behaves_like_a_sorted_set(a in btree_set(0..500u32, 0..40), b in btree_set(0..300u32, 0..40)) {
            let (mut x, mut y) = (BitSet::default(), BitSet::default());
            a.iter().for_each(|number| x.insert(*number));
            b.iter().for_each(|number| y.insert(*number));
            prop_assert!(x.iter().eq(a.iter().copied()));
            prop_assert!(x.shared(&y).eq(a.intersection(&b).copied()));
            let mut all = x.clone();
            all.unite(&y);
            prop_assert!((0..600).all(|n| all.contains(n) == (a.contains(&n) || b.contains(&n))));
            b.iter().for_each(|number| all.remove(*number));
            let left: BTreeSet<u32> = a.difference(&b).copied().collect();
            prop_assert!((0..600).all(|number| all.contains(number) == left.contains(&number)));
        }

        #[test]
        fn inserting_a_range_inserts_each_of_its_numbers(a in btree_set(0..500u32, 0..9), first in 0..400u32, len in 0..200u32) {
            let (mut by_range, mut one_by_one) = (BitSet::default(), BitSet::default());
            for bits in [&mut by_range, &mut one_by_one] {
                a.iter().for_each(|number| bits.insert(*number));
            }
            by_range.insert_range(first..=first + len);
            (first..=first + len).for_each(|number| one_by_one.insert(number));
            prop_assert_eq!(by_range, one_by_one);
        }
    }
}
