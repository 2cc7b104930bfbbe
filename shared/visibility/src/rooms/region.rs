//! Regions of space as boolean combinations of half-spaces.

use glam::{DVec3, Vec3};

use sightline_world::geometry::Aabb;

/// All points on one side of a plane, the plane included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfSpace {
    /// Of unit length, out of it.
    pub normal: DVec3,
    /// From the origin to its plane along the normal, in metres.
    pub distance: f64,
}

/// Where a box is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Containment {
    /// No point of it is inside.
    Outside,
    /// Some may be.
    Partial,
    /// Every point of it is inside.
    Inside,
}

impl HalfSpace {
    /// Whether a point is inside, or outside by no more than `tolerance`, in metres.
    pub fn holds(&self, point: Vec3, tolerance: f64) -> bool {
        self.normal.dot(point.as_dvec3()) <= self.distance + tolerance
    }

    /// Where a box is.
    pub fn side(&self, region: &Aabb) -> Containment {
        let ahead = self.normal.dot(region.centre().as_dvec3()) - self.distance;
        let reach = self.normal.abs().dot(region.size().as_dvec3() * 0.5);
        if ahead > reach {
            Containment::Outside
        } else if ahead <= -reach {
            Containment::Inside
        } else {
            Containment::Partial
        }
    }

    /// The same with its plane further out, in metres.
    pub fn moved(&self, by: f64) -> Self {
        Self { distance: self.distance + by, ..*self }
    }

    /// The other side.
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, distance: -self.distance }
    }

    /// The side of a box with this number, from 0 to 5: lesser ones first.
    pub(super) fn of_box(region: &Aabb, number: usize) -> Self {
        let axis = number % 3;
        let normal = DVec3::AXES[axis];
        if number < 3 {
            Self { normal: -normal, distance: -f64::from(region.min[axis]) }
        } else {
            Self { normal, distance: f64::from(region.max[axis]) }
        }
    }
}

/// A region of space.
#[derive(Clone, Debug, PartialEq)]
pub enum BooleanRegion {
    /// One side of a plane.
    Half(HalfSpace),
    /// What is in all of these; all of space when there are none.
    All(Vec<BooleanRegion>),
    /// What is in some of these; nothing when there are none.
    Any(Vec<BooleanRegion>),
    /// What is not in that.
    Not(Box<BooleanRegion>),
}

impl BooleanRegion {
    /// All of space.
    pub const EVERYWHERE: Self = Self::All(Vec::new());
    /// No point.
    pub const NOWHERE: Self = Self::Any(Vec::new());

    /// What is on the inner sides of some planes.
    pub fn within(planes: impl IntoIterator<Item = HalfSpace>) -> Self {
        Self::All(planes.into_iter().map(Self::Half).collect())
    }

    /// Whether a point is inside.
    pub fn contains(&self, point: Vec3) -> bool {
        match self {
            Self::Half(half) => half.holds(point, 0.0),
            Self::All(parts) => parts.iter().all(|part| part.contains(point)),
            Self::Any(parts) => parts.iter().any(|part| part.contains(point)),
            Self::Not(part) => !part.contains(point),
        }
    }

    /// Where a box is. [`Containment::Partial`] is also what is not known.
    pub fn side(&self, region: &Aabb) -> Containment {
        match self {
            Self::Half(half) => half.side(region),
            Self::All(parts) => {
                let mut all = Containment::Inside;
                for part in parts {
                    match part.side(region) {
                        Containment::Outside => return Containment::Outside,
                        Containment::Partial => all = Containment::Partial,
                        Containment::Inside => (),
                    }
                }
                all
            }
            Self::Any(parts) => {
                let mut any = Containment::Outside;
                for part in parts {
                    match part.side(region) {
                        Containment::Inside => return Containment::Inside,
                        Containment::Partial => any = Containment::Partial,
                        Containment::Outside => (),
                    }
                }
                any
            }
            Self::Not(part) => match part.side(region) {
                Containment::Outside => Containment::Inside,
                Containment::Partial => Containment::Partial,
                Containment::Inside => Containment::Outside,
            },
        }
    }

    /// Whether some of a box may be inside: never wrongly denied.
    pub fn meets(&self, region: &Aabb) -> bool {
        self.side(region) != Containment::Outside
    }

    /// How many planes it has.
    pub fn planes(&self) -> usize {
        match self {
            Self::Half(_) => 1,
            Self::All(parts) | Self::Any(parts) => parts.iter().map(Self::planes).sum(),
            Self::Not(part) => part.planes(),
        }
    }

    /// A region with no more planes than this that holds all of it. What is taken out of it is filled
    /// in first; then planes go, those that differ least from the ones that stay.
    pub fn simplified(&self, planes_max: usize) -> Self {
        if self.planes() <= planes_max {
            return self.clone();
        }
        match self {
            Self::Half(_) | Self::Not(_) => Self::EVERYWHERE,
            Self::Any(parts) => {
                let share = planes_max / parts.len().max(1);
                if share == 0 {
                    return Self::EVERYWHERE;
                }
                Self::Any(parts.iter().map(|part| part.simplified(share)).collect())
            }
            Self::All(parts) => Self::All(fewer(parts, planes_max)),
        }
    }
}

/// Some of what a region must be in: half-spaces, and one thing besides if there is room.
fn fewer(parts: &[BooleanRegion], planes_max: usize) -> Vec<BooleanRegion> {
    let halves: Vec<HalfSpace> = parts
        .iter()
        .filter_map(|part| if let BooleanRegion::Half(half) = part { Some(*half) } else { None })
        .collect();
    let mut kept: Vec<HalfSpace> = halves.first().copied().into_iter().collect();
    kept.truncate(planes_max);
    while kept.len() < planes_max.min(halves.len()) {
        // How much a plane says that no other does.
        let alike = |half: &HalfSpace| {
            kept.iter().map(|other| other.normal.dot(half.normal)).fold(f64::NEG_INFINITY, f64::max)
        };
        let left = halves.iter().filter(|half| !kept.contains(half));
        let Some(next) = left.min_by(|a, b| alike(a).total_cmp(&alike(b))) else { break };
        kept.push(*next);
    }
    let mut room = planes_max - kept.len();
    let mut fewer: Vec<BooleanRegion> = kept.into_iter().map(BooleanRegion::Half).collect();
    for part in
        parts.iter().filter(|part| matches!(part, BooleanRegion::All(_) | BooleanRegion::Any(_)))
    {
        let part = part.simplified(room);
        room -= part.planes().min(room);
        fewer.push(part);
    }
    fewer
}
