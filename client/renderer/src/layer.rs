//! A whole layer of voxels, drawn at once: which voxel a pixel shows follows by arithmetic.
//!
//! A layer is a box one voxel thick. A line of sight that enters through the side towards the eye
//! shows the voxel where it meets the plane of that side. Its place is two quotients of numbers
//! that are linear in the pixel. A line of sight that enters through a narrow side shows the voxel
//! where it enters. So all modes of the renderer show the same voxel, at any distance and size.

use glam::Vec3A;

use super::{hull::Hull, mask::BLOCK, view::BandView};

/// A layer of voxels, relative to the eye.
pub(super) struct Layer {
    outline: Hull,
    /// The least and the greatest corner of the layer's box.
    low: Vec3A,
    high: Vec3A,
    /// Where the first voxel begins along each axis.
    starts: Vec3A,
    /// The two axes along the layer, lower axis first.
    along: [usize; 2],
    /// The number of voxels in a metre.
    per_metre: f32,
    /// The index of the last voxel along each axis.
    last: f32,
    /// Three numbers that are linear in the pixel, each as its changes to the right and downwards
    /// and its value at the band's corner. The quotients of the first two by the third are the
    /// place in the plane towards the eye, in voxels along the two axes.
    ratios: [[f32; 3]; 3],
    /// Whether the eye is between the two planes, so that it sees narrow sides only.
    between: bool,
    /// The depth of the first voxel's centre, in metres.
    depth: f32,
    /// How much deeper the next voxel's centre is along each of the two axes, in metres.
    deeper: [f32; 2],
}

/// A node whose voxels form one whole layer.
pub(super) struct LayerNode {
    /// The centre relative to the eye, in metres.
    pub(super) centre: Vec3A,
    /// The depth of the centre, in metres.
    pub(super) depth: f32,
    /// Half the edge, in metres.
    pub(super) half: f32,
    /// How many levels the node is above the leaves.
    pub(super) levels: u32,
}

impl Layer {
    /// The layer of a node across an axis, `place` voxels from the lower side.
    #[inline(always)]
    pub(super) fn new(view: &BandView, node: &LayerNode, axis: usize, place: u8) -> Self {
        debug_assert!(u32::from(place) < 1 << node.levels, "{place} of 2^{} voxels", node.levels);
        debug_assert!(node.levels <= 4, "the index of a voxel has at most eight bits");
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
        // Where two voxels meet, the nearer one covers the seam.
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

    /// The outline of the layer's box.
    #[inline(always)]
    pub(super) fn outline(&self) -> &Hull {
        &self.outline
    }

    /// The voxels that a line of eight pixels shows, as indices in memory, and their depths in
    /// metres. Only the results of `wanted` pixels, which the outline contains, mean anything.
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

    /// Where the lines of sight of eight pixels enter the layer, in voxels along both axes, also
    /// through its narrow sides.
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

    /// The voxels at eight places, given in voxels along both axes.
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

/// At this size one step of a float is 1, so its lowest bits hold a whole number.
const ONES: f32 = 12_582_912.0;

/// The whole part of a number clamped to 0 and `last`, plus [`ONES`].
#[inline(always)]
fn whole(number: f32, last: f32) -> f32 {
    let number = number - 0.5;
    let number = if number > 0.0 { number } else { 0.0 };
    (if number < last { number } else { last }) + ONES
}

/// Interleaves the bits of two numbers of up to four bits, of which the second is shifted up by
/// sixteen.
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
