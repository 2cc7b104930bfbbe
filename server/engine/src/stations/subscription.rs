//! Subscriptions: the sectors that a station's own avatars may see.

use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

use sightline_world::motion::AvatarId;

use crate::{bit_set::BitSet, generation::Generation};

/// A sector that nobody may see any more is given up at one of the moments that are so far apart.
/// So people who go to and fro cost nothing.
const GIVE_UP_AFTER: Duration = Duration::from_secs(2);

/// What of its subscription a station tells the others.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(crate) struct Change {
    pub(crate) number: u32,
    pub(crate) added: Vec<u32>,
    pub(crate) removed: Vec<u32>,
}

/// The sectors that a station subscribes to.
#[derive(Clone, Debug, Default)]
pub(crate) struct Subscription {
    /// How many avatars may see each sector.
    seen: BTreeMap<u32, u32>,
    /// The sectors that each avatar may see, and the version of the footprint that they follow
    /// from.
    by_avatar: BTreeMap<AvatarId, (Generation, Vec<u32>)>,
    all: BitSet,
    /// The sectors of which all others have said who may be there.
    synced: BitSet,
    /// Changes that some other station has not answered yet.
    waiting: VecDeque<Change>,
    number: u32,
    given_up: Duration,
}

impl Subscription {
    /// Whether the sectors that an avatar may see are known for this version of its footprint.
    pub(crate) fn is_current(&self, avatar: AvatarId, version: Generation) -> bool {
        self.by_avatar.get(&avatar).is_some_and(|(known, _)| *known == version)
    }

    /// Takes in the sectors that an avatar may see.
    pub(crate) fn set(&mut self, avatar: AvatarId, version: Generation, sectors: Vec<u32>) {
        sectors.iter().for_each(|sector| *self.seen.entry(*sector).or_insert(0) += 1);
        let old = self.by_avatar.insert(avatar, (version, sectors));
        self.lose(old.map(|(_, sectors)| sectors));
    }

    /// Forgets an avatar.
    pub(crate) fn remove(&mut self, avatar: AvatarId) {
        let old = self.by_avatar.remove(&avatar);
        self.lose(old.map(|(_, sectors)| sectors));
    }

    fn lose(&mut self, sectors: Option<Vec<u32>>) {
        for sector in sectors.into_iter().flatten() {
            if let Some(count) = self.seen.get_mut(&sector) {
                *count -= 1;
                if *count == 0 {
                    self.seen.remove(&sector);
                }
            }
        }
    }

    /// What has changed since the last call, if anything has.
    pub(crate) fn change(&mut self, now: Duration) -> Option<Change> {
        let new = |sector: &&u32| !self.all.contains(**sector);
        let added: Vec<u32> = self.seen.keys().filter(new).copied().collect();
        let mut removed = Vec::new();
        if now >= self.given_up + GIVE_UP_AFTER {
            self.given_up = now;
            removed.extend(self.all.iter().filter(|sector| !self.seen.contains_key(sector)));
        }
        if added.is_empty() && removed.is_empty() {
            return None;
        }
        added.iter().for_each(|sector| self.all.insert(*sector));
        for sector in &removed {
            self.all.remove(*sector);
            self.synced.remove(*sector);
            self.waiting.iter_mut().for_each(|change| change.added.retain(|s| s != sector));
        }
        self.number += 1;
        let change = Change { number: self.number, added, removed };
        self.waiting.push_back(Change { removed: Vec::new(), ..change.clone() });
        Some(change)
    }

    /// Takes in that what was said of its sectors is void.
    pub(crate) fn doubt(&mut self) {
        self.synced.clear();
    }

    /// All of it, as a newcomer is told. What it has to say of these sectors is not known yet.
    pub(crate) fn whole(&mut self) -> Change {
        self.number += 1;
        self.synced.clear();
        let change =
            Change { number: self.number, added: self.all.iter().collect(), removed: vec![] };
        self.waiting = VecDeque::from([change.clone()]);
        change
    }

    /// Takes in up to which change all others have answered.
    pub(crate) fn sync(&mut self, number: u32) {
        while self.waiting.front().is_some_and(|change| change.number <= number) {
            let change = self.waiting.pop_front().unwrap_or_default();
            change.added.iter().for_each(|sector| self.synced.insert(*sector));
        }
    }

    /// Whether it is known of all these sectors who may be there.
    pub(crate) fn knows(&self, sectors: &BitSet) -> bool {
        sectors.iter().all(|sector| self.synced.contains(sector))
    }

    /// How many sectors it has.
    pub(crate) fn len(&self) -> usize {
        self.all.iter().count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ADA: AvatarId = AvatarId(1);
    const BEN: AvatarId = AvatarId(2);

    fn set(sectors: &[u32]) -> BitSet {
        let mut set = BitSet::default();
        sectors.iter().for_each(|sector| set.insert(*sector));
        set
    }

    #[test]
    fn a_sector_is_known_once_all_others_have_answered_and_given_up_when_nobody_may_see_it() {
        let mut subscription = Subscription::default();
        let mut version = Generation::default();
        subscription.set(ADA, version, vec![1, 2]);
        subscription.set(BEN, version, vec![2, 3]);
        let late = Duration::from_secs(9);
        let change = subscription.change(late).expect("all are new");
        assert_eq!((change.number, change.added, change.removed), (1, vec![1, 2, 3], vec![]));
        assert!(!subscription.knows(&set(&[2])));
        subscription.sync(1);
        assert!(subscription.knows(&set(&[1, 3])) && !subscription.knows(&set(&[4])));
        subscription.set(ADA, version.next(), vec![4]);
        let change = subscription.change(late).expect("one is new");
        assert_eq!((change.added, change.removed), (vec![4], vec![]), "to and fro costs nothing");
        let change = subscription.change(late + GIVE_UP_AFTER).expect("one is given up");
        assert_eq!((change.added, change.removed), (vec![], vec![1]));
        assert!(!subscription.knows(&set(&[1])) && subscription.knows(&set(&[2])));
        assert_eq!(subscription.whole().added, [2, 3, 4]);
        assert!(!subscription.knows(&set(&[2])), "a newcomer has said nothing");
        subscription.remove(ADA);
        assert_eq!(subscription.change(late * 2).expect("she has left").removed, [4]);
    }
}
