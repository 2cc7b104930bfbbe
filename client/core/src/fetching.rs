//! Which pieces of a world to fetch next, while it is drawn already.
//!
//! What surrounds the body comes first: it can move only where all voxels are there. Then comes the
//! next grade of each branch that the picture shows, coarse grades before fine ones and near
//! branches before far ones. Nothing else is fetched before a picture was sharp. Then come the
//! voxels around where the body is going; a coarse grade of what is near and may be seen from where
//! the eye is, for when it turns, and from where it is going; and the rest, if it is wanted. Of what
//! is far away, grades with voxels smaller than a pixel wait with the rest.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use glam::Vec3;
use sightline_world::{
    PieceId, World, WorldHead,
    geometry::Aabb,
    octree::{Octree, pieces::PartialOctree},
    plan::Plan,
};

/// Voxels are fetched around where the body will be after these times on its way, in seconds.
const BODY_AHEAD_S: [f32; 3] = [0.5, 1.0, 2.0];
/// A coarse grade is fetched of what may be seen from where the eye will be after these times on its
/// way, in seconds.
const EYE_AHEAD_S: [f32; 3] = [0.0, 2.0, 4.0];
/// The number of grades that are fetched of what may be seen and is not shown yet. They are a small
/// part of all bytes, and a picture that shows it for a moment only needs no more.
const UNSHOWN_GRADES: u8 = 1;
/// They are fetched within this many edges of a branch from the eye. What is farther away looks
/// little different without them.
const UNSHOWN_EDGES: f32 = 4.0;
/// How urgent what a picture shows is, by the ranks of [`Wish`].
const SHOWN: u8 = 1;

/// A piece that was refused is asked for again after this number of calls of
/// [`PieceFetcher::next`]: a second or two, in which the body is elsewhere.
const REFUSED_CALLS: u64 = 60;

/// What the voxels of a world that arrives may take, in bytes, unless another limit is set: 512 MiB.
const MEMORY_BYTES: usize = 1 << 29;

/// The share of the distance that counts: what is drawn at an edge of the picture is less deep.
const DEPTH_SHARE: f32 = 0.9;

/// Why a piece cannot be taken in.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PieceError {
    /// There is no piece of this number.
    #[error("the server sent a piece that the world does not have")]
    Unknown,
    /// Its bytes do not match its content id.
    #[error("a piece of the world is damaged: it does not match its content id")]
    Damaged,
    /// Its bytes are not the grade of a branch, although they match the content id.
    #[error("a piece of the world is malformed: {0}")]
    Malformed(String),
}

/// A branch that a picture shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShownBranch {
    /// The branch.
    pub branch: u32,
    /// The least depth at which the picture shows it, in metres.
    pub depth: f32,
}

/// What pieces are needed for.
#[derive(Clone, Copy, Debug)]
pub struct Outlook<'a> {
    /// Where the eye is, in metres.
    pub eye: Vec3,
    /// Where it is going, in metres a second.
    pub velocity: Vec3,
    /// The focal length in pixels: how many pixels a metre spans at a distance of one metre.
    pub focal: f32,
    /// What the last picture shows.
    pub shown: &'a [ShownBranch],
    /// Whether the plan of the storey is wanted.
    pub plan: bool,
    /// Whether all pieces of the octree are wanted in the end.
    pub all: bool,
}

/// Says which pieces to fetch next, and takes them in.
#[derive(Clone, Debug)]
pub struct PieceFetcher {
    head: WorldHead,
    /// The pieces that were asked for and are not here yet.
    asked: BTreeSet<usize>,
    /// Pieces that came before a coarser one of the same branch.
    early: BTreeMap<usize, Vec<u8>>,
    /// Whether some picture was sharp. Until then nothing is fetched that it does not need.
    was_sharp: bool,
    /// The plans that are here, by the numbers of their pieces.
    plans: BTreeMap<usize, Arc<Plan>>,
    /// The pieces that were refused, and the call from which on they may be asked for again.
    refused: BTreeMap<usize, u64>,
    /// The number of calls of [`PieceFetcher::next`].
    calls: u64,
    /// What the voxels may take, in bytes.
    memory: usize,
}

