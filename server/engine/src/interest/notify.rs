//! Whom a viewer is told of, under each policy.

use glam::{IVec3, Vec3};
use sightline_world::motion::AvatarId;

use crate::{
    Engine, Output, Policy,
    interest::candidates::{Pair, matched},
    interest::snapshot::{LiveAvatar, LiveAvatars, Snapshot},
    population::{Avatar, Slot},
};

impl Engine {
    /// Tells live viewers what has changed for them, by id.
    pub(crate) fn tell(&mut self, scene: &mut Snapshot, outputs: &mut Vec<Output>) {
        let Snapshot { lives, pairs } = scene;
        let mut told = self.crew.gather(pairs, |_, place, pairs, told| {
            let viewer = &lives.all()[place];
            if !self.config.policy.uses_cells() {
                *pairs = self.pair_without_cells(viewer, pairs);
            }
            self.tell_one((lives, viewer), pairs, told);
        });
        for output in &told {
            let (avatar, is_shown) = match output {
                Output::Appear { avatar, .. } => (avatar, true),
                Output::Vanish { avatar, .. } => (avatar, false),
                _ => continue,
            };
            if let Some(slot) = self.population.slot(*avatar) {
                let watchers = &mut self.population.at_mut(slot).watchers;
                *watchers = if is_shown { *watchers + 1 } else { *watchers - 1 };
            }
        }
        told.sort_by_key(Output::to);
        outputs.extend(told);
    }

    fn tell_one(
        &self,
        (lives, viewer): (&LiveAvatars, &LiveAvatar),
        pairs: &mut Vec<Pair>,
        told: &mut Vec<Output>,
    ) {
        let to = viewer.id;
        let mut poses = Vec::with_capacity(pairs.iter().filter(|pair| pair.is_held).count());
        for pair in pairs.iter_mut() {
            let avatar = lives.at(pair.slot);
            let is_hidden = pair.look.is_hidden();
            if !is_hidden {
                pair.held_until = self.ticks + self.config.hold_ticks;
            }
            let is_kept = pair.is_held && self.ticks < pair.held_until;
            // What is sealed off is not told, whatever the regions say.
            let agrees = avatar.seal.agrees(&viewer.seal);
            let wanted = pair.concerns && agrees && (!is_hidden || is_kept);
            match (pair.is_held, wanted) {
                // Of whom it is not to see it is not told anything, not even that.
                (true, true) if !is_hidden && avatar.version != pair.version => {
                    pair.version = avatar.version;
                    poses.push((pair.id, avatar.pose));
                }
                (true, false) => told.push(Output::Vanish { to, avatar: pair.id }),
                (false, true) => {
                    pair.version = avatar.version;
                    told.push(appear(to, self.population.at(pair.slot)));
                }
                (true, true) | (false, false) => {}
            }
            pair.is_held = wanted;
        }
        pairs.retain(|pair| pair.concerns);
        if !poses.is_empty() {
            told.push(Output::Poses { to, tick: self.ticks, poses });
        }
    }

    /// All whom a viewer is to be told of under a policy that knows no walls.
    fn pair_without_cells(&self, viewer: &LiveAvatar, pairs: &[Pair]) -> Vec<Pair> {
        let from = self.population.at(viewer.slot);
        let is_told =
            |slot: Slot| slot != viewer.slot && self.within(from, self.population.at(slot));
        matched(pairs, self.population.all().filter(|(_, slot)| is_told(*slot)).collect())
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
