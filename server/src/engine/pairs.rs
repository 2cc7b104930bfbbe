//! Which avatars concern which viewers: kept up to date by what moved, never gone through as a whole.
//!
//! A viewer has a pair with every avatar whose body can be in a sector that is visible from where the
//! viewer's eye can be. What their sectors leave open is [looked at](super::looks) more closely.

use sightline_shared::motion::AvatarId;

use super::{Engine, Output, looks::Look, near::Moves, population::Slot, zones::Member};

/// A viewer's dealings with an avatar. Ordered by id.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(super) id: AvatarId,
    pub(super) slot: Slot,
    /// By their cells, the avatar may be visible to the viewer.
    pub(super) concerns: bool,
    /// The viewer's client has been told of it.
    pub(super) is_held: bool,
    /// Until that tick its client is not told that it is gone, if by their cells it may be in sight.
    pub(super) held_until: u32,
    /// The [`Avatar::version`](super::population::Avatar::version) that was sent last.
    pub(super) version: u32,
    pub(super) look: Look,
}

impl Pair {
    pub(super) fn new((id, slot): Member) -> Self {
        let look = Look::Unknown;
        Self { id, slot, concerns: true, is_held: false, held_until: 0, version: 0, look }
    }
}

impl Engine {
    /// Makes and ends pairs after regions have changed.
    pub(super) fn pair(&mut self, moves: &Moves) {
        for viewer in &moves.viewers {
            self.pair_all(*viewer);
        }
        // These have all their pairs; no others need to be looked up among them.
        let mut done = moves.viewers.clone();
        done.sort_unstable();
        for (slot, sectors) in &moves.bodies {
            for viewer in self.viewers_of(sectors) {
                if viewer != *slot && done.binary_search(&viewer).is_err() {
                    self.pair_one(viewer, *slot);
                }
            }
        }
    }

    /// The live avatars that may see into some of these sectors.
    fn viewers_of(&self, sectors: &[u32]) -> Vec<Slot> {
        let visible = self.sectors.visible_from(sectors);
        let mut viewers: Vec<Slot> =
            self.near_eyes.among(&visible).map(|(_, slot)| *slot).collect();
        viewers.sort_unstable();
        viewers.dedup();
        viewers
    }

    /// Finds all whom a viewer has to do with.
    fn pair_all(&mut self, viewer: Slot) {
        let avatar = self.population.at(viewer);
        let Some(eyes) = &avatar.near.eyes else { return };
        let mut found: Vec<Member> = self.near_bodies.among(&eyes.visible).copied().collect();
        found.sort_unstable();
        found.dedup();
        let delay = self.horizons.delay(avatar.round_trip);
        found.retain(|(_, slot)| {
            *slot != viewer && self.population.at(*slot).near.is_visible_to(eyes, delay)
        });
        let pairs = matched(&avatar.pairs, found);
        self.population.at_mut(viewer).pairs = pairs;
    }

    /// Finds whether a viewer has to do with an avatar.
    fn pair_one(&mut self, viewer: Slot, slot: Slot) {
        let (from, to) = (self.population.at(viewer), self.population.at(slot));
        let Some(eyes) = &from.near.eyes else { return };
        let concerns = to.near.is_visible_to(eyes, self.horizons.delay(from.round_trip));
        let id = to.id;
        let pairs = &mut self.population.at_mut(viewer).pairs;
        match pairs.binary_search_by_key(&id, |pair| pair.id) {
            Ok(place) if concerns || pairs[place].is_held => pairs[place].concerns = concerns,
            Ok(place) => drop(pairs.remove(place)),
            Err(place) if concerns => pairs.insert(place, Pair::new((id, slot))),
            Err(_) => {}
        }
    }

    /// Ends all pairs with an avatar that is gone or hidden, whose regions have just been taken
    /// out; those who held it are told at the next tick.
    pub(super) fn part(&mut self, slot: Slot) {
        let sectors = self.forget_near(slot);
        let id = self.population.at(slot).id;
        let viewers: Vec<Slot> = if self.config.policy.uses_cells() {
            self.viewers_of(&sectors)
        } else {
            self.population.live().collect()
        };
        for viewer in viewers {
            let to = self.population.at(viewer).id;
            let pairs = &mut self.population.at_mut(viewer).pairs;
            if let Ok(place) = pairs.binary_search_by_key(&id, |pair| pair.id)
                && pairs.remove(place).is_held
            {
                self.population.at_mut(slot).watchers -= 1;
                self.pending.push(Output::Vanish { to, avatar: id });
            }
        }
    }
}

/// The pairs of a viewer that has to do with just these avatars; both are by id. Those that its
/// client still holds stay until that is told.
pub(super) fn matched(pairs: &[Pair], found: Vec<Member>) -> Vec<Pair> {
    let mut matched = Vec::with_capacity(found.len());
    let mut found = found.into_iter().peekable();
    for old in pairs {
        while let Some(new) = found.next_if(|(id, _)| *id < old.id) {
            matched.push(Pair::new(new));
        }
        let concerns = found.next_if(|(id, _)| *id == old.id).is_some();
        if concerns || old.is_held {
            matched.push(Pair { concerns, ..*old });
        }
    }
    matched.extend(found.map(Pair::new));
    matched
}
