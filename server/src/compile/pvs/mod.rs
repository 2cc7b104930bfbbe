//! Cell-to-cell visibility: sight lines propagated through portal sequences.
//!
//! Portal by portal, as in Teller's thesis and in the tools made for Quake: a quick flood bounds
//! what each portal might see; then a depth-first search through sequences of portals cuts each
//! next portal by the planes that separate the source portal from the one before, and follows
//! what is left. Everything that is not provably invisible is kept: portals are widened, planes
//! have a tolerance on the visible side, and a search that grows too long falls back on the flood.

mod bits;
mod flow;
mod winding;

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use roaring::RoaringBitmap;
use sightline_shared::world::{CellId, Cells, Portal, Pvs};

use bits::Bits;
use winding::{Plane, Winding};

/// Portals are widened by this much on each side, in metres: more than five times what
/// [`super::occluders::PLANE_TOLERANCE`] may have moved a surface.
const WIDENING: f64 = 5e-4;
/// Portals searched with the same knowledge. What one portal of a batch has found prunes the
/// search of the next batch, so that the result does not depend on the number of threads.
const BATCH: usize = 64;

/// A search through the spaces gives up after so many steps, and keeps what the flood allows.
const STEPS_MAX: u32 = 100_000;
/// The search from a place gives up sooner, since it only refines what its space sees.
const STEPS_PLACE_MAX: u32 = 1_500;

/// One way through a portal.
struct Gate {
    /// The cell it leads to.
    to: u32,
    /// The portal's plane, with `to` in front.
    plane: Plane,
    winding: Winding,
}

/// A building's portals, ready for the search.
struct Gates {
    /// Two for each portal: gate `2i` leads through portal `i` to its greater side, gate `2i + 1` to
    /// its lesser side.
    gates: Vec<Gate>,
    /// For each cell, the gates that lead out of it.
    out_of: Vec<Vec<u32>>,
}

impl Gates {
    /// The gates of a subdivision. What they lead to is named by `to`.
    fn new(cells: &Cells, to: impl Fn(CellId) -> u32) -> Self {
        let mut out_of = vec![Vec::new(); cells.cells.len()];
        let mut gates = Vec::with_capacity(cells.portals.len() * 2);
        for portal in &cells.portals {
            let [low, high] = portal.cells;
            for (from, towards, sign) in [(low, high, 1.0), (high, low, -1.0)] {
                out_of[from.0 as usize].push(gates.len() as u32);
                gates.push(Gate::new(portal, to(towards), sign));
            }
        }
        Self { gates, out_of }
    }
}

impl Gate {
    fn new(portal: &Portal, to: u32, towards: f64) -> Self {
        let axis = usize::from(portal.axis);
        let mut normal = DVec3::ZERO;
        normal[axis] = towards;
        let at = f64::from(portal.bounds.min[axis]);
        Self { to, plane: Plane { normal, distance: at * towards }, winding: widened(portal) }
    }
}

/// The portal's rectangle, a little larger.
fn widened(portal: &Portal) -> Winding {
    let axis = usize::from(portal.axis);
    let (u, v) = super::occluders::other_axes(axis);
    let wide = |bound: Vec3, by: f64| {
        let mut bound = bound.as_dvec3();
        bound[u] += by;
        bound[v] += by;
        bound
    };
    let (min, max) = (wide(portal.bounds.min, -WIDENING), wide(portal.bounds.max, WIDENING));
    let corners = [(min[u], min[v]), (max[u], min[v]), (max[u], max[v]), (min[u], max[v])];
    Winding::quad(corners.map(|(at_u, at_v)| {
        let mut corner = min;
        corner[u] = at_u;
        corner[v] = at_v;
        corner
    }))
}

