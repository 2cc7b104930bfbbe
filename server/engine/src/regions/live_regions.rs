//! Where live avatars can be until the next tick's word stands.

use std::{sync::OnceLock, time::Duration};

use glam::Vec3;
use sightline_world::{
    CellId, Cells,
    geometry::Aabb,
    motion::{Body, Pose},
    tolerance::WIRE_POSE_M,
};

use crate::{
    Engine,
    bit_set::BitSet,
    claims::walkability::WalkState,
    interest::snapshot::{LiveAvatar, LiveAvatars},
    population::Slot,
    regions::cover_boxes::CoverBoxes,
    regions::footprints::RegionFootprint,
    regions::reach::{Reach, Start},
    worker_pool::Workspace,
};

/// Wide regions have so much to spare on each side, in metres: most pairs of people are far from
/// seeing each other, and this is how long nothing need be done about them.
const WIDE_M: f32 = 0.75;

/// How much regions have to spare on each side, as multiples of [`Config::spare_m`](crate::Config::spare_m).
/// Those of somebody who walks have most of it ahead.
pub(crate) const SPARES: [f32; 2] = [1.0, 4.0];
/// How much of it walkers have aside and behind.
const ASIDE: f32 = 0.25;
/// A line that will last ends so near the side of a region that it moves towards.
const LEAD: f32 = 0.9;
/// For no more ticks than these is it believed that somebody goes on so.
const AHEAD_TICKS: f32 = 12.0;

/// Where an eye can be until a moment: in a box about it, as far as portals lead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MotionBound {
    /// Where it was last, in own axes.
    pub(crate) from: Vec3,
    /// In own axes.
    pub(crate) within: Aabb,
    /// No way is longer, in metres.
    pub(crate) way_m: f32,
}

impl MotionBound {
    pub(crate) fn scaled(self, by: f32) -> Self {
        if by == 1.0 {
            return self;
        }
        Self { within: scaled(&self.within, self.from, by), way_m: self.way_m * by, ..self }
    }
}

/// A box that is so many times as large about a point in it.
pub(crate) fn scaled(region: &Aabb, about: Vec3, by: f32) -> Aabb {
    Aabb::new(about + (region.min - about) * by, about + (region.max - about) * by)
}

/// Where an avatar's body can be, and thereby its eye, with much to spare: this lasts for about ten steps.
/// Pairs are made and ended by it.
#[derive(Clone, Debug)]
pub(crate) struct CoarseRegion {
    /// It holds as long as the eye can be here only, as viewers with the longest delay must see it.
    spare: Aabb,
    /// Around all places of the body.
    bodies: CoverBoxes,
    /// Where the eye can be, and where the body can.
    pub(crate) grounds: [RegionFootprint; 2],
    /// The cells of both, ascending, as the indices of wide regions have them.
    pub(crate) cells: [Vec<u32>; 2],
}

impl CoarseRegion {
    /// Fills in the cells that can be seen from where the eye can be, and from where the body can.
    pub(crate) fn look_around(&self, cells: &Cells, seen: &mut [BitSet; 2]) {
        let [eyes, bodies] = &self.grounds;
        let [from_eyes, from_bodies] = seen;
        from_eyes.clear();
        eyes.see(cells, |_| true, from_eyes);
        from_bodies.clone_from(from_eyes);
        bodies.see(cells, |cell| eyes.cells().binary_search(&cell).is_err(), from_bodies);
    }
}

/// Where an eye can be, or a body as viewers with a certain delay must see it. What portals lead to
/// is worked out when it is asked for, by whichever thread asks first.
#[derive(Clone, Debug)]
pub(crate) struct LiveRegion {
    /// Of viewers.
    delay: Duration,
    /// Where the eye can be at this tick, whatever walls are in it.
    pub(crate) within: Aabb,
    /// How far it moves from tick to tick.
    step: Vec3,
    /// The last has most to spare, and lasts longest.
    kept: [OnceLock<Box<CachedRegion>>; SPARES.len()],
    /// Counts the changes of each of these.
    pub(crate) versions: [u32; SPARES.len()],
    /// Whether the first of them was there when this tick began: what depends on it must not depend on who
    /// asks for it first in this tick.
    is_known: bool,
    /// Lines that will last end here: towards the side to which it goes. And the cell that this is in.
    pub(crate) lead: (Vec3, Option<CellId>),
    /// With nothing to spare.
    exact: OnceLock<CoverBoxes>,
}

