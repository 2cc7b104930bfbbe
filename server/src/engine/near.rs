//! Where live avatars can be until the next tick's word stands.

use std::{collections::BTreeSet, time::Duration};

use glam::Vec3;
use sightline_shared::{geometry::Aabb, motion::Pose, world::CellId};

use super::{
    Engine,
    bits::Bits,
    parts::Parts,
    population::{Avatar, Slot},
    reach::Reach,
};

/// Places are rounded on the wire and in sums, in metres.
pub(super) const ROUNDING_M: f32 = 0.01;

/// Where an eye can be until a moment: in a box about it, as far as portals lead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leeway {
    /// Where it was last, in own axes.
    pub(super) from: Vec3,
    /// In own axes.
    pub(super) within: Aabb,
    /// No way is longer, in metres.
    pub(super) way_m: f32,
}

impl Leeway {
    pub(super) fn scale(&mut self, by: f32) {
        self.within.min = self.from + (self.within.min - self.from) * by;
        self.within.max = self.from + (self.within.max - self.from) * by;
        self.way_m *= by;
    }
}

/// Where something can be: just, and with something to spare, so that it lasts for a few ticks.
#[derive(Clone, Debug)]
pub(super) struct Region {
    /// Around all its places at this tick, and perhaps what is behind a wall there.
    pub(super) just: Parts,
    /// Around all its places at a tick, worked out when it is asked for.
    exact: Option<(u32, Parts)>,
    /// Around all its places as long as its eye is in `spare`.
    pub(super) parts: Parts,
    spare: Aabb,
}

impl Region {
    /// Whether it serves for where the eye can be now: it holds all of that, and was not made when far
    /// more was possible.
    fn serves(&self, within: &Aabb, spare_m: f32) -> bool {
        self.spare.contains_box(within) && within.grown(2.0 * spare_m).contains_box(&self.spare)
    }

    fn is_exact_at(&self, tick: u32) -> bool {
        self.exact.as_ref().is_some_and(|(then, _)| *then == tick)
    }

    /// Around all its places at the tick at which these were asked for last.
    pub(super) fn exact(&self) -> Option<&Parts> {
        self.exact.as_ref().map(|(_, parts)| parts)
    }

    fn new(parts: Parts, spare: Aabb, just: &Aabb) -> Self {
        Self { just: parts.within(just), exact: None, parts, spare }
    }
}

/// Where the eye of a live avatar can be, and what may be visible from there.
#[derive(Clone, Debug)]
pub(super) struct Eyes {
    pub(super) region: Region,
    /// The cells that it can be in, ascending.
    pub(super) cells: Vec<CellId>,
    /// Likewise, the sectors.
    sectors: Vec<u32>,
    /// The sectors that are visible from there.
    pub(super) visible: Bits,
}

/// Where the body of a live avatar can be, as viewers with a certain delay must see it.
#[derive(Clone, Debug)]
pub(super) struct Bodies {
    pub(super) delay: Duration,
    pub(super) region: Region,
    /// The cells that it can be in, ascending.
    pub(super) cells: Vec<CellId>,
    /// Likewise, the sectors.
    sectors: Vec<u32>,
}

/// The regions of a live avatar; none while hidden.
#[derive(Clone, Debug, Default)]
pub(super) struct Near {
    pub(super) eyes: Option<Eyes>,
    /// Counts the changes of `eyes`.
    pub(super) eyes_version: u32,
    /// By delay, ascending; the last is that of the slowest viewer.
    pub(super) bodies: Vec<Bodies>,
    /// Counts the changes of `bodies`.
    pub(super) bodies_version: u32,
    /// The sectors that the index of bodies has: those of all of `bodies`, ascending.
    indexed: Vec<u32>,
}

impl Near {
    /// As viewers with a delay must see it.
    pub(super) fn bodies_for(&self, delay: Duration) -> Option<&Bodies> {
        self.bodies.iter().find(|bodies| bodies.delay == delay)
    }

