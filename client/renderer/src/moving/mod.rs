//! What moves, and is drawn at a cost that follows what of it is in view.
//!
//! Movers and avatars sit in an octree of their own ([`Occupants`]) and are drawn after the building, whose
//! depths decide. In the order of Sudarsky and Gotsman (*Output-Sensitive Visibility Algorithms for
//! Dynamic Scenes*, sections 2.1 and 3.2), each way does less than the one before:
//!
//! * [`Culling::Plain`]: everything is placed and drawn, in each picture.
//! * [`Culling::Hierarchical`]: everything is placed in the octree; its nodes are tested against the Z
//!   pyramid, front to back, and what is in nodes that nothing of can be seen is not drawn.
//! * [`Culling::Temporal`]: what was not seen is replaced by a temporal bounding volume, the box that it
//!   stays in until the volume expires. It is not looked at again before that, or before the
//!   volume comes into view. Volumes last longer after they expired, and shorter after they were seen.
//!
//! A mover's volume is what it sweeps. An avatar's follows from its pose and what a body can do; it
//! need not keep to that, so what the server tells of a hidden avatar is held against its
//! volume when it comes ([`AvatarSource::updates`]).
//!
//! All three draw the same pixels. What moves does not hide what else does: walls do most of that.

mod moving_set;
mod occlusion;
#[cfg(test)]
mod tests;

use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

use sightline_world::{
    Mover, World,
    geometry::Aabb,
    motion::AvatarId,
    octree::occupants::{OccupantId, Occupants, Visit},
};

use self::{
    moving_set::{MovingId, MovingSet, NoAvatars},
    occlusion::OcclusionTest,
};
use super::{
    Camera, Frame,
    avatars::{self, AvatarFigure},
    movers,
    pyramid::Pyramid,
};
use sightline_client_core::replica::{AvatarSource, Update, VisibleAvatar};

/// The edge of the smallest nodes, in metres: about what stands in a room.
const NODE_M: f32 = 1.0;
/// What a volume is made to last at first.
const VALIDITY_FIRST: Duration = Duration::from_secs(1);
/// Shorter ones are not worth it.
const VALIDITY_MIN: Duration = Duration::from_millis(50);
const VALIDITY_MAX: Duration = Duration::from_secs(60);

/// What is done about what moves and cannot be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Culling {
    /// Nothing.
    Plain,
    /// It is not drawn.
    Hierarchical,
    /// It is not even looked at.
    #[default]
    Temporal,
}

impl Culling {
    /// All ways, in the order in which they do less.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Hierarchical, Self::Temporal];
}

/// What the last picture took, in counts that do not depend on the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct MovingCounters {
    /// Movers and avatars that were drawn.
    pub drawn: usize,
    /// Those whose place was worked out.
    pub placed: usize,
    /// Boxes, of nodes and of what is in them, that were tested against the picture.
    pub tested: usize,
    /// Volumes that expired.
    pub expired: usize,
    /// Volumes that came into view.
    pub revealed: usize,
    /// Volumes that news of an avatar put an end to.
    pub refuted: usize,
}

/// The movers of a world, and the avatars that a client is told of, from one picture to the next.
#[derive(Clone, Debug)]
pub struct MovingRenderer {
    culling: Culling,
    /// Movers first, in their order.
    occupants: Occupants,
    /// By number.
    things: Vec<Option<MovingObject>>,
    avatars: BTreeMap<AvatarId, u32>,
    /// No avatar's name has more letters.
    letters_max: usize,
    /// By number, those that are placed in each picture.
    tracked: BTreeSet<u32>,
    expiries: BTreeSet<(Duration, u32)>,
    /// Of the last picture.
    now: Duration,
    pyramid: Pyramid,
    counters: MovingCounters,
}

/// What is known of something that moves.
#[derive(Clone, Debug)]
struct MovingObject {
    what: MovingId,
    /// Of the name above it, as it is shown.
    letters: usize,
    /// How long its volume was made to last.
    validity: Duration,
    /// When the volume expires that stands for it, if one does.
    until: Option<Duration>,
}

impl MovingRenderer {
    /// The movers of a world. Those whose box is nowhere are never drawn.
    pub fn new(world: &World, culling: Culling) -> Self {
        let octree = &world.octree;
        let depth = (octree.edge / NODE_M).log2().ceil().clamp(1.0, 12.0) as u8;
        let mut moving = Self {
            culling,
            occupants: Occupants::new(octree.origin, octree.edge, depth),
            things: Vec::new(),
            avatars: BTreeMap::new(),
            letters_max: 0,
            tracked: BTreeSet::new(),
            expiries: BTreeSet::new(),
            now: Duration::ZERO,
            pyramid: Pyramid::default(),
            counters: MovingCounters::default(),
        };
        let cast = MovingSet::new(world, &NoAvatars, Duration::ZERO);
        for at in 0..world.movers.len() {
            let what = MovingId::Mover(at as u32);
            if moving.add(what, 0, &cast).is_none() {
                break;
            }
        }
        moving
    }