/// What lasts for a few ticks.
#[derive(Clone, Debug)]
pub(crate) struct CachedRegion {
    /// It holds as long as the eye can be here only.
    spare: Aabb,
    /// Around all places.
    parts: CoverBoxes,
    pub(crate) ground: RegionFootprint,
}

/// The regions of a live avatar; none while hidden.
#[derive(Clone, Debug, Default)]
pub(crate) struct LiveRegions {
    pub(crate) wide: Option<Box<CoarseRegion>>,
    /// Of the eye; then of the body, by delay, ascending: the last is that of the slowest viewer.
    nears: Vec<LiveRegion>,
    /// As what this one must be shown others.
    pub(crate) shown: RegionKind,
    /// The place that the regions were brought up to date for last, and the space that it is in.
    home: Option<(Vec3, Option<u32>)>,
}

/// What a region is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct RegionKind(usize);

impl RegionKind {
    /// The eye. All others are bodies, as viewers with some delay must see them.
    pub(crate) const EYES: Self = Self(0);
}

/// Whether what was made for `spare` serves where an eye can be now: it holds all of that, and was not
/// made when far more was possible.
fn serves(spare: &Aabb, within: &Aabb, spare_m: f32) -> bool {
    spare.contains_box(within) && within.grown(2.0 * spare_m).contains_box(spare)
}

/// Where an eye can be before long that can be in a box now: with so much to spare, most of it in the way of
/// which it goes a step each tick.
pub(crate) fn ahead(within: &Aabb, step: Vec3, spare_m: f32) -> Aabb {
    let ahead_m = (step.length() * AHEAD_TICKS).min(2.0 * (1.0 - ASIDE) * spare_m);
    let way = step.normalize_or_zero() * ahead_m;
    let there = Aabb::new(within.min + way, within.max + way);
    within.union(&there).grown(spare_m - 0.5 * ahead_m)
}

impl LiveRegion {
    fn new(delay: Duration) -> Self {
        let (kept, versions) = (Default::default(), Default::default());
        Self {
            delay,
            within: Aabb::EMPTY,
            step: Vec3::ZERO,
            kept,
            versions,
            is_known: false,
            lead: (Vec3::ZERO, None),
            exact: OnceLock::new(),
        }
    }

    /// Takes in where the eye can be now, and drops what does not serve any more. Gives whether something is
    /// not as it was.
    fn renew(&mut self, within: Aabb, step: Vec3, has_moved: bool, spare_m: f32) -> bool {
        let has_changed = has_moved || within != self.within;
        if has_changed {
            self.exact = OnceLock::new();
        }
        (self.within, self.step) = (within, step);
        for (level, kept) in self.kept.iter_mut().enumerate() {
            let serves =
                |kept: &CachedRegion| serves(&kept.spare, &within, spare_m * SPARES[level]);
            if kept.get().is_some_and(|kept| !serves(kept)) {
                *kept = OnceLock::new();
                self.versions[level] = self.versions[level].wrapping_add(1);
            }
        }
        self.is_known = self.kept[0].get().is_some();
        has_changed
    }

    /// Where the boxes are that are kept with least to spare, if they were asked for.
    pub(crate) fn ground(&self) -> Option<&RegionFootprint> {
        self.kept[0].get().map(|kept| &kept.ground)
    }

    /// Boxes around all places at this tick that are not far from it, if there are any.
    fn current(&self) -> Option<&CoverBoxes> {
        self.kept[0].get().filter(|_| self.is_known).map(|kept| &kept.parts)
    }
}

impl LiveRegions {
    pub(crate) fn get(&self, part: RegionKind) -> Option<&LiveRegion> {
        self.nears.get(part.0)
    }

    /// What viewers with some delay must be shown.
    pub(crate) fn bodies(&self, delay: Duration) -> RegionKind {
        let place = self.nears.iter().skip(1).position(|near| near.delay == delay);
        RegionKind(place.map_or(self.nears.len(), |place| place + 1))
    }

    /// The space that the avatar was in last, if it was in one.
    pub(crate) fn home(&self) -> Option<u32> {
        self.home.and_then(|(_, space)| space)
    }

    /// Has all worked out anew: the avatar is where it has not come to by itself.
    pub(crate) fn forget(&mut self) {
        if let Some(wide) = &mut self.wide {
            wide.spare = Aabb::EMPTY;
        }
        for near in &mut self.nears {
            near.kept = Default::default();
            near.exact = OnceLock::new();
            near.versions.iter_mut().for_each(|version| *version = version.wrapping_add(1));
        }
    }