    /// Whether its body may be visible from somewhere in these eyes.
    pub(super) fn is_visible_to(&self, eyes: &Eyes, delay: Duration) -> bool {
        self.bodies_for(delay)
            .is_some_and(|bodies| bodies.sectors.iter().any(|at| eyes.visible.contains(*at)))
    }
}

/// What changed when an avatar's regions were brought up to date.
#[derive(Debug, Default)]
pub(super) struct Moves {
    /// Viewers that see other sectors than before.
    pub(super) viewers: Vec<Slot>,
    /// Avatars, and the sectors that they entered or left.
    pub(super) bodies: Vec<(Slot, Vec<u32>)>,
}

impl Engine {
    /// Where an eye can be some time after its last accepted report was made.
    pub(super) fn leeway(&self, pose: &Pose, time: Duration) -> Leeway {
        let axes = &self.world.cells.axes;
        let (eye, velocity) = (axes.own(pose.eye), axes.own(pose.velocity));
        Leeway {
            from: eye,
            within: self.agility.eyes(eye, velocity, time).grown(ROUNDING_M),
            way_m: self.agility.way(velocity, time) + ROUNDING_M,
        }
    }

    /// How far an avatar can get until the next tick's word stands at viewers with a delay.
    pub(super) fn near_leeway(&self, now: Duration, avatar: &Avatar, delay: Duration) -> Leeway {
        let age = now.saturating_sub(avatar.heard);
        self.leeway(&avatar.pose, self.horizons.near(age, avatar.round_trip, delay))
    }

    /// Brings the regions of a live avatar up to date, where they have to be.
    pub(super) fn place_near(
        &mut self,
        now: Duration,
        slot: Slot,
        delays: &[Duration],
        moves: &mut Moves,
    ) {
        let delay = self.horizons.delay(self.population.at(slot).round_trip);
        if self.place_eyes(now, slot, delay) {
            moves.viewers.push(slot);
        }
        let avatar = self.population.at_mut(slot);
        let mut is_new = avatar.near.bodies.len() != delays.len();
        avatar.near.bodies.retain(|bodies| delays.contains(&bodies.delay));
        for delay in delays {
            is_new |= self.place_bodies(now, slot, *delay);
        }
        if !is_new {
            return;
        }
        let near = &mut self.population.at_mut(slot).near;
        let all = near.bodies.iter().flat_map(|bodies| bodies.sectors.iter().copied());
        let new: BTreeSet<u32> = all.collect();
        let old: BTreeSet<u32> = near.indexed.iter().copied().collect();
        near.indexed = new.iter().copied().collect();
        let [left, entered]: [Vec<u32>; 2] =
            [old.difference(&new).copied().collect(), new.difference(&old).copied().collect()];
        let id = self.population.at(slot).id;
        self.near_bodies.remove((id, slot), &left);
        self.near_bodies.insert((id, slot), &entered);
        // With several delays, who is nearer to some viewers may have moved in none of the two.
        moves.bodies.push((slot, self.population.at(slot).near.indexed.clone()));
        if let Some((_, sectors)) = moves.bodies.last_mut() {
            sectors.extend(left);
        }
    }

    /// Whether the sectors that the eye can be in are others than before.
    fn place_eyes(&mut self, now: Duration, slot: Slot, delay: Duration) -> bool {
        let leeway = self.near_leeway(now, self.population.at(slot), delay);
        let avatar = self.population.at_mut(slot);
        let id = avatar.id;
        if let Some(eyes) = &mut avatar.near.eyes
            && eyes.region.serves(&leeway.within, self.config.spare_m)
        {
            eyes.region.just = eyes.region.parts.within(&leeway.within);
            return false;
        }
        let cells = &self.world.cells;
        let spare = leeway.within.grown(self.config.spare_m);
        let reach = Reach::within(&mut self.scratch, cells, leeway.from, &spare);
        let region = Region::new(reach.eye_parts(cells), spare, &leeway.within);
        let in_cells = reach.eyes();
        let found = self.sectors.of(&in_cells);
        let near = &mut avatar.near;
        near.eyes_version = near.eyes_version.wrapping_add(1);
        if let Some(eyes) = &mut near.eyes
            && eyes.sectors == found
        {
            (eyes.region, eyes.cells) = (region, in_cells);
            return false;
        }
        let visible = self.sectors.visible_from(&found);
        self.near_eyes.insert((id, slot), &found);
        if let Some(old) =
            near.eyes.replace(Eyes { region, cells: in_cells, sectors: found, visible })
        {
            self.near_eyes.remove((id, slot), &old.sectors);
        }
        true
    }

