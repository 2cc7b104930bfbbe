//! Sets of small numbers in which looking one up takes no search.

use roaring::RoaringBitmap;

/// A bit for each number up to the greatest: 5 KiB for the cells of a building of 40,000.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(super) struct Bits(Vec<u64>);

impl Bits {
    pub(super) fn insert(&mut self, number: u32) {
        self.reserve(number as usize / 64 + 1);
        self.0[number as usize / 64] |= 1 << (number % 64);
    }

    pub(super) fn remove(&mut self, number: u32) {
        if let Some(word) = self.0.get_mut(number as usize / 64) {
            *word &= !(1 << (number % 64));
        }
    }

    /// Takes in all of a row of the PVS.
    pub(super) fn extend(&mut self, row: &RoaringBitmap) {
        row.iter().for_each(|number| self.insert(number));
    }

    /// Takes in all of another set.
    pub(super) fn unite(&mut self, other: &Self) {
        self.reserve(other.0.len());
        self.0.iter_mut().zip(&other.0).for_each(|(word, other)| *word |= other);
    }

    pub(super) fn contains(&self, number: u32) -> bool {
        self.0.get(number as usize / 64).is_some_and(|word| word & 1 << (number % 64) != 0)
    }

    /// All of them, ascending.
    pub(super) fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        numbers(self.0.iter().copied())
    }

    /// Those that are in another set as well, ascending.
    pub(super) fn shared<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = u32> + 'a {
        numbers(self.0.iter().zip(&other.0).map(|(word, other)| word & other))
    }

    fn reserve(&mut self, words: usize) {
        if self.0.len() < words {
            self.0.resize(words, 0);
        }
    }
}

fn numbers(words: impl Iterator<Item = u64>) -> impl Iterator<Item = u32> {
    (0..).zip(words).flat_map(|(place, word)| {
        let mut left = word;
        std::iter::from_fn(move || {
            let bit = (left != 0).then(|| left.trailing_zeros())?;
            left &= left - 1;
            Some(place * 64 + bit)
        })
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::{collection::btree_set, prelude::*};

    use super::*;

    proptest! {
        #[test]
        fn as_a_sorted_set_does(a in btree_set(0..500u32, 0..40), b in btree_set(0..300u32, 0..40)) {
            let (mut x, mut y) = (Bits::default(), Bits::default());
            x.extend(&a.iter().copied().collect());
            b.iter().for_each(|number| y.insert(*number));
            prop_assert!(x.iter().eq(a.iter().copied()));
            prop_assert!(x.shared(&y).eq(a.intersection(&b).copied()));
            let mut all = x.clone();
            all.unite(&y);
            prop_assert!(all.iter().eq(a.union(&b).copied()));
            b.iter().for_each(|number| all.remove(*number));
            let left: BTreeSet<u32> = a.difference(&b).copied().collect();
            prop_assert!((0..600).all(|number| all.contains(number) == left.contains(&number)));
        }
    }
}
