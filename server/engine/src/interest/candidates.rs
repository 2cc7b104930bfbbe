//! Which avatars concern which viewers: kept up to date by what moved, never gone through as a whole.
//!
//! Two live avatars have a pair each, the one as the viewer of the other, while their wide regions may
//! see each other: by their cells, which an index has, and by the gates between them. Most people in a
//! building have none with each other, and nothing is done about them until one has gone some way.
//! What pairs leave open is [looked at](crate::interest::sight_tests) more closely.

use sightline_world::motion::AvatarId;

use crate::{
    Engine, Output,
    interest::sight_tests::{Regions, SightResult},
    interest::snapshot::{LiveAvatars, Snapshot},
    population::Slot,
    regions::footprints::Member,
    worker_pool::Workspace,
};

/// A viewer's dealings with an avatar. Ordered by id.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) id: AvatarId,
    pub(crate) slot: Slot,
    /// By their wide regions, the avatar may be visible to the viewer.
    pub(crate) concerns: bool,
    /// The viewer's client has been told of it.
    pub(crate) is_held: bool,
    /// Until that tick its client is not told that it is out of sight.
    pub(crate) held_until: u32,
    /// The [`Avatar::version`](crate::population::Avatar::version) that was sent last.
    pub(crate) version: u32,
    pub(crate) look: SightResult,
    /// Cells of these regions see each other.
    pub(crate) seen: Option<Regions>,
    /// Between these regions, gates and cells left it open.
    pub(crate) open: Option<Regions>,
    /// Before that tick gates and cells are not asked again.
    pub(crate) gates_from: u32,
    /// Before that tick it is not tried whether regions with more to spare are hidden from each other.
    pub(crate) spare_from: u32,
}

impl Pair {
    pub(crate) fn new((id, slot): Member) -> Self {
        let (concerns, is_held, look) = (true, false, SightResult::Unknown);
        Self {
            id,
            slot,
            concerns,
            is_held,
            held_until: 0,
            version: 0,
            look,
            seen: None,
            open: None,
            gates_from: 0,
            spare_from: 0,
        }
    }
}

/// Somebody with a new wide region, and whom it may see or be seen by: of others who have one too, only
/// those that come after it.
struct Mover {
    place: usize,
    met: Vec<Member>,
}

impl Engine {
    /// Makes and ends pairs after wide regions have changed.
    pub(crate) fn pair(&self, scene: &mut Snapshot) {
        let Snapshot { lives, pairs } = scene;
        let moved = lives.all().iter().enumerate().filter(|(_, live)| live.moved.is_some());
        let mut movers: Vec<Mover> =
            moved.map(|(place, _)| Mover { place, met: Vec::new() }).collect();
        self.crew.each(&mut movers, |work, _, mover| {
            mover.met = self.met_by(work, (lives, pairs), mover.place);
        });
        let mut found: Vec<Vec<Member>> = vec![Vec::new(); movers.len()];
        for (at, mover) in movers.iter().enumerate() {
            let live = &lives.all()[mover.place];
            for (_, slot) in &mover.met {
                let other = lives.place(*slot);
                if lives.all()[other].moved.is_some()
                    && let Ok(later) = movers.binary_search_by_key(&other, |mover| mover.place)
                {
                    found[later].push((live.id, live.slot));
                }
            }
            found[at].extend(&mover.met);
        }
        for (mover, mut found) in movers.iter().zip(found) {
            found.sort_unstable();
            renew(lives, pairs, mover.place, found);
        }
    }

    /// Finds all whom one with a new wide region has to do with, but for those before it who have one too.
    fn met_by(
        &self,
        work: &mut Workspace,
        (lives, pairs): (&LiveAvatars, &[Vec<Pair>]),
        place: usize,
    ) -> Vec<Member> {
        let mut found: Vec<Member> = Vec::new();
        let Some(wide) = &lives.all()[place].near.wide else { return found };
        wide.look_around(&self.world.cells, &mut work.seen);
        work.met.clear();
        work.met.insert(place as u32);
        // The body is seen by the eyes of the one, or the eyes see it.
        let Workspace { seen, met, .. } = &mut *work;
        let [eyes, bodies] = &self.near;
        for member in bodies.among(&seen[0]).chain(eyes.among(&seen[1])) {
            let other = lives.place(member.1);
            if !met.contains(other as u32) {
                met.insert(other as u32);
                let is_done = other < place && lives.all()[other].moved.is_some();
                found.extend((!is_done).then_some(*member));
            }
        }
        let own = &pairs[place];
        found.retain(|(id, slot)| {
            // What is open between their narrower regions is open between these.
            let known = own.binary_search_by_key(id, |pair| pair.id).map(|at| &own[at]);
            if known.is_ok_and(|pair| pair.concerns && pair.look.is_open()) {
                return true;
            }
            let other = lives.at(*slot).near.wide.as_ref();
            other.is_some_and(|other| self.may_meet(work, wide, other))
        });
        found
    }