    /// Draws what is in view at a time of the server's clock into a frame that shows the building from the
    /// same camera: the movers of the world, which is the one that this was made for, and the avatars
    /// that a client is told of, if there are others. Tells which of these can be seen: at
    /// least one pixel shows them.
    pub fn draw(
        &mut self,
        frame: &mut Frame,
        camera: &Camera,
        world: &World,
        told: Option<&mut dyn AvatarSource>,
        now: Duration,
    ) -> Vec<VisibleAvatar> {
        self.counters = MovingCounters::default();
        let nobody: &mut dyn AvatarSource = &mut NoAvatars;
        let told = told.unwrap_or(nobody);
        let news = told.updates();
        let cast = MovingSet::new(world, told, now);
        self.hear(&news, &cast);
        if frame.width() == 0 || frame.height() == 0 {
            return Vec::new();
        }
        let seen: BTreeSet<u32> = if self.culling == Culling::Plain {
            self.counters.placed = self.tracked.len();
            self.tracked.clone()
        } else {
            self.wake(now);
            for number in self.tracked.clone() {
                self.place(number, &cast);
            }
            self.find(frame, camera, &cast)
        };
        self.show(frame, camera, &seen, &cast)
    }

    /// What the last picture took.
    pub fn counters(&self) -> MovingCounters {
        self.counters
    }

    /// Takes in what was told of avatars since the last picture.
    fn hear(&mut self, news: &[(AvatarId, Update)], cast: &MovingSet<'_>) {
        for &(avatar, news) in news {
            if news == Update::Appeared {
                self.appear(avatar, cast);
            }
            let Some(&number) = self.avatars.get(&avatar) else { continue };
            let thing = self.things[number as usize].as_ref();
            let Some(until) = thing.and_then(|thing| thing.until) else { continue };
            let path = cast.path(avatar, until);
            let holds = path.is_some_and(|path| {
                self.occupants.primitives(OccupantId(number)).any(|it| it.contains_box(&path))
            });
            if !holds {
                self.counters.refuted += 1;
                self.track(number);
            }
        }
    }

    /// Takes in somebody, or another name.
    fn appear(&mut self, avatar: AvatarId, cast: &MovingSet<'_>) {
        let letters = cast.letters(avatar);
        self.letters_max = self.letters_max.max(letters);
        if let Some(&number) = self.avatars.get(&avatar) {
            if let Some(thing) = &mut self.things[number as usize] {
                thing.letters = letters;
            }
        } else if let Some(number) = self.add(MovingId::Avatar(avatar), letters, cast) {
            self.avatars.insert(avatar, number);
        }
    }

    /// Takes something in, and tells its number.
    fn add(&mut self, what: MovingId, letters: usize, cast: &MovingSet<'_>) -> Option<u32> {
        // What has no sane box gets a number all the same, and is met by nobody.
        let nowhere = Aabb::around(cast.world.octree.origin, 0.0);
        let inserted = self.occupants.insert(&[cast.bounds(what).unwrap_or(nowhere)]);
        let OccupantId(number) = inserted.or_else(|_| self.occupants.insert(&[nowhere])).ok()?;
        let thing = MovingObject { what, letters, validity: VALIDITY_FIRST, until: None };
        if self.things.len() <= number as usize {
            self.things.resize(number as usize + 1, None);
        }
        self.things[number as usize] = Some(thing);
        self.tracked.insert(number);
        Some(number)
    }

    /// Forgets who has vanished.
    fn forget(&mut self, number: u32) {
        self.track(number);
        self.tracked.remove(&number);
        self.occupants.remove(OccupantId(number));
        if let Some(MovingObject { what: MovingId::Avatar(avatar), .. }) =
            self.things[number as usize].take()
        {
            self.avatars.remove(&avatar);
        }
    }

    /// Puts an end to the volume that stands for something.
    fn track(&mut self, number: u32) {
        let until = self.things[number as usize].as_mut().and_then(|thing| thing.until.take());
        if let Some(until) = until {
            self.expiries.remove(&(until, number));
        }
        self.tracked.insert(number);
    }

    /// Tracks those again whose volumes have expired; all when time went backwards.
    fn wake(&mut self, now: Duration) {
        let is_back = now < std::mem::replace(&mut self.now, now);
        while let Some(&(until, number)) = self.expiries.first()
            && (is_back || until < now)
        {
            self.counters.expired += 1;
            if let Some(thing) = &mut self.things[number as usize] {
                thing.validity = (thing.validity * 3 / 2).min(VALIDITY_MAX);
            }
            self.track(number);
        }
    }