    /// Has a part for the eye and for each delay.
    fn prepare(&mut self, own: Duration, delays: &[Duration]) {
        if !self.nears.iter().skip(1).map(|near| near.delay).eq(delays.iter().copied()) {
            let mut old = std::mem::take(&mut self.nears).into_iter();
            self.nears.push(old.next().unwrap_or_else(|| LiveRegion::new(own)));
            let mut old: Vec<LiveRegion> = old.collect();
            self.nears.extend(delays.iter().map(|delay| {
                match old.iter().position(|bodies| bodies.delay == *delay) {
                    Some(place) => old.swap_remove(place),
                    None => LiveRegion::new(*delay),
                }
            }));
        }
        self.shown = self.bodies(own);
    }

    /// Boxes around where a part can be at this tick; places behind walls only where that saves work.
    pub(crate) fn just(&self, part: RegionKind, body: &Body) -> CoverBoxes {
        let Some((near, wide)) = self.get(part).zip(self.wide.as_ref()) else {
            return CoverBoxes::default();
        };
        let now =
            if part == RegionKind::EYES { near.within } else { body.around_box(&near.within) };
        near.current().unwrap_or(&wide.bodies).within(&now)
    }

    /// Whether a point is in one of these boxes.
    pub(crate) fn may_hold(&self, part: RegionKind, point: Vec3, body: &Body) -> bool {
        let Some((near, wide)) = self.get(part).zip(self.wide.as_ref()) else { return false };
        let is_now = if part == RegionKind::EYES {
            near.within.contains(point)
        } else {
            body.around_box(&near.within).contains(point)
        };
        let parts = || near.current().unwrap_or(&wide.bodies);
        is_now && parts().boxes().iter().any(|part| part.contains(point))
    }
}

impl Engine {
    /// How far an eye gets some time after its last accepted report was made, if what that says is believed.
    pub(crate) fn leeway(&self, pose: &Pose, is_believed: bool, time: Duration) -> MotionBound {
        let axes = &self.world.cells.axes;
        let mut agility = self.agility;
        if !is_believed {
            agility.dash = agility.speed_max;
        }
        let (eye, velocity) = (axes.own(pose.eye), axes.own(pose.velocity));
        MotionBound {
            from: eye,
            within: agility.eyes(eye, velocity, time).grown(WIRE_POSE_M),
            way_m: self.agility.way(velocity, time) + WIRE_POSE_M,
        }
    }