    /// Whether the sectors that the body can be in are others than before.
    fn place_bodies(&mut self, now: Duration, slot: Slot, delay: Duration) -> bool {
        let leeway = self.near_leeway(now, self.population.at(slot), delay);
        let cells = &self.world.cells;
        let just = cells.axes.own_body(&self.world.body).around_box(&leeway.within);
        let near = &mut self.population.at_mut(slot).near;
        let place = near.bodies.binary_search_by_key(&delay, |bodies| bodies.delay);
        if let Ok(place) = place
            && let region = &mut near.bodies[place].region
            && region.serves(&leeway.within, self.config.spare_m)
        {
            region.just = region.parts.within(&just);
            return false;
        }
        let spare = leeway.within.grown(self.config.spare_m);
        let reach = Reach::within(&mut self.scratch, cells, leeway.from, &spare);
        let (found, parts) = reach.bodies(cells, &self.world.body);
        let sectors = self.sectors.of(&found);
        let region = Region::new(parts, spare, &just);
        let new = Bodies { delay, region, cells: found, sectors };
        near.bodies_version = near.bodies_version.wrapping_add(1);
        match place {
            Ok(place) => {
                let old = std::mem::replace(&mut near.bodies[place], new);
                old.sectors != near.bodies[place].sectors
            }
            Err(place) => {
                near.bodies.insert(place, new);
                true
            }
        }
    }

    /// Works out where a live avatar's eye can be at this tick.
    pub(super) fn place_exact_eyes(&mut self, now: Duration, slot: Slot) {
        let avatar = self.population.at(slot);
        if avatar.near.eyes.as_ref().is_none_or(|eyes| eyes.region.is_exact_at(self.ticks)) {
            return;
        }
        let reach = self.exact_reach(now, slot, self.horizons.delay(avatar.round_trip));
        let parts = reach.eye_parts(&self.world.cells);
        if let Some(eyes) = &mut self.population.at_mut(slot).near.eyes {
            eyes.region.exact = Some((self.ticks, parts));
        }
    }

    /// Works out where a live avatar's body can be at this tick, as a viewer with that delay must
    /// see it.
    pub(super) fn place_exact_bodies(&mut self, now: Duration, slot: Slot, delay: Duration) {
        let bodies = self.population.at(slot).near.bodies_for(delay);
        if bodies.is_none_or(|bodies| bodies.region.is_exact_at(self.ticks)) {
            return;
        }
        let reach = self.exact_reach(now, slot, delay);
        let (_, parts) = reach.bodies(&self.world.cells, &self.world.body);
        let bodies = &mut self.population.at_mut(slot).near.bodies;
        if let Some(bodies) = bodies.iter_mut().find(|bodies| bodies.delay == delay) {
            bodies.region.exact = Some((self.ticks, parts));
        }
    }

    fn exact_reach(&mut self, now: Duration, slot: Slot, delay: Duration) -> Reach {
        let leeway = self.near_leeway(now, self.population.at(slot), delay);
        let cells = &self.world.cells;
        Reach::within(&mut self.scratch, cells, leeway.from, &leeway.within)
    }

    /// Takes an avatar's regions out; gives the sectors that its body could be in.
    pub(super) fn forget_near(&mut self, slot: Slot) -> Vec<u32> {
        let avatar = self.population.at_mut(slot);
        let (id, near) = (avatar.id, std::mem::take(&mut avatar.near));
        if let Some(eyes) = near.eyes {
            self.near_eyes.remove((id, slot), &eyes.sectors);
        }
        self.near_bodies.remove((id, slot), &near.indexed);
        near.indexed
    }
}
