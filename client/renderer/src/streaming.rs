//! Which parts of an octree that still arrives a picture shows.
//!
//! Stand-ins fill all space that is missing. So nothing that a picture needs is
//! behind what it does not show: once the branches that it shows are there, it is the picture of
//! the whole octree. Of glass it shows the pane that is nearest to the eye. A node counts as glass
//! when all below is glass, so its stand-in has a pane, too, wherever the node has one.

use std::collections::BTreeMap;

use glam::Vec3;
use sightline_client_core::fetching::ShownBranch;
use sightline_world::octree::pieces::PartialOctree;

use super::{Camera, Frame, view::View};

/// The branches that a picture shows, in ascending order. One pixel of `step`, in one row of `step`,
/// tells two: that of what the pixel shows, and that of the glass before it. The picture must have
/// been drawn of this octree with this camera.
pub fn shown_branches(
    frame: &Frame,
    camera: &Camera,
    octree: &PartialOctree,
    step: usize,
) -> Vec<ShownBranch> {
    let view = View::new(camera, frame.width(), frame.height());
    let voxel = octree.octree().voxel();
    let mut finder = Finder { octree, shown: BTreeMap::new(), runs: Default::default() };
    let step = step.max(1);
    for y in (0..frame.height()).step_by(step) {
        for x in (0..frame.width()).step_by(step) {
            let Some(&opaque) = frame.depth.get(y * frame.width() + x) else { continue };
            let ray = view.ray(x as f32, y as f32);
            let pane = frame.panes.depth_at([x, y]);
            for (layer, depth) in [Some(opaque), pane].into_iter().enumerate() {
                let Some(depth) = depth.filter(|depth| depth.is_finite()) else { continue };
                // A depth is that of the middle of a voxel, or of a node as large as a pixel. The
                // line of sight may pass beside it, and it may belong to the branch next to that of
                // the line.
                let beside = Vec3::splat(voxel + depth / view.focal());
                let point = camera.eye + ray * depth;
                let corners =
                    [point - beside, point + beside].map(|corner| octree.place_of(corner));
                finder.show(layer, corners, depth);
            }
        }
    }
    finder.finish()
}

/// Finds branches by their places. Neighbouring pixels mostly show the same ones.
struct Finder<'a> {
    octree: &'a PartialOctree,
    shown: BTreeMap<u32, f32>,
    /// The last places around what is seen, and around glass, and the least depth since they are
    /// those.
    runs: [Option<([[i32; 3]; 2], f32)>; 2],
}

impl Finder<'_> {
    /// Takes in that places between two corners are shown at a depth.
    fn show(&mut self, layer: usize, corners: [[i32; 3]; 2], depth: f32) {
        let Some(run) = self.runs.get_mut(layer) else { return };
        match run {
            Some((last, nearest)) if *last == corners => *nearest = nearest.min(depth),
            last => {
                let before = last.replace((corners, depth));
                self.note(before);
            }
        }
    }

    fn note(&mut self, run: Option<([[i32; 3]; 2], f32)>) {
        let Some(([low, high], depth)) = run else { return };
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    if let Some(branch) = self.octree.branch_of([x, y, z]) {
                        let nearest = self.shown.entry(branch as u32).or_insert(f32::INFINITY);
                        *nearest = nearest.min(depth);
                    }
                }
            }
        }
    }

    fn finish(mut self) -> Vec<ShownBranch> {
        for run in self.runs {
            self.note(run);
        }
        let shown = self.shown.into_iter();
        shown.map(|(branch, depth)| ShownBranch { branch, depth }).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use sightline_world::octree::{Material, Octree, Voxel, morton};

    use super::*;
    use crate::Renderer;

    /// A wall at z = 0 behind a pane at z = 5, in a cube of 8 m.
    fn walls() -> Octree {
        let of = |z: u32, flags: u8| {
            (0..128 * 128u32).map(move |i| {
                let key = morton(UVec3::new(i % 128, i / 128, z));
                Voxel { key, colour: [200, 90, 40], normal: [0, 0, 127], flags }
            })
        };
        let mut voxels: Vec<Voxel> = of(0, 0).chain(of(80, Material::GLASS)).collect();
        voxels.sort_by_key(|voxel| voxel.key);
        Octree::from_voxels(Vec3::ZERO, 1.0 / 16.0, 7, voxels).unwrap()
    }

    #[test]
    fn what_is_seen_and_the_glass_before_it_are_shown_branches() {
        let whole = walls();
        let pieces = whole.to_pieces();
        let mut partial = PartialOctree::new(&pieces.trunk).unwrap();
        let camera = Camera { eye: Vec3::new(4.0, 4.0, 7.5), yaw: 0.0, pitch: 0.0, fov_y: 1.2 };
        let (mut frame, mut renderer) = (Frame::new(64, 48), Renderer::default());
        let mut rounds = 0;
        loop {
            renderer.draw(partial.octree(), &camera, &mut frame);
            let shown = shown_branches(&frame, &camera, &partial, 1);
            let missing: Vec<usize> = shown
                .iter()
                .map(|shown| shown.branch as usize)
                .filter(|branch| partial.grades_of(*branch) < partial.grades())
                .collect();
            if missing.is_empty() {
                break;
            }
            for branch in missing {
                let grade = usize::from(partial.grades_of(branch));
                partial.grow(branch, &pieces.branches[branch][grade]).unwrap();
            }
            rounds += 1;
        }
        assert!(rounds >= 3, "{rounds}");
        let mut expected = Frame::new(64, 48);
        renderer.draw(&whole, &camera, &mut expected);
        assert!(frame.colour == expected.colour);
        let pane = partial.branch_at(Vec3::new(4.1, 4.1, 5.01)).unwrap();
        let shown = shown_branches(&frame, &camera, &partial, 1);
        assert!(shown.iter().any(|shown| shown.branch as usize == pane), "the pane is shown");
    }
}
