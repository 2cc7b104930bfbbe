//! A whole layer of voxels: which of them a pixel sees is arithmetic.
//!
//! The layer is what it is, a box one voxel thick. A line of sight that comes in through the side
//! towards the eye sees the voxel where it meets that side's plane: two quotients of numbers that are linear in the
//! pixel. One that comes in through a narrow side sees the voxel where it comes in. So both modes
//! of the renderer show the same voxel, and a layer of any size is drawn at once, however near it is.

use glam::Vec3A;

use super::{hull::Hull, mask::BLOCK, view::BandView};

/// A layer, relative to the eye.
pub(super) struct Layer {
    outline: Hull,
    low: Vec3A,
    high: Vec3A,
    /// Where the first voxel begins along each axis.
    starts: Vec3A,
    /// The two axes along the layer, lower axis first.
    along: [usize; 2],
    /// Voxels for each metre.
    per_metre: f32,
    /// The greatest voxel along each axis.
    last: f32,
    /// Numbers whose quotients by the last are the voxel along the two axes, in the plane towards the
    /// eye: for each pixel to the right, and downwards, and at the picture's corner.
    ratios: [[f32; 3]; 3],
    /// Whether the eye is between the two planes: it sees narrow sides only.
    between: bool,
    /// How far away the first voxel's centre is, and how much farther the next along each axis.
    depth: f32,
    deeper: [f32; 2],
}

/// A node that is a layer: its centre relative to the eye, the centre's depth, half its edge in metres.
pub(super) struct LayerNode {
    pub(super) centre: Vec3A,
    pub(super) depth: f32,
    pub(super) half: f32,
    /// How many levels it is above the leaves.
    pub(super) levels: u32,
}

impl Layer {
    /// The layer of a node across an axis, so many voxels from the lower side.
    #[inline(always)]
    pub(super) fn new(view: &BandView, node: &LayerNode, axis: usize, place: u8) -> Self {
        let side = (1u32 << node.levels) as f32;
        let voxel = node.half * 2.0 / side;
        let (mut low, mut high) = (node.centre - node.half, node.centre + node.half);
        let centre = low[axis] + (f32::from(place) + 0.5) * voxel;
        (low[axis], high[axis]) = (centre - 0.5 * voxel, centre + 0.5 * voxel);
        let seam = view.seam(node.depth);
        (low, high) = (low - seam, high + seam);
        let [u, v] = [[1, 2], [0, 2], [0, 1]][axis];
        let near = if low[axis] > 0.0 { low[axis] } else { high[axis] };
        let per_metre = side / (node.half * 2.0);
        let linear = |number: &dyn Fn(Vec3A) -> f32| {
            [number(view.ray_step[0]), number(view.ray_step[1]), number(view.first_ray)]
        };
        let towards = near.signum();
        // Of two voxels the nearer one covers the seam.
        let starts = node.centre - node.half + Vec3A::splat(seam).copysign(node.centre);
        let voxel_at = |of: usize| {
            let start = starts[of];
            let (reach, start) = (near * per_metre * towards, start * per_metre * towards);
            linear(&|ray: Vec3A| ray[of] * reach - ray[axis] * start)
        };
        let deeper = [u, v].map(|of| view.axes[of].z * voxel);
        let first = (side - 1.0) * 0.5;
        let across = view.axes[axis].z * (centre - node.centre[axis]);
        Self {
            outline: Hull::new(view, low, high),
            low,
            high,
            starts,
            along: [u, v],
            per_metre,
            last: side - 1.0,
            ratios: [voxel_at(u), voxel_at(v), linear(&|ray| ray[axis] * towards)],
            between: low[axis] <= 0.0 && high[axis] >= 0.0,
            depth: node.depth + across - first * (deeper[0] + deeper[1]),
            deeper,
        }
    }

    /// What lines of sight meet it.
    #[inline(always)]
    pub(super) fn outline(&self) -> &Hull {
        &self.outline
    }

