//! Which avatars concern which viewers: kept up to date by what moved, never gone through as a whole.
//!
//! Two live avatars have a pair each, the one as the viewer of the other, while their wide regions may
//! see each other: by their sectors, by the gates between them, and by their cells. Most people in a
//! building have none with each other, and nothing is done about them until one has gone some way.
//! What pairs leave open is [looked at](super::looks) more closely.

use sightline_shared::motion::AvatarId;

use super::{
    Engine, Output,
    bits::Bits,
    looks::{Look, Regions},
    near::Moves,
    population::Slot,
    zones::Member,
};

/// A viewer's dealings with an avatar. Ordered by id.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(super) id: AvatarId,
    pub(super) slot: Slot,
    /// By their wide regions, the avatar may be visible to the viewer.
    pub(super) concerns: bool,
    /// The viewer's client has been told of it.
    pub(super) is_held: bool,
    /// Until that tick its client is not told that it is gone, if by their cells it may be in sight.
    pub(super) held_until: u32,
    /// The [`Avatar::version`](super::population::Avatar::version) that was sent last.
    pub(super) version: u32,
    pub(super) look: Look,
    /// Between these regions, gates and cells left it open.
    pub(super) open: Option<Regions>,
    /// Before that tick it is not tried whether regions with more to spare are hidden from each other.
    pub(super) spare_from: u32,
}

impl Pair {
    pub(super) fn new((id, slot): Member) -> Self {
        let (concerns, is_held, look) = (true, false, Look::Unknown);
        Self {
            id,
            slot,
            concerns,
            is_held,
            held_until: 0,
            version: 0,
            look,
            open: None,
            spare_from: 0,
        }
    }
}

impl Engine {
    /// Makes and ends pairs after wide regions have changed.
    pub(super) fn pair(&mut self, moves: &Moves) {
        let mut moved: Vec<Slot> = moves.0.iter().map(|(slot, _)| *slot).collect();
        moved.sort_unstable();
        let mut done = vec![false; moved.len()];
        for (slot, _) in &moves.0 {
            let Ok(place) = moved.binary_search(slot) else { continue };
            done[place] = true;
            let is_done = |other: &Slot| moved.binary_search(other).is_ok_and(|at| done[at]);
            self.pair_all(*slot, is_done);
        }
    }

    /// Finds all whom an avatar has to do with, but for those who have just done the same.
    fn pair_all(&mut self, slot: Slot, is_done: impl Fn(&Slot) -> bool) {
        let Some(wide) = &self.population.at(slot).near.wide else { return };
        let visible = self.sectors.visible_from(&wide.sectors);
        let mut seen = std::mem::take(&mut self.seen);
        wide.look_around(&self.world.cells, &mut seen);
        let member = (self.population.at(slot).id, slot);
        // Most are in several sectors, and most turn out not to matter: only the rest is sorted.
        let mut met = Bits::default();
        met.insert(slot.0);
        let mut found: Vec<Member> = Vec::new();
        for other in self.near_bodies.among(&visible) {
            if !met.contains(other.1.0) {
                met.insert(other.1.0);
                found.push(*other);
            }
        }
        found.retain(|(_, other)| {
            if is_done(other) {
                self.concerns(*other, member.0)
            } else {
                self.may_meet(slot, *other, &seen)
            }
        });
        found.sort_unstable();
        self.seen = seen;
        let old = std::mem::take(&mut self.population.at_mut(slot).pairs);
        for (_, other) in found.iter().filter(|(_, other)| !is_done(other)) {
            self.concern(*other, member);
        }
        for pair in &old {
            if found.binary_search(&(pair.id, pair.slot)).is_err() && !is_done(&pair.slot) {
                self.part_from(pair.slot, member.0);
            }
        }
        self.population.at_mut(slot).pairs = matched(&old, found);
    }

    /// Forgets what was found of all pairs of an avatar.
    pub(super) fn unlook(&mut self, slot: Slot) {
        let id = self.population.at(slot).id;
        let others: Vec<Slot> = self.pairs_of(slot).map(|pair| pair.slot).collect();
        for viewer in others.into_iter().chain([slot]) {
            let pairs = self.population.at_mut(viewer).pairs.iter_mut();
            pairs
                .filter(|pair| viewer == slot || pair.id == id)
                .for_each(|pair| pair.look = Look::Unknown);
        }
    }

    /// Whether a viewer has to do with an avatar.
    fn concerns(&self, viewer: Slot, id: AvatarId) -> bool {
        let pairs = &self.population.at(viewer).pairs;
        let place = pairs.binary_search_by_key(&id, |pair| pair.id);
        place.is_ok_and(|place| pairs[place].concerns)
    }

    fn pairs_of(&self, slot: Slot) -> impl Iterator<Item = &Pair> {
        self.population.at(slot).pairs.iter()
    }

    /// Makes a pair, unless there is one.
    fn concern(&mut self, viewer: Slot, member: Member) {
        let pairs = &mut self.population.at_mut(viewer).pairs;
        match pairs.binary_search_by_key(&member.0, |pair| pair.id) {
            Ok(place) => pairs[place].concerns = true,
            Err(place) => pairs.insert(place, Pair::new(member)),
        }
    }

    /// Ends a pair; what the client still holds stays until that is told.
    fn part_from(&mut self, viewer: Slot, id: AvatarId) {
        let pairs = &mut self.population.at_mut(viewer).pairs;
        if let Ok(place) = pairs.binary_search_by_key(&id, |pair| pair.id) {
            pairs[place].concerns = false;
            if !pairs[place].is_held {
                pairs.remove(place);
            }
        }
    }

    /// Ends all pairs with an avatar that is gone or hidden, whose regions have just been taken
    /// out; those who held it are told at the next tick.
    pub(super) fn part(&mut self, slot: Slot) {
        self.forget_near(slot);
        let id = self.population.at(slot).id;
        let viewers: Vec<Slot> = if self.config.policy.uses_cells() {
            self.pairs_of(slot).map(|pair| pair.slot).collect()
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
