//! Whether somebody in one region can see somebody in another: shafts between their boxes.
//!
//! What was found hidden stays so while both regions last, since walls do not move; what was found in
//! sight stays so while the line that was free still joins the two. So most ticks cost a comparison.
//! The rest has a budget, in units of work and not in time, so that the same inputs give the same
//! outputs. Where it does not suffice a pair counts as visible.

use std::{sync::Arc, time::Duration};

use sightline_shared::{
    shaft::{Line, Occluders, Outcome, Scratch},
    world::CellId,
};

use super::{Engine, pairs::Pair, parts::Parts, population::Slot};

/// Ticks before a pair that could not be decided is looked at again.
const UNDECIDED_TICKS: u32 = 8;

/// The regions, with what they have to spare, that something was found of: how often those of the
/// viewer's eyes, and those of the avatar's body, had changed by then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Regions {
    eyes: u32,
    bodies: u32,
}

/// What is known of the lines from a viewer's eyes to an avatar's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Look {
    /// Nothing.
    Unknown,
    /// That some may be free, between these regions; it is tried again at that tick.
    Undecided {
        /// The regions.
        of: Regions,
        /// The tick.
        again: u32,
    },
    /// One is free, and by their cells these regions see each other.
    Free(Line, Regions),
    /// All are blocked, and stay so as long as these regions last.
    Hidden(Regions),
    /// All are blocked at that tick.
    JustHidden {
        /// The tick.
        tick: u32,
    },
}

/// What two regions turned out to be to each other.
pub(super) enum Found {
    Free(Line),
    Hidden,
    Undecided,
}

/// What blocks sight, ready to be asked.
#[derive(Clone, Debug)]
pub(super) struct Shafts {
    occluders: Arc<Occluders>,
    scratch: Scratch,
}

impl Shafts {
    pub(super) fn new(occluders: Arc<Occluders>) -> Self {
        Self { occluders, scratch: Scratch::default() }
    }

    /// Looks from every part of the eyes to every part of the bodies, for no more than `most`, as
    /// far as the budget goes.
    pub(super) fn between(
        &mut self,
        eyes: &Parts,
        bodies: &Parts,
        most: u32,
        budget: &mut u32,
    ) -> Found {
        let given = most.min(*budget);
        let mut left = given;
        let found = self.look(eyes, bodies, &mut left);
        *budget -= given - left;
        found
    }

    fn look(&mut self, eyes: &Parts, bodies: &Parts, budget: &mut u32) -> Found {
        let mut found = Found::Hidden;
        for from in eyes.boxes() {
            for to in bodies.boxes() {
                match self.occluders.between(&mut self.scratch, from, to, budget) {
                    Outcome::Visible(line) => return Found::Free(line),
                    Outcome::Hidden => {}
                    // Another part may still be in sight for good.
                    Outcome::Unknown => found = Found::Undecided,
                }
            }
        }
        found
    }
}

impl Engine {
    /// Looks at all pairs of live viewers for which something may have changed: first at those of
    /// whom the viewer will be told if nothing is found, beginning with another viewer at each tick.
    pub(super) fn look(&mut self, now: Duration, live: &[Slot]) {
        let mut budget = self.config.look_budget;
        let (last, first) = live.split_at(self.ticks as usize % live.len().max(1));
        let mut held = Vec::new();
        for &viewer in first.iter().chain(last) {
            let mut pairs = std::mem::take(&mut self.population.at_mut(viewer).pairs);
            for (place, pair) in pairs.iter_mut().enumerate() {
                if !pair.concerns || self.still_holds(viewer, pair) {
                    continue;
                }
                if pair.is_held {
                    held.push((viewer, place));
                } else {
                    self.look_at(now, viewer, pair, &mut budget);
                }
            }
            self.population.at_mut(viewer).pairs = pairs;
        }
        for (viewer, place) in held {
            let mut pair = self.population.at(viewer).pairs[place];
            self.look_at(now, viewer, &mut pair, &mut budget);
            self.population.at_mut(viewer).pairs[place] = pair;
        }
    }

    /// Whether a pair is known to be hidden.
    pub(super) fn is_hidden(&self, viewer: Slot, pair: &Pair) -> bool {
        match pair.look {
            Look::Hidden(then) => then == self.regions(viewer, pair),
            Look::JustHidden { tick } => tick == self.ticks,
            Look::Unknown | Look::Undecided { .. } | Look::Free(..) => false,
        }
    }

