//! Whom a viewer is told of, under each policy.

use std::time::Duration;

use glam::{IVec3, Vec3};
use sightline_shared::motion::AvatarId;

use super::{
    Engine, Output, Policy,
    population::{Avatar, Held, Slot},
    reach::Reach,
    zones::Member,
};

/// Viewers whose delay is so much less than the slowest's have each avatar tested for themselves.
const DELAYS_APART: Duration = Duration::from_millis(5);

impl Engine {
    /// Tells a live viewer what has changed for it.
    pub(super) fn tell(&mut self, now: Duration, viewer: Slot, outputs: &mut Vec<Output>) {
        let wanted = self.interest(now, viewer);
        let to = self.population.at(viewer).id;
        let old = std::mem::take(&mut self.population.at_mut(viewer).held);
        let mut held = Vec::with_capacity(wanted.len());
        let mut poses = Vec::new();
        changes(&old, &wanted, |change| match change {
            Change::Gone(was) => {
                self.population.at_mut(was.slot).watchers -= 1;
                outputs.push(Output::Vanish { to, avatar: was.id });
            }
            Change::Kept(mut still) => {
                let avatar = self.population.at(still.slot);
                if avatar.version != still.version {
                    still.version = avatar.version;
                    poses.push((still.id, avatar.pose));
                }
                held.push(still);
            }
            Change::New(id, slot) => {
                let avatar = self.population.at_mut(slot);
                avatar.watchers += 1;
                held.push(Held { id, slot, version: avatar.version });
                outputs.push(appear(to, avatar));
            }
        });
        self.population.at_mut(viewer).held = held;
        if !poses.is_empty() {
            outputs.push(Output::Poses { to, tick: self.ticks, poses });
        }
    }

    /// Brings the small balls of a live avatar up to date.
    pub(super) fn place_near(&mut self, now: Duration, slot: Slot) {
        let avatar = self.population.at(slot);
        let cells = &self.world.cells;
        let (one_way, widest) =
            (self.horizons.one_way(avatar.round_trip), self.horizons.one_way_max());
        let eyes = self.near_reach(avatar, now, one_way);
        let wide = (one_way < widest).then(|| self.near_reach(avatar, now, widest));
        let bodies = wide.as_ref().unwrap_or(&eyes).bodies(cells, &self.world.body);
        let eyes = eyes.eyes();
        let avatar = self.population.at_mut(slot);
        let (id, near) = (avatar.id, &mut avatar.near);
        if near.eyes != eyes {
            near.visible.clear();
            eyes.iter().for_each(|cell| near.visible |= &cells.pvs[cell.0 as usize]);
            near.eyes = eyes;
        }
        if near.bodies != bodies {
            self.near.remove((id, slot), &near.bodies);
            self.near.insert((id, slot), &bodies);
            near.bodies = bodies;
        }
    }

    /// Takes an avatar out of what is near.
    pub(super) fn forget_near(&mut self, slot: Slot) {
        let avatar = self.population.at_mut(slot);
        let near = std::mem::take(&mut avatar.near);
        self.near.remove((avatar.id, slot), &near.bodies);
    }

    /// Those that a live viewer is to be told of, by id.
    fn interest(&self, now: Duration, viewer: Slot) -> Vec<Member> {
        let policy = self.config.policy;
        if policy.uses_cells() {
            return self.interest_by_cells(now, viewer);
        }
        let from = self.population.at(viewer);
        self.population
            .all()
            .filter(|(_, slot)| *slot != viewer && self.within(from, self.population.at(*slot)))
            .collect()
    }

    /// Whether a policy that knows no walls tells a viewer of an avatar.
    fn within(&self, viewer: &Avatar, avatar: &Avatar) -> bool {
        let [from, to] = [viewer, avatar].map(|avatar| avatar.pose.eye);
        match self.config.policy {
            Policy::Radius(metres) => from.distance(to) <= metres,
            Policy::Grid(metres) => {
                let cube = |eye: Vec3| (eye / metres).floor().as_ivec3();
                let apart = cube(from).saturating_sub(cube(to));
                (apart.cmpge(IVec3::NEG_ONE) & apart.cmple(IVec3::ONE)).all()
            }
            Policy::Region { .. } | Policy::Room { .. } => {
                self.places.tells(viewer.place, avatar.place)
            }
            Policy::Broadcast | Policy::Pvs | Policy::Tbv => true,
        }
    }

    fn interest_by_cells(&self, now: Duration, viewer: Slot) -> Vec<Member> {
        let avatar = self.population.at(viewer);
        let mut found = Vec::new();
        for cell in &avatar.near.visible & self.near.occupied() {
            found.extend(self.near.of(cell));
        }
        found.sort_unstable();
        found.dedup();
        found.retain(|(_, slot)| *slot != viewer && self.near_enough(now, avatar, *slot));
        found
    }

    /// Whether an avatar that the slowest viewer would have to be told of concerns this one.
    fn near_enough(&self, now: Duration, viewer: &Avatar, slot: Slot) -> bool {
        let one_way = self.horizons.one_way(viewer.round_trip);
        if one_way + DELAYS_APART >= self.horizons.one_way_max() {
            return true;
        }
        let reach = self.near_reach(self.population.at(slot), now, one_way);
        reach.body_meets(&self.world.cells, &self.world.body, &viewer.near.visible)
    }

    /// Where an avatar's eye can be until the next tick's word stands at a viewer.
    fn near_reach(&self, avatar: &Avatar, now: Duration, one_way: Duration) -> Reach {
        let age = now.saturating_sub(avatar.heard);
        let way_m = self.horizons.near_m(age, avatar.round_trip, one_way);
        Reach::new(&self.world.cells, avatar.pose.eye, way_m)
    }
}

/// What changed between what a client holds and whom it is to be told of; both are by id.
enum Change {
    /// It holds the avatar no more.
    Gone(Held),
    /// It still holds the avatar.
    Kept(Held),
    /// It does not hold the avatar yet.
    New(AvatarId, Slot),
}

/// Goes through both lists at once.
fn changes(held: &[Held], wanted: &[Member], mut each: impl FnMut(Change)) {
    let (mut held, mut wanted) = (held.iter().peekable(), wanted.iter().peekable());
    loop {
        match (held.peek(), wanted.peek()) {
            (Some(old), Some((id, _))) if old.id == *id => {
                each(Change::Kept(**old));
                held.next();
                wanted.next();
            }
            (Some(old), new) if new.is_none_or(|(id, _)| old.id < *id) => {
                each(Change::Gone(**old));
                held.next();
            }
            (_, Some((id, slot))) => {
                each(Change::New(*id, *slot));
                wanted.next();
            }
            (_, None) => return,
        }
    }
}

fn appear(to: AvatarId, avatar: &Avatar) -> Output {
    Output::Appear {
        to,
        avatar: avatar.id,
        name: avatar.name.clone(),
        colour: avatar.colour,
        pose: avatar.pose,
    }
}