    /// Of a line of pixels that begins there, those that are wanted see which voxels, in their order in memory, and how
    /// far away?
    #[inline(always)]
    pub(super) fn voxels(
        &self,
        view: &BandView,
        [x, y]: [usize; 2],
        wanted: &[u8; BLOCK],
    ) -> ([u32; BLOCK], [f32; BLOCK]) {
        let spot =
            self.ratios.map(|[right, down, start]| right * x as f32 + down * y as f32 + start);
        let mut places = [[0.0; BLOCK]; 2];
        let mut outside = 0;
        let end = self.last + 1.0;
        for i in 0..BLOCK {
            let [u, v, by] = [0, 1, 2].map(|k| spot[k] + self.ratios[k][0] * i as f32);
            let by = 1.0 / by;
            let (u, v) = (u * by, v * by);
            let inside = (u >= 0.0) & (u < end) & (v >= 0.0) & (v < end);
            outside |= u8::from(!inside) & wanted[i];
            (places[0][i], places[1][i]) = (u, v);
        }
        if outside != 0 || self.between {
            places = self.through_sides(view, [x, y]);
        }
        self.voxels_at(&places)
    }

    /// Where a line of pixels sees the layer, in voxels along both axes, also through its narrow sides.
    #[inline(never)]
    fn through_sides(&self, view: &BandView, [x, y]: [usize; 2]) -> [[f32; BLOCK]; 2] {
        let mut places = [[0.0; BLOCK]; 2];
        for i in 0..BLOCK {
            let ray = view.ray(x + i, y);
            let (a, b) = (self.low / ray, self.high / ray);
            let enters = a.min(b).max_element();
            for (places, of) in places.iter_mut().zip(self.along) {
                places[i] = (ray[of] * enters - self.starts[of]) * self.per_metre;
            }
        }
        places
    }

    /// The voxels at places along both axes.
    #[inline(always)]
    fn voxels_at(&self, places: &[[f32; BLOCK]; 2]) -> ([u32; BLOCK], [f32; BLOCK]) {
        let mut voxels = [0; BLOCK];
        let mut depths = [0.0; BLOCK];
        for x in 0..BLOCK {
            let [u, v] = [0, 1].map(|i| whole(places[i][x], self.last));
            voxels[x] = spread(u.to_bits() & 0xff | (v.to_bits() & 0xff) << 16);
            let [u, v] = [u, v].map(|number| number - ONES);
            depths[x] = self.depth + u * self.deeper[0] + v * self.deeper[1];
        }
        (voxels, depths)
    }
}

/// The lowest bits of a number of this size count ones.
const ONES: f32 = 12_582_912.0;

/// The whole part of a number that is held between zero and a greatest, and [`ONES`] more.
#[inline(always)]
fn whole(number: f32, last: f32) -> f32 {
    let number = number - 0.5;
    let number = if number > 0.0 { number } else { 0.0 };
    (if number < last { number } else { last }) + ONES
}

/// Two numbers of up to four bits, one of them sixteen bits up, with their bits in turn.
#[inline(always)]
fn spread(both: u32) -> u32 {
    let both = (both | both << 2) & 0x0033_0033;
    let both = (both | both << 1) & 0x0055_0055;
    (both | both >> 15) & 0xff
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_come_in_turn() {
        for i in 0..256u32 {
            let part = |first: u32| (0..4).map(|bit| (i >> (2 * bit + first) & 1) << bit).sum();
            let (low, high): (u32, u32) = (part(0), part(1));
            assert_eq!(spread(low | high << 16), i);
        }
    }

    #[test]
    fn numbers_are_cut_and_held() {
        let cut = |number: f32| whole(number, 7.0).to_bits() & 0xff;
        let numbers = [-3.0, -0.1, 0.2, 0.7, 1.2, 6.9, 7.5, 8.0, 90.0, f32::INFINITY, f32::NAN];
        assert_eq!(numbers.map(cut), [0, 0, 0, 0, 1, 6, 7, 7, 7, 7, 0]);
    }
}
