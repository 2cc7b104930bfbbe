//! Models made of boxes: opaque, of one colour, without texture.

use glam::Vec3;
use sightline_compiler::model::{Model, Surface, SurfaceMaterial};
use sightline_world::{Spawn, geometry::Aabb, motion::Body};

/// A model of opaque triangles, with one spawn point for people.
pub fn model(
    title: &str,
    opaque: Vec<[Vec3; 3]>,
    colour: [u8; 3],
    spawn: Vec3,
    speed_max: f32,
) -> Model {
    assert!(!opaque.is_empty() && speed_max > 0.0, "{title}: nothing to walk in");
    let positions = opaque.as_flattened().to_vec();
    let triangles = (0..opaque.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
    let material = SurfaceMaterial { colour, texture: None, glass: false };
    let surface = Surface { positions, uvs: Vec::new(), colours: Vec::new(), triangles, material };
    Model {
        title: title.to_owned(),
        surfaces: vec![surface],
        is_lit: true,
        opaque,
        solids: Vec::new(),
        spawns: vec![Spawn { eye: spawn, yaw: 0.0 }],
        places: Vec::new(),
        body: Body::PERSON,
        speed_max,
        origin: None,
        movers: Vec::new(),
        rooms: Vec::new(),
        nodes: Vec::new(),
        warnings: Vec::new(),
    }
}

/// The twelve triangles of a box, facing outward.
pub fn triangles(of: &Aabb) -> Vec<[Vec3; 3]> {
    let size = of.size();
    let mut triangles = Vec::with_capacity(12);
    for axis in 0..3 {
        let [mut u, mut v, mut across] = [Vec3::ZERO; 3];
        u[(axis + 1) % 3] = size[(axis + 1) % 3];
        v[(axis + 2) % 3] = size[(axis + 2) % 3];
        across[axis] = size[axis];
        for (corner, [u, v]) in [(of.min, [v, u]), (of.min + across, [u, v])] {
            triangles.push([corner, corner + u, corner + u + v]);
            triangles.push([corner, corner + u + v, corner + v]);
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_triangles_of_a_box_enclose_its_volume() {
        let solid = Aabb::new(Vec3::new(1.0, -2.0, 3.0), Vec3::new(2.0, 2.0, 6.0));
        let faces = triangles(&solid);
        assert_eq!(faces.len(), 12);
        // The divergence theorem: outward faces give the positive volume.
        let volume: f32 = faces.iter().map(|[a, b, c]| a.dot(b.cross(*c)) / 6.0).sum();
        assert!((volume - 12.0).abs() < 1e-4, "{volume}");
    }
}
