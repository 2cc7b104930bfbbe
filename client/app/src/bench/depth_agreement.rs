//! How the depths of a picture agree with the ends of rays through the triangles.

use rayon::prelude::*;
use serde::Serialize;
use sightline_renderer::{Camera, Frame};

use super::{BvhKind, RayCaster, rays::PixelRays};

/// Shares of the pixels of a picture that agree with rays, from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DepthAgreement {
    /// The share of pixels that agree.
    pub agreeing: f64,
    /// The share of pixels that show something beyond the end of the ray: holes.
    pub beyond: f64,
    /// The share of pixels that show something where no triangle is near.
    pub before: f64,
    /// The share of pixels whose depth along the ray is within the tolerance. It is less than
    /// `agreeing`: a ray that grazes a surface meets its voxels long before the surface itself.
    pub along: f64,
}

/// How a pixel disagrees with rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthFault {
    /// It shows something beyond the end of the ray.
    Beyond,
    /// It shows something where no triangle is near.
    Before,
}

impl DepthAgreement {
    /// Compares a frame of voxels with an edge of `voxel` metres. The tolerance is the diagonal of
    /// a voxel. Where a pixel spans more than a voxel, it is the diagonal of a cube as wide as the
    /// pixel. A pixel agrees
    ///
    /// * when it shows nothing beyond the end of its ray, or of the ray of one of its eight
    ///   neighbours: at an edge, either side is right;
    /// * and when a triangle is within the tolerance of what it shows.
    ///
    /// Also returns the pixels that disagree, by index.
    pub fn of(
        frame: &Frame,
        camera: &Camera,
        rays: &RayCaster,
        voxel: f32,
    ) -> (Self, Vec<(usize, DepthFault)>) {
        let (width, height) = (frame.width(), frame.height());
        let mut traced = vec![0.0; width * height];
        rays.trace(BvhKind::Bvh2, camera, width, &mut traced);
        let lens = PixelRays::new(camera, width, height);
        let tolerance = |depth: f32| 3f32.sqrt() * voxel.max(depth * lens.pixel);
        let is_along =
            |shown: f32, end: f32| shown == end || (shown - end).abs() <= tolerance(shown.min(end));
        let look = |i: usize| {
            let shown = frame.depth[i];
            let is_within = |end: f32| shown <= end + tolerance(end);
            if !is_within(traced[i]) && !around(i, width, height).any(|j| is_within(traced[j])) {
                return Some((i, DepthFault::Beyond));
            }
            if is_along(shown, traced[i]) || !shown.is_finite() {
                return None;
            }
            let point = lens.eye + lens.ray(i % width, i / width) * shown;
            (!rays.is_near(point.into(), tolerance(shown))).then_some((i, DepthFault::Before))
        };
        let faults: Vec<(usize, DepthFault)> =
            (0..frame.depth.len()).into_par_iter().filter_map(look).collect();
        assert!(faults.len() <= frame.depth.len(), "a pixel has one fault at most");
        let pixels = frame.depth.len().max(1) as f64;
        let part =
            |which| faults.iter().filter(|(_, fault)| *fault == which).count() as f64 / pixels;
        let (beyond, before) = (part(DepthFault::Beyond), part(DepthFault::Before));
        let along = frame.depth.iter().zip(&traced);
        let along = along.filter(|&(&shown, &end)| is_along(shown, end)).count();
        let agreeing = 1.0 - beyond - before;
        (Self { agreeing, beyond, before, along: along as f64 / pixels }, faults)
    }
}

/// A pixel and its neighbours.
fn around(i: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let span = |at: usize, side: usize| at.saturating_sub(1)..=(at + 1).min(side - 1);
    let (x, y) = (i % width, i / width);
    span(y, height).flat_map(move |j| span(x, width).map(move |k| j * width + k))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_world::Mesh;

    use super::*;

    /// A wall 5 m ahead that ends in the middle of the picture.
    #[test]
    fn holes_and_ghosts_are_found_and_edges_may_be_off_by_a_pixel() {
        let mesh = Mesh {
            positions: vec![
                Vec3::new(0.0, -99.0, -5.0),
                Vec3::new(0.0, 99.0, -5.0),
                Vec3::new(-999.0, 0.0, -5.0),
            ],
            triangles: vec![[0, 1, 2]],
        };
        let rays = RayCaster::new(&mesh).unwrap();
        let camera = Camera { eye: Vec3::ZERO, yaw: 0.0, pitch: 0.0, fov_y: 0.2 };
        let shown = |edge: usize, depth: f32| {
            let mut frame = Frame::new(40, 30);
            for (i, shown) in frame.depth.iter_mut().enumerate() {
                *shown = if i % 40 < edge { depth } else { f32::INFINITY };
            }
            DepthAgreement::of(&frame, &camera, &rays, 0.06).0
        };
        let good = DepthAgreement { agreeing: 1.0, along: 1.0, ..DepthAgreement::default() };
        assert_eq!(shown(20, 5.05), good);
        assert_eq!(shown(19, 4.95).agreeing, 1.0);
        // Past the edge, the frame shows points in the wall's plane, but outside the wall. There a
        // pixel spans 33 mm, and a voxel's diagonal is 104 mm.
        assert_eq!(shown(30, 5.0).before, 7.0 / 40.0);
        assert_eq!(shown(16, 5.0).beyond, 3.0 / 40.0);
        // All but the column at the edge, whose neighbour shows nothing.
        assert_eq!(shown(20, 5.2).beyond, 19.0 / 40.0);
        assert_eq!(shown(20, 4.8).before, 0.5);
    }
}
