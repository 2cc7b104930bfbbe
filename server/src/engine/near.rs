//! Where live avatars can be until the next tick's word stands.

use std::time::Duration;

use glam::Vec3;
use sightline_shared::{
    geometry::Aabb,
    motion::{Body, Pose},
    world::Cells,
};

use super::{
    Engine,
    bits::Bits,
    parts::Parts,
    population::{Avatar, Slot},
    reach::Reach,
    zones::Ground,
};

/// Places are rounded on the wire and in sums, in metres.
pub(super) const ROUNDING_M: f32 = 0.01;

/// Wide regions have so much to spare on each side, in metres: most pairs of people are far from
/// seeing each other, and this is how long nothing need be done about them.
const WIDE_M: f32 = 0.75;

/// How much regions have to spare, as multiples of [`Config::spare_m`](super::Config::spare_m).
pub(super) const SPARES: [f32; 2] = [1.0, 4.0];

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

/// Where an avatar's body can be, and thereby its eye, with much to spare: this lasts for about ten steps.
/// Pairs are made and ended by it.
#[derive(Clone, Debug)]
pub(super) struct Wide {
    /// It holds as long as the eye can be here only, as viewers with the longest delay must see it.
    spare: Aabb,
    /// Around all places of the body.
    bodies: Parts,
    /// Where the eye can be, and where the body can.
    pub(super) grounds: [Ground; 2],
    /// The sectors that the body can be in, ascending.
    pub(super) sectors: Vec<u32>,
}

impl Wide {
    /// Fills in the cells that can be seen from where the eye can be, and from where the body can.
    pub(super) fn look_around(&self, cells: &Cells, seen: &mut [Bits; 2]) {
        let [eyes, bodies] = &self.grounds;
        let [from_eyes, from_bodies] = seen;
        from_eyes.clear();
        eyes.see(cells, |_| true, from_eyes);
        from_bodies.clone_from(from_eyes);
        bodies.see(cells, |cell| eyes.cells().binary_search(&cell).is_err(), from_bodies);
    }
}

/// Where an eye can be, or a body as viewers with a certain delay must see it. What portals lead to
/// is worked out when it is asked for.
#[derive(Clone, Debug)]
pub(super) struct Near {
    /// Of viewers, for bodies.
    delay: Duration,
    /// Where the eye can be at this tick, whatever walls are in it.
    pub(super) within: Aabb,
    /// The last has most to spare, and lasts longest.
    kept: [Option<Kept>; SPARES.len()],
    /// Counts the changes of each of these.
    pub(super) versions: [u32; SPARES.len()],
    exact: Option<(u32, Parts)>,
}

/// What lasts for a few ticks.
#[derive(Clone, Debug)]
struct Kept {
    /// It holds as long as the eye can be here only.
    spare: Aabb,
    /// Around all places.
    parts: Parts,
    ground: Ground,
}

/// The regions of a live avatar; none while hidden.
#[derive(Clone, Debug, Default)]
pub(super) struct Whereabouts {
    pub(super) wide: Option<Wide>,
    pub(super) eyes: Option<Near>,
    /// By delay, ascending; the last is that of the slowest viewer.
    bodies: Vec<Near>,
}

/// What a region is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Eyes,
    /// As viewers with that delay must see it.
    Bodies(Duration),
}

/// Whether what was made for `spare` serves where an eye can be now: it holds all of that, and was not
/// made when far more was possible.
fn serves(spare: &Aabb, within: &Aabb, spare_m: f32) -> bool {
    spare.contains_box(within) && within.grown(2.0 * spare_m).contains_box(spare)
}

impl Near {
    fn new(delay: Duration) -> Self {
        let (kept, versions) = (Default::default(), Default::default());
        Self { delay, within: Aabb::EMPTY, kept, versions, exact: None }
    }

    /// Where the boxes are that were worked out last with so much to spare.
    pub(super) fn ground(&self, level: usize) -> Option<&Ground> {
        self.kept[level].as_ref().map(|kept| &kept.ground)
    }

    /// Those of the tick at which they were asked for last, with nothing to spare.
    pub(super) fn exact(&self) -> Option<&Parts> {
        self.exact.as_ref().map(|(_, parts)| parts)
    }

