//! Small bright surfaces in groups. From afar a group gives light like the strongest of its members.
//!
//! A building may have thousands of small lamps, and all points ask for the light of each. So they
//! are in a tree, and each point takes the coarsest groups that are good enough for it (Walter et
//! al. 2005, "Lightcuts", sections 3 and 4). Members of a group face about the same way.

use std::{cmp::Ordering, collections::BinaryHeap};

use glam::Vec3;
use sightline_world::geometry::Aabb;

use super::emitters::AreaEmitter;

/// A group is split where it may give more than this share of all light. Then nobody sees where
/// neighbouring points take other groups.
const SPLIT_SHARE: f32 = 0.02;
/// The square of the distance of a group that may touch the point, in square metres.
const TOUCHES_M2: f32 = 1.0e-6;

/// All small surfaces that give light.
#[derive(Default)]
pub(super) struct EmitterGroups {
    groups: Vec<Group>,
    /// A group for each of the six ways that members may face, where there are any.
    roots: Vec<usize>,
    members: Vec<AreaEmitter>,
}

struct Group {
    bounds: Aabb,
    /// The largest component of all the light that the members give to one direction.
    power: f32,
    /// The strongest member, with the light of all.
    stands_for: AreaEmitter,
    /// None for a single member.
    halves: Option<[usize; 2]>,
}

/// A group, and the most light that it can give to a point.
struct Candidate {
    at_most: f32,
    group: usize,
}

impl EmitterGroups {
    pub(super) fn new(members: Vec<AreaEmitter>) -> Self {
        let mut found = Self { members, ..Self::default() };
        let mut by_side: [Vec<usize>; 6] = Default::default();
        for (number, member) in found.members.iter().enumerate() {
            let axis = member.normal.abs().max_position();
            by_side[2 * axis + usize::from(member.normal[axis] < 0.0)].push(number);
        }
        for mut side in by_side {
            if !side.is_empty() {
                let root = found.add(&mut side);
                found.roots.push(root);
            }
        }
        found
    }

    /// All surfaces, each for itself.
    pub(super) fn members(&self) -> &[AreaEmitter] {
        &self.members
    }

    /// Surfaces, at most `groups_max`, that together give a point about the light of all members,
    /// and how much each can give at most.
    pub(super) fn seen_from(&self, point: Vec3, groups_max: usize) -> Vec<(&AreaEmitter, f32)> {
        let candidate = |group: usize| Candidate { at_most: self.at_most(group, point), group };
        let mut open: BinaryHeap<Candidate> = self.roots.iter().copied().map(candidate).collect();
        let mut all: f32 = open.iter().map(|group| group.at_most).sum();
        let mut taken = Vec::new();
        while let Some(Candidate { at_most, group }) = open.pop() {
            let Group { stands_for, halves, .. } = &self.groups[group];
            let is_split = at_most > SPLIT_SHARE * all && open.len() + taken.len() + 1 < groups_max;
            match halves.filter(|_| is_split) {
                Some(halves) => {
                    let halves = halves.map(candidate);
                    all += halves.iter().map(|half| half.at_most).sum::<f32>() - at_most;
                    open.extend(halves);
                }
                None => taken.push((stands_for, stands_for.at_most(point))),
            }
        }
        taken.retain(|(_, at_most)| *at_most > 0.0);
        taken
    }

    fn at_most(&self, group: usize, point: Vec3) -> f32 {
        let Group { bounds, power, stands_for, halves } = &self.groups[group];
        match halves {
            None => stands_for.at_most(point),
            Some(_) => {
                let nearest = point.clamp(bounds.min, bounds.max);
                power / point.distance_squared(nearest).max(TOUCHES_M2)
            }
        }
    }

    /// Adds a group of some members, and all groups in it. Returns its number.
    fn add(&mut self, members: &mut [usize]) -> usize {
        let light = |member: &AreaEmitter| member.radiance * member.area;
        let of = |number: &usize| &self.members[*number];
        let all: Vec3 = members.iter().map(|number| light(of(number))).sum();
        let by_light = |a: &&usize, b: &&usize| {
            let [a, b] = [a, b].map(|number| light(of(number)).max_element());
            a.total_cmp(&b)
        };
        let strongest = *of(members.iter().max_by(by_light).expect("a group has members"));
        let bounds = Aabb::from_points(members.iter().flat_map(|number| of(number).corners));
        let radiance = all / strongest.area.max(f32::MIN_POSITIVE);
        let stands_for = AreaEmitter { radiance, ..strongest };
        let halves = (members.len() > 1).then(|| {
            let axis = bounds.size().max_position();
            let middle = members.len() / 2;
            let members_of = &self.members;
            let place = |number: &usize| members_of[*number].middle()[axis];
            members.select_nth_unstable_by(middle, |a, b| place(a).total_cmp(&place(b)));
            let (one, other) = members.split_at_mut(middle);
            [self.add(one), self.add(other)]
        });
        self.groups.push(Group { bounds, power: all.max_element(), stands_for, halves });
        self.groups.len() - 1
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.at_most.total_cmp(&other.at_most).then(other.group.cmp(&self.group))
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::SmallRng};

    use super::*;

    fn emitters(count: usize, random: &mut SmallRng) -> Vec<AreaEmitter> {
        let mut triangle = || {
            let mut vector = |size: f32| {
                Vec3::from_array(std::array::from_fn(|_| random.random_range(-size..size)))
            };
            let (at, [u, v]) = (vector(20.0), [vector(0.3), vector(0.3)]);
            let radiance = vector(1.0).abs() * 10.0;
            let normal = u.cross(v).normalize();
            let area = u.cross(v).length() / 2.0;
            AreaEmitter { corners: [at, at + u, at + v], normal, radiance, area }
        };
        (0..count).map(|_| triangle()).collect()
    }

    #[test]
    fn groups_give_about_the_light_of_their_members() {
        let random = &mut SmallRng::seed_from_u64(1);
        for count in [0, 1, 3, 40, 3_000] {
            let groups = EmitterGroups::new(emitters(count, random));
            let (mut off, mut whole, mut most) = (0.0, 0.0, 0);
            for _ in 0..100 {
                let point =
                    Vec3::from_array(std::array::from_fn(|_| random.random::<f32>() * 10.0));
                let normal =
                    (Vec3::splat(0.5) - Vec3::from(random.random::<[f32; 3]>())).normalize();
                let facing = groups.members().iter().filter(|one| one.at_most(point) > 0.0);
                let known: Vec3 = facing.map(|one| one.unhidden(point, normal)).sum();
                let seen = groups.seen_from(point, 128);
                let found: Vec3 = seen.iter().map(|(one, _)| one.unhidden(point, normal)).sum();
                off += (found - known).abs().element_sum();
                whole += known.element_sum();
                most = most.max(seen.len());
            }
            assert!(off <= 0.1 * whole, "{count}: {off} of {whole}");
            assert!(most <= count.min(128), "{most} of {count}");
        }
    }
}
