//! Pictures of all views, side by side.

use std::path::Path;

use anyhow::Context;
use sightline_cli::progress::Progress;
use sightline_client::bench::{self, DepthAgreement, DepthFault, RayCaster, Views};
use sightline_renderer::{Camera, Frame, Mode, Renderer};
use sightline_world::World;

use crate::cli::picture;

/// Marks pixels that show something too far away.
const RED: u32 = 0x00ff_2020;
/// Marks pixels that show something where there is no triangle.
const BLUE: u32 = 0x0020_80ff;
/// The factor by which differences are exaggerated.
const STRONGER: u32 = 8;

/// What pictures are made of.
pub struct Gallery<'a> {
    /// The world that is drawn.
    pub world: &'a World,
    /// The rays that pictures are compared with.
    pub rays: Option<&'a RayCaster>,
    /// Columns and rows of each panel.
    pub size: (usize, usize),
}

impl Gallery<'_> {
    /// Writes a picture of every view into a folder.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, views: &Views, folder: &Path, progress: &Progress) -> anyhow::Result<()> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
        let spawns =
            views.spawns.iter().enumerate().map(|(i, view)| (format!("spawn-{i:03}"), view));
        let path = views.path.iter().enumerate().map(|(i, view)| (format!("path-{i:04}"), view));
        let count = views.spawns.len() + views.path.len();
        for (i, (name, camera)) in spawns.chain(path).enumerate() {
            let panels = self.panels(camera);
            let panels: Vec<_> = panels.iter().map(|panel| (self.size.0, &panel[..])).collect();
            picture::save(&folder.join(name + ".png"), &panels)?;
            progress.show("pictures", (i + 1) as f32 / count as f32);
        }
        Ok(())
    }

    fn panels(&self, camera: &Camera) -> Vec<Vec<u32>> {
        let [orthogonal, perspective] =
            [Mode::Orthogonal, Mode::Perspective].map(|mode| self.draw(mode, camera));
        let difference = orthogonal.colour.iter().zip(&perspective.colour);
        let difference = difference.map(|(&a, &b)| strong(a, b)).collect();
        let marked = self.rays.map(|rays| {
            let (_, faults) =
                DepthAgreement::of(&orthogonal, camera, rays, self.world.octree.voxel());
            let mut marked: Vec<u32> = orthogonal.colour.iter().map(|&pixel| grey(pixel)).collect();
            for (i, fault) in faults {
                marked[i] = if fault == DepthFault::Beyond { RED } else { BLUE };
            }
            marked
        });
        let panels = [orthogonal.colour, perspective.colour, difference];
        panels.into_iter().chain(marked).collect()
    }

    fn draw(&self, mode: Mode, camera: &Camera) -> Frame {
        let mut frame = Frame::new(self.size.0, self.size.1);
        let mut renderer = Renderer::default();
        renderer.mode = mode;
        renderer.draw(&self.world.octree, camera, &mut frame);
        frame
    }
}

fn strong(a: u32, b: u32) -> u32 {
    let [red, green, blue] =
        bench::channels(a, b).map(|level| (u32::from(level) * STRONGER).min(255));
    red << 16 | green << 8 | blue
}

fn grey(pixel: u32) -> u32 {
    let sum: u32 = [16, 8, 0].iter().map(|shift| pixel >> shift & 0xff).sum();
    sum / 3 * 0x0001_0101
}
