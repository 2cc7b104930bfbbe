//! A single floor with eight arched windows, on which carving is shown.
//!
//! It resembles the fifth floor of Lei and Ouhyoung 1999, section 5: a hallway with arched windows
//! on one side and rooms on the other, with walls and slabs only. It is one closed solid, made of
//! boxes except for the arches.

use std::f32::consts::PI;

use glam::Vec3;

use super::{
    mesh::{Face, Paint, Scene, metres},
    rect::merge,
};

const ROOMS: i32 = 16;
const WINDOWS: i32 = 8;
/// The number of segments of an arch.
const SEGMENTS: i32 = 8;
/// Lengths on the lattice of 1/64 m.
const WALL: i32 = 16;
const SLAB: i32 = 16;
const CEILING: i32 = 192;
const ROOM_WIDTH: i32 = 224;
const ROOM_DEPTH: i32 = 384;
const HALLWAY: i32 = 192;
/// The longest side of a rectangle into which faces are divided.
const PIECE_MAX: i32 = 95;

const LENGTH: i32 = WALL + ROOMS * (ROOM_WIDTH + WALL);
const DEPTH: i32 = WALL + HALLWAY + WALL + ROOM_DEPTH + WALL;

/// A generated floor.
pub struct ArchedFloor {
    /// The floor as a GLB 2.0 file.
    pub glb: Vec<u8>,
    /// The number of triangles.
    pub triangles: usize,
    /// The number of polygons: rectangles, and the pieces of the arches.
    pub polygons: usize,
}

/// Makes the floor, which is always the same.
pub fn arched_floor() -> ArchedFloor {
    let mut scene = Scene::with_nodes(vec!["hallway".into(), "rooms".into(), "shell".into()]);
    let boxes = Boxes::new();
    let polygons = boxes.build(&mut scene) + arches(&mut scene);
    let feet = |x: i32, z: i32| Vec3::new(metres(x), 0.0, metres(z));
    for i in 0..4 {
        scene.spawn(feet(LENGTH / 8 * (2 * i + 1), WALL + HALLWAY / 2), 0.0);
    }
    ArchedFloor { triangles: scene.triangle_count(), glb: scene.to_glb(), polygons }
}

/// What fills a part of space.
#[derive(Clone, Copy, PartialEq)]
enum Filling {
    Solid,
    Outside,
    Hallway,
    Room,
    Opening,
    /// The head of a window, which the arch fills.
    Arch,
}

/// A lattice box: from, to, and what fills it. Later layers cover earlier ones.
type Layer = ([i32; 3], [i32; 3], Filling);

struct Boxes {
    cuts: [Vec<i32>; 3],
    fillings: Vec<Filling>,
}

impl Boxes {
    fn new() -> Self {
        let layers = layers();
        let cuts = [0, 1, 2].map(|axis| {
            let mut cuts: Vec<i32> =
                layers.iter().flat_map(|(min, max, _)| [min[axis], max[axis]]).collect();
            cuts.sort_unstable();
            cuts.dedup();
            // One empty layer surrounds everything.
            let (first, last) = (cuts[0] - 1, cuts[cuts.len() - 1] + 1);
            [vec![first], cuts, vec![last]].concat()
        });
        let [x, y, z] = [0, 1, 2].map(|axis| cuts[axis].len() - 1);
        let mut boxes = Self { cuts, fillings: vec![Filling::Outside; x * y * z] };
        for layer in &layers {
            boxes.fill(layer);
        }
        boxes
    }

    fn fill(&mut self, (min, max, filling): &Layer) {
        let [xs, ys, zs] = [0, 1, 2].map(|axis| {
            let find = |v: i32| self.cuts[axis].partition_point(|&cut| cut < v);
            find(min[axis])..find(max[axis])
        });
        for (x, y) in xs.flat_map(|x| ys.clone().map(move |y| (x, y))) {
            for z in zs.clone() {
                let index = self.index([x, y, z]);
                self.fillings[index] = *filling;
            }
        }
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * (self.cuts[1].len() - 1) + y) * (self.cuts[2].len() - 1) + z
    }

    /// Adds a face wherever solid and open parts meet, and gives the number of polygons.
    fn build(&self, scene: &mut Scene) -> usize {
        let mut count = 0;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for plane in 1..self.cuts[axis].len() - 1 {
                let label = |i: usize, j: usize| {
                    let mut at = [0; 3];
                    (at[u], at[v]) = (i, j);
                    let [before, behind] = [plane - 1, plane].map(|along| {
                        at[axis] = along;
                        self.fillings[self.index(at)]
                    });
                    match (before, behind) {
                        (Filling::Arch, _) | (_, Filling::Arch) => None,
                        (Filling::Solid, Filling::Solid) => None,
                        (Filling::Solid, open) => Some((open, true)),
                        (open, Filling::Solid) => Some((open, false)),
                        _ => None,
                    }
                };
                let (columns, rows) = (self.cuts[u].len() - 1, self.cuts[v].len() - 1);
                for ([i, j], [k, l], (open, positive)) in merge(columns, rows, label) {
                    let min = [self.cuts[u][i], self.cuts[v][j]];
                    let max = [self.cuts[u][k], self.cuts[v][l]];
                    let at = self.cuts[axis][plane];
                    count += pieces(scene, open, Face { axis, at, min, max, positive });
                }
            }
        }
        count
    }
}