impl PieceFetcher {
    /// A fetcher that has the head of a world.
    pub fn new(head: WorldHead) -> Self {
        Self {
            head,
            asked: BTreeSet::new(),
            early: BTreeMap::new(),
            was_sharp: false,
            plans: BTreeMap::new(),
            refused: BTreeMap::new(),
            calls: 0,
            memory: MEMORY_BYTES,
        }
    }

    /// Sets what the voxels may take, in bytes. Beyond it, branches are let go that a picture needs
    /// least. What the last picture and the surroundings of the body need stays.
    pub fn set_memory(&mut self, bytes: usize) {
        self.memory = bytes;
    }

    /// The world without voxels and without mesh.
    pub fn world(&self) -> &Arc<World> {
        &self.head.world
    }

    /// The octree as far as it is here.
    pub fn octree(&self) -> &PartialOctree {
        &self.head.octree
    }

    /// Takes the octree out. There is an empty one in its place.
    pub(crate) fn take_octree(&mut self) -> Octree {
        self.head.octree.take_octree()
    }

    /// The plan of the storey of a body with its soles at this height, in metres, if it is here.
    pub fn plan_at(&self, soles: f32) -> Option<&Arc<Plan>> {
        self.plans.get(&self.head.plan_at(soles)?)
    }

    /// The share of the octree's bytes that is here, from 0 to 1.
    pub fn share(&self) -> f32 {
        let grades = usize::from(self.head.octree.grades()).max(1);
        let (mut here, mut all) = (0, 0);
        for number in 0..self.head.first_plan() {
            let bytes = self.length(number) as u64;
            all += bytes;
            let is_here = number % grades < self.head.octree.grades_of(number / grades).into();
            here += if is_here || self.early.contains_key(&number) { bytes } else { 0 };
        }
        here as f32 / all.max(1) as f32
    }

    /// The content id and the length in bytes of a piece, if there is one of this number.
    pub fn piece(&self, number: usize) -> Option<(PieceId, u32)> {
        self.head.piece(number)
    }

    /// The pieces to ask for now, the most urgent first. All that were asked for and are not here
    /// take at most `bytes_max` bytes, or are one.
    pub fn next(&mut self, outlook: &Outlook<'_>, bytes_max: usize) -> Vec<usize> {
        let mut under_way: usize = self.asked.iter().map(|&number| self.length(number)).sum();
        let mut next = Vec::new();
        self.calls += 1;
        self.refused.retain(|_, until| *until > self.calls);
        self.let_go(outlook);
        self.was_sharp |= self.is_sharp(outlook);
        if under_way >= bytes_max {
            return next;
        }
        let plan = self.missing_plan(outlook).filter(|_| self.was_sharp);
        for number in plan.into_iter().chain(self.wanted(outlook)) {
            if under_way > 0 && under_way + self.length(number) > bytes_max {
                break;
            }
            under_way += self.length(number);
            self.asked.insert(number);
            next.push(number);
        }
        next
    }

    /// Takes in a piece, whether it was asked for or not.
    ///
    /// # Errors
    /// When the bytes are not the piece of this number. It may be asked for again.
    pub fn take(&mut self, number: usize, piece: Vec<u8>) -> Result<(), PieceError> {
        let (id, _) = self.head.piece(number).ok_or(PieceError::Unknown)?;
        self.asked.remove(&number);
        if PieceId::of(&piece) != id {
            return Err(PieceError::Damaged);
        }
        if number >= self.head.first_plan() {
            let plan = Plan::from_bytes(&piece);
            let plan = plan.map_err(|error| PieceError::Malformed(error.to_string()))?;
            self.plans.insert(number, Arc::new(plan));
            return Ok(());
        }
        let grades = usize::from(self.head.octree.grades()).max(1);
        let branch = number / grades;
        self.early.insert(number, piece);
        loop {
            let next = branch * grades + usize::from(self.head.octree.grades_of(branch));
            let is_own = next / grades == branch;
            let Some(piece) = self.early.remove(&next).filter(|_| is_own) else { return Ok(()) };
            let grown = self.head.octree.grow(branch, &piece);
            grown.map_err(|error| PieceError::Malformed(error.to_string()))?;
        }
    }