    /// Forgets what was found of all pairs of an avatar.
    pub(crate) fn unlook(&mut self, slot: Slot) {
        let id = self.population.at(slot).id;
        let others: Vec<Slot> = self.pairs_of(slot).map(|pair| pair.slot).collect();
        for viewer in others.into_iter().chain([slot]) {
            let pairs = self.population.at_mut(viewer).pairs.iter_mut();
            pairs.filter(|pair| viewer == slot || pair.id == id).for_each(|pair| {
                *pair = Pair { look: SightResult::Unknown, gates_from: 0, ..*pair }
            });
        }
    }

    fn pairs_of(&self, slot: Slot) -> impl Iterator<Item = &Pair> {
        self.population.at(slot).pairs.iter()
    }

    /// Ends all pairs with an avatar that is gone or hidden, whose regions have just been taken
    /// out; those who held it are told at the next tick.
    pub(crate) fn part(&mut self, slot: Slot) {
        self.forget_near(slot);
        let id = self.population.at(slot).id;
        let viewers: Vec<Slot> = if self.config.policy.uses_cells() {
            self.pairs_of(slot).map(|pair| pair.slot).collect()
        } else {
            self.population.live().collect()
        };
        for viewer in viewers {
            let to = self.population.at(viewer).id;
            let pairs = &mut self.population.at_mut(viewer).pairs;
            if let Ok(place) = pairs.binary_search_by_key(&id, |pair| pair.id)
                && pairs.remove(place).is_held
            {
                self.population.at_mut(slot).watchers -= 1;
                self.pending.push(Output::Vanish { to, avatar: id });
            }
        }
    }
}

/// Has one with a new wide region have pairs with just these avatars, and them with it. Others with new
/// regions see to their own.
fn renew(lives: &LiveAvatars, pairs: &mut [Vec<Pair>], place: usize, found: Vec<Member>) {
    let live = &lives.all()[place];
    let old = std::mem::take(&mut pairs[place]);
    let known = |id: AvatarId| {
        let at = old.binary_search_by_key(&id, |pair| pair.id);
        at.is_ok_and(|at| old[at].concerns)
    };
    let keeps_own = |other: usize| lives.all()[other].moved.is_some();
    for &(id, slot) in &found {
        let other = lives.place(slot);
        if !keeps_own(other) && !known(id) {
            concern(&mut pairs[other], (live.id, live.slot));
        }
    }
    for pair in old.iter().filter(|pair| pair.concerns) {
        let other = lives.place(pair.slot);
        if !keeps_own(other) && found.binary_search(&(pair.id, pair.slot)).is_err() {
            part_from(&mut pairs[other], live.id);
        }
    }
    pairs[place] = matched(&old, found);
}

/// Makes a pair, unless there is one.
fn concern(pairs: &mut Vec<Pair>, member: Member) {
    match pairs.binary_search_by_key(&member.0, |pair| pair.id) {
        Ok(place) => pairs[place].concerns = true,
        Err(place) => pairs.insert(place, Pair::new(member)),
    }
}

/// Ends a pair; what the client still holds stays until that is told.
fn part_from(pairs: &mut Vec<Pair>, id: AvatarId) {
    if let Ok(place) = pairs.binary_search_by_key(&id, |pair| pair.id) {
        pairs[place].concerns = false;
        if !pairs[place].is_held {
            pairs.remove(place);
        }
    }
}

/// The pairs of a viewer that has to do with just these avatars; both are by id. Those that its
/// client still holds stay until that is told.
pub(crate) fn matched(pairs: &[Pair], found: Vec<Member>) -> Vec<Pair> {
    let mut matched = Vec::with_capacity(found.len());
    let mut found = found.into_iter().peekable();
    for old in pairs {
        while let Some(new) = found.next_if(|(id, _)| *id < old.id) {
            matched.push(Pair::new(new));
        }
        let concerns = found.next_if(|(id, _)| *id == old.id).is_some();
        if concerns || old.is_held {
            matched.push(Pair { concerns, ..*old });
        }
    }
    matched.extend(found.map(Pair::new));
    matched
}