/// Finds the PVS of a subdivision into places. Sight lines go from each of its portals through the
/// portals of `spaces`, the coarser subdivision in which it lies ([`super::subdivide::Grain`]):
/// those are far fewer, and all that occludes lies between them. `progress` is told the share
/// done, from 0 to 1.
pub fn potentially_visible(spaces: &Cells, places: &Cells, progress: &(dyn Fn(f32) + Sync)) -> Pvs {
    let gates = Gates::new(spaces, |cell| cell.0);
    let might: Vec<Bits> =
        gates.gates.par_iter().map(|source| flow::flood(&gates, source)).collect();
    let known = search(&gates, &might, &|share| progress(share * 0.5));
    let space_of: Vec<u32> =
        places.cells.iter().map(|place| spaces.at(place.bounds.centre()).0).collect();
    let seen = spaces_seen(&gates, &known, places, &space_of, &|share| progress(0.5 + share * 0.5));
    mutual(&seen, &space_of, spaces.cells.len())
}

/// For each place, the spaces that can be seen from it: its own, and what its gates show.
fn spaces_seen(
    gates: &Gates,
    known: &[Bits],
    places: &Cells,
    space_of: &[u32],
    progress: &(dyn Fn(f32) + Sync),
) -> Vec<RoaringBitmap> {
    let sources = Gates::new(places, |place| space_of[place.0 as usize]);
    let known_from: Vec<Bits> = gates.out_of.par_iter().map(|out| seen_from(out, known)).collect();
    let done = AtomicUsize::new(0);
    let through: Vec<RoaringBitmap> = sources
        .gates
        .par_iter()
        .map(|source| {
            let mut might = flow::flood(gates, source);
            might.keep_only(&known_from[source.to as usize]);
            let seen = flow::visible_through(gates, known, source, &might, STEPS_PLACE_MAX);
            let count = done.fetch_add(1, Relaxed);
            if count.is_multiple_of(BATCH) {
                progress(count as f32 / sources.gates.len() as f32);
            }
            seen.ones().map(|gate| gates.gates[gate].to).chain([source.to]).collect()
        })
        .collect();
    progress(1.0);
    let all_from = |(place, &own): (usize, &u32)| {
        let out = &sources.out_of[place];
        let all = RoaringBitmap::from_iter([own]);
        out.iter().fold(all, |all, &gate| all | &through[gate as usize])
    };
    space_of.par_iter().enumerate().map(all_from).collect()
}

/// The gates out of a space, and what can be seen through them.
fn seen_from(out: &[u32], known: &[Bits]) -> Bits {
    let mut seen = Bits::none(known.len());
    for &gate in out {
        seen.set(gate as usize);
        seen.add_all(&known[gate as usize]);
    }
    seen
}

/// Sight goes both ways: two places see each other when each can see the space of the other.
fn mutual(seen: &[RoaringBitmap], space_of: &[u32], spaces: usize) -> Pvs {
    let mut places_in = vec![Vec::new(); spaces];
    for (place, &space) in (0u32..).zip(space_of) {
        places_in[space as usize].push(place);
    }
    seen.par_iter()
        .zip(space_of)
        .map(|(row, &own)| {
            let places = row.iter().flat_map(|space| &places_in[space as usize]);
            places.copied().filter(|&place| seen[place as usize].contains(own)).collect()
        })
        .collect()
}

