//! Movers and avatars, drawn at a cost that follows how much of them is in view.
//!
//! They sit in an octree of their own ([`Occupants`]) and are drawn after the building, whose
//! depths decide what can be seen. There are three ways, each with less work than the one before
//! (Sudarsky and Gotsman 1996, sections 2.1 and 3.2):
//!
//! * [`Culling::Plain`]: every object is placed and drawn in every picture.
//! * [`Culling::Hierarchical`]: every object is placed in the octree. The octree's nodes are tested
//!   against the Z pyramid front to back, and objects in hidden nodes are not drawn.
//! * [`Culling::Temporal`]: a temporal bounding volume (TBV) takes the place of an object that was
//!   not seen: a box that the object stays in until the TBV expires. The object is left alone until
//!   the TBV expires or comes into view. TBVs last longer after one expired, and shorter after one
//!   was seen.
//!
//! The TBV of a mover is the box that it sweeps. The TBV of an avatar follows from its pose and
//! from what a body can do. An avatar need not keep to that, so each update of a hidden avatar is
//! compared with its TBV ([`AvatarSource::updates`]).
//!
//! All three ways draw the same pixels. Moving objects do not count as occluders: walls hide most.

mod in_view;
mod moving_set;
mod occlusion;
#[cfg(test)]
mod tests;

use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

use sightline_client_core::replica::{AvatarSource, ShownAvatar, Update};
use sightline_world::{
    World,
    geometry::Aabb,
    motion::AvatarId,
    octree::occupants::{OccupantId, Occupants, Visit},
};

use self::{
    moving_set::{MovingId, MovingSet, NoAvatars},
    occlusion::OcclusionTest,
};
use super::{Camera, Frame, movers, pyramid::Pyramid};

pub use self::in_view::InView;

/// The edge of the octree's smallest nodes, in metres: about the size of what stands in a room.
const NODE_M: f32 = 1.0;
/// The validity of an object's first TBV.
const VALIDITY_FIRST: Duration = Duration::from_secs(1);
/// A TBV with a shorter validity is not worth its cost.
const VALIDITY_MIN: Duration = Duration::from_millis(50);
const VALIDITY_MAX: Duration = Duration::from_secs(60);

/// How the cost of hidden objects is avoided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Culling {
    /// Hidden objects are placed and drawn like others.
    Plain,
    /// Hidden objects are placed but not drawn.
    Hierarchical,
    /// Hidden objects are left alone while a TBV stands for them.
    #[default]
    Temporal,
}

impl Culling {
    /// All ways, the one with the most work first.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Hierarchical, Self::Temporal];
}

/// What drawing a picture took, in counts that do not depend on the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct MovingCounters {
    /// Objects drawn.
    pub drawn: usize,
    /// Objects whose place was worked out.
    pub placed: usize,
    /// Boxes, of nodes and of objects, tested against the picture.
    pub tested: usize,
    /// TBVs that expired.
    pub expired: usize,
    /// TBVs that came into view.
    pub revealed: usize,
    /// TBVs that an update of an avatar ended.
    pub refuted: usize,
}

/// Draws the movers of a world and the avatars that a client is told of, and keeps their TBVs from
/// one picture to the next.
#[derive(Clone, Debug)]
pub struct MovingRenderer {
    culling: Culling,
    /// The boxes of the objects, or of the TBVs that stand for them. Movers come first, in their
    /// order.
    occupants: Occupants,
    /// The objects, by their number in `occupants`.
    objects: Vec<Option<MovingObject>>,
    /// The numbers of the avatars.
    avatars: BTreeMap<AvatarId, u32>,
    /// The numbers of the objects that are placed in every picture: those without a TBV.
    tracked: BTreeSet<u32>,
    /// The expiries of all TBVs, with the numbers of their objects.
    expiries: BTreeSet<(Duration, u32)>,
    /// The time of the last picture.
    now: Duration,
    pyramid: Pyramid,
    counters: MovingCounters,
}

/// A mover or an avatar.
#[derive(Clone, Debug)]
struct MovingObject {
    id: MovingId,
    /// The validity of its last TBV.
    validity: Duration,
    /// When the TBV that stands for it expires; `None` while it is tracked.
    until: Option<Duration>,
}

impl MovingRenderer {
    /// A renderer for the movers of a world. A mover whose box is not finite is never drawn.
    pub fn new(world: &World, culling: Culling) -> Self {
        let octree = &world.octree;
        let depth = (octree.edge / NODE_M).log2().ceil().clamp(1.0, 12.0) as u8;
        let mut moving = Self {
            culling,
            occupants: Occupants::new(octree.origin, octree.edge, depth),
            objects: Vec::new(),
            avatars: BTreeMap::new(),
            tracked: BTreeSet::new(),
            expiries: BTreeSet::new(),
            now: Duration::ZERO,
            pyramid: Pyramid::default(),
            counters: MovingCounters::default(),
        };
        let set = MovingSet::new(world, &NoAvatars, Duration::ZERO);
        for at in 0..world.movers.len() {
            let id = MovingId::Mover(at as u32);
            if moving.add(id, &set).is_none() {
                break;
            }
        }
        moving
    }

