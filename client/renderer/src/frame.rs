//! A picture: colours, depths and materials of its pixels.

use glam::Vec3;
use sightline_world::octree::Octree;

use super::{mask::BLOCK, panes::Panes, parallel};

/// No side of a frame is longer, in pixels. Colours and depths of the largest frame take 512 MiB.
pub const SIDE_MAX: usize = 8192;

/// A picture: for each pixel the colour, the depth and the material of what it shows.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Frame {
    pub(super) width: usize,
    pub(super) height: usize,
    /// sRGB as 0x00RRGGBB, row by row from the top.
    pub colour: Vec<u32>,
    /// The distance along the camera's direction in metres, row by row from the top; infinite in
    /// the sky. Whatever is drawn over the building makes a pixel nearer, never farther.
    pub depth: Vec<f32>,
    /// The index in [`Octree::materials`] of the opaque voxel that each pixel shows, row by row
    /// from the top. It has no meaning in the sky.
    pub material_ids: Vec<u16>,
    /// An upper bound of the depths in each block of pixels, row by row from the top.
    pub(super) farthest: Vec<f32>,
    /// The glass in front of what the pixels show.
    pub(super) panes: Panes,
}

impl Frame {
    /// A black picture. A side longer than [`SIDE_MAX`] is cut to it.
    pub fn new(width: usize, height: usize) -> Self {
        let mut frame = Self::default();
        frame.resize(width, height);
        frame
    }

    /// Changes the size. The picture turns black when the size differs.
    pub fn resize(&mut self, width: usize, height: usize) {
        let (width, height) = (width.min(SIDE_MAX), height.min(SIDE_MAX));
        if (width, height) != (self.width, self.height) {
            (self.width, self.height) = (width, height);
            self.colour = vec![0; width * height];
            self.depth = vec![f32::INFINITY; width * height];
            self.material_ids = vec![u16::MAX; width * height];
            self.farthest = vec![f32::INFINITY; width.div_ceil(BLOCK) * height.div_ceil(BLOCK)];
            self.panes = Panes::default();
        }
    }

    /// Becomes a copy of another picture. Keeps its memory.
    pub fn copy_from(&mut self, other: &Self) {
        (self.width, self.height) = (other.width, other.height);
        self.colour.clone_from(&other.colour);
        self.depth.clone_from(&other.depth);
        self.material_ids.clone_from(&other.material_ids);
        self.farthest.clone_from(&other.farthest);
        self.panes.clone_from(&other.panes);
    }

    /// The outward normal of the surface that a pixel shows; zero in the sky and where the material
    /// has none. The octree must be the one that was drawn.
    pub fn normal(&self, pixel: usize, octree: &Octree) -> Vec3 {
        let is_surface = self.depth[pixel].is_finite();
        let id = usize::from(self.material_ids[pixel]);
        let material = octree.materials.get(id).filter(|_| is_surface);
        material.map_or(Vec3::ZERO, |of| Vec3::from(of.normal.map(f32::from)) / 127.0)
    }

    /// The number of pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Fails when a buffer does not have the frame's size: they are public, and drawing indexes
    /// them by it.
    pub(super) fn check(&self) {
        let pixels = self.width * self.height;
        assert_eq!(self.colour.len(), pixels, "colours of {} × {}", self.width, self.height);
        assert_eq!(self.depth.len(), pixels, "depths of {} × {}", self.width, self.height);
        assert_eq!(
            self.material_ids.len(),
            pixels,
            "materials of {} × {}",
            self.width,
            self.height
        );
    }

    /// Becomes a picture that was drawn twice as wide and high, at half its resolution. Colours are
    /// means of four pixels; depth and material are those of the nearest of the four.
    pub(super) fn downsample(&mut self, fine: &mut Self) {
        assert_eq!([2 * self.width, 2 * self.height], [fine.width, fine.height]);
        self.panes = Panes { finer: true, ..std::mem::take(&mut fine.panes) };
        let (width, fine) = (self.width, &*fine);
        let [across, fine_across] = [width, fine.width].map(|side| side.div_ceil(BLOCK));
        self.farthest.fill(0.0);
        for (row, blocks) in fine.farthest.chunks(fine_across.max(1)).enumerate() {
            for (column, farthest) in blocks.iter().enumerate() {
                let most = &mut self.farthest[row / 2 * across + column / 2];
                *most = farthest.max(*most);
            }
        }
        let rows = self.colour.chunks_mut(width.max(1));
        let rows = rows.zip(self.depth.chunks_mut(width.max(1)));
        let rows = rows.zip(self.material_ids.chunks_mut(width.max(1)));
        parallel::for_each(rows.collect(), |y, ((colour, depth), material_ids)| {
            for x in 0..width {
                let corner = 2 * y * fine.width + 2 * x;
                let four = [0, 1, fine.width, fine.width + 1].map(|step| corner + step);
                let channel = |shift: u32| {
                    let sum: u32 = four.iter().map(|&i| fine.colour[i] >> shift & 0xff).sum();
                    ((sum + 2) / 4) << shift
                };
                let nearer = |a: usize, b: usize| if fine.depth[b] < fine.depth[a] { b } else { a };
                let nearest = four.into_iter().fold(corner, nearer);
                colour[x] = channel(0) | channel(8) | channel(16);
                (depth[x], material_ids[x]) = (fine.depth[nearest], fine.material_ids[nearest]);
            }
        });
    }
}
