//! A whole layer of voxels in orthogonal mode: which of them a pixel sees is two linear functions.
//!
//! The layer is drawn as what it is, a box one voxel thick. A line of sight that comes in through
//! one of the narrow sides sees the voxel that is nearest in the layer.

use glam::Vec2;

use super::{
    form::{FRACTION, Flat, Form, halved, whole},
    hull::Hull,
    lines::PLANES,
    mask::BLOCK,
};

/// Seen flatter, in voxels for each pixel, a layer is drawn like anything else.
const VOXELS_MAX: f32 = 16.0;

/// Functions of the pixel for a layer, and its outline.
pub(super) struct Layer {
    /// 0 to 1 between opposite sides of the outline, as in [`Hull::of_bands`].
    bands: [[f32; 3]; 3],
    /// The voxel along the two axes, lower axis first: for each pixel to the right, and downwards,
    /// and at the picture's corner.
    voxels: [[f32; 3]; 2],
    steps: [i32; 2],
    steps_down: [i32; 2],
    /// How far away the first voxel's centre is, and how much farther the next along each axis.
    depth: f32,
    deeper: [f32; 2],
    /// The greatest voxel along each axis.
    last: i32,
    /// What mirrors it.
    mirror: [i32; 2],
}

/// Where a block's first pixel, or a line's, lies in the layer.
pub(super) struct Spot {
    voxels: [i32; 2],
}

impl Layer {
    /// The layer across an axis, so many voxels from the lower side, of a node that is so many
    /// levels above the leaves. None when it is seen too flat.
    #[inline(always)]
    pub(super) fn new(
        form: &Form,
        node: &Flat,
        levels: u32,
        axis: usize,
        place: u8,
    ) -> Option<Self> {
        let scale = halved(node.below + levels);
        let edges = form.edges.map(|edge| edge * scale);
        let deep = form.edges_deep.map(|deep| deep * scale);
        let side = (1u32 << levels) as f32;
        let last = (1i32 << levels) - 1;
        let is_mirrored = |axis: usize| form.flip >> axis & 1 == 1;
        let place =
            if is_mirrored(axis) { last - i32::from(place) } else { i32::from(place) } as f32;
        let [low, high] = [[1, 2], [0, 2], [0, 1]][axis];

        let unit = 1.0 / (1 << FRACTION) as f32;
        let corner: Vec2 = edges.iter().map(|edge| -edge.min(Vec2::ZERO)).sum();
        let nearest = Vec2::from(node.at.map(|part| part as f32 * unit)) + corner * side;
        let start = nearest + edges[axis] * place;
        let area = edges[low].perp_dot(edges[high]);
        // A number for each pixel to the right and downwards, and what it is at the corner.
        let linear = |right: f32, down: f32, at_start: f32| {
            [right, down, at_start - right * start.x - down * start.y]
        };
        let along_low = [edges[high].y / area, -edges[high].x / area];
        let along_high = [-edges[low].y / area, edges[low].x / area];
        let steepest = along_low.iter().chain(&along_high).fold(0.0, |a: f32, b| a.max(b.abs()));
        if steepest >= VOXELS_MAX {
            return None;
        }
        let voxels =
            [linear(along_low[0], along_low[1], 0.0), linear(along_high[0], along_high[1], 0.0)];
        let ends = |of: usize| if of == axis { [place, place + 1.0] } else { [0.0, side] };
        let mirror = |axis: usize| if is_mirrored(axis) { last } else { 0 };
        Some(Self {
            bands: bands(&edges, nearest, form.slack, ends),
            steps: voxels.map(|voxel| whole(voxel[0])),
            steps_down: voxels.map(|voxel| whole(voxel[1])),
            voxels,
            depth: node.depth + deep[axis] * (place + 0.5) + 0.5 * (deep[low] + deep[high]),
            deeper: [deep[low], deep[high]],
            last,
            mirror: [mirror(low), mirror(high)],
        })
    }

    /// What lines of sight meet it.
    #[inline(always)]
    pub(super) fn outline(&self) -> Hull {
        Hull::of_bands(self.bands)
    }

    /// Where a block's first pixel lies.
    #[inline(always)]
    pub(super) fn at(&self, x: f32, y: f32) -> Spot {
        let value = |[right, down, start]: [f32; 3]| right * x + down * y + start;
        Spot { voxels: self.voxels.map(|voxel| whole(value(voxel))) }
    }

    /// Where a line's first pixel lies, so many below.
    #[inline(always)]
    pub(super) fn line(&self, corner: &Spot, y: usize) -> Spot {
        let below =
            |i: usize| corner.voxels[i].wrapping_add(self.steps_down[i].wrapping_mul(y as i32));
        Spot { voxels: [below(0), below(1)] }
    }

    /// Which of the layer's voxels, in their order in memory, the pixels of a line see, and how far
    /// away.
    #[inline(always)]
    pub(super) fn line_of_voxels(&self, line: &Spot) -> ([u32; BLOCK], [f32; BLOCK]) {
        let mut voxels = [0; BLOCK];
        let mut depths = [0.0; BLOCK];
        for x in 0..BLOCK {
            let [low, high] = [0, 1].map(|i| {
                let at = line.voxels[i].wrapping_add(self.steps[i].wrapping_mul(x as i32));
                (at >> FRACTION).clamp(0, self.last)
            });
            let places = [low ^ self.mirror[0], high ^ self.mirror[1]].map(|at| spread(at as u32));
            voxels[x] = places[0] | places[1] << 1;
            depths[x] = self.depth + low as f32 * self.deeper[0] + high as f32 * self.deeper[1];
        }
        (voxels, depths)
    }
}

/// A number of up to four bits with zeros between the bits.
#[inline(always)]
fn spread(number: u32) -> u32 {
    let number = (number | number << 2) & 0x33;
    (number | number << 1) & 0x55
}

/// The outline of a box, whose ends along each axis are in edges' lengths from the nearest corner,
/// widened by the slack.
#[inline(always)]
fn bands(
    edges: &[Vec2; 3],
    nearest: Vec2,
    slack: Vec2,
    ends: impl Fn(usize) -> [f32; 2],
) -> [[f32; 3]; 3] {
    let share = [0, 1, 2].map(|axis| edges[(axis + 1) % 3].perp_dot(edges[(axis + 2) % 3]));
    let sign = if share[0] + share[1] + share[2] < 0.0 { -1.0 } else { 1.0 };
    PLANES.map(|[first, second]| {
        let third = edges[3 - first - second] * sign;
        let (along, up) = (share[first] * sign, share[second] * sign);
        let ([first_low, first_high], [second_low, second_high]) = (ends(first), ends(second));
        let slack = slack.x * third.y.abs() + slack.y * third.x.abs();
        let low = second_low * along - first_high * up - slack;
        let high = second_high * along - first_low * up + slack;
        let scale = 1.0 / (high - low).max(f32::MIN_POSITIVE);
        let (across, down) = (third.y * scale, -third.x * scale);
        [across, down, -low * scale - across * nearest.x - down * nearest.y]
    })
}