    /// Puts something where it is now; tells its box, unless it has vanished.
    fn place(&mut self, number: u32, cast: &MovingSet<'_>) -> Option<Aabb> {
        self.counters.placed += 1;
        let what = self.things[number as usize].as_ref().map(|thing| thing.what)?;
        let bounds = cast.bounds(what);
        match bounds {
            // What has no sane box stays where it was.
            Some(bounds) => drop(self.occupants.move_to(OccupantId(number), &[bounds])),
            None => self.forget(number),
        }
        bounds
    }

    /// Finds what to draw; and gives what is not seen a volume to be replaced by.
    fn find(&mut self, frame: &Frame, camera: &Camera, cast: &MovingSet<'_>) -> BTreeSet<u32> {
        let mut pyramid = std::mem::take(&mut self.pyramid);
        let mut sight = OcclusionTest::new(camera, frame, &mut pyramid);
        let mut met = Vec::new();
        self.occupants.front_to_back(camera.eye, |what| match what {
            Visit::Node(bounds) => sight.shows(&bounds, self.letters_max),
            Visit::Occupant(id) => {
                met.push(id);
                true
            }
        });
        let mut seen = BTreeSet::new();
        for id in met {
            let Some(thing) = &self.things[id.0 as usize] else { continue };
            let (letters, is_tracked) = (thing.letters, thing.until.is_none());
            let shows = self.occupants.primitives(id).any(|bounds| sight.shows(bounds, letters));
            if shows && (is_tracked || self.reveal(&mut sight, id.0, cast)) {
                seen.insert(id.0);
            }
        }
        if self.culling == Culling::Temporal {
            let unseen: Vec<u32> = self.tracked.difference(&seen).copied().collect();
            for number in unseen {
                self.hide(&mut sight, number, cast);
            }
        }
        self.counters.tested = sight.tested;
        self.pyramid = pyramid;
        seen
    }

    /// Looks at something whose volume has come into view: whether it is in view itself. Otherwise it
    /// gets a shorter one.
    fn reveal(&mut self, sight: &mut OcclusionTest<'_>, number: u32, cast: &MovingSet<'_>) -> bool {
        self.counters.revealed += 1;
        let Some(thing) = &mut self.things[number as usize] else { return false };
        thing.validity = (thing.validity / 2).max(VALIDITY_MIN);
        let letters = thing.letters;
        self.track(number);
        self.place(number, cast).is_some_and(|bounds| sight.shows(&bounds, letters))
    }

    /// Lets a volume that is not in view stand for something, if there is one that is worth it.
    fn hide(&mut self, sight: &mut OcclusionTest<'_>, number: u32, cast: &MovingSet<'_>) {
        let Some(thing) = &mut self.things[number as usize] else { return };
        let mut validity = thing.validity;
        while validity >= VALIDITY_MIN {
            let until = cast.now.saturating_add(validity);
            let Some(volume) = cast.volume(thing.what, until) else { return };
            if !sight.shows(&volume, thing.letters)
                && self.occupants.move_to(OccupantId(number), &[volume]).is_ok()
            {
                self.counters.placed += 1;
                (thing.validity, thing.until) = (validity, Some(until));
                self.tracked.remove(&number);
                self.expiries.insert((until, number));
                return;
            }
            validity /= 2;
        }
        thing.validity = VALIDITY_MIN;
    }

    /// Draws some of what moves.
    fn show(
        &mut self,
        frame: &mut Frame,
        camera: &Camera,
        seen: &BTreeSet<u32>,
        cast: &MovingSet<'_>,
    ) -> Vec<VisibleAvatar> {
        let (mut doors, mut others): (Vec<&Mover>, Vec<AvatarId>) = Default::default();
        for thing in seen.iter().filter_map(|number| self.things[*number as usize].as_ref()) {
            match thing.what {
                MovingId::Mover(at) => doors.extend(cast.world.movers.get(at as usize)),
                MovingId::Avatar(avatar) => others.push(avatar),
            }
        }
        movers::draw_those(frame, camera, &doors, cast.now);
        others.sort_unstable();
        let mut shown: Vec<VisibleAvatar> = Vec::with_capacity(others.len());
        for avatar in others {
            match (cast.told.shown(avatar, cast.now), self.avatars.get(&avatar)) {
                (Some(avatar), _) => shown.push(avatar),
                (None, Some(&number)) => self.forget(number),
                (None, None) => {}
            }
        }
        self.counters.drawn = doors.len() + shown.len();
        let body = cast.world.body;
        let figure = |avatar| {
            let VisibleAvatar { name, colour, pose, .. }: &'_ VisibleAvatar = avatar;
            AvatarFigure { pose: *pose, body, colour: *colour, name }
        };
        let figures: Vec<AvatarFigure> = shown.iter().map(figure).collect();
        let mut is_seen = avatars::draw(frame, camera, &figures).into_iter();
        shown.retain(|_| is_seen.next() == Some(true));
        shown
    }
}
