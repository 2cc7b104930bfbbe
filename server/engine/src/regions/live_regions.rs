//! Live regions: where a live avatar can be until the next tick takes effect.

use std::{sync::OnceLock, time::Duration};

use glam::Vec3;
use sightline_world::{CellId, geometry::Aabb, motion::Body};

use super::{
    CoverBoxes, Motion, MotionBound, Occupied, Reach, ReachSearch, RegionFootprint,
    lasting_margin_m, with_margin_ahead,
};
use crate::{
    building::Building, generation::Generation, pair::RegionMargin, tick_context::TickContext,
};

/// The margin of coarse regions on each side, in metres. Most pairs of people are far from seeing
/// each other, and nothing is done about them while their coarse regions last.
const COARSE_M: f32 = 0.75;
/// The small and the large margin of cached regions.
const MARGINS: [CachedMargin; RegionMargin::COUNT] =
    [CachedMargin { parts: 1.0, is_lasting: false }, CachedMargin { parts: 4.0, is_lasting: true }];
/// How near a predicted line ends to the side of the region that the avatar moves towards, from 0
/// to 1.
const HEADING: f32 = 0.9;

/// What a region is of: the eye, or the body as viewers with a certain delay must see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct RegionKind(usize);

impl RegionKind {
    /// The eye. All other kinds are of the body.
    pub(crate) const EYES: Self = Self(0);

    /// The number of the kind among all of an avatar.
    pub(crate) fn index(self) -> usize {
        self.0
    }
}

/// The regions of a live avatar; none while it is hidden.
#[derive(Clone, Debug, Default)]
pub(crate) struct LiveRegions {
    coarse: Option<Box<CoarseRegion>>,
    /// The coarse region holds while the eye can only be in this box, as viewers with the longest
    /// delay must see it; `None` where it does not hold.
    coarse_in: Option<Aabb>,
    /// The region of the eye, then those of the body by delay, ascending. The last is that for the
    /// slowest viewer.
    regions: Vec<LiveRegion>,
    /// Counts the changes of all cached regions. A delay may go and come again, and its region with
    /// it. So no two cached regions of an avatar ever have the same version.
    changes: Generation,
    /// The body regions of others that this avatar must be shown.
    shown: RegionKind,
    /// The eye position that the regions were last updated for.
    last_place: Option<Place>,
}

/// An eye position in own axes, and the space that it is in.
#[derive(Clone, Copy, Debug)]
struct Place {
    from: Vec3,
    cell: Option<CellId>,
    space: Option<u32>,
}

/// Where an avatar can be, with a large margin that lasts for about ten steps. Pairs are made and
/// ended by coarse regions.
#[derive(Clone, Debug)]
pub(crate) struct CoarseRegion {
    /// Boxes around all places of the body.
    bodies: CoverBoxes,
    pub(crate) eye_footprint: RegionFootprint,
    pub(crate) body_footprint: RegionFootprint,
    /// The cells of both footprints.
    pub(crate) cells: Occupied,
}

impl CoarseRegion {
    fn new(building: &Building, search: &mut ReachSearch, motion: &Motion, within: &Aabb) -> Self {
        let reach = Reach::in_box(search, &motion.start(building), within);
        let bodies = reach.bodies(search, building);
        let eye_footprint = RegionFootprint::new(building, reach.pieces(), &reach.eye_cover());
        let body_footprint = RegionFootprint::new(building, &bodies.pieces, &bodies.cover);
        let [eyes, bodies_in] =
            [&eye_footprint, &body_footprint].map(|footprint| footprint.cell_numbers(building));
        let cells = Occupied { eyes, bodies: bodies_in };
        Self { bodies: bodies.cover, eye_footprint, body_footprint, cells }
    }
}

