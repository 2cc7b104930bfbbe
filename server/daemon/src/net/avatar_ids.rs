//! Ids of avatars, which tell nobody how many there were.

use std::{
    collections::{HashSet, VecDeque},
    hash::{BuildHasher, RandomState},
};

use sightline_engine::StationId;
use sightline_world::motion::AvatarId;

use crate::bus::STATIONS_MAX;

/// The number of ids for each connection that may exist at a time. They are short on the wire.
const IDS_PER_CONNECTION: usize = 8;
/// An id is used again only after a part of all ids were released: one in this number.
const RESTING_PARTS: usize = 4;

/// The bits of an id that say which station has drawn it.
const STATION_BITS: u32 = STATIONS_MAX.count_ones();

/// Draws ids at random. One that was released rests for long before it is used again.
#[derive(Debug)]
pub struct AvatarIds {
    /// Ids are from 1 to this, before they become those of a station.
    greatest: u32,
    /// The station on a bus, whose ids no other one draws.
    station: Option<StationId>,
    keys: RandomState,
    drawn: u64,
    /// The ids in use, and those that rest.
    taken: HashSet<AvatarId>,
    /// Those that rest, oldest first.
    resting: VecDeque<AvatarId>,
}

impl AvatarIds {
    /// Ids for this number of connections at a time, of a server or of a station on a bus.
    pub fn new(connections_max: usize, station: Option<StationId>) -> Self {
        let ids = (connections_max.max(1) * IDS_PER_CONNECTION).next_power_of_two();
        let most = if station.is_some() { u32::MAX >> STATION_BITS } else { u32::MAX };
        Self {
            greatest: u32::try_from(ids).unwrap_or(most).min(most),
            station,
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
            let id = self.of_station(random as u32 + 1);
            if self.taken.insert(id) {
                return id;
            }
        }
    }

    fn of_station(&self, id: u32) -> AvatarId {
        AvatarId(match self.station {
            Some(StationId(station)) => (id << STATION_BITS) | (station & STATIONS_MAX),
            None => id,
        })
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
        let mut ids = AvatarIds::new(100, None);
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

    #[test]
    fn no_two_stations_draw_the_same_id() {
        let drawn = (1..=STATIONS_MAX).flat_map(|station| {
            let mut ids = AvatarIds::new(4, Some(StationId(station)));
            (0..20).map(move |_| ids.draw())
        });
        let drawn: HashSet<AvatarId> = drawn.collect();
        assert_eq!(drawn.len(), 20 * STATIONS_MAX as usize);
        let mut most = AvatarIds::new(usize::MAX / 16, Some(StationId(STATIONS_MAX)));
        assert_eq!(most.draw().0 & STATIONS_MAX, STATIONS_MAX);
    }
}
