//! The carve preview: pictures of a model before and after carving, and of what was cut off.

use std::time::Duration;

use glam::{DVec3, Vec3, Vec3A};
use obvhs::{
    BvhBuildParams,
    bvh2::{Bvh2, builder::build_bvh2_from_tris},
    ray::{Ray, RayHit},
    triangle::Triangle,
};
use rayon::prelude::*;
use sightline_picture::Picture;
use sightline_world::{Mesh, geometry::Axes};

use crate::{
    carve::{self, CarvedModel, Class},
    drawing::{INK, PAPER, write},
};

/// The width of a panel, in pixels.
const WIDTH: u32 = 400;
/// The height of a panel without its caption, in pixels.
const HEIGHT: u32 = 400;
/// The height of a caption, in pixels.
const CAPTION: u32 = 20;
/// The gap between panels, in pixels.
const GAP: u32 = 8;
/// The tangent of half the horizontal field of view, which is 70 degrees.
const HALF_VIEW: f32 = 0.7;
/// Rays along each side of a pixel, both ends included, so that both pixels see an edge between
/// them.
const RAYS: u32 = 3;

const SKY: [f32; 3] = [196.0, 214.0, 232.0];
const AXIAL: [f32; 3] = [216.0, 213.0, 206.0];
const SEMI_AXIAL: [f32; 3] = [188.0, 202.0, 214.0];
const NON_AXIAL: [f32; 3] = [232.0, 212.0, 170.0];
const CAP: [f32; 3] = [74.0, 76.0, 84.0];
/// The colours of cuttings, by number of the unit.
const CUTTINGS: [[f32; 3]; 6] = [
    [214.0, 84.0, 62.0],
    [62.0, 130.0, 190.0],
    [96.0, 160.0, 72.0],
    [208.0, 150.0, 40.0],
    [142.0, 92.0, 172.0],
    [48.0, 160.0, 156.0],
];

/// A point of view, in metres.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// The eye.
    pub eye: Vec3,
    /// The point in the middle of the picture.
    pub look: Vec3,
}

/// Carves the opaque mesh of a world in its own axes and draws it three times, side by side: the
/// model, with non-axial polygons tinted; the carved model with its cuttings in colour; and the
/// carved model alone, with its caps dark.
pub fn draw(mesh: &Mesh, view: &View) -> (Picture, CarvedModel) {
    let corner = |i: u32| mesh.positions[i as usize];
    let opaque: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|t| t.map(corner)).collect();
    let turn = carve::dominant_orientation(&opaque);
    let axes = Axes::turned(turn);
    let own = |p: Vec3| axes.own_exact(p.as_dvec3());
    let triangles: Vec<[DVec3; 3]> = opaque.iter().map(|t| t.map(own)).collect();
    let carved = carve::carve(&triangles, &[], &carve::CarveOptions::default());
    let eye = View { eye: own(view.eye).as_vec3(), look: own(view.look).as_vec3() };
    let panels = [
        ("the model", Scene::model(&carved)),
        ("carved, with its cuttings", Scene::carved(&carved, true)),
        ("carved, without them", Scene::carved(&carved, false)),
    ];
    let width = panels.len() as u32 * (WIDTH + GAP) - GAP;
    let mut picture = Picture::filled(width, HEIGHT + CAPTION, PAPER);
    for (i, (caption, scene)) in (0..).zip(&panels) {
        let left = i * (WIDTH + GAP);
        scene.draw(&eye, left, &mut picture);
        write(&mut picture, left as i32, 6, caption, INK);
    }
    (picture, carved)
}

/// Triangles, each with a colour and the number of its polygon.
struct Scene {
    triangles: Vec<Triangle>,
    materials: Vec<([f32; 3], u32)>,
    bvh: Bvh2,
}

