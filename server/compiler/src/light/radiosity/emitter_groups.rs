//! Small bright surfaces in groups. From afar a group gives light like one surface in its middle.
//!
//! A building may have thousands of small lamps, and all points ask for the light of each. So they
//! are in a tree, and each point takes the coarsest groups that are good enough for it (Walter et
//! al. 2005, "Lightcuts", sections 3 and 4). Members of a group face about the same way.

use std::{cmp::Ordering, collections::BinaryHeap, f32::consts::TAU};

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
    /// A surface with the light, the place and the direction of all, in the mean.
    mean: AreaEmitter,
    /// The strongest member. The mean may lie in a wall, so a point sees the group where it sees
    /// this.
    strongest: AreaEmitter,
    /// None for a single member.
    halves: Option<[usize; 2]>,
}

/// A group of surfaces, as a point takes it.
pub(super) struct Seen<'a> {
    /// What gives the light.
    pub(super) light: &'a AreaEmitter,
    /// What tells whether something is in between.
    pub(super) sign: &'a AreaEmitter,
    /// An upper bound of the light.
    pub(super) at_most: f32,
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

    /// Groups, at most `groups_max`, that together give a point about the light of all members.
    pub(super) fn seen_from(&self, point: Vec3, groups_max: usize) -> Vec<Seen<'_>> {
        let candidate = |group: usize| Candidate { at_most: self.at_most(group, point), group };
        let mut open: BinaryHeap<Candidate> = self.roots.iter().copied().map(candidate).collect();
        let mut all: f32 = open.iter().map(|group| group.at_most).sum();
        let mut taken = Vec::new();
        while let Some(Candidate { at_most, group }) = open.pop() {
            let Group { mean, strongest, halves, .. } = &self.groups[group];
            let is_split = at_most > SPLIT_SHARE * all && open.len() + taken.len() + 1 < groups_max;
            match halves.filter(|_| is_split) {
                Some(halves) => {
                    let halves = halves.map(candidate);
                    all += halves.iter().map(|half| half.at_most).sum::<f32>() - at_most;
                    open.extend(halves);
                }
                None => {
                    let at_most = mean.at_most(point);
                    taken.push(Seen { light: mean, sign: strongest, at_most });
                }
            }
        }
        taken.retain(|seen| seen.at_most > 0.0);
        taken
    }

    fn at_most(&self, group: usize, point: Vec3) -> f32 {
        let Group { bounds, power, mean, halves, .. } = &self.groups[group];
        match halves {
            None => mean.at_most(point),
            Some(_) => {
                let nearest = point.clamp(bounds.min, bounds.max);
                power / point.distance_squared(nearest).max(TOUCHES_M2)
            }
        }
    }

    /// Adds a group of some members, and all groups in it. Returns its number.
    fn add(&mut self, members: &mut [usize]) -> usize {
        let of = |number: &usize| &self.members[*number];
        let power = |number: &usize| of(number).power();
        let strongest = members.iter().max_by(|a, b| power(a).total_cmp(&power(b)));
        let strongest = *of(strongest.expect("a group has members"));
        let bounds = Aabb::from_points(members.iter().flat_map(|number| of(number).corners));
        let mean = if members.len() == 1 { strongest } else { mean(members.iter().map(of)) };
        let power = members.iter().map(power).sum();
        let halves = (members.len() > 1).then(|| {
            let axis = bounds.size().max_position();
            let middle = members.len() / 2;
            let members_of = &self.members;
            let place = |number: &usize| members_of[*number].middle()[axis];
            members.select_nth_unstable_by(middle, |a, b| place(a).total_cmp(&place(b)));
            let (one, other) = members.split_at_mut(middle);
            [self.add(one), self.add(other)]
        });
        self.groups.push(Group { bounds, power, mean, strongest, halves });
        self.groups.len() - 1
    }
}

/// A surface with the light, the place and the direction of several, in the mean.
fn mean<'a>(members: impl Iterator<Item = &'a AreaEmitter>) -> AreaEmitter {
    let (mut area, mut power, mut light) = (0.0, f32::MIN_POSITIVE, Vec3::ZERO);
    let (mut place, mut facing) = (Vec3::ZERO, Vec3::ZERO);
    for member in members {
        area += member.area;
        power += member.power();
        light += member.radiance * member.area;
        place += member.middle() * member.power();
        facing += member.normal * member.power();
    }
    let (place, facing) = (place / power, facing / power);
    let normal = facing.normalize_or(Vec3::Y);
    let (u, v) = normal.any_orthonormal_pair();
    // The corners of an equilateral triangle of that area.
    let radius = (area * 4.0 / 27.0_f32.sqrt()).sqrt();
    let corner = |turn: f32| {
        let (sine, cosine) = turn.sin_cos();
        place + (u * cosine + v * sine) * radius
    };
    let corners = [0.0, TAU / 3.0, 2.0 * TAU / 3.0].map(corner);
    // Members that face different ways give less to each.
    let radiance = light / area.max(f32::MIN_POSITIVE) * facing.length();
    AreaEmitter { corners, normal, radiance, area }
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

    /// Lamps that shine down, tilted a little, in a storey of 60 m.
    fn lamps(count: usize, random: &mut SmallRng) -> Vec<AreaEmitter> {
        let mut lamp = || {
            let [x, y, z, dx, dz] = random.random::<[f32; 5]>();
            let at = Vec3::new(x * 60.0 - 30.0, 2.5 + y, z * 60.0 - 30.0);
            let [u, v] = [Vec3::new(0.3, dx * 0.1, 0.0), Vec3::new(0.0, dz * 0.1, 0.3)];
            let radiance = Vec3::from(random.random::<[f32; 3]>()) * 10.0;
            let (normal, area) = (u.cross(v).normalize(), u.cross(v).length() / 2.0);
            AreaEmitter { corners: [at, at + u, at + v], normal, radiance, area }
        };
        (0..count).map(|_| lamp()).collect()
    }

    /// How far groups are off the light of their members, as a share of it, and the most groups
    /// that a point takes.
    fn error(members: usize, groups_max: usize) -> (f32, usize) {
        let random = &mut SmallRng::seed_from_u64(1);
        let groups = EmitterGroups::new(lamps(members, random));
        let (mut off, mut whole, mut most) = (0.0, 0.0, 0);
        for _ in 0..100 {
            let point = Vec3::from(random.random::<[f32; 3]>()) * Vec3::new(20.0, 2.0, 20.0);
            let normal = (Vec3::splat(0.5) - Vec3::from(random.random::<[f32; 3]>())).normalize();
            let facing = groups.members().iter().filter(|one| one.at_most(point) > 0.0);
            let known: Vec3 = facing.map(|one| one.unhidden(point, normal)).sum();
            let seen = groups.seen_from(point, groups_max);
            let found: Vec3 = seen.iter().map(|one| one.light.unhidden(point, normal)).sum();
            off += (found - known).abs().element_sum();
            whole += known.element_sum();
            most = most.max(seen.len());
        }
        (off / whole.max(f32::MIN_POSITIVE), most)
    }

    #[test]
    fn groups_give_about_the_light_of_their_members() {
        for members in [0, 1, 3, 40, 3_000] {
            let (few, many) = (error(members, 24), error(members, 256));
            assert!(few.0 < 0.4 && many.0 < 0.2, "{members}: {few:?} {many:?}");
            assert!(few.1 <= members.min(24) && many.1 <= members.min(256));
        }
    }
}