/// For each gate, the gates that can be seen through it. The least-visible go first, since what
/// they cannot see prunes most.
fn search(gates: &Gates, might: &[Bits], progress: &(dyn Fn(f32) + Sync)) -> Vec<Bits> {
    let mut order: Vec<usize> = (0..might.len()).collect();
    order.sort_by_key(|&gate| (might[gate].count(), gate));
    let mut known = might.to_vec();
    for (i, batch) in order.chunks(BATCH).enumerate() {
        let found: Vec<Bits> = batch
            .par_iter()
            .map(|&gate| {
                let source = &gates.gates[gate];
                flow::visible_through(gates, &known, source, &known[gate], STEPS_MAX)
            })
            .collect();
        for (&gate, seen) in batch.iter().zip(found) {
            known[gate] = seen;
        }
        progress(((i + 1) * BATCH) as f32 / order.len() as f32);
    }
    known
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::SmallRng};
    use sightline_shared::{geometry::Aabb, world::Mesh};

    use super::*;
    use crate::{
        compile::{
            occluders::axial_planes,
            subdivide::{Grain, subdivide},
        },
        sight::Sight,
    };

    /// A grid of rooms whose walls are full, have a hole, or are missing; and a few slanted panes.
    fn random_building(rng: &mut SmallRng) -> (Aabb, Vec<[Vec3; 3]>) {
        let bounds = Aabb::new(Vec3::ZERO, Vec3::new(9.0, 6.0, 9.0));
        let mut opaque = Vec::new();
        for axis in 0..3 {
            for at in 1..=2 {
                for u in 0..3 {
                    for v in 0..3 {
                        let at =
                            at as f32 * [3.0, 2.0, 3.0][axis] + [0.0, 1e-3][rng.random_range(0..2)];
                        wall(rng, axis, at, u, v, &mut opaque);
                    }
                }
            }
        }
        for _ in 0..4 {
            opaque.push(std::array::from_fn(|_| {
                Vec3::from_array(std::array::from_fn(|i| rng.random_range(0.0..bounds.max[i])))
            }));
        }
        (bounds, opaque)
    }

    fn wall(
        rng: &mut SmallRng,
        axis: usize,
        at: f32,
        u: usize,
        v: usize,
        out: &mut Vec<[Vec3; 3]>,
    ) {
        let steps = [3.0, 2.0, 3.0];
        let (axis_u, axis_v) = crate::compile::occluders::other_axes(axis);
        let mut panel = |u0: f32, v0: f32, u1: f32, v1: f32| {
            let corner = |cu: f32, cv: f32| {
                let mut p = Vec3::splat(at);
                p[axis_u] = (u as f32 + cu) * steps[axis_u];
                p[axis_v] = (v as f32 + cv) * steps[axis_v];
                p
            };
            let [a, b, c, d] = [corner(u0, v0), corner(u1, v0), corner(u1, v1), corner(u0, v1)];
            out.extend([[a, b, c], [a, c, d]]);
        };
        let hole = [0.1, 0.3, 0.5, 0.9].map(|at: f32| at + rng.random_range(-0.05..0.05));
        match rng.random_range(0..10) {
            0..6 => panel(0.0, 0.0, 1.0, 1.0),
            6..9 => {
                panel(0.0, 0.0, hole[1], 1.0);
                panel(hole[2], 0.0, 1.0, 1.0);
                panel(hole[1], 0.0, hole[2], hole[0]);
                panel(hole[1], hole[3], hole[2], 1.0);
            }
            _ => {}
        }
    }

    /// The spaces and the places, which have no PVS yet.
    fn both(bounds: &Aabb, opaque: &[[Vec3; 3]]) -> (Cells, Cells) {
        let planes = axial_planes(opaque);
        (subdivide(bounds, &planes, Grain::Occluders), subdivide(bounds, &planes, Grain::Places))
    }

    fn compiled(bounds: &Aabb, opaque: &[[Vec3; 3]]) -> Cells {
        let (spaces, mut places) = both(bounds, opaque);
        places.pvs = potentially_visible(&spaces, &places, &|_| ());
        places
    }

    fn mesh(opaque: &[[Vec3; 3]]) -> Mesh {
        Mesh {
            positions: opaque.as_flattened().to_vec(),
            triangles: (0..opaque.len() as u32).map(|i| [0, 1, 2].map(|k| i * 3 + k)).collect(),
        }
    }

    fn point(rng: &mut SmallRng, within: &Aabb) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|i| rng.random_range(within.min[i]..within.max[i])))
    }

    /// How many sight lines were tried and found, and how many of those the PVS denies.
    fn misses(rng: &mut SmallRng, cells: &Cells, sight: &Sight, lines: usize) -> (usize, usize) {
        let (mut found, mut missed) = (0, 0);
        for i in 0..lines {
            let any = &cells.cells[rng.random_range(0..cells.cells.len())].bounds;
            // By cell, so that small ones are tried, and by volume.
            let within = if i % 2 == 0 { any } else { &cells.bounds };
            let (a, b) = (point(rng, within), point(rng, &cells.bounds));
            if sight.between(a, b) {
                found += 1;
                missed += usize::from(!cells.sees(cells.at(a), cells.at(b)));
            }
        }
        (found, missed)
    }

    #[test]
    fn no_sight_line_is_missed_in_random_buildings() {
        let (mut found, mut dense) = (0, 0.0);
        for seed in 0..60 {
            let mut rng = SmallRng::seed_from_u64(seed);
            let (bounds, opaque) = random_building(&mut rng);
            let cells = compiled(&bounds, &opaque);
            let sight = Sight::new(&mesh(&opaque));
            let (lines, missed) = misses(&mut rng, &cells, &sight, 3_000);
            assert_eq!(missed, 0, "of {lines} sight lines in building {seed}");
            found += lines;
            dense += cells.density() / 60.0;
        }
        assert!(found > 10_000, "the buildings have sight lines to miss: {found}");
        assert!(dense < 0.6, "and much that is hidden: density {dense}");
    }

    /// The proof that the test above can fail.
    #[test]
    fn a_lost_portal_is_noticed() {
        let mut noticed = 0;
        for seed in 0..20 {
            let mut rng = SmallRng::seed_from_u64(seed);
            let (bounds, opaque) = random_building(&mut rng);
            let (mut spaces, mut cells) = both(&bounds, &opaque);
            let area = |p: &Portal| {
                let size = p.bounds.size();
                (size.x * size.y).max(size.y * size.z).max(size.z * size.x)
            };
            let largest = |a: &&Portal, b: &&Portal| area(a).total_cmp(&area(b));
            let lost = *spaces.portals.iter().max_by(largest).unwrap();
            spaces.portals.retain(|portal| *portal != lost);
            cells.pvs = potentially_visible(&spaces, &cells, &|_| ());
            let sight = Sight::new(&mesh(&opaque));
            noticed += usize::from(misses(&mut rng, &cells, &sight, 20_000).1 > 0);
        }
        assert!(noticed >= 10, "only {noticed} of 20");
    }

    #[test]
    fn the_pvs_is_symmetric_reflexive_and_the_same_on_any_number_of_threads() {
        let mut rng = SmallRng::seed_from_u64(7);
        let (bounds, opaque) = random_building(&mut rng);
        let (spaces, places) = both(&bounds, &opaque);
        let pvs = potentially_visible(&spaces, &places, &|_| ());
        for (cell, row) in (0u32..).zip(&pvs) {
            assert!(row.contains(cell));
            assert!(row.iter().all(|other| pvs[other as usize].contains(cell)));
        }
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| potentially_visible(&spaces, &places, &|_| ())), pvs);
    }

    /// Four rooms in a row with three doors: the first and the last see each other only when one
    /// line goes through all doors.
    #[test]
    fn a_bend_is_not_seen_through() {
        let check = |doors: [f32; 3], expected: bool| {
            let mut opaque = Vec::new();
            for (x, door) in [4.0, 8.0, 12.0].into_iter().zip(doors) {
                for (z0, z1) in [(0.0, door), (door + 1.0, 30.0)] {
                    let c = |y: f32, z: f32| Vec3::new(x, y, z);
                    opaque.push([c(0.0, z0), c(3.0, z0), c(3.0, z1)]);
                    opaque.push([c(0.0, z0), c(3.0, z1), c(0.0, z1)]);
                }
            }
            let bounds = Aabb::new(Vec3::ZERO, Vec3::new(16.0, 3.0, 30.0));
            let cells = compiled(&bounds, &opaque);
            let rooms: Vec<Vec<u32>> = (0..4)
                .map(|i| {
                    let is_in = |place: &u32| {
                        let x = cells.cells[*place as usize].bounds.centre().x;
                        (x / 4.0) as usize == i
                    };
                    (0..cells.cells.len() as u32).filter(is_in).collect()
                })
                .collect();
            let sees = |from: usize, to: usize| {
                let pairs = rooms[from].iter().flat_map(|a| rooms[to].iter().map(move |b| (a, b)));
                pairs.into_iter().any(|(&a, &b)| cells.sees(CellId(a), CellId(b)))
            };
            assert!((0..3).all(|i| sees(i, i + 1)) && sees(0, 2) && sees(1, 3));
            assert_eq!(sees(0, 3), expected, "doors at {doors:?}");
        };
        check([1.0, 1.0, 1.0], true);
        check([1.0, 12.0, 23.0], true);
        check([1.0, 12.0, 24.9], true);
        check([1.0, 12.0, 25.1], false);
        check([1.0, 12.0, 1.0], false);
        check([12.0, 1.0, 12.0], false);
    }
}