    /// Where an eye is, in own axes, and what it may go through.
    fn start(&self, from: Vec3, footing: WalkState) -> Start<'_> {
        Start { cells: &self.world.cells, fit: self.ways.fit_of(footing), from }
    }

    /// Brings up to date where live avatars can be at this tick, and their wide regions where need be.
    pub(crate) fn place_near(&mut self, now: Duration, lives: &mut LiveAvatars) {
        let delays: Vec<Duration> = self.horizons.delays().collect();
        let crew = &self.crew;
        crew.each(lives.all_mut(), |work, _, live| self.renew(work, now, &delays, live));
        for live in lives.all() {
            if let Some((old, wide)) = live.moved.as_ref().zip(live.near.wide.as_ref()) {
                for (index, (old, new)) in self.near.iter_mut().zip(old.iter().zip(&wide.cells)) {
                    index.replace((live.id, live.slot), old, new);
                }
            }
        }
    }

    fn renew(
        &self,
        work: &mut Workspace,
        now: Duration,
        delays: &[Duration],
        live: &mut LiveAvatar,
    ) {
        let own = self.horizons.delay(live.link.round_trip);
        let age = now.saturating_sub(live.heard);
        let within = |delay: Duration, is_believed: bool| {
            let time = self.horizons.near(age, live.link, delay);
            let leeway = self.leeway(&live.pose, is_believed, time);
            leeway.scaled(self.config.faults.region_scale).within
        };
        let (near, spare_m) = (&mut live.near, self.config.spare_m);
        near.prepare(own, delays);
        let has_moved = near.home.is_none_or(|(from, _)| from != live.from);
        if has_moved {
            let cells = &self.world.cells;
            let cell = cells.at_own(live.from);
            near.home = Some((live.from, cell.map(|cell| cells.cells[cell.0 as usize].space)));
        }
        // Whoever is doubted may be anywhere, but is told as much as others.
        let eyes = within(own, true);
        let step = self.world.cells.axes.own(live.pose.velocity) * self.config.tick.as_secs_f32();
        let (mut all, mut has_changed) = (eyes, false);
        for (place, near) in near.nears.iter_mut().enumerate() {
            let is_own = place == 0 || near.delay == own && live.is_believed;
            let within = if is_own { eyes } else { within(near.delay, live.is_believed) };
            all = all.union(&within);
            has_changed |= near.renew(within, step, has_moved, spare_m);
        }
        if !near.wide.as_ref().is_some_and(|wide| serves(&wide.spare, &all, WIDE_M)) {
            let spare = ahead(&all, step, WIDE_M);
            let wide = self.wide(work, &self.start(live.from, live.footing), spare);
            let old = near.wide.replace(Box::new(wide));
            live.moved = Some(old.map_or_else(Default::default, |old| old.cells));
        }
        if has_changed {
            self.find_leads(live);
        }
    }

    /// Finds where lines end that will last, as far as somebody goes on so.
    fn find_leads(&self, live: &mut LiveAvatar) {
        let cells = &self.world.cells;
        let near = &mut live.near;
        let way = cells.axes.own(live.pose.velocity.with_y(0.0)).normalize_or_zero();
        for part in (0..near.nears.len()).map(RegionKind) {
            let within = near.nears[part.0].within;
            let ahead = within.centre().with_y(live.from.y) + way * within.size() * (0.5 * LEAD);
            let end = if near.may_hold(part, ahead, &self.body) { ahead } else { live.from };
            near.nears[part.0].lead = (end, cells.at_own(end));
        }
    }

    fn wide(&self, work: &mut Workspace, start: &Start<'_>, spare: Aabb) -> CoarseRegion {
        let cells = &self.world.cells;
        let reach = Reach::within(&mut work.reach, start, &spare);
        let (found, bodies) = reach.bodies(cells, &self.world.body);
        let eyes = RegionFootprint::of(cells, &self.rooms, reach.eyes(), &reach.eye_parts(cells));
        let grounds = [eyes, RegionFootprint::of(cells, &self.rooms, found, &bodies)];
        let numbers = |ground: &RegionFootprint| ground.cells().iter().map(|cell| cell.0).collect();
        let cells = grounds.each_ref().map(numbers);
        CoarseRegion { spare, bodies, grounds, cells }
    }

    /// What portals lead to for a part of a live avatar, with so much to spare.
    pub(crate) fn kept<'a>(
        &self,
        work: &mut Workspace,
        live: &'a LiveAvatar,
        part: RegionKind,
        level: usize,
    ) -> Option<&'a CachedRegion> {
        let near = live.near.get(part)?;
        if near.kept[level].get().is_none() {
            let spare = ahead(&near.within, near.step, self.config.spare_m * SPARES[level]);
            let start = self.start(live.from, live.footing);
            let reach = Reach::within(&mut work.reach, &start, &spare);
            // An eye and its body have been to the same places: both will be asked for.
            for part in [RegionKind::EYES, live.near.shown, part] {
                if let Some(twin) = live.near.get(part)
                    && twin.within == near.within
                    && twin.kept[level].get().is_none()
                {
                    // Another thread may have been faster; what it found is the same.
                    let _ = twin.kept[level].set(Box::new(self.keep(&reach, spare, part)));
                }
            }
        }
        near.kept[level].get().map(|kept| &**kept)
    }

    fn keep(&self, reach: &Reach, spare: Aabb, part: RegionKind) -> CachedRegion {
        let cells = &self.world.cells;
        let (found, parts) = if part == RegionKind::EYES {
            (reach.eyes(), reach.eye_parts(cells))
        } else {
            reach.bodies(cells, &self.world.body)
        };
        let ground = RegionFootprint::of(cells, &self.rooms, found, &parts);
        CachedRegion { spare, parts, ground }
    }

    /// The same with nothing to spare, for this tick.
    pub(crate) fn exact<'a>(
        &self,
        work: &mut Workspace,
        live: &'a LiveAvatar,
        part: RegionKind,
    ) -> Option<&'a CoverBoxes> {
        let near = live.near.get(part)?;
        let exact = near.exact.get_or_init(|| {
            let cells = &self.world.cells;
            let start = self.start(live.from, live.footing);
            let reach = Reach::within(&mut work.reach, &start, &near.within);
            if part == RegionKind::EYES {
                reach.eye_parts(cells)
            } else {
                reach.bodies(cells, &self.world.body).1
            }
        });
        Some(exact)
    }

    /// Takes an avatar's regions out.
    pub(crate) fn forget_near(&mut self, slot: Slot) {
        let avatar = self.population.at_mut(slot);
        let (id, near) = (avatar.id, std::mem::take(&mut avatar.near));
        if let Some(wide) = near.wide {
            for (index, cells) in self.near.iter_mut().zip(&wide.cells) {
                index.replace((id, slot), cells, &[]);
            }
        }
    }
}
