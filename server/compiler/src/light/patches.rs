//! Patches: the triangles of a surface that lie in one plane and share corners.

use std::collections::HashMap;

use glam::Vec3;

use crate::model::Surface;

/// Normals of one patch agree in units of this.
const NORMAL_STEP: f32 = 0.01;

/// The triangles of each patch, ascending. Triangles without area are in none.
pub(super) fn patches(surface: &Surface) -> Vec<Vec<u32>> {
    let mut known: HashMap<([u32; 3], [i8; 3]), u32> = HashMap::new();
    let mut above: Vec<u32> = (0..surface.triangles.len() as u32).collect();
    let mut with_area = Vec::with_capacity(above.len());
    for index in 0..surface.triangles.len() as u32 {
        let Some(corners) = surface.corners_of(index as usize) else { continue };
        let Some(normal) = normal(corners) else { continue };
        let turned = (normal / NORMAL_STEP).to_array().map(|part| part.round() as i8);
        for corner in corners {
            // Adding zero removes the minus sign of zero.
            let place = (corner + 0.0).to_array().map(f32::to_bits);
            let other = *known.entry((place, turned)).or_insert(index);
            join(&mut above, other, index);
        }
        with_area.push(index);
    }
    let mut patches: Vec<Vec<u32>> = Vec::new();
    let mut numbers: HashMap<u32, usize> = HashMap::new();
    for index in with_area {
        let number = *numbers.entry(root(&mut above, index)).or_insert(patches.len());
        if number == patches.len() {
            patches.push(Vec::new());
        }
        patches[number].push(index);
    }
    patches
}

/// The unit normal of a triangle. None without an area, or when a corner is not finite.
pub(super) fn normal([a, b, c]: [Vec3; 3]) -> Option<Vec3> {
    (b - a).cross(c - a).try_normalize()
}

fn root(above: &mut [u32], index: u32) -> u32 {
    let mut at = index as usize;
    while above[at] != at as u32 {
        above[at] = above[above[at] as usize];
        at = above[at] as usize;
    }
    at as u32
}

fn join(above: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(above, a), root(above, b));
    above[a.max(b) as usize] = a.min(b);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SurfaceMaterial;

    #[test]
    fn a_patch_is_flat_and_in_one_piece() {
        let quad = |a: Vec3, u: Vec3, v: Vec3| [[a, a + u, a + u + v], [a, a + u + v, a + v]];
        let flat = [[Vec3::ZERO, Vec3::X, Vec3::X * 2.0]];
        let triangles = [
            quad(Vec3::ZERO, Vec3::Z, Vec3::X).as_slice(),
            &flat,
            &quad(Vec3::ZERO, Vec3::Y, Vec3::Z),
            &quad(Vec3::Z, Vec3::Z, Vec3::X),
            &quad(Vec3::Z * 5.0, Vec3::Z, Vec3::X),
        ]
        .concat();
        let surface = Surface::of_triangles(&triangles, SurfaceMaterial::opaque([255; 3]));
        assert_eq!(patches(&surface), [vec![0, 1, 5, 6], vec![3, 4], vec![7, 8]]);
    }
}