    /// Boxes around all places at this tick that are not far from it, if there are any.
    fn current(&self, spare_m: f32) -> Option<&Parts> {
        let kept = self.kept[0].as_ref()?;
        serves(&kept.spare, &self.within, spare_m).then_some(&kept.parts)
    }
}

impl Whereabouts {
    pub(super) fn get(&self, part: Part) -> Option<&Near> {
        match part {
            Part::Eyes => self.eyes.as_ref(),
            Part::Bodies(delay) => self.bodies.iter().find(|bodies| bodies.delay == delay),
        }
    }

    /// Has all worked out anew: the avatar is where it has not come to by itself.
    pub(super) fn forget(&mut self) {
        if let Some(wide) = &mut self.wide {
            wide.spare = Aabb::EMPTY;
        }
        self.eyes
            .iter_mut()
            .chain(&mut self.bodies)
            .for_each(|near| near.kept = Default::default());
    }

    fn get_mut(&mut self, part: Part) -> Option<&mut Near> {
        match part {
            Part::Eyes => self.eyes.as_mut(),
            Part::Bodies(delay) => self.bodies.iter_mut().find(|bodies| bodies.delay == delay),
        }
    }

    /// Boxes around where a part can be at this tick; places behind walls only where that saves work.
    pub(super) fn just(&self, part: Part, body: &Body, spare_m: f32) -> Parts {
        let Some((near, wide)) = self.get(part).zip(self.wide.as_ref()) else {
            return Parts::default();
        };
        let now = match part {
            Part::Eyes => near.within,
            Part::Bodies(_) => body.around_box(&near.within),
        };
        near.current(spare_m).unwrap_or(&wide.bodies).within(&now)
    }

    /// Whether a point is in one of these boxes.
    pub(super) fn may_hold(&self, part: Part, point: Vec3, body: &Body, spare_m: f32) -> bool {
        let Some((near, wide)) = self.get(part).zip(self.wide.as_ref()) else { return false };
        let is_now = match part {
            Part::Eyes => near.within.contains(point),
            Part::Bodies(_) => body.around_box(&near.within).contains(point),
        };
        let parts = || near.current(spare_m).unwrap_or(&wide.bodies);
        is_now && parts().boxes().iter().any(|part| part.contains(point))
    }
}

/// Who has new regions to make pairs by, and the sectors that it was in and is in now.
#[derive(Debug, Default)]
pub(super) struct Moves(pub(super) Vec<(Slot, Vec<u32>)>);

impl Engine {
    /// How far an eye gets some time after its last accepted report was made.
    pub(super) fn leeway(&self, pose: &Pose, time: Duration) -> Leeway {
        let axes = &self.world.cells.axes;
        let (eye, velocity) = (axes.own(pose.eye), axes.own(pose.velocity));
        Leeway {
            from: eye,
            within: self.agility.eyes(eye, velocity, time).grown(ROUNDING_M),
            way_m: self.agility.way(velocity, time) + ROUNDING_M,
        }
    }

    /// How far an avatar gets until the next tick's word stands at viewers with a delay.
    fn near_leeway(&self, now: Duration, avatar: &Avatar, delay: Duration) -> Leeway {
        let age = now.saturating_sub(avatar.heard);
        self.leeway(&avatar.pose, self.horizons.near(age, avatar.round_trip, delay))
    }