    /// Takes in that pieces do not come that were asked for. They are asked for again.
    pub fn forget(&mut self, numbers: &[usize]) {
        for number in numbers {
            self.asked.remove(number);
        }
    }

    /// Takes in that the server does not hand out pieces now that were asked for: by what it knows,
    /// they cannot be seen. They are asked for again later.
    pub fn refuse(&mut self, numbers: &[usize]) {
        self.forget(numbers);
        let until = self.calls + REFUSED_CALLS;
        self.refused.extend(numbers.iter().map(|number| (*number, until)));
    }

    /// Whether all voxels are there around a body whose eye is here, so that it can move, and the
    /// eye sees more than what stands in for them.
    pub fn is_open_at(&self, eye: Vec3) -> bool {
        self.head.octree.is_complete_in(&self.around(eye))
    }

    /// The pieces, whether here or not, that the last picture and the space of the body need.
    pub fn needed(&self, outlook: &Outlook<'_>) -> Vec<usize> {
        let all = usize::from(self.head.octree.grades());
        let pieces = |(branch, grades)| (0..usize::from(grades)).map(move |g| branch * all + g);
        self.needs(outlook).flat_map(|(_, need)| pieces(need)).collect()
    }

    /// Whether a picture shows nothing that is coarser than its pixels.
    pub fn is_sharp(&self, outlook: &Outlook<'_>) -> bool {
        self.is_open_at(outlook.eye)
            && self
                .needs(outlook)
                .all(|(_, (branch, grades))| self.head.octree.grades_of(branch) >= grades)
    }