    /// Whether what was found of a pair is still true.
    fn still_holds(&self, viewer: Slot, pair: &mut Pair) -> bool {
        let now = self.regions(viewer, pair);
        match &mut pair.look {
            Look::Unknown => false,
            Look::Undecided { of, again } => {
                let (again, same) = (*again, std::mem::replace(of, now) == now);
                self.ticks < again && (same || self.may_see_by_cells(viewer, pair))
            }
            Look::Hidden(then) => *then == now,
            Look::JustHidden { tick } => *tick == self.ticks,
            Look::Free(line, then) => {
                let (line, same) = (*line, std::mem::replace(then, now) == now);
                (same || self.may_see_by_cells(viewer, pair)) && self.joins(viewer, pair, &line)
            }
        }
    }

    /// Looks between the regions that last, and where these may see each other, between what they
    /// are just now.
    fn look_at(&mut self, now: Duration, viewer: Slot, pair: &mut Pair, budget: &mut u32) {
        let regions = self.regions(viewer, pair);
        if !self.may_see_by_cells(viewer, pair) {
            pair.look = Look::Hidden(regions);
            return;
        }
        let most = self.config.look_max;
        let (from, to) = (self.population.at(viewer), self.population.at(pair.slot));
        let delay = self.horizons.delay(from.round_trip);
        let eyes = from.near.eyes.as_ref().map(|eyes| &eyes.region.parts);
        let bodies = to.near.bodies_for(delay).map(|bodies| &bodies.region.parts);
        let Some((eyes, bodies)) = eyes.zip(bodies) else { return };
        if let Found::Hidden = self.shafts.between(eyes, bodies, most, budget) {
            pair.look = Look::Hidden(regions);
            return;
        }
        self.place_exact_eyes(now, viewer);
        self.place_exact_bodies(now, pair.slot, delay);
        let (from, to) = (&self.population.at(viewer).near, &self.population.at(pair.slot).near);
        let eyes = from.eyes.as_ref().and_then(|eyes| eyes.region.exact());
        let bodies = to.bodies_for(delay).and_then(|bodies| bodies.region.exact());
        let Some((eyes, bodies)) = eyes.zip(bodies) else { return };
        pair.look = match self.shafts.between(eyes, bodies, most, budget) {
            Found::Hidden => Look::JustHidden { tick: self.ticks },
            Found::Free(line) => Look::Free(line, regions),
            // What had too little is tried again at once.
            Found::Undecided if *budget == 0 => Look::Undecided { of: regions, again: self.ticks },
            Found::Undecided => {
                Look::Undecided { of: regions, again: self.ticks + UNDECIDED_TICKS }
            }
        };
    }

    /// Whether some cell that the viewer's eye can be in may see one that the avatar's body can be in.
    pub(super) fn may_see_by_cells(&self, viewer: Slot, pair: &Pair) -> bool {
        let (from, to) = (self.population.at(viewer), self.population.at(pair.slot));
        let bodies = to.near.bodies_for(self.horizons.delay(from.round_trip));
        from.near.eyes.as_ref().zip(bodies).is_some_and(|(eyes, bodies)| {
            let sees =
                |from: &CellId| bodies.cells.iter().any(|to| self.world.cells.sees(*from, *to));
            eyes.cells.iter().any(sees)
        })
    }

    /// Whether a line goes from where the viewer's eye can be to where the avatar's body can be.
    fn joins(&self, viewer: Slot, pair: &Pair, line: &Line) -> bool {
        let (from, to) = (self.population.at(viewer), self.population.at(pair.slot));
        let bodies = to.near.bodies_for(self.horizons.delay(from.round_trip));
        from.near.eyes.as_ref().zip(bodies).is_some_and(|(eyes, bodies)| {
            eyes.region.just.boxes().iter().any(|part| part.contains(line.from))
                && bodies.region.just.boxes().iter().any(|part| part.contains(line.to))
        })
    }

    fn regions(&self, viewer: Slot, pair: &Pair) -> Regions {
        let (from, to) = (&self.population.at(viewer).near, &self.population.at(pair.slot).near);
        Regions { eyes: from.eyes_version, bodies: to.bodies_version }
    }
}