impl Scene {
    fn new<'a>(parts: impl Iterator<Item = (&'a [[DVec3; 3]], [f32; 3])>) -> Self {
        let (mut triangles, mut materials) = (Vec::new(), Vec::new());
        for (number, (part, colour)) in (0..).zip(parts) {
            for corners in part {
                let [v0, v1, v2] = corners.map(|p| Vec3A::from(p.as_vec3()));
                triangles.push(Triangle { v0, v1, v2 });
                materials.push((colour, number));
            }
        }
        let params = BvhBuildParams::medium_build();
        let bvh = build_bvh2_from_tris(&triangles, params, &mut Duration::default());
        Self { triangles, materials, bvh }
    }

    fn model(carved: &CarvedModel) -> Self {
        let kept = carved.polygons.iter().map(|p| (&p.triangles[..], grey(p.class)));
        let cut = carved.cuttings.iter().map(|p| (&p.triangles[..], grey(p.class)));
        Self::new(kept.chain(cut))
    }

    fn carved(carved: &CarvedModel, with_cuttings: bool) -> Self {
        let kept = carved.polygons.iter().map(|p| (&p.triangles[..], grey(p.class)));
        // With the cuttings in place, the caps lie inside the solid.
        let caps = carved.caps.iter().filter(|_| !with_cuttings);
        let caps = caps.map(|a| (&a.triangles[..], CAP));
        let cut = carved.cuttings.iter().filter(|_| with_cuttings).map(|p| {
            let colour = CUTTINGS[p.unit.unwrap_or(0) as usize % CUTTINGS.len()];
            (&p.triangles[..], colour)
        });
        Self::new(kept.chain(caps).chain(cut))
    }

    fn draw(&self, view: &View, left: u32, picture: &mut Picture) {
        let rays = Rays::new(view);
        let rows: Vec<Vec<[u8; 3]>> = (0..HEIGHT)
            .into_par_iter()
            .map(|y| (0..WIDTH).map(|x| self.pixel(&rays, x, y)).collect())
            .collect();
        for (y, row) in (0..).zip(rows) {
            for (x, colour) in (0..).zip(row) {
                if let Some(pixel) = picture.pixel_mut(left + x, CAPTION + y) {
                    *pixel = colour;
                }
            }
        }
    }

    /// The mean of the rays of a pixel; darker where two polygons meet.
    fn pixel(&self, rays: &Rays, x: u32, y: u32) -> [u8; 3] {
        let mut sum = Vec3::ZERO;
        let mut first = None;
        let mut is_edge = false;
        for ray in 0..RAYS * RAYS {
            let (dx, dy) = (ray % RAYS, ray / RAYS);
            let step = |at: u32, part: u32| at as f32 + part as f32 / (RAYS - 1) as f32;
            let (colour, number) = self.seen(rays, step(x, dx), step(y, dy));
            sum += Vec3::from_array(colour);
            is_edge |= *first.get_or_insert(number) != number;
        }
        let mean = sum / (RAYS * RAYS) as f32;
        (mean * if is_edge { 0.8 } else { 1.0 }).to_array().map(|c| c as u8)
    }

    fn seen(&self, rays: &Rays, x: f32, y: f32) -> ([f32; 3], u32) {
        let towards = rays.towards(x, y);
        let ray = Ray::new_inf(rays.eye.into(), towards.into());
        let mut hit = RayHit::none();
        let triangle = |id: usize| self.bvh.primitive_indices[id] as usize;
        if !self
            .bvh
            .ray_traverse(ray, &mut hit, |ray, id| self.triangles[triangle(id)].intersect(ray))
        {
            return (SKY, u32::MAX);
        }
        let index = triangle(hit.primitive_id as usize);
        let Triangle { v0, v1, v2 } = self.triangles[index];
        let normal = Vec3::from((v1 - v0).cross(v2 - v0)).normalize_or_zero();
        let (colour, number) = self.materials[index];
        (colour.map(|c| c * lit(normal)), number)
    }
}

/// The brightness of a face, the same from both sides.
fn lit(normal: Vec3) -> f32 {
    let n = normal.abs();
    0.62 * n.x * n.x + 0.96 * n.y * n.y + 0.8 * n.z * n.z
}

fn grey(class: Class) -> [f32; 3] {
    match class {
        Class::Axial => AXIAL,
        Class::SemiAxial => SEMI_AXIAL,
        Class::NonAxial => NON_AXIAL,
    }
}

/// Rays from the eye through points of a panel.
struct Rays {
    eye: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
}

impl Rays {
    fn new(view: &View) -> Self {
        let forward = (view.look - view.eye).normalize_or(Vec3::NEG_Z);
        let right = forward.cross(Vec3::Y).normalize_or(Vec3::X);
        Self { eye: view.eye, forward, right, up: right.cross(forward) }
    }

    fn towards(&self, x: f32, y: f32) -> Vec3 {
        let (u, v) = (x / WIDTH as f32 * 2.0 - 1.0, 1.0 - y / HEIGHT as f32 * 2.0);
        let tall = HALF_VIEW * HEIGHT as f32 / WIDTH as f32;
        (self.forward + self.right * u * HALF_VIEW + self.up * v * tall).normalize()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::import::glb;
    use sightline_demo_building::arched_floor;

    /// The first two panels show the sky in the same pixels; the third shows more of it.
    #[test]
    fn without_the_cuttings_more_of_the_sky_is_visible() {
        let model = glb::read_slice(&arched_floor().glb, None::<&Path>, "floor").unwrap();
        let positions = model.opaque.concat();
        let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        let mesh = Mesh { triangles: triangles.collect(), positions };
        let view = View { eye: Vec3::new(27.6, 1.5, 3.1), look: Vec3::new(26.36, 1.75, 0.2) };
        let (picture, carved) = draw(&mesh, &view);
        assert_eq!(carved.report.clusters, 8);
        let is_sky = |panel: u32, x: u32, y: u32| {
            picture.pixel(panel * (WIDTH + GAP) + x, CAPTION + y) == SKY.map(|c| c as u8)
        };
        let places = || (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
        assert!(places().all(|(x, y)| is_sky(0, x, y) == is_sky(1, x, y)));
        let count = |panel| places().filter(|&(x, y)| is_sky(panel, x, y)).count();
        let (with, without) = (count(1), count(2));
        assert!(with > 20_000 && without > with + 3_000, "{with} {without}");
    }
}
