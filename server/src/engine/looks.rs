//! Whether somebody in one region can see somebody in another: shafts between their boxes.
//!
//! What was found hidden stays so while both regions last, since walls do not move; what was found in
//! sight stays so while the line that was free still joins the two. So most ticks cost a comparison.
//! Gates and cells are asked first, between regions with something to spare. The rest, between what
//! regions are just now, has a budget, in units of work and not in time, so that the same inputs give
//! the same outputs. Where it does not suffice a pair counts as visible.

use std::sync::Arc;

use glam::Vec3;
use sightline_shared::{
    geometry::Aabb,
    motion::AvatarId,
    shaft::{Line, Occluders, Outcome, Scratch},
};

use super::{
    Engine,
    bits::Bits,
    near::{Near, Part},
    pairs::Pair,
    parts::Parts,
    population::Slot,
    zones::Ground,
};

/// Ticks before a pair that could not be decided is looked at again.
const UNDECIDED_TICKS: u32 = 8;

/// Ticks before regions with more to spare are tried again where they did not help.
const SPARE_TICKS: u32 = 16;
/// How much of the budget is there for those whom the viewer has not been told of.
const NEW_PER_CENT: u32 = 60;
/// One look costs no more than so many times an equal share of the budget; and where that is little, no
/// less than such a part of the most it may ever cost.
const SHARES: u32 = 8;

/// The regions, with what they have to spare, that something was found of: how often those of the
/// viewer's eyes, and those of the avatar's body, had changed by then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Regions {
    /// Which of [`SPARES`](super::near::SPARES) they have.
    level: usize,
    eyes: u32,
    bodies: u32,
}