/// Where an eye can be, or a body as viewers with a certain delay must see it. What portals lead to
/// is computed by the thread that asks for it first.
#[derive(Clone, Debug)]
struct LiveRegion {
    /// The delay to the viewers.
    delay: Duration,
    /// Where the eye can be at this tick, whatever walls are in this box.
    eyes: Aabb,
    /// How far the eye moves from tick to tick, in metres.
    step: Vec3,
    /// The region with each of [`MARGINS`]. The last lasts longest.
    cached: [OnceLock<CachedRegion>; MARGINS.len()],
    /// The version of each cached region.
    versions: [Generation; MARGINS.len()],
    /// Whether the first cached region was there when this tick began. What depends on that region
    /// must not depend on who asks for it first in this tick.
    was_cached: bool,
    /// Where a predicted line to the region ends.
    heading: OnceLock<LineEnd>,
    /// The region without a margin.
    exact: OnceLock<CoverBoxes>,
}

/// An end of a line that may be free.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LineEnd {
    /// In own axes.
    pub(crate) point: Vec3,
    /// The cell of that point; `None` in something solid.
    pub(crate) cell: Option<CellId>,
}

/// How much larger than needed a cached region is.
#[derive(Clone, Copy, Debug)]
struct CachedMargin {
    /// The least margin on each side, as a multiple of [`Config::spare_m`](crate::Config::spare_m).
    parts: f32,
    /// Whether the margin is larger for fast avatars.
    is_lasting: bool,
}

impl CachedMargin {
    fn metres(self, spare_m: f32, step: Vec3) -> f32 {
        let least_m = spare_m * self.parts;
        if self.is_lasting { lasting_margin_m(step, least_m) } else { least_m }
    }
}

/// A region with a margin, which lasts for a few ticks.
#[derive(Clone, Debug)]
struct CachedRegion {
    /// The region holds while the eye can only be in this box. Each tick reads it, and seldom more.
    valid_in: Aabb,
    region: Box<RegionInBuilding>,
}

/// What a region covers.
#[derive(Clone, Debug)]
struct RegionInBuilding {
    /// Boxes around all places.
    cover: CoverBoxes,
    footprint: RegionFootprint,
}

impl CachedRegion {
    fn new(
        building: &Building,
        search: &mut ReachSearch,
        reach: &Reach,
        valid_in: Aabb,
        kind: RegionKind,
    ) -> Self {
        let (footprint, cover) = if kind == RegionKind::EYES {
            let cover = reach.eye_cover();
            (RegionFootprint::new(building, reach.pieces(), &cover), cover)
        } else {
            let bodies = reach.bodies(search, building);
            (RegionFootprint::new(building, &bodies.pieces, &bodies.cover), bodies.cover)
        };
        Self { valid_in, region: Box::new(RegionInBuilding { cover, footprint }) }
    }
}

/// Whether a region that is valid in one box serves an eye that can be in another. It must contain
/// that box, and not have been made when far more was possible.
fn serves(valid_in: &Aabb, eyes: &Aabb, margin_m: f32) -> bool {
    valid_in.contains_box(eyes) && eyes.grown(2.0 * margin_m).contains_box(valid_in)
}

/// What a region takes in at a tick.
struct RegionUpdate {
    /// Where the eye can be now.
    eyes: Aabb,
    /// How far the eye moves from tick to tick, in metres.
    step: Vec3,
    /// Whether the avatar is elsewhere than at the last tick.
    has_moved: bool,
    /// The small margin, in metres.
    margin_m: f32,
}

impl LiveRegion {
    fn new(delay: Duration, changes: &mut Generation) -> Self {
        Self {
            delay,
            eyes: Aabb::EMPTY,
            step: Vec3::ZERO,
            cached: Default::default(),
            versions: [changes.next(), changes.next()],
            was_cached: false,
            heading: OnceLock::new(),
            exact: OnceLock::new(),
        }
    }

    /// Takes in where the eye can be now, and drops cached regions that no longer serve.
    fn update(&mut self, update: &RegionUpdate, changes: &mut Generation) {
        let &RegionUpdate { eyes, step, has_moved, margin_m } = update;
        self.was_cached = self.cached[0].get().is_some();
        self.step = step;
        if !has_moved && eyes == self.eyes {
            return;
        }
        (self.exact, self.heading) = (OnceLock::new(), OnceLock::new());
        self.eyes = eyes;
        let regions = self.cached.iter_mut().zip(&mut self.versions);
        for ((cached, version), margin) in regions.zip(MARGINS) {
            let is_valid = |region: &CachedRegion| {
                serves(&region.valid_in, &eyes, margin.metres(margin_m, step))
            };
            if cached.get().is_some_and(|region| !is_valid(region)) {
                *cached = OnceLock::new();
                *version = changes.next();
            }
        }
        self.was_cached = self.cached[0].get().is_some();
    }