    /// Brings up to date where a live avatar can be at this tick, and if need be its wide region.
    pub(super) fn place_near(
        &mut self,
        now: Duration,
        slot: Slot,
        delays: &[Duration],
        moves: &mut Moves,
    ) {
        let avatar = self.population.at(slot);
        let own = self.horizons.delay(avatar.round_trip);
        let within = |delay: Duration| self.near_leeway(now, avatar, delay).within;
        let eyes = within(own);
        let bodies: Vec<Aabb> = delays.iter().map(|delay| within(*delay)).collect();
        let near = &mut self.population.at_mut(slot).near;
        near.eyes.get_or_insert_with(|| Near::new(own)).within = eyes;
        if !near.bodies.iter().map(|bodies| bodies.delay).eq(delays.iter().copied()) {
            let mut old = std::mem::take(&mut near.bodies);
            near.bodies.extend(delays.iter().map(|delay| {
                match old.iter().position(|bodies| bodies.delay == *delay) {
                    Some(place) => old.swap_remove(place),
                    None => Near::new(*delay),
                }
            }));
        }
        near.bodies.iter_mut().zip(&bodies).for_each(|(near, within)| near.within = *within);
        let all = bodies.iter().fold(eyes, |all, within| all.union(within));
        if !near.wide.as_ref().is_some_and(|wide| serves(&wide.spare, &all, WIDE_M)) {
            self.place_wide(slot, all.grown(WIDE_M), moves);
        }
    }

    fn place_wide(&mut self, slot: Slot, spare: Aabb, moves: &mut Moves) {
        let cells = &self.world.cells;
        let avatar = self.population.at_mut(slot);
        let from = cells.axes.own(avatar.pose.eye);
        let reach = Reach::within(&mut self.scratch, cells, from, &spare);
        let (found, bodies) = reach.bodies(cells, &self.world.body);
        let sectors = self.sectors.of(&found);
        let eyes = Ground::of(cells, &self.rooms, reach.eyes(), &reach.eye_parts(cells));
        let grounds = [eyes, Ground::of(cells, &self.rooms, found, &bodies)];
        let wide = Wide { spare, bodies, grounds, sectors };
        let old = avatar.near.wide.replace(wide).map_or_else(Vec::new, |old| old.sectors);
        let member = (avatar.id, slot);
        if let Some(wide) = &avatar.near.wide {
            self.near_bodies.replace(member, &old, &wide.sectors);
        }
        moves.0.push((slot, old));
    }

    /// Works out what portals lead to for a part of a live avatar, with so much to spare, where what is
    /// known does not serve; gives how often that has changed.
    pub(super) fn place(&mut self, slot: Slot, part: Part, level: usize) -> u32 {
        let spare_m = self.config.spare_m * SPARES[level];
        let avatar = self.population.at_mut(slot);
        let from = self.world.cells.axes.own(avatar.pose.eye);
        let Some(near) = avatar.near.get_mut(part) else { return 0 };
        let kept = &near.kept[level];
        if !kept.as_ref().is_some_and(|kept| serves(&kept.spare, &near.within, spare_m)) {
            let cells = &self.world.cells;
            let spare = near.within.grown(spare_m);
            let reach = Reach::within(&mut self.scratch, cells, from, &spare);
            let (found, parts) = match part {
                Part::Eyes => (reach.eyes(), reach.eye_parts(cells)),
                Part::Bodies(_) => reach.bodies(cells, &self.world.body),
            };
            let ground = Ground::of(cells, &self.rooms, found, &parts);
            near.versions[level] = near.versions[level].wrapping_add(1);
            near.kept[level] = Some(Kept { spare, parts, ground });
        }
        near.versions[level]
    }

    /// The same with nothing to spare, for this tick.
    pub(super) fn place_exactly(&mut self, slot: Slot, part: Part) {
        let avatar = self.population.at_mut(slot);
        let from = self.world.cells.axes.own(avatar.pose.eye);
        let Some(near) = avatar.near.get_mut(part) else { return };
        if near.exact.as_ref().is_some_and(|(then, _)| *then == self.ticks) {
            return;
        }
        let cells = &self.world.cells;
        let reach = Reach::within(&mut self.scratch, cells, from, &near.within);
        let parts = match part {
            Part::Eyes => reach.eye_parts(cells),
            Part::Bodies(_) => reach.bodies(cells, &self.world.body).1,
        };
        near.exact = Some((self.ticks, parts));
    }

    /// Takes an avatar's regions out.
    pub(super) fn forget_near(&mut self, slot: Slot) {
        let avatar = self.population.at_mut(slot);
        let (id, near) = (avatar.id, std::mem::take(&mut avatar.near));
        if let Some(wide) = near.wide {
            self.near_bodies.replace((id, slot), &wide.sectors, &[]);
        }
    }
}