    /// The branches around the body and in the picture, with how many grades of each are needed,
    /// and how urgent that is.
    fn needs<'a>(
        &'a self,
        outlook: &'a Outlook<'_>,
    ) -> impl Iterator<Item = (u8, (usize, u8))> + 'a {
        let octree = &self.head.octree;
        let near = octree.branches_in(self.around(outlook.eye));
        let near = near.map(|branch| (0, (branch, octree.grades())));
        let shown = outlook.shown.iter().map(|shown| {
            let grades = self.grades_at(shown.depth * DEPTH_SHARE, outlook.focal);
            (SHOWN, (shown.branch as usize, grades))
        });
        near.chain(shown)
    }

    /// Lets branches go while all take more memory than they may, until they take three quarters of
    /// it: first those that cannot be seen from where the eye is, far ones before near ones.
    fn let_go(&mut self, outlook: &Outlook<'_>) {
        let octree = &self.head.octree;
        if octree.bytes() <= self.memory {
            return;
        }
        let needed: BTreeSet<usize> = self.needs(outlook).map(|(_, (branch, _))| branch).collect();
        let seen = self.head.seen_from(outlook.eye);
        let is_seen = |branch: usize| seen.is_none_or(|seen| seen.contains(branch as u32));
        let mut others: Vec<(bool, f32, usize)> = (0..octree.branches())
            .filter(|branch| octree.bytes_of(*branch) > 0 && !needed.contains(branch))
            .map(|branch| (is_seen(branch), self.distance(branch, outlook.eye), branch))
            .collect();
        others.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
        let excess = octree.bytes().saturating_sub(self.spare_memory());
        let mut gone = BTreeSet::new();
        let mut freed = 0;
        for (.., branch) in others {
            if freed >= excess {
                break;
            }
            freed += octree.bytes_of(branch);
            gone.insert(branch);
        }
        if !gone.is_empty() {
            self.head.octree.keep(|branch| !gone.contains(&branch));
        }
    }

    /// What may be taken before nothing is fetched but what is needed, in bytes.
    fn spare_memory(&self) -> usize {
        self.memory / 4 * 3
    }

    fn length(&self, number: usize) -> usize {
        self.head.piece(number).map_or(0, |(_, bytes)| bytes as usize)
    }

    fn around(&self, eye: Vec3) -> Aabb {
        self.head.world.body.surroundings(&Aabb::new(eye, eye))
    }

    /// The number of grades that a picture needs at a depth in metres.
    fn grades_at(&self, depth: f32, focal: f32) -> u8 {
        let octree = &self.head.octree;
        let fine = |&grades: &u8| octree.edge_after(grades) * focal <= depth;
        (1..octree.grades()).find(fine).unwrap_or(octree.grades())
    }

    /// The plan that is wanted, is not here and was not asked for.
    fn missing_plan(&self, outlook: &Outlook<'_>) -> Option<usize> {
        let soles = outlook.eye.y - self.head.world.body.below_eye;
        let number = self.head.plan_at(soles).filter(|_| outlook.plan)?;
        (self.may_ask(number) && !self.plans.contains_key(&number)).then_some(number)
    }

    /// The pieces of the octree that are not here and were not asked for, the most urgent first.
    fn wanted(&self, outlook: &Outlook<'_>) -> Vec<usize> {
        let octree = &self.head.octree;
        let mut urgent = Urgency::new(octree.branches());
        for (rank, (branch, grades)) in self.needs(outlook) {
            urgent.note(branch, rank, grades);
        }
        // Where memory is short, what is fetched beyond that would push out what is needed.
        if !self.was_sharp || octree.bytes() > self.spare_memory() {
            return self.in_order(&urgent, outlook.eye);
        }
        let is_moving = outlook.velocity.length_squared() > 0.0;
        let ahead = |seconds: f32| outlook.eye + outlook.velocity * seconds;
        let ways = BODY_AHEAD_S.into_iter().filter(|_| is_moving);
        let seen = self.head.seen_from(outlook.eye);
        for (rank, seconds) in (SHOWN + 1..).zip(ways) {
            // What may not be seen from here lies beyond a wall.
            let near = octree
                .branches_in(self.around(ahead(seconds)))
                .filter(|branch| seen.is_none_or(|seen| seen.contains(*branch as u32)));
            near.for_each(|branch| urgent.note(branch, rank, octree.grades()));
        }
        let looks = EYE_AHEAD_S.into_iter().filter(|seconds| is_moving || *seconds == 0.0);
        for (rank, seconds) in (10..).zip(looks) {
            let place = ahead(seconds);
            let mut note = |branch: usize| {
                if self.distance(branch, place) <= octree.edge_after(0) * UNSHOWN_EDGES {
                    urgent.note(branch, rank, UNSHOWN_GRADES);
                }
            };
            match self.head.seen_from(place) {
                Some(seen) => seen.iter().for_each(|branch| note(branch as usize)),
                None if seconds == 0.0 => (0..octree.branches()).for_each(note),
                None => {}
            }
        }
        if outlook.all {
            (0..octree.branches()).for_each(|branch| urgent.note(branch, u8::MAX, octree.grades()));
        }
        self.in_order(&urgent, outlook.eye)
    }

    fn in_order(&self, urgent: &Urgency, eye: Vec3) -> Vec<usize> {
        let grades = usize::from(self.head.octree.grades());
        let mut wanted = Vec::new();
        for (branch, wishes) in urgent.0.iter().enumerate() {
            let away = self.distance(branch, eye);
            let first = usize::from(self.head.octree.grades_of(branch));
            for grade in first..grades {
                let number = branch * grades + grade;
                let wish = wishes.iter().find(|wish| usize::from(wish.grades) > grade);
                let is_new = self.may_ask(number) && !self.early.contains_key(&number);
                // What stands in for a branch fills more than it does. So a picture that shows it
                // may not show it any more once the next grade is here.
                let is_due = |wish: &&Wish| is_new && (wish.rank != SHOWN || grade == first);
                if let Some(wish) = wish.filter(is_due) {
                    wanted.push((wish.rank, grade, away, number));
                }
            }
        }
        wanted.sort_by(|a, b| {
            (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)).then(a.3.cmp(&b.3))
        });
        wanted.into_iter().map(|(.., number)| number).collect()
    }

    /// Whether a piece was neither asked for nor refused shortly before.
    fn may_ask(&self, number: usize) -> bool {
        !self.asked.contains(&number) && !self.refused.contains_key(&number)
    }

    fn distance(&self, branch: usize, eye: Vec3) -> f32 {
        let bounds = self.head.octree.bounds_of(branch);
        bounds.map_or(0.0, |bounds| eye.clamp(bounds.min, bounds.max).distance(eye))
    }
}