    /// Drops everything that was computed.
    fn forget(&mut self, changes: &mut Generation) {
        self.cached = Default::default();
        (self.exact, self.heading) = (OnceLock::new(), OnceLock::new());
        self.versions.iter_mut().for_each(|version| *version = changes.next());
    }

    /// Boxes of this tick around all places and little more, if they were computed before it.
    fn current(&self) -> Option<&CoverBoxes> {
        self.cached[0].get().filter(|_| self.was_cached).map(|cached| &cached.region.cover)
    }

    /// The box around the region at this tick.
    fn bounds(&self, kind: RegionKind, body: &Body) -> Aabb {
        if kind == RegionKind::EYES { self.eyes } else { body.around_box(&self.eyes) }
    }
}

impl LiveRegions {
    fn get(&self, kind: RegionKind) -> Option<&LiveRegion> {
        self.regions.get(kind.0)
    }

    pub(crate) fn coarse(&self) -> Option<&CoarseRegion> {
        self.coarse.as_deref()
    }

    /// The kind of the body regions of others that this avatar must be shown.
    pub(crate) fn shown(&self) -> RegionKind {
        self.shown
    }

    /// The body region that viewers with this delay must be shown.
    pub(crate) fn bodies(&self, delay: Duration) -> RegionKind {
        let index = self.regions.iter().skip(1).position(|region| region.delay == delay);
        RegionKind(index.map_or(self.regions.len(), |index| index + 1))
    }

    /// The space that the avatar was in at its last update, if it was in one.
    pub(crate) fn space(&self) -> Option<u32> {
        self.last_place.and_then(|place| place.space)
    }

    /// The cell that the avatar was in at its last update, if it was in one.
    pub(crate) fn cell(&self) -> Option<CellId> {
        self.last_place.and_then(|place| place.cell)
    }

    /// Where the eye can be at this tick for a kind of region, whatever walls are in this box.
    pub(crate) fn eyes(&self, kind: RegionKind) -> Aabb {
        self.get(kind).map_or(Aabb::EMPTY, |region| region.eyes)
    }

    /// How many kinds of regions there are.
    pub(crate) fn kinds(&self) -> usize {
        self.regions.len()
    }