/// Adds a face in pieces, and gives their number.
fn pieces(scene: &mut Scene, open: Filling, face: Face) -> usize {
    let (node, paint) = paint(open, &face);
    let parts = [0, 1].map(|side| {
        let (from, to) = (face.min[side], face.max[side]);
        let count = (to - from + PIECE_MAX - 1) / PIECE_MAX;
        let cut = move |i: i32| from + (to - from) * i / count;
        (0..count).map(|i| [cut(i), cut(i + 1)]).collect::<Vec<_>>()
    });
    for &[u0, u1] in &parts[0] {
        for &[v0, v1] in &parts[1] {
            scene.face(node, paint, Face { min: [u0, v0], max: [u1, v1], ..face });
        }
    }
    parts[0].len() * parts[1].len()
}

/// The node and the paint of a face, by what is in front of it.
fn paint(open: Filling, face: &Face) -> (usize, Paint) {
    const PLASTER: Paint = Paint::opaque([236, 230, 218]);
    const BRICK: Paint = Paint::opaque([176, 112, 88]);
    const TRIM: Paint = Paint::opaque([214, 208, 196]);
    const STONE: Paint = Paint::opaque([150, 156, 160]);
    const WOOD: Paint = Paint::opaque([168, 128, 88]);
    match (open, face.axis, face.positive) {
        (Filling::Hallway, 1, true) => (0, STONE),
        (Filling::Hallway, ..) => (0, PLASTER),
        (Filling::Room, 1, true) => (1, WOOD),
        (Filling::Room, ..) => (1, PLASTER),
        (Filling::Opening, ..) => (2, TRIM),
        _ => (2, BRICK),
    }
}

/// The height of the sill of an arched window.
const SILL: i32 = 32;
/// The height at which the round part begins.
const SPRING: i32 = 96;
/// The height of the top of the arch.
const CROWN: i32 = 168;
/// The height of the top of the pieces of wall above the arch.
const HEAD: i32 = 180;

fn layers() -> Vec<Layer> {
    use Filling::{Arch, Hallway, Opening, Room, Solid};
    let mut layers = vec![
        ([0, -SLAB, 0], [LENGTH, CEILING + SLAB, DEPTH], Solid),
        ([WALL, 0, WALL], [LENGTH - WALL, CEILING, WALL + HALLWAY], Hallway),
    ];
    let inner = WALL + HALLWAY;
    for room in 0..ROOMS {
        let x = WALL + room * (ROOM_WIDTH + WALL);
        let z = inner + WALL;
        layers.push(([x, 0, z], [x + ROOM_WIDTH, CEILING, z + ROOM_DEPTH], Room));
        layers.push(([x + 24, 0, inner], [x + 88, 136, z], Opening));
        layers.push(([x + 48, 56, DEPTH - WALL], [x + 176, 152, DEPTH], Opening));
    }
    for [from, to] in windows() {
        layers.push(([from, SILL, 0], [to, SPRING, WALL], Opening));
        layers.push(([from, SPRING, 0], [to, HEAD, WALL], Arch));
    }
    for x in [0, LENGTH - WALL] {
        layers.push(([x, 0, WALL + 64], [x + WALL, 136, WALL + 128], Opening));
    }
    layers
}

/// The extent of each arched window along the hallway.
fn windows() -> impl Iterator<Item = [i32; 2]> {
    let pitch = LENGTH / WINDOWS;
    (0..WINDOWS).map(move |i| [pitch * i + (pitch - 160) / 2, pitch * i + (pitch + 160) / 2])
}