/// For each branch, by falling urgency, how many grades are needed.
struct Urgency(Vec<Vec<Wish>>);

struct Wish {
    /// The lower, the more urgent.
    rank: u8,
    grades: u8,
}

impl Urgency {
    fn new(branches: usize) -> Self {
        Self(std::iter::repeat_with(Vec::new).take(branches).collect())
    }

    /// Notes a wish, which is not more urgent than those before.
    fn note(&mut self, branch: usize, rank: u8, grades: u8) {
        if let Some(wishes) = self.0.get_mut(branch)
            && wishes.last().is_none_or(|last| last.grades < grades)
        {
            wishes.push(Wish { rank, grades });
        }
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor;
    use sightline_world::{Viewpoints, WorldPieces};

    use super::*;

    /// A floor of four branches, all of which may be seen from everywhere.
    fn pieces() -> WorldPieces {
        let world = voxel_floor::world(&[]);
        let octree = world.octree.to_pieces();
        let seen = vec![(0..octree.branches.len() as u32).collect()];
        let plan = Plan::new(&world, 0.0);
        WorldPieces::new(&world, octree, &Viewpoints::of(&world.cells), &seen, &[plan])
    }

    fn fetcher(pieces: &WorldPieces) -> PieceFetcher {
        PieceFetcher::new(WorldHead::read(&pieces.head).unwrap())
    }

    fn outlook(shown: &[ShownBranch]) -> Outlook<'_> {
        let eye = Vec3::new(1.5, 1.8, 1.5);
        Outlook { eye, velocity: Vec3::ZERO, focal: 500.0, shown, plan: false, all: false }
    }

    #[test]
    fn what_is_around_the_body_comes_first_and_then_what_is_shown() {
        let pieces = pieces();
        let mut fetcher = fetcher(&pieces);
        let branch_at = |x: f32, z: f32| fetcher.octree().branch_at(Vec3::new(x, 0.1, z)).unwrap();
        let (own, far) = (branch_at(1.0, 1.0), branch_at(7.0, 7.0));
        let shown = [ShownBranch { branch: far as u32, depth: 6.0 }];
        let outlook = outlook(&shown);
        let order: Vec<_> =
            fetcher.next(&outlook, 1 << 20).iter().map(|n| (n / 3, n % 3)).collect();
        let first = [(own, 0), (own, 1), (own, 2), (far, 0)];
        assert_eq!(order, first);
        assert!(
            fetcher.next(&outlook, 1 << 20).is_empty(),
            "the next grade of what is shown waits"
        );
        for (branch, grade) in &order[..3] {
            assert!(!fetcher.is_open_at(outlook.eye));
            let number = branch * 3 + grade;
            fetcher.take(number, pieces.pieces[number].clone()).unwrap();
        }
        assert!(fetcher.is_open_at(outlook.eye) && !fetcher.is_sharp(&outlook));
        // Of the far branch the finest grade comes first.
        for grade in [2, 0, 1] {
            assert_eq!(fetcher.octree().grades_of(far), u8::from(grade == 1));
            fetcher.take(far * 3 + grade, pieces.pieces[far * 3 + grade].clone()).unwrap();
        }
        assert!(fetcher.is_sharp(&outlook) && !fetcher.octree().is_complete());
        let coarse = fetcher.next(&outlook, 1 << 20);
        assert!(coarse.len() == 2 && coarse.iter().all(|number| number % 3 == 0), "{coarse:?}");
    }