    /// The versions of the cached regions of each kind, by margin.
    pub(crate) fn versions(&self) -> impl Iterator<Item = [Generation; RegionMargin::COUNT]> + '_ {
        self.regions.iter().map(|region| region.versions)
    }

    /// The version of a cached region.
    pub(crate) fn version(&self, kind: RegionKind, margin: RegionMargin) -> Generation {
        self.get(kind).map_or(Generation::default(), |region| region.versions[margin as usize])
    }

    /// The box around a region at this tick.
    pub(crate) fn bounds(&self, kind: RegionKind, body: &Body) -> Aabb {
        self.get(kind).map_or(Aabb::EMPTY, |region| region.bounds(kind, body))
    }

    /// Where a predicted line to a region ends, if the avatar goes on as it does: near the side
    /// that it moves towards.
    pub(crate) fn heading(
        &self,
        building: &Building,
        motion: &Motion,
        kind: RegionKind,
    ) -> Option<LineEnd> {
        let region = self.get(kind)?;
        let end = region.heading.get_or_init(|| {
            let way = building.axes().own(motion.pose.velocity.with_y(0.0)).normalize_or_zero();
            let middle = region.eyes.centre().with_y(motion.from.y);
            let ahead = middle + way * region.eyes.size() * (0.5 * HEADING);
            let is_possible = self.may_contain(kind, ahead, &building.body);
            let point = if is_possible { ahead } else { motion.from };
            LineEnd { point, cell: building.cell_at(point, self.cell()) }
        });
        Some(*end)
    }

    /// The footprint of a cached region with the small margin, if it was computed.
    pub(crate) fn known_footprint(&self, kind: RegionKind) -> Option<&RegionFootprint> {
        self.get(kind)?.cached[0].get().map(|cached| &cached.region.footprint)
    }

    /// Drops everything: the avatar did not come by itself to where it is.
    pub(crate) fn forget(&mut self) {
        self.coarse_in = None;
        self.regions.iter_mut().for_each(|region| region.forget(&mut self.changes));
    }

    /// Makes sure that there is a region of the eye, and one of the body for each delay.
    fn prepare(&mut self, own: Duration, delays: &[Duration]) {
        debug_assert!(delays.is_sorted(), "regions of the body are by delay");
        if !self.regions.iter().skip(1).map(|region| region.delay).eq(delays.iter().copied()) {
            let Self { regions, changes, .. } = self;
            let mut old = regions.drain(..);
            let eyes = old.next().unwrap_or_else(|| LiveRegion::new(own, changes));
            let mut old: Vec<LiveRegion> = old.collect();
            regions.push(eyes);
            regions.extend(delays.iter().map(|delay| {
                match old.iter().position(|bodies| bodies.delay == *delay) {
                    Some(index) => old.swap_remove(index),
                    None => LiveRegion::new(*delay, changes),
                }
            }));
        }
        self.shown = self.bodies(own);
    }

    /// Brings the regions up to date for this tick. Returns the cells of the last coarse region if
    /// there is a new one.
    pub(crate) fn update(
        &mut self,
        context: TickContext<'_>,
        search: &mut ReachSearch,
        motion: &Motion,
        delays: &[Duration],
    ) -> Option<Occupied> {
        let TickContext { building, config, horizons, .. } = context;
        let own = horizons.delay(motion.round_trip);
        let eyes_in = |delay: Duration, is_believed: bool| {
            let time = horizons.live_horizon(motion.age, delay);
            let bound = MotionBound::new(building, motion, is_believed, time);
            bound.scaled(config.faults.region_scale).eyes
        };
        self.prepare(own, delays);
        let has_moved = self.last_place.is_none_or(|place| place.from != motion.from);
        if has_moved {
            let cell = building.cell_at(motion.from, self.cell());
            let space = cell.map(|cell| building.cells().cells[cell.0 as usize].space);
            self.last_place = Some(Place { from: motion.from, cell, space });
        }
        // A doubted avatar may be anywhere, but is told of no more than others.
        let own_eyes = eyes_in(own, true);
        let step = building.axes().own(motion.pose.velocity) * config.tick.as_secs_f32();
        let mut all = own_eyes;
        for (index, region) in self.regions.iter_mut().enumerate() {
            let is_own = index == 0 || region.delay == own && motion.is_believed;
            let eyes = if is_own { own_eyes } else { eyes_in(region.delay, motion.is_believed) };
            all = all.union(&eyes);
            let update = RegionUpdate { eyes, step, has_moved, margin_m: config.spare_m };
            region.update(&update, &mut self.changes);
        }
        let mut old_cells = None;
        let coarse_m = lasting_margin_m(step, COARSE_M);
        if !self.coarse_in.is_some_and(|valid_in| serves(&valid_in, &all, coarse_m)) {
            let valid_in = with_margin_ahead(&all, step, coarse_m);
            self.coarse_in = Some(valid_in);
            let coarse = CoarseRegion::new(building, search, motion, &valid_in);
            let old = self.coarse.replace(Box::new(coarse));
            old_cells = Some(old.map_or_else(Default::default, |old| old.cells));
        }
        old_cells
    }

    /// Boxes around where a region is at this tick. Places behind walls are left out only where
    /// that is known already.
    pub(crate) fn known_cover(&self, kind: RegionKind, body: &Body) -> CoverBoxes {
        let Some((region, coarse)) = self.get(kind).zip(self.coarse()) else {
            return CoverBoxes::default();
        };
        let now = region.bounds(kind, body);
        region.current().unwrap_or(&coarse.bodies).clipped(&now)
    }

    /// Whether a point is in one of the boxes of [`LiveRegions::known_cover`].
    pub(crate) fn may_contain(&self, kind: RegionKind, point: Vec3, body: &Body) -> bool {
        let Some((region, coarse)) = self.get(kind).zip(self.coarse()) else { return false };
        let cover = || region.current().unwrap_or(&coarse.bodies);
        region.bounds(kind, body).contains(point)
            && cover().boxes().iter().any(|part| part.contains(point))
    }

    /// Boxes around a region of this tick, and around those places in its bounds that only the
    /// cached region with the small margin has. That takes no flood of its own.
    pub(crate) fn close_cover(
        &self,
        context: TickContext<'_>,
        search: &mut ReachSearch,
        motion: &Motion,
        kind: RegionKind,
    ) -> Option<CoverBoxes> {
        self.find_cached(context, search, motion, kind, RegionMargin::Small).map(|cached| {
            let now = self.bounds(kind, &context.building.body);
            cached.region.cover.clipped(&now)
        })
    }

    /// What a cached region with one of the margins covers.
    pub(crate) fn cached(
        &self,
        context: TickContext<'_>,
        search: &mut ReachSearch,
        motion: &Motion,
        kind: RegionKind,
        margin: RegionMargin,
    ) -> Option<&RegionFootprint> {
        let cached = self.find_cached(context, search, motion, kind, margin);
        cached.map(|cached| &cached.region.footprint)
    }

    fn find_cached(
        &self,
        context: TickContext<'_>,
        search: &mut ReachSearch,
        motion: &Motion,
        kind: RegionKind,
        margin: RegionMargin,
    ) -> Option<&CachedRegion> {
        let (region, level) = (self.get(kind)?, margin as usize);
        if region.cached[level].get().is_none() {
            let margin_m = MARGINS[level].metres(context.config.spare_m, region.step);
            let valid_in = with_margin_ahead(&region.eyes, region.step, margin_m);
            debug_assert!(valid_in.contains_box(&region.eyes), "a margin adds to a region");
            let reach = Reach::in_box(search, &motion.start(context.building), &valid_in);
            // An eye and its body have been to the same places, and both will be asked for.
            for kind in [RegionKind::EYES, self.shown, kind] {
                if let Some(same) = self.get(kind)
                    && same.eyes == region.eyes
                    && same.cached[level].get().is_none()
                {
                    let found = CachedRegion::new(context.building, search, &reach, valid_in, kind);
                    // Another thread may have been faster; it found the same.
                    let _ = same.cached[level].set(found);
                }
            }
        }
        region.cached[level].get()
    }

    /// Boxes around a region of this tick, without a margin.
    pub(crate) fn exact(
        &self,
        context: TickContext<'_>,
        search: &mut ReachSearch,
        motion: &Motion,
        kind: RegionKind,
    ) -> Option<&CoverBoxes> {
        let region = self.get(kind)?;
        let exact = region.exact.get_or_init(|| {
            let reach = Reach::in_box(search, &motion.start(context.building), &region.eyes);
            if kind == RegionKind::EYES {
                reach.eye_cover()
            } else {
                reach.bodies(search, context.building).cover
            }
        });
        Some(exact)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Config, Input,
        tests::stage::{self, Stage},
    };

    /// What was proved for the region of a delay must not seem proved for a later region of the
    /// same delay.
    #[test]
    fn a_delay_that_comes_again_brings_a_new_version() {
        let mut stage = Stage::new(stage::row(3), Config::default());
        let (ada, bob) = (stage.join(1, 5.0), stage.join(2, 18.0));
        let mut version_at = |round_trip_ms: u64| {
            let round_trip = Duration::from_millis(round_trip_ms);
            stage.engine.handle(stage.now, Input::RoundTrip { avatar: ada, round_trip });
            stage.tick();
            let delay = stage.engine.horizons.delay(round_trip);
            let avatar = stage.engine.population.find(bob).expect("bob is present");
            avatar.regions.version(avatar.regions.bodies(delay), RegionMargin::Small)
        };
        let versions = [200, 0, 200, 0].map(&mut version_at);
        let is_new = |index: usize| !versions[..index].contains(&versions[index]);
        assert!((1..versions.len()).all(is_new), "{versions:?}");
    }
}