    /// Draws the movers and avatars in view, at a time of the server's clock, into a frame that
    /// shows the building from the same camera. The world is the one that this renderer was made
    /// for. Returns the avatars that can be seen: those that at least one pixel shows.
    pub fn draw(
        &mut self,
        frame: &mut Frame,
        camera: &Camera,
        world: &World,
        source: Option<&mut dyn AvatarSource>,
        now: Duration,
    ) -> Vec<ShownAvatar> {
        self.find(frame, camera, world, source, now).draw(frame, camera, world, &world.octree)
    }

    /// Finds the movers and avatars in view, at a time of the server's clock. The frame shows the
    /// building alone, from the same camera.
    pub fn find(
        &mut self,
        frame: &Frame,
        camera: &Camera,
        world: &World,
        source: Option<&mut dyn AvatarSource>,
        now: Duration,
    ) -> InView {
        self.counters = MovingCounters::default();
        let nobody: &mut dyn AvatarSource = &mut NoAvatars;
        let source = source.unwrap_or(nobody);
        let updates = source.updates();
        let set = MovingSet::new(world, source, now);
        self.take_in(&updates, &set);
        if frame.width() == 0 || frame.height() == 0 {
            return InView::default();
        }
        let seen: BTreeSet<u32> = if self.culling == Culling::Plain {
            self.counters.placed = self.tracked.len();
            self.tracked.clone()
        } else {
            self.expire(now);
            for number in self.tracked.clone() {
                self.place(number, &set);
            }
            self.test(frame, camera, &set)
        };
        self.in_view(&seen, &set)
    }

    /// The counters of the last picture.
    pub fn counters(&self) -> MovingCounters {
        self.counters
    }

    /// Takes in the updates of avatars since the last picture.
    fn take_in(&mut self, updates: &[(AvatarId, Update)], set: &MovingSet<'_>) {
        for &(avatar, update) in updates {
            if update == Update::Appeared {
                self.appear(avatar, set);
            }
            let Some(&number) = self.avatars.get(&avatar) else { continue };
            let object = self.objects[number as usize].as_ref();
            let Some(until) = object.and_then(|object| object.until) else { continue };
            let path = set.path(avatar, until);
            let holds = path.is_some_and(|path| {
                self.occupants.primitives(OccupantId(number)).any(|it| it.contains_box(&path))
            });
            if !holds {
                self.counters.refuted += 1;
                self.track(number);
            }
        }
    }

    /// Takes in an avatar that appeared.
    fn appear(&mut self, avatar: AvatarId, set: &MovingSet<'_>) {
        if !self.avatars.contains_key(&avatar)
            && let Some(number) = self.add(MovingId::Avatar(avatar), set)
        {
            self.avatars.insert(avatar, number);
        }
    }

    /// Takes in an object. Returns its number, or `None` when there are too many objects.
    fn add(&mut self, id: MovingId, set: &MovingSet<'_>) -> Option<u32> {
        // An object without a finite box gets a number too, and an empty box.
        let nowhere = Aabb::around(set.world.octree.origin, 0.0);
        let inserted = self.occupants.insert(&[set.bounds(id).unwrap_or(nowhere)]);
        let OccupantId(number) = inserted.or_else(|_| self.occupants.insert(&[nowhere])).ok()?;
        let object = MovingObject { id, validity: VALIDITY_FIRST, until: None };
        if self.objects.len() <= number as usize {
            self.objects.resize(number as usize + 1, None);
        }
        self.objects[number as usize] = Some(object);
        self.tracked.insert(number);
        Some(number)
    }

    /// Removes an object that has vanished.
    fn forget(&mut self, number: u32) {
        self.track(number);
        self.tracked.remove(&number);
        self.occupants.remove(OccupantId(number));
        if let Some(MovingObject { id: MovingId::Avatar(avatar), .. }) =
            self.objects[number as usize].take()
        {
            self.avatars.remove(&avatar);
        }
    }

    /// Ends the TBV that stands for an object, if one does.
    fn track(&mut self, number: u32) {
        let until = self.objects[number as usize].as_mut().and_then(|object| object.until.take());
        if let Some(until) = until {
            self.expiries.remove(&(until, number));
        }
        self.tracked.insert(number);
    }