/// Adds the round parts of the windows, and gives the number of polygons.
fn arches(scene: &mut Scene) -> usize {
    let brick = Paint::opaque([176, 112, 88]);
    let (plaster, trim) = (Paint::opaque([236, 230, 218]), Paint::opaque([214, 208, 196]));
    let mut count = 0;
    for [from, to] in windows() {
        let at = |i: i32| {
            let turn = PI * i as f32 / SEGMENTS as f32;
            let along = metres(from + to) * 0.5 - metres(to - from) * 0.5 * turn.cos();
            let rise = if i % SEGMENTS == 0 { 0.0 } else { turn.sin() };
            (along, metres(SPRING) + metres(CROWN - SPRING) * rise)
        };
        for i in 0..SEGMENTS {
            let ((a, low), (b, high)) = (at(i), at(i + 1));
            let (outer, inner, top) = (0.0, metres(WALL), metres(HEAD));
            let p = Vec3::new;
            let front = [p(a, low, inner), p(b, high, inner), p(b, top, inner), p(a, top, inner)];
            let back = [p(a, top, outer), p(b, top, outer), p(b, high, outer), p(a, low, outer)];
            let soffit = [p(a, low, inner), p(a, low, outer), p(b, high, outer), p(b, high, inner)];
            scene.polygon(0, plaster, &front);
            scene.polygon(2, brick, &back);
            scene.polygon(2, trim, &soffit);
            count += 3;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use std::{path::Path, time::Instant};

    use glam::{DVec3, Vec3};
    use rand::{Rng, SeedableRng, rngs::SmallRng};
    use sightline_world::Mesh;

    use super::*;
    use sightline_compiler::{
        carve::{CarveOptions, CarvedModel, Class, carve},
        import::glb,
    };
    use sightline_oracle::Oracle;

    fn opaque() -> Vec<[DVec3; 3]> {
        let model = glb::read_slice(&arched_floor().glb, None::<&Path>, "floor").unwrap();
        model.opaque.iter().map(|corners| corners.map(|p| p.as_dvec3())).collect()
    }

    fn sight<'a>(triangles: impl Iterator<Item = &'a [DVec3; 3]>) -> Oracle {
        let positions: Vec<Vec3> = triangles.flatten().map(|p| p.as_vec3()).collect();
        let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        Oracle::new(&Mesh { triangles: triangles.collect(), positions })
    }

    fn carved() -> (Vec<[DVec3; 3]>, CarvedModel) {
        let triangles = opaque();
        let started = Instant::now();
        let carved = carve(&triangles, &[], &CarveOptions::default());
        assert!(started.elapsed().as_secs_f64() < 3.0);
        (triangles, carved)
    }

    /// The figures agree with the fifth floor of Lei and Ouhyoung 1999: 3104 polygons with eight
    /// clusters of 24 polygons, three caps for each window, and 16 pieces of wall left above it.
    #[test]
    fn carving_leaves_an_axial_model() {
        let (_, carved) = carved();
        let report = &carved.report;
        assert_eq!(report.polygons, arched_floor().polygons);
        assert!((3000..3200).contains(&report.polygons), "{}", report.polygons);
        assert_eq!((report.clusters, report.elements), (8, 64));
        assert_eq!((report.non_axial, report.cuttings), (192, 192));
        assert_eq!((report.added, report.sealed), (24, 24));
        assert_eq!(carved.polygons.len(), report.polygons - 192 + 8 * 16);
        assert_eq!((report.before, report.after), (Class::NonAxial, Class::Axial));
        assert_eq!(report.semi_axial, 0);
    }

    /// With its cuttings, the model looks the same from everywhere. Without them, it has
    /// rectangular holes where the arches were (Lei and Ouhyoung 1999, Figs. 10 and 11).
    #[test]
    fn with_the_cuttings_it_looks_the_same_and_without_them_it_has_holes() {
        let (triangles, carved) = carved();
        let kept = || carved.polygons.iter().flat_map(|p| &p.triangles);
        let cut = || carved.cuttings.iter().flat_map(|p| &p.triangles);
        let original = sight(triangles.iter());
        let (whole, holed) = (sight(kept().chain(cut())), sight(kept()));
        let mut random = SmallRng::seed_from_u64(7);
        let mut holes = 0;
        for _ in 0..20_000 {
            let share = |random: &mut SmallRng| random.random_range(0.02..0.98);
            let eye = Vec3::new(
                metres(LENGTH) * share(&mut random),
                metres(CEILING) * share(&mut random),
                metres(WALL) + metres(HALLWAY) * share(&mut random),
            );
            let towards = Vec3::from_array([0; 3].map(|_| random.random_range(-1.0..1.0f32)));
            let towards = towards.normalize_or(Vec3::NEG_Z);
            let at = |sight: &Oracle| sight.distance(eye, towards).unwrap_or(1e4);
            assert!((at(&original) - at(&whole)).abs() < 1e-3, "{eye} {towards}");
            assert!(at(&holed) >= at(&original) - 1e-3, "{eye} {towards}");
            holes += usize::from(at(&holed) > at(&original) + 0.01);
        }
        // The corners beside the arches are a small part of the picture.
        assert!((20..2_000).contains(&holes), "{holes}");
    }
}
