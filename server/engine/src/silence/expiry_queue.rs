//! Expiry queue: a deadline for each avatar.

use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

use sightline_world::motion::AvatarId;

/// Deadlines, one for each avatar, kept in slots one tick long.
///
/// A deadline is due before it has passed, never after: [`ExpiryQueue::due`] returns all that would
/// be late at the next tick. A full slot passes further deadlines to the slot before it, so a
/// thousand deadlines at one moment are spread over the ticks before it.
#[derive(Clone, Debug)]
pub(crate) struct ExpiryQueue {
    tick: Duration,
    slots: BTreeMap<u64, BTreeSet<AvatarId>>,
    slot_of: BTreeMap<AvatarId, u64>,
}

impl ExpiryQueue {
    /// An empty queue, which is looked at once a tick.
    pub(crate) fn new(tick: Duration) -> Self {
        let tick = tick.max(Duration::from_millis(1));
        Self { tick, slots: BTreeMap::new(), slot_of: BTreeMap::new() }
    }

    /// The number of deadlines.
    pub(crate) fn len(&self) -> usize {
        self.slot_of.len()
    }

    /// Sets an avatar's deadline, in place of the one it had. The deadline goes to the latest slot
    /// that is not late and holds fewer than `slot_max`, or else to its own slot.
    pub(crate) fn set(
        &mut self,
        avatar: AvatarId,
        now: Duration,
        deadline: Duration,
        slot_max: usize,
    ) {
        self.cancel(avatar);
        let own = self.slot_at(deadline);
        let next = self.slot_at(now) + 1;
        let slot = (next..=own).rev().find(|s| self.held(*s) < slot_max).unwrap_or(own);
        self.slots.entry(slot).or_default().insert(avatar);
        self.slot_of.insert(avatar, slot);
    }

    /// Cancels an avatar's deadline, if it has one.
    pub(crate) fn cancel(&mut self, avatar: AvatarId) {
        let Some(slot) = self.slot_of.remove(&avatar) else { return };
        if let Some(avatars) = self.slots.get_mut(&slot) {
            avatars.remove(&avatar);
            if avatars.is_empty() {
                self.slots.remove(&slot);
            }
        }
    }

    /// Takes out all deadlines that would be late at the tick after the one at `now`, by slot, then
    /// by id.
    pub(crate) fn due(&mut self, now: Duration) -> Vec<AvatarId> {
        let mut due = Vec::new();
        while let Some(slot) = self.slots.first_entry()
            && self.tick.as_nanos() * u128::from(*slot.key()) < (now + self.tick).as_nanos()
        {
            due.extend(slot.remove());
        }
        for avatar in &due {
            let slot = self.slot_of.remove(avatar);
            debug_assert!(slot.is_some(), "every deadline has a slot");
        }
        due
    }

    fn held(&self, slot: u64) -> usize {
        self.slots.get(&slot).map_or(0, BTreeSet::len)
    }

    /// The last slot that does not begin after a moment.
    fn slot_at(&self, moment: Duration) -> u64 {
        u64::try_from(moment.as_nanos() / self.tick.as_nanos()).unwrap_or(u64::MAX - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: Duration = Duration::from_millis(50);

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn nothing_is_late_and_nothing_is_more_than_two_ticks_early() {
        for phase in [0, 1, 20, 49] {
            for deadline in 0..400 {
                let mut queue = ExpiryQueue::new(TICK);
                queue.set(AvatarId(1), ms(0), ms(deadline), usize::MAX);
                let out = (0..).map(|k| ms(50 * k + phase)).find(|t| !queue.due(*t).is_empty());
                let out = out.unwrap();
                assert!(out <= ms(deadline) || out < TICK, "{phase} {deadline} {out:?}");
                assert!(out + 2 * TICK > ms(deadline), "{phase} {deadline} {out:?}");
            }
        }
    }

    #[test]
    fn a_thousand_at_once_are_spread_and_never_late() {
        let mut queue = ExpiryQueue::new(TICK);
        for i in 0..1_000 {
            queue.set(AvatarId(i), ms(0), ms(1_000), 100);
        }
        let mut all = 0;
        for k in 1..=20 {
            let due = queue.due(TICK * k);
            assert!(due.len() <= 100, "{} at tick {k}", due.len());
            all += due.len();
        }
        assert_eq!((all, queue.len()), (1_000, 0));
    }

    #[test]
    fn more_than_fits_goes_over_the_bound_rather_than_late() {
        let mut queue = ExpiryQueue::new(TICK);
        for i in 0..50 {
            queue.set(AvatarId(i), ms(0), ms(200), 10);
        }
        let out: Vec<usize> = (1..=4).map(|k| queue.due(TICK * k).len()).collect();
        assert_eq!(out, [10, 10, 10, 20]);
    }

    #[test]
    fn the_last_deadline_counts_and_a_cancelled_one_does_not() {
        let mut queue = ExpiryQueue::new(TICK);
        queue.set(AvatarId(1), ms(0), ms(100), 1);
        queue.set(AvatarId(1), ms(0), ms(300), 1);
        queue.set(AvatarId(2), ms(0), ms(100), 1);
        queue.cancel(AvatarId(2));
        queue.cancel(AvatarId(3));
        assert_eq!(queue.len(), 1);
        assert!(queue.due(ms(200)).is_empty());
        assert_eq!(queue.due(ms(300)), [AvatarId(1)]);
        assert_eq!(queue.len(), 0);
    }
}
