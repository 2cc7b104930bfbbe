//! Ids of avatars, which tell nobody how many there were.

use std::{
    collections::{HashSet, VecDeque},
    hash::{BuildHasher, RandomState},
};

use sightline_world::motion::AvatarId;

/// The number of ids for each connection that may exist at a time. They are short on the wire.
const IDS_PER_CONNECTION: usize = 8;
/// An id is used again only after a part of all ids were released: one in this number.
const RESTING_PARTS: usize = 4;

/// Draws ids at random. One that was released rests for long before it is used again.
#[derive(Debug)]
pub struct AvatarIds {
    /// Ids are from 1 to this.
    greatest: u32,
    keys: RandomState,
    drawn: u64,
    /// The ids in use, and those that rest.
    taken: HashSet<AvatarId>,
    /// Those that rest, oldest first.
    resting: VecDeque<AvatarId>,
}

impl AvatarIds {
    /// Ids for this number of connections at a time.
    pub fn new(connections_max: usize) -> Self {
        let ids = (connections_max.max(1) * IDS_PER_CONNECTION).next_power_of_two();
        Self {
            greatest: u32::try_from(ids).unwrap_or(u32::MAX),
            keys: RandomState::new(),
            drawn: 0,
            taken: HashSet::new(),
            resting: VecDeque::new(),
        }
    }

    /// An id that nobody has.
    pub fn draw(&mut self) -> AvatarId {
        assert!(self.taken.len() < self.greatest as usize, "connections have a limit");
        loop {
            self.drawn += 1;
            let random = self.keys.hash_one(self.drawn) % u64::from(self.greatest);
            let id = AvatarId(random as u32 + 1);
            if self.taken.insert(id) {
                return id;
            }
        }
    }

    /// Takes back an id.
    pub fn release(&mut self, id: AvatarId) {
        debug_assert!(self.taken.contains(&id), "an id is drawn before it is released");
        self.resting.push_back(id);
        if self.resting.len() > self.greatest as usize / RESTING_PARTS
            && let Some(rested) = self.resting.pop_front()
        {
            self.taken.remove(&rested);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique_rest_long_and_do_not_ascend() {
        let mut ids = AvatarIds::new(100);
        let first: Vec<AvatarId> = (0..100).map(|_| ids.draw()).collect();
        assert_eq!(first.iter().collect::<HashSet<_>>().len(), 100);
        assert!(first.iter().all(|id| (1..=1_024).contains(&id.0)));
        let ascending = first.windows(2).filter(|pair| pair[0].0 + 1 == pair[1].0).count();
        assert!(ascending < 20, "{ascending} of 99 follow each other");
        // One connection after the other: none has the id of one of the last 256.
        let mut last = VecDeque::new();
        for _ in 0..5_000 {
            let id = ids.draw();
            assert!(!last.contains(&id) && !first.contains(&id));
            ids.release(id);
            last.push_back(id);
            last.drain(..last.len().saturating_sub(256));
        }
    }
}
