//! Sets of small numbers, with a lookup that takes no search.

/// A bit for each number up to the greatest: 2 KiB for 16,384 numbers.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(crate) struct BitSet(Vec<u64>);

impl BitSet {
    pub(crate) fn insert(&mut self, number: u32) {
        self.reserve(number as usize / 64 + 1);
        self.0[number as usize / 64] |= 1 << (number % 64);
    }

    pub(crate) fn remove(&mut self, number: u32) {
        if let Some(word) = self.0.get_mut(number as usize / 64) {
            *word &= !(1 << (number % 64));
        }
    }

    /// Inserts all numbers of another set.
    pub(crate) fn unite(&mut self, other: &Self) {
        self.reserve(other.0.len());
        self.0.iter_mut().zip(&other.0).for_each(|(word, other)| *word |= other);
    }

    pub(crate) fn contains(&self, number: u32) -> bool {
        self.0.get(number as usize / 64).is_some_and(|word| word >> (number % 64) & 1 == 1)
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
            prop_assert!(x.shared(&y).eq(a.intersection(&b).copied()));
            let mut all = x.clone();
            all.unite(&y);
            prop_assert!((0..600).all(|n| all.contains(n) == (a.contains(&n) || b.contains(&n))));
            b.iter().for_each(|number| all.remove(*number));
            let left: BTreeSet<u32> = a.difference(&b).copied().collect();
            prop_assert!((0..600).all(|number| all.contains(number) == left.contains(&number)));
        }
    }
}
