//! Regions of space as boolean combinations of half-spaces (Menon and Rossignac 1999, FIG. 7,
//! step 715).

use glam::Vec3;
use sightline_world::geometry::Aabb;

use crate::{Containment, HalfSpace};

/// A region of space.
#[derive(Clone, Debug, PartialEq)]
pub enum BooleanRegion {
    /// One side of a plane.
    Half(HalfSpace),
    /// The intersection of regions; all of space if there are none.
    All(Vec<BooleanRegion>),
    /// The union of regions; nothing if there are none.
    Any(Vec<BooleanRegion>),
    /// Everything outside a region.
    Not(Box<BooleanRegion>),
}

impl BooleanRegion {
    /// All of space.
    pub const EVERYWHERE: Self = Self::All(Vec::new());
    /// The empty region.
    pub const NOWHERE: Self = Self::Any(Vec::new());

    /// The intersection of half-spaces.
    pub fn within(planes: impl IntoIterator<Item = HalfSpace>) -> Self {
        Self::All(planes.into_iter().map(Self::Half).collect())
    }

    /// Whether a point is in the region.
    pub fn contains(&self, point: Vec3) -> bool {
        match self {
            Self::Half(half) => half.holds(point, 0.0),
            Self::All(parts) => parts.iter().all(|part| part.contains(point)),
            Self::Any(parts) => parts.iter().any(|part| part.contains(point)),
            Self::Not(part) => !part.contains(point),
        }
    }

    /// Where a box lies relative to the region. [`Containment::Partial`] is also the answer when it
    /// is not known.
    pub fn containment(&self, region: &Aabb) -> Containment {
        match self {
            Self::Half(half) => half.containment(region),
            Self::All(parts) => {
                let mut all = Containment::Inside;
                for part in parts {
                    match part.containment(region) {
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
                    match part.containment(region) {
                        Containment::Inside => return Containment::Inside,
                        Containment::Partial => any = Containment::Partial,
                        Containment::Outside => (),
                    }
                }
                any
            }
            Self::Not(part) => match part.containment(region) {
                Containment::Outside => Containment::Inside,
                Containment::Partial => Containment::Partial,
                Containment::Inside => Containment::Outside,
            },
        }
    }

    /// Whether some of a box may be in the region: may be wrongly true, never wrongly false.
    pub fn meets(&self, region: &Aabb) -> bool {
        self.containment(region) != Containment::Outside
    }

    /// The number of half-spaces that the region consists of.
    pub fn planes(&self) -> usize {
        match self {
            Self::Half(_) => 1,
            Self::All(parts) | Self::Any(parts) => parts.iter().map(Self::planes).sum(),
            Self::Not(part) => part.planes(),
        }
    }

    /// A region of at most `planes_max` half-spaces that holds all of this one. Regions that were
    /// taken out are filled in first. Then half-spaces are dropped: those that differ least from
    /// the kept ones.
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

/// Some of the parts of an intersection, with at most this number of half-spaces.
fn fewer(parts: &[BooleanRegion], planes_max: usize) -> Vec<BooleanRegion> {
    let halves: Vec<HalfSpace> = parts
        .iter()
        .filter_map(|part| if let BooleanRegion::Half(half) = part { Some(*half) } else { None })
        .collect();
    let mut kept: Vec<HalfSpace> = halves.first().copied().into_iter().collect();
    kept.truncate(planes_max);
    while kept.len() < planes_max.min(halves.len()) {
        // How much a half-space resembles the kept ones: the greatest cosine between their normals.
        let alike = |half: &HalfSpace| {
            kept.iter().map(|other| other.normal.dot(half.normal)).fold(f64::NEG_INFINITY, f64::max)
        };
        let left = halves.iter().filter(|half| !kept.contains(half));
        let Some(next) = left.min_by(|a, b| alike(a).total_cmp(&alike(b))) else { break };
        kept.push(*next);
    }
    debug_assert!(kept.len() <= planes_max);
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
