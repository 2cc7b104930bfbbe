//! Counting changes, so that old results are known to be old.

/// Counts changes. Equal generations mean that nothing changed in between; the count wraps after
/// 2³² changes, so no result may be kept for so long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct Generation(u32);

impl Generation {
    /// Counts one change.
    pub(crate) fn advance(&mut self) {
        self.0 = self.0.wrapping_add(1);
    }

    /// Counts one change, and returns the new count.
    pub(crate) fn next(&mut self) -> Self {
        self.advance();
        *self
    }
}

/// A value for some of the numbers below a bound, all of which are forgotten at once.
///
/// Each entry holds the generation in which it was set, so clearing touches no entry. That suits
/// searches that visit few of many cells, portals or gates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Generational<T> {
    current: Generation,
    entries: Vec<(Generation, T)>,
}

impl<T: Copy + Default> Generational<T> {
    /// Forgets all values, and makes room for the numbers below `bound`.
    pub(crate) fn clear(&mut self, bound: usize) {
        self.entries.resize(bound, (Generation::default(), T::default()));
        self.current.advance();
        if self.current == Generation::default() {
            // The count has wrapped: old entries must not look new.
            self.entries.fill((Generation::default(), T::default()));
            self.current.advance();
        }
    }

    /// The value of a number, if it was set since the last [`Generational::clear`].
    pub(crate) fn get(&self, number: u32) -> Option<T> {
        let (generation, value) = self.entries[number as usize];
        (generation == self.current).then_some(value)
    }

    /// Sets the value of a number.
    pub(crate) fn set(&mut self, number: u32, value: T) {
        self.entries[number as usize] = (self.current, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_forgotten_when_cleared_even_after_the_count_wraps() {
        let mut values = Generational::<u32>::default();
        values.clear(2);
        assert_eq!(values.get(1), None);
        values.set(1, 7);
        assert_eq!((values.get(0), values.get(1)), (None, Some(7)));
        values.clear(2);
        assert_eq!(values.get(1), None);
        values.set(1, 8);
        values.current = Generation(u32::MAX);
        values.set(0, 9);
        values.clear(2);
        assert_eq!((values.get(0), values.get(1)), (None, None));
        assert_eq!(values.current, Generation(1));
    }
}
