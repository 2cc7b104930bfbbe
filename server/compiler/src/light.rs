//! Light for models that bring none: ambient occlusion and one soft lamp, which make corners, edges
//! and objects on a floor visible.
//!
//! Triangles are divided until their edges are short. From each corner, rays go out over the side
//! that it faces. Surfaces that they meet nearby take light away, near ones more. Rays towards the
//! lamp count more. Light is a factor on vertex colours, linear between corners. It depends on the
//! triangles alone and uses no random numbers.

use std::{collections::HashMap, f32::consts::TAU, ops::ControlFlow};

use glam::{Vec2, Vec3, Vec3A};
use obvhs::{
    BvhBuildParams,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    ray::{Ray, RayHit},
    triangle::Triangle,
};
use rayon::prelude::*;
use sightline_world::tolerance::RAY_LIFT_M;

use super::model::Surface;

/// Surfaces farther away than this take no light, in metres.
const REACH: f32 = 1.6;
/// The number of rays from a corner.
const RAYS: usize = 40;
/// The direction towards the lamp.
const LAMP: Vec3 = Vec3::new(0.44, 0.78, 0.45);
/// How much more a ray straight towards the lamp counts.
const LAMP_SHARE: f32 = 0.45;
/// The least light of a place, from 0 to 1, so that walls stay visible.
const DARKEST: f32 = 0.3;
/// A corner is inside something solid when more than this share of its rays meet backs of surfaces.
const BACKS_MAX: f32 = 0.3;
/// Edges are divided until they are no longer than this, in metres …
const EDGE_MIN: f32 = 0.22;
/// … or than this many voxels, whichever is more …
const EDGE_VOXELS: f32 = 5.0;
/// … and in large buildings stay longer, so that there are about this many triangles.
const DIVIDED_TRIANGLES: f32 = 500_000.0;
/// How often one triangle is halved at most.
const DIVISIONS_MAX: u32 = 14;