/// What is known of the lines from a viewer's eyes to an avatar's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Look {
    /// Nothing.
    Unknown,
    /// That some may be free; it is tried again at that tick.
    Undecided {
        /// The tick.
        again: u32,
    },
    /// One is free, as far as occluders go.
    Free(Line),
    /// All are blocked, and stay so as long as these regions last.
    Hidden(Regions),
    /// All are blocked, and stay so while the eye can be in the one of these boxes only, and while the
    /// other's eye can in the other.
    HiddenIn([Aabb; 2]),
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

    /// Whether no gates lead from one to another.
    fn are_apart(&mut self, one: &Ground, other: &Ground) -> bool {
        let [one, other] = [one, other].map(|ground| (&ground.around, &ground.spaces[..]));
        self.occluders.are_apart(&mut self.scratch, one, other)
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
    /// whom the viewer will be told if nothing is found. A hard pair takes no more than a few times
    /// what there is for each. Where there is not enough, the next tick goes on.
    pub(super) fn look(&mut self, live: &[Slot]) {
        let mut open = [Vec::new(), Vec::new()];
        for &viewer in live {
            let mut pairs = std::mem::take(&mut self.population.at_mut(viewer).pairs);
            for pair in pairs.iter_mut().filter(|pair| pair.concerns) {
                if !self.still_holds(viewer, pair) && !self.is_hidden_by_cells(viewer, pair) {
                    open[usize::from(pair.is_held)].push((viewer, pair.id));
                }
            }
            self.population.at_mut(viewer).pairs = pairs;
        }
        let count = open[0].len() + open[1].len();
        let each = self.config.look_budget / u32::try_from(count).unwrap_or(u32::MAX).max(1);
        let most = (SHARES * each).clamp(self.config.look_max / SHARES, self.config.look_max);
        let mut budget = 0;
        for (place, open) in open.iter().enumerate() {
            budget += self.config.look_budget / 100 * [NEW_PER_CENT, 100 - NEW_PER_CENT][place];
            self.look_from(place, open, most, &mut budget);
        }
    }

    /// Looks at pairs, beginning with those of the viewer at whom the budget was used up the last time.
    fn look_from(&mut self, place: usize, open: &[(Slot, AvatarId)], most: u32, budget: &mut u32) {
        let from = self.looked_to[place];
        let id = |(viewer, _): &(Slot, AvatarId)| self.population.at(*viewer).id;
        let (last, first) = open.split_at(open.partition_point(|pair| id(pair) < from));
        for &(viewer, id) in first.iter().chain(last) {
            if *budget == 0 {
                self.looked_to[place] = self.population.at(viewer).id;
                return;
            }
            let find = |pairs: &[Pair]| pairs.binary_search_by_key(&id, |pair| pair.id);
            let Ok(at) = find(&self.population.at(viewer).pairs) else { continue };
            let mut pair = self.population.at(viewer).pairs[at];
            self.look_at(viewer, &mut pair, most, budget);
            self.population.at_mut(viewer).pairs[at] = pair;
        }
    }

    /// Whether a pair is known to be hidden, as of this tick's looks.
    pub(super) fn is_hidden(&self, pair: &Pair) -> bool {
        match pair.look {
            Look::Hidden(_) | Look::HiddenIn(_) => true,
            Look::Unknown | Look::Undecided { .. } | Look::Free(..) => false,
        }
    }

    /// Whether what was found of a pair is still true.
    fn still_holds(&mut self, viewer: Slot, pair: &mut Pair) -> bool {
        match pair.look {
            Look::Unknown => false,
            Look::Undecided { again } => self.is_closed(viewer, pair) || self.ticks < again,
            Look::HiddenIn(then) => {
                let now = self.eyes_of(viewer, pair);
                then.iter().zip(&now).all(|(then, now)| then.contains_box(now))
            }
            Look::Hidden(then) => then == self.regions(viewer, pair, then.level),
            Look::Free(line) => self.is_closed(viewer, pair) || self.joins(viewer, pair, &line),
        }
    }

    /// Whether no gates lead from a pair's regions to each other, or no cells of theirs see each other:
    /// with much to spare, so that this lasts, unless it did not help a while ago; or with little.
    fn is_hidden_by_cells(&mut self, viewer: Slot, pair: &mut Pair) -> bool {
        if self.ticks >= pair.spare_from {
            let regions = self.regions(viewer, pair, 1);
            if !self.may_see(viewer, pair, 1) {
                pair.look = Look::Hidden(regions);
                return true;
            }
            pair.spare_from = self.ticks + SPARE_TICKS;
        }
        let is_closed = self.is_closed(viewer, pair);
        if !is_closed {
            pair.look = Look::Undecided { again: self.ticks };
        }
        is_closed
    }

    /// Whether the same is found of a pair's regions with little to spare, where these have changed.
    fn is_closed(&mut self, viewer: Slot, pair: &mut Pair) -> bool {
        let regions = self.regions(viewer, pair, 0);
        let is_closed = pair.open != Some(regions) && !self.may_see(viewer, pair, 0);
        if is_closed {
            pair.look = Look::Hidden(regions);
        } else {
            pair.open = Some(regions);
        }
        is_closed
    }

    /// Looks between what a pair's regions are just now.
    fn look_at(&mut self, viewer: Slot, pair: &mut Pair, most: u32, budget: &mut u32) {
        let bodies = self.parts_of(viewer);
        self.place_exactly(viewer, Part::Eyes);
        self.place_exactly(pair.slot, bodies);
        let exact = |slot: Slot, part: Part| self.population.at(slot).near.get(part)?.exact();
        let regions = exact(viewer, Part::Eyes).zip(exact(pair.slot, bodies));
        let Some((eyes, bodies)) = regions else { return };
        pair.look = match self.shafts.between(eyes, bodies, most, budget) {
            Found::Hidden => Look::HiddenIn(self.eyes_of(viewer, pair)),
            Found::Free(line) => Look::Free(line),
            Found::Undecided if *budget == 0 => pair.look,
            Found::Undecided => Look::Undecided { again: self.ticks + UNDECIDED_TICKS },
        };
    }

    /// Where the eyes of both can be just now, whatever walls are there.
    fn eyes_of(&self, viewer: Slot, pair: &Pair) -> [Aabb; 2] {
        [(viewer, Part::Eyes), (pair.slot, self.parts_of(viewer))].map(|(slot, part)| {
            self.population.at(slot).near.get(part).map_or(Aabb::EMPTY, |near| near.within)
        })
    }

    /// Whether somebody in one wide region, from which these cells can be seen, may see somebody in
    /// another, or be seen.
    pub(super) fn may_meet(&mut self, one: Slot, other: Slot, seen: &[Bits; 2]) -> bool {
        let wide = |slot: Slot| self.population.at(slot).near.wide.as_ref();
        let Some((one, other)) = wide(one).zip(wide(other)) else { return false };
        let by_gates = self.config.look_budget > 0;
        let ([eyes, bodies], [other_eyes, other_bodies]) = (&one.grounds, &other.grounds);
        let mut may =
            |eyes: &Ground, bodies: &Ground| !(by_gates && self.shafts.are_apart(eyes, bodies));
        let shows = |eyes: &Ground, bodies: &Ground| eyes.shows(bodies, &self.rooms);
        other_bodies.is_among(&seen[0]) && shows(eyes, other_bodies) && may(eyes, other_bodies)
            || other_eyes.is_among(&seen[1]) && shows(other_eyes, bodies) && may(other_eyes, bodies)
    }

    /// Whether a pair may see each other as far as rooms and cells tell.
    pub(super) fn may_see_by_cells(&mut self, viewer: Slot, pair: &Pair) -> bool {
        self.regions(viewer, pair, 0);
        let ground = |slot: Slot, part: Part| self.population.at(slot).near.get(part)?.ground(0);
        let grounds = ground(viewer, Part::Eyes).zip(ground(pair.slot, self.parts_of(viewer)));
        grounds.is_some_and(|(eyes, bodies)| {
            eyes.sees(bodies, &self.world.cells, &self.sectors) && eyes.shows(bodies, &self.rooms)
        })
    }

    /// The same of the regions of a pair, as they were worked out last.
    pub(super) fn may_see(&mut self, viewer: Slot, pair: &Pair, level: usize) -> bool {
        let eyes = self.population.at(viewer).near.get(Part::Eyes);
        let bodies = self.population.at(pair.slot).near.get(self.parts_of(viewer));
        let grounds = |(eyes, bodies): (&'_ Near, &'_ Near)| {
            let (eyes, bodies) = eyes.ground(level).zip(bodies.ground(level))?;
            Some(
                !(self.config.look_budget > 0 && self.shafts.are_apart(eyes, bodies))
                    && eyes.sees(bodies, &self.world.cells, &self.sectors)
                    && eyes.shows(bodies, &self.rooms),
            )
        };
        eyes.zip(bodies).and_then(grounds).unwrap_or(false)
    }

    /// Whether a line goes from where the viewer's eye can be to where the avatar's body can be.
    fn joins(&self, viewer: Slot, pair: &Pair, line: &Line) -> bool {
        let holds = |slot: Slot, part: Part, point: Vec3| {
            self.population.at(slot).near.may_hold(part, point, &self.body, self.config.spare_m)
        };
        holds(viewer, Part::Eyes, line.from) && holds(pair.slot, self.parts_of(viewer), line.to)
    }

    /// What a viewer must see of bodies.
    fn parts_of(&self, viewer: Slot) -> Part {
        Part::Bodies(self.horizons.delay(self.population.at(viewer).round_trip))
    }

    /// The regions that last, brought up to date.
    fn regions(&mut self, viewer: Slot, pair: &Pair, level: usize) -> Regions {
        let bodies = self.parts_of(viewer);
        let eyes = self.place(viewer, Part::Eyes, level);
        Regions { level, eyes, bodies: self.place(pair.slot, bodies, level) }
    }
}