    /// Ends the TBVs that have expired; all of them when time went backwards.
    fn expire(&mut self, now: Duration) {
        let is_back = now < std::mem::replace(&mut self.now, now);
        while let Some(&(until, number)) = self.expiries.first()
            && (is_back || until < now)
        {
            debug_assert!(!self.tracked.contains(&number), "{number} has a TBV and is tracked");
            self.counters.expired += 1;
            if let Some(object) = &mut self.objects[number as usize] {
                object.validity = (object.validity * 3 / 2).min(VALIDITY_MAX);
            }
            self.track(number);
        }
    }

    /// Puts an object where it is now. Returns its box, or `None` when it has vanished.
    fn place(&mut self, number: u32, set: &MovingSet<'_>) -> Option<Aabb> {
        self.counters.placed += 1;
        let id = self.objects[number as usize].as_ref().map(|object| object.id)?;
        let bounds = set.bounds(id);
        match bounds {
            // An object whose box is not finite stays where it was.
            Some(bounds) => drop(self.occupants.move_to(OccupantId(number), &[bounds])),
            None => self.forget(number),
        }
        bounds
    }

    /// Finds the objects to draw, and gives hidden objects a TBV.
    fn test(&mut self, frame: &Frame, camera: &Camera, set: &MovingSet<'_>) -> BTreeSet<u32> {
        let mut pyramid = std::mem::take(&mut self.pyramid);
        let mut test = OcclusionTest::new(camera, frame, &mut pyramid);
        let mut met = Vec::new();
        self.occupants.front_to_back(camera.eye, |visit| match visit {
            Visit::Node(bounds) => test.shows(&bounds),
            Visit::Occupant(id) => {
                met.push(id);
                true
            }
        });
        let mut seen = BTreeSet::new();
        for id in met {
            let Some(object) = &self.objects[id.0 as usize] else { continue };
            let is_tracked = object.until.is_none();
            let shows = self.occupants.primitives(id).any(|bounds| test.shows(bounds));
            if shows && (is_tracked || self.reveal(&mut test, id.0, set)) {
                seen.insert(id.0);
            }
        }
        if self.culling == Culling::Temporal {
            let unseen: Vec<u32> = self.tracked.difference(&seen).copied().collect();
            for number in unseen {
                self.hide(&mut test, number, set);
            }
        }
        debug_assert_eq!(self.expiries.len() + self.tracked.len(), self.occupants.len());
        self.counters.tested = test.tested;
        self.pyramid = pyramid;
        seen
    }

    /// Tests an object whose TBV has come into view. Returns whether the object is in view itself.
    /// Its next TBV is shorter.
    fn reveal(&mut self, test: &mut OcclusionTest<'_>, number: u32, set: &MovingSet<'_>) -> bool {
        self.counters.revealed += 1;
        let Some(object) = &mut self.objects[number as usize] else { return false };
        object.validity = (object.validity / 2).max(VALIDITY_MIN);
        self.track(number);
        self.place(number, set).is_some_and(|bounds| test.shows(&bounds))
    }

    /// Lets a TBV that is not in view stand for an object, if one is worth it.
    fn hide(&mut self, test: &mut OcclusionTest<'_>, number: u32, set: &MovingSet<'_>) {
        let Some(object) = &mut self.objects[number as usize] else { return };
        let mut validity = object.validity;
        while validity >= VALIDITY_MIN {
            let until = set.now.saturating_add(validity);
            let Some(volume) = set.volume(object.id, until) else { return };
            if !test.shows(&volume) && self.occupants.move_to(OccupantId(number), &[volume]).is_ok()
            {
                self.counters.placed += 1;
                (object.validity, object.until) = (validity, Some(until));
                self.tracked.remove(&number);
                self.expiries.insert((until, number));
                return;
            }
            validity /= 2;
        }
        object.validity = VALIDITY_MIN;
    }

    /// Some objects as they are now.
    fn in_view(&mut self, seen: &BTreeSet<u32>, set: &MovingSet<'_>) -> InView {
        let mut found = InView { now: set.now, ..InView::default() };
        let mut others: Vec<AvatarId> = Vec::new();
        for object in seen.iter().filter_map(|number| self.objects[*number as usize].as_ref()) {
            match object.id {
                MovingId::Mover(at) => {
                    let mover = set.world.movers.get(at as usize);
                    found.movers.extend(mover.map(|mover| (at, movers::place(mover, set.now))));
                }
                MovingId::Avatar(avatar) => others.push(avatar),
            }
        }
        others.sort_unstable();
        for avatar in others {
            match (set.source.shown(avatar, set.now), self.avatars.get(&avatar)) {
                (Some(avatar), _) => found.avatars.push(avatar),
                (None, Some(&number)) => self.forget(number),
                (None, None) => {}
            }
        }
        self.counters.drawn = found.movers.len() + found.avatars.len();
        found
    }
}