    #[test]
    fn voxels_are_fetched_where_the_body_goes_and_all_in_the_end_if_that_is_wanted() {
        let pieces = pieces();
        let mut fetcher = fetcher(&pieces);
        let branch_at = |x: f32, z: f32| fetcher.octree().branch_at(Vec3::new(x, 0.1, z)).unwrap();
        let (ahead, others) = (branch_at(7.0, 1.0), [branch_at(1.0, 7.0), branch_at(7.0, 7.0)]);
        let walks = Outlook { velocity: Vec3::X * 3.0, ..outlook(&[]) };
        let mut take_all = |outlook: &Outlook<'_>| {
            let next = fetcher.next(outlook, 1 << 20);
            for number in &next {
                fetcher.take(*number, pieces.pieces[*number].clone()).unwrap();
            }
            next
        };
        assert_eq!(take_all(&walks).len(), 3, "around the body");
        let next: Vec<_> = take_all(&walks).iter().map(|number| (number / 3, number % 3)).collect();
        let coarse = others.map(|branch| (branch, 0));
        assert_eq!(next[..3], [(ahead, 0), (ahead, 1), (ahead, 2)]);
        assert!(next.len() == 5 && coarse.iter().all(|piece| next.contains(piece)), "{next:?}");
        assert!(take_all(&walks).is_empty());
        assert_eq!(take_all(&Outlook { all: true, ..walks }).len(), 4);
    }

    #[test]
    fn a_plan_that_is_wanted_comes_once_a_picture_was_sharp() {
        let pieces = pieces();
        let mut fetcher = fetcher(&pieces);
        let wants = Outlook { plan: true, ..outlook(&[]) };
        let soles = wants.eye.y - fetcher.world().body.below_eye;
        let number = pieces.pieces.len() - 1;
        let mut rounds = 0;
        while fetcher.plan_at(soles).is_none() {
            let next = fetcher.next(&wants, 1 << 20);
            assert_eq!(next.first() == Some(&number), fetcher.is_sharp(&wants));
            for number in next {
                fetcher.take(number, pieces.pieces[number].clone()).unwrap();
            }
            rounds += 1;
        }
        assert_eq!(rounds, 2);
        let expected = Plan::from_bytes(&pieces.pieces[number]).unwrap();
        assert_eq!(fetcher.plan_at(soles).map(|plan| &**plan), Some(&expected));
        assert!(fetcher.plan_at(soles + 3.0).is_none() && !fetcher.octree().is_complete());
        assert!(!fetcher.next(&wants, 1 << 20).contains(&number), "it is here");
    }

    #[test]
    fn voxels_smaller_than_a_pixel_are_not_needed() {
        let pieces = pieces();
        let fetcher = fetcher(&pieces);
        let grades = |depth: f32| {
            let shown = [ShownBranch { branch: 3, depth }];
            fetcher.needed(&outlook(&shown)).iter().filter(|&&number| number / 3 == 3).count()
        };
        // Nodes of a quarter and of half a metre span a pixel at 125 m and at 250 m.
        assert_eq!([100.0, 150.0, 300.0].map(grades), [3, 2, 1]);
    }

    #[test]
    fn damaged_and_unknown_pieces_are_refused_and_asked_for_again() {
        let pieces = pieces();
        let mut fetcher = fetcher(&pieces);
        let first = fetcher.next(&outlook(&[]), 1)[0];
        assert!(fetcher.next(&outlook(&[]), 1).is_empty(), "one is under way");
        let mut damaged = pieces.pieces[first].clone();
        damaged[0] ^= 1;
        assert_eq!(fetcher.take(first, damaged), Err(PieceError::Damaged));
        assert_eq!(fetcher.take(999, Vec::new()), Err(PieceError::Unknown));
        assert_eq!(fetcher.next(&outlook(&[]), 1), [first]);
        fetcher.forget(&[first]);
        assert_eq!(fetcher.next(&outlook(&[]), 1), [first]);
        fetcher.refuse(&[first]);
        let mut calls = 0;
        while fetcher.next(&outlook(&[]), 1) != [first] {
            let others = fetcher.asked.clone().into_iter().collect::<Vec<_>>();
            fetcher.forget(&others);
            calls += 1;
        }
        assert_eq!(calls, REFUSED_CALLS - 1);
    }
}