/// The surfaces with light in their vertex colours. None when `progress` breaks.
pub(super) fn lit(
    surfaces: &[Surface],
    opaque: &[[Vec3; 3]],
    voxel: f32,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Option<Vec<Surface>> {
    let area: f32 = surfaces.iter().flat_map(Surface::corners).map(area).sum();
    let edge_max = (2.0 * area / DIVIDED_TRIANGLES).sqrt().max(EDGE_MIN).max(EDGE_VOXELS * voxel);
    let shell = Shell::new(opaque);
    let mut done = Vec::with_capacity(surfaces.len());
    for (index, surface) in surfaces.iter().enumerate() {
        if progress(index as f32 / surfaces.len() as f32).is_break() {
            return None;
        }
        let mut divided = divided(surface, edge_max);
        let spots = Spots::of(&divided);
        let light: Vec<_> = spots.places.par_iter().map(|spot| shell.light(spot)).collect();
        let light = spots.filled(&light);
        for (colour, &spot) in divided.colours.iter_mut().zip(&spots.of_vertex) {
            // Colours are multiplied in sRGB, where the square root of light is about right.
            let share = light[spot].sqrt();
            *colour = colour.map(|channel| (f32::from(channel) * share + 0.5) as u8);
        }
        done.push(divided);
    }
    assert_eq!(done.len(), surfaces.len(), "each surface is lit");
    Some(done)
}

fn area([a, b, c]: [Vec3; 3]) -> f32 {
    (b - a).cross(c - a).length() / 2.0
}

/// The surfaces that take light away.
struct Shell {
    bvh: Option<Bvh2>,
    triangles: Vec<Triangle>,
    directions: Vec<Vec3>,
}

/// A corner of triangles that lie in one plane.
#[derive(Clone, Copy)]
struct Spot {
    at: Vec3,
    normal: Vec3,
}

impl Shell {
    fn new(opaque: &[[Vec3; 3]]) -> Self {
        let triangle =
            |&[a, b, c]: &[Vec3; 3]| Triangle { v0: a.into(), v1: b.into(), v2: c.into() };
        let triangles: Vec<_> = opaque.iter().map(triangle).collect();
        let params = BvhBuildParams::medium_build();
        let bvh = (!triangles.is_empty())
            .then(|| build_bvh2_from_tris(&triangles, params, &mut Default::default()));
        Self { bvh, triangles, directions: directions() }
    }

    /// The light from 0 to 1, on the brighter side of a sheet. None inside something solid.
    fn light(&self, spot: &Spot) -> Option<f32> {
        let front = self.light_on(spot);
        if front.is_some_and(|light| light > 0.5) {
            return front;
        }
        let back = self.light_on(&Spot { normal: -spot.normal, ..*spot });
        front.into_iter().chain(back).reduce(f32::max)
    }

    fn light_on(&self, spot: &Spot) -> Option<f32> {
        let (u, v) = spot.normal.any_orthonormal_pair();
        let from = spot.at + spot.normal * RAY_LIFT_M;
        let (mut open, mut full, mut backs) = (0.0, 0.0, 0);
        for direction in &self.directions {
            let along = u * direction.x + v * direction.y + spot.normal * direction.z;
            let weight = 1.0 + LAMP_SHARE * along.dot(LAMP);
            full += weight;
            match self.first(from, along) {
                None => open += weight,
                Some((distance, is_back)) => {
                    open += weight * (distance / REACH).min(1.0);
                    backs += usize::from(is_back);
                }
            }
        }
        let is_inside = backs as f32 > BACKS_MAX * RAYS as f32;
        // Relative to a place in the open that half faces the lamp.
        let lamp = 1.0 + LAMP_SHARE * (spot.normal.dot(LAMP) - 1.0) * 0.5;
        (!is_inside).then(|| (open / full * lamp).clamp(0.0, 1.0).max(DARKEST))
    }

    /// The distance of the first surface within reach, and whether the ray meets its back.
    fn first(&self, from: Vec3, along: Vec3) -> Option<(f32, bool)> {
        let bvh = self.bvh.as_ref()?;
        let ray = Ray::new(from.into(), along.into(), 0.0, REACH);
        let mut hit = RayHit::none();
        let triangle = |id: usize| &self.triangles[bvh.primitive_indices[id] as usize];
        if !bvh.ray_traverse(ray, &mut hit, |ray, id| triangle(id).intersect(ray)) {
            return None;
        }
        let Triangle { v0, v1, v2 } = *triangle(hit.primitive_id as usize);
        let normal = (v1 - v0).cross(v2 - v0);
        Some((hit.t, normal.dot(Vec3A::from(along)) > 0.0))
    }
}

/// Directions about the z axis on a spiral, denser where light falls steeply.
fn directions() -> Vec<Vec3> {
    let golden = 0.618_034;
    (0..RAYS)
        .map(|i| {
            let share = (i as f32 + 0.5) / RAYS as f32;
            let around = (i as f32 * golden).fract() * TAU;
            let flat = Vec2::from_angle(around) * share.sqrt();
            flat.extend((1.0 - share).sqrt())
        })
        .collect()
}

/// The corners of a surface, each once for each normal.
struct Spots {
    places: Vec<Spot>,
    of_vertex: Vec<usize>,
    /// The three spots of each triangle.
    triangles: Vec<[usize; 3]>,
}

impl Spots {
    /// The spots of a surface in which no two triangles share a vertex.
    fn of(divided: &Surface) -> Self {
        let mut known: HashMap<([u32; 3], [i8; 3]), usize> = HashMap::new();
        let mut spots = Self {
            places: Vec::new(),
            of_vertex: vec![0; divided.positions.len()],
            triangles: Vec::with_capacity(divided.triangles.len()),
        };
        for (indices, corners) in divided.triangles.iter().zip(divided.corners()) {
            let [a, b, c] = corners;
            let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
            let turned = (normal * 100.0).to_array().map(|part| part.round() as i8);
            let spot = |at: Vec3| {
                *known.entry((at.to_array().map(f32::to_bits), turned)).or_insert_with(|| {
                    spots.places.push(Spot { at, normal });
                    spots.places.len() - 1
                })
            };
            let of_corners = corners.map(spot);
            for (&index, spot) in indices.iter().zip(of_corners) {
                spots.of_vertex[index as usize] = spot;
            }
            spots.triangles.push(of_corners);
        }
        assert_eq!(spots.of_vertex.len(), divided.positions.len(), "a spot for each vertex");
        spots
    }

    /// Gives corners inside something solid the light of their neighbours, so that they darken
    /// nothing visible.
    fn filled(&self, light: &[Option<f32>]) -> Vec<f32> {
        let mut sums = vec![(0.0, 0.0); light.len()];
        for triangle in &self.triangles {
            let known: Vec<f32> = triangle.iter().filter_map(|&spot| light[spot]).collect();
            for &spot in triangle {
                sums[spot].0 += known.iter().sum::<f32>();
                sums[spot].1 += known.len() as f32;
            }
        }
        let fill = |(light, (sum, count)): (&Option<f32>, (f32, f32))| {
            light.unwrap_or(if count > 0.0 { sum / count } else { DARKEST })
        };
        light.iter().zip(sums).map(fill).collect()
    }
}

/// The triangles of a surface, divided until no edge is longer. No two share a vertex.
fn divided(surface: &Surface, edge_max: f32) -> Surface {
    let mut pieces = Surface {
        positions: Vec::new(),
        uvs: Vec::new(),
        colours: Vec::new(),
        triangles: Vec::new(),
        material: surface.material.clone(),
    };
    for (indices, corners) in surface.triangles.iter().zip(surface.corners()) {
        let uv = |i: u32| surface.uvs.get(i as usize).copied();
        let colour = |i: u32| surface.colours.get(i as usize).map_or([255; 3], |&colour| colour);
        let corner = |k: usize| Corner {
            at: corners[k],
            uv: uv(indices[k]).unwrap_or_default(),
            colour: Vec3::from(colour(indices[k]).map(f32::from)),
        };
        divide([0, 1, 2].map(corner), edge_max, DIVISIONS_MAX, &mut pieces);
    }
    if surface.uvs.is_empty() {
        pieces.uvs.clear();
    }
    pieces
}

#[derive(Clone, Copy)]
struct Corner {
    at: Vec3,
    uv: Vec2,
    colour: Vec3,
}

fn divide(triangle: [Corner; 3], edge_max: f32, divisions: u32, pieces: &mut Surface) {
    let length = |i: usize| triangle[i].at.distance(triangle[(i + 1) % 3].at);
    let longest = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    if divisions > 0 && length(longest) > edge_max {
        let [a, b, c] = [0, 1, 2].map(|i| triangle[(longest + i) % 3]);
        // The midpoint is the same from both sides of an edge, bit for bit.
        let middle = Corner {
            at: (a.at + b.at) * 0.5,
            uv: (a.uv + b.uv) * 0.5,
            colour: (a.colour + b.colour) * 0.5,
        };
        divide([a, middle, c], edge_max, divisions - 1, pieces);
        return divide([middle, b, c], edge_max, divisions - 1, pieces);
    }
    let first = pieces.positions.len() as u32;
    for corner in triangle {
        pieces.positions.push(corner.at);
        pieces.uvs.push(corner.uv);
        pieces.colours.push(corner.colour.to_array().map(|channel| channel as u8));
    }
    pieces.triangles.push([first, first + 1, first + 2]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SurfaceMaterial;

    /// A room of 6 × 3 × 6 m whose sides face inwards.
    fn room() -> Vec<[Vec3; 3]> {
        let quad = |a: Vec3, u: Vec3, v: Vec3| [[a, a + u, a + u + v], [a, a + u + v, a + v]];
        let (x, y, z) = (Vec3::X * 6.0, Vec3::Y * 3.0, Vec3::Z * 6.0);
        [
            quad(Vec3::ZERO, z, x),
            quad(y, x, z),
            quad(Vec3::ZERO, x, y),
            quad(z, y, x),
            quad(Vec3::ZERO, y, z),
            quad(x, z, y),
        ]
        .concat()
    }

    fn surface(triangles: &[[Vec3; 3]]) -> Surface {
        Surface::of_triangles(triangles, SurfaceMaterial::opaque([255; 3]))
    }

    /// The light at the vertex nearest to a point.
    fn light_at(surfaces: &[Surface], point: Vec3) -> u8 {
        let vertices = surfaces.iter().flat_map(|s| s.positions.iter().zip(&s.colours));
        let nearest = vertices.min_by(|a, b| a.0.distance(point).total_cmp(&b.0.distance(point)));
        nearest.expect("there are some").1[0]
    }

    fn lit_room(with: &[[Vec3; 3]]) -> Vec<Surface> {
        let all = [room(), with.to_vec()].concat();
        lit(&[surface(&all)], &all, 0.03, &|_| ControlFlow::Continue(())).expect("not broken off")
    }

    #[test]
    fn corners_are_darker_than_open_floor() {
        let lit = lit_room(&[]);
        let [open, edge, corner] = [Vec3::new(3.0, 0.0, 3.0), Vec3::new(3.0, 0.0, 0.0), Vec3::ZERO]
            .map(|point| light_at(&lit, point));
        assert!(open > edge + 30 && edge > corner, "{open} {edge} {corner}");
        let ceiling = light_at(&lit, Vec3::new(3.0, 3.0, 3.0));
        assert!(open > ceiling + 10, "the lamp is above: {open} {ceiling}");
    }

    #[test]
    fn buried_corners_darken_nothing() {
        // A wall that continues below the floor, where its foot is not visible.
        let quad = |a: Vec3, u: Vec3, v: Vec3| [[a, a + u, a + u + v], [a, a + u + v, a + v]];
        let post = quad(Vec3::new(2.0, -0.2, 3.0), Vec3::X * 2.0, Vec3::Y * 2.2);
        let lit = lit_room(&post);
        let foot = light_at(&lit, Vec3::new(3.0, -0.2, 3.0));
        assert!(foot > 120, "{foot}");
    }

    #[test]
    fn dividing_keeps_the_area_and_the_colours() {
        let mut before = surface(&[[Vec3::ZERO, Vec3::X * 3.0, Vec3::Z * 2.0]]);
        before.colours = vec![[200, 0, 0], [0, 200, 0], [0, 0, 200]];
        before.uvs = vec![Vec2::ZERO, Vec2::X, Vec2::Y];
        let after = divided(&before, 0.25);
        let sum = |s: &Surface| s.corners().map(area).sum::<f32>();
        assert!((sum(&before) - sum(&after)).abs() < 1.0e-4);
        assert!(after.triangles.len() > 96, "{}", after.triangles.len());
        for ((at, uv), colour) in after.positions.iter().zip(&after.uvs).zip(&after.colours) {
            assert!((uv.x - at.x / 3.0).abs() < 1.0e-5 && (uv.y - at.z / 2.0).abs() < 1.0e-5);
            assert!((f32::from(colour[1]) - 200.0 * uv.x).abs() < 14.0);
        }
        let shortest =
            after.corners().flat_map(|[a, b, c]| [a.distance(b), b.distance(c), c.distance(a)]);
        assert!(shortest.fold(0.0, f32::max) <= 0.25);
    }

    #[test]
    fn threads_do_not_matter() {
        let with = |threads| {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| lit_room(&[])).iter().map(|s| s.colours.clone()).collect::<Vec<_>>()
        };
        assert_eq!(with(1), with(3));
    }
}
