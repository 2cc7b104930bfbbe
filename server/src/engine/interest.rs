//! Whom a viewer is told of, under each policy.

use glam::{IVec3, Vec3};
use sightline_shared::motion::AvatarId;

use super::{
    Engine, Output, Policy,
    pairs::matched,
    population::{Avatar, Slot},
};

impl Engine {
    /// Tells a live viewer what has changed for it.
    pub(super) fn tell(&mut self, viewer: Slot, outputs: &mut Vec<Output>) {
        if !self.config.policy.uses_cells() {
            self.pair_without_cells(viewer);
        }
        let to = self.population.at(viewer).id;
        let seal = self.population.at(viewer).seal;
        let mut pairs = std::mem::take(&mut self.population.at_mut(viewer).pairs);
        let mut poses = Vec::new();
        for pair in &mut pairs {
            let is_hidden = self.is_hidden(pair);
            let is_kept = is_hidden
                && pair.is_held
                && self.ticks < pair.held_until
                && self.may_see_by_cells(viewer, pair);
            // What is sealed off is not told, whatever the regions say.
            let agrees = self.population.at(pair.slot).seal.agrees(&seal);
            let wanted = pair.concerns && agrees && (!is_hidden || is_kept);
            match (pair.is_held, wanted) {
                (true, true) => {
                    let avatar = self.population.at(pair.slot);
                    // Of whom it is not to see it is not told anything, not even that.
                    if !is_hidden && avatar.version != pair.version {
                        pair.version = avatar.version;
                        poses.push((pair.id, avatar.pose));
                    }
                }
                (true, false) => {
                    self.population.at_mut(pair.slot).watchers -= 1;
                    outputs.push(Output::Vanish { to, avatar: pair.id });
                }
                (false, true) => {
                    let avatar = self.population.at_mut(pair.slot);
                    avatar.watchers += 1;
                    pair.version = avatar.version;
                    pair.held_until = self.ticks + self.config.hold_ticks;
                    outputs.push(appear(to, avatar));
                }
                (false, false) => {}
            }
            pair.is_held = wanted;
        }
        pairs.retain(|pair| pair.concerns);
        self.population.at_mut(viewer).pairs = pairs;
        if !poses.is_empty() {
            outputs.push(Output::Poses { to, tick: self.ticks, poses });
        }
    }

    /// Finds all whom a viewer is to be told of under a policy that knows no walls.
    fn pair_without_cells(&mut self, viewer: Slot) {
        let from = self.population.at(viewer);
        let found = self
            .population
            .all()
            .filter(|(_, slot)| *slot != viewer && self.within(from, self.population.at(*slot)));
        let pairs = matched(&from.pairs, found.collect());
        self.population.at_mut(viewer).pairs = pairs;
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
