//! The form pattern of a node, by which nodes below it are placed without projection (Dell 2012,
//! Figs. 20 to 22).
//!
//! Without perspective inside of a node, all its octants look alike: the same hexagon, half as
//! large. Their places follow from the node's own by adding offsets, which a shift halves from
//! level to level. A point deeper than the node's centre by a share e of its depth is seen nearer
//! to the centre, by the factor 1 / (1 + e). The product (1 - e) (1 + e²) (1 + e⁴) stands for it,
//! so places are right to the order of e⁸, and sizes to the order of e.
//!
//! **Precision.** Places are in pixels with 16 fractional bits. An offset is rounded once and then
//! shifted, so each level errs by less than 2⁻¹⁵ pixels. Sixteen levels err by at most 2⁻¹¹, far
//! less than half a pixel. A picture is at most 8,192 pixels wide, so places fit into 31 bits.

use glam::{Vec2, Vec3A, Vec4};

use super::{
    SIDE_MAX,
    lines::{CellRow, ENTRIES, FIRST, Lines, PLACES, PLANES},
    margins::SPARE_PX,
    view::BandView,
};

/// Fractional bits of places in pixels.
pub(super) const FRACTION: u32 = 16;

const _: () = assert!(SIDE_MAX < 1 << (30 - FRACTION), "places fit into 31 bits");

/// A place in the picture: pixels with [`FRACTION`] fractional bits.
pub(super) type ScreenPoint = [i32; 2];

#[inline(always)]
fn fixed(pixels: Vec2) -> ScreenPoint {
    pixels.to_array().map(|part| (part * (1 << FRACTION) as f32) as i32)
}

/// The form pattern of a node: what all nodes below it have in common.
pub(super) struct Form {
    /// The level of the form's own node.
    pub(super) level: u8,
    /// Where the node's centre is seen, in pixels.
    middle: Vec2,
    /// One over the depth of the node's centre.
    depth_inverse: f32,
    /// The size of the bounding box.
    size: ScreenPoint,
    /// From the least corner of the bounding box to those of the octants.
    octants: [ScreenPoint; 8],
    /// From the node's centre to those of the octants, in metres. The last number is how much
    /// deeper they lie.
    octants_centres: [Vec4; 8],
    /// Half the edge, in metres.
    pub(super) half: f32,
    /// The longest edge, in pixels.
    edge_px: f32,
    /// Half the size of the bounding box, and what perspective inside may add to it, in pixels.
    reach: Vec2,
}

/// A node in orthogonal mode.
#[derive(Clone, Copy, Default)]
pub(super) struct OrthoNode {
    /// The index among the inner nodes, or among the leaves at the octree's depth.
    pub(super) index: u32,
    /// How many levels it is below the form's own node.
    pub(super) below: u32,
    /// Whether its form is a fine one.
    pub(super) fine: bool,
    /// Whether nothing is in front of the node.
    pub(super) unoccluded: bool,
    /// The least corner of the bounding box in the picture.
    pub(super) at: ScreenPoint,
    /// The centre relative to the eye in metres, and its depth.
    pub(super) centre: Vec4,
}

impl Form {
    /// The form of a node whose centre is seen at `middle`, and the node itself in orthogonal mode.
    #[inline(always)]
    pub(super) fn new(
        view: &BandView,
        level: u8,
        index: u32,
        middle: Vec2,
        centre: Vec4,
    ) -> (Self, OrthoNode) {
        let pattern = &view.patterns[usize::from(level)];
        let depth_inverse = 1.0 / centre.w;
        let edges = edges(view, middle, 2.0 * pattern.half * depth_inverse);
        let half = edges.iter().map(|edge| edge.abs()).sum::<Vec2>() * 0.5;
        let octants = std::array::from_fn(|octant| {
            let part = |axis: usize| {
                let edge = edges[axis] * 0.5;
                let is_far = octant >> axis & 1 == 1;
                if is_far { edge.max(Vec2::ZERO) } else { (-edge).max(Vec2::ZERO) }
            };
            fixed(part(0) + part(1) + part(2))
        });
        let deviation = deviation(pattern.reach.z, centre.w);
        let longest = edges.iter().map(|edge| edge.length_squared()).fold(0.0, f32::max);
        let form = Self {
            middle,
            level,
            depth_inverse,
            size: fixed(half * 2.0),
            octants,
            octants_centres: std::array::from_fn(|octant| {
                pattern.octants[octant].extend(pattern.octants_projected[octant].z)
            }),
            half: pattern.half,
            edge_px: longest.sqrt(),
            reach: half * (1.0 + 2.0 * deviation),
        };
        let at = fixed(middle - half);
        (form, OrthoNode { index, below: 0, fine: false, unoccluded: false, at, centre })
    }

    /// The columns and rows that a node's bounding box meets.
    #[inline(always)]
    pub(super) fn span(&self, node: &OrthoNode) -> [[i32; 2]; 2] {
        let middle = self.middle(node);
        let reach = self.reach * halved(node.below) + SPARE_PX;
        let (low, high) = (middle - reach, middle + reach);
        [0, 1].map(|axis| [low[axis].ceil() as i32, (high[axis].floor() as i32).saturating_add(1)])
    }

    /// The longest edge of a node this many levels below, in pixels.
    #[inline(always)]
    pub(super) fn cell_px(&self, levels: u32) -> f32 {
        self.edge_px * halved(levels)
    }

    /// Where the centre of a node is seen, corrected for perspective.
    #[inline(always)]
    pub(super) fn middle(&self, node: &OrthoNode) -> Vec2 {
        let unit = 1.0 / (1 << FRACTION) as f32;
        let middle = [0, 1].map(|axis| {
            node.at[axis].saturating_add(self.size[axis] >> (node.below + 1)) as f32 * unit
        });
        let deeper = node.centre.w * self.depth_inverse - 1.0;
        let square = deeper * deeper;
        let nearer = (1.0 - deeper) * (1.0 + square) * (1.0 + square * square);
        self.middle + (Vec2::from(middle) - self.middle) * nearer
    }

    /// An octant of a node, by the octant's own index.
    #[inline(always)]
    pub(super) fn octant(&self, node: &OrthoNode, octant: usize, index: u32) -> OrthoNode {
        let offset = self.octants[octant];
        OrthoNode {
            index,
            below: node.below + 1,
            fine: node.fine,
            unoccluded: node.unoccluded,
            at: [0, 1].map(|axis| node.at[axis].saturating_add(offset[axis] >> node.below)),
            centre: node.centre + self.octants_centres[octant] * halved(node.below),
        }
    }
}

/// Two to the power of `-times`.
#[inline(always)]
pub(super) fn halved(times: u32) -> f32 {
    debug_assert!(times < 127, "{times} levels");
    f32::from_bits((127 - times) << 23)
}

/// How far edges along the axes reach in the picture, in pixels, for edges at a point that is seen
/// at `from` and has `scale` as the ratio of edge to depth.
#[inline(always)]
fn edges(view: &BandView, from: Vec2, scale: f32) -> [Vec2; 3] {
    view.axes.map(|step| (Vec2::new(step.x, step.y) - from * step.z) * scale)
}

/// The greatest relative difference between the depth of a centre and depths that are at most
/// `reach` away from it.
#[inline(always)]
fn deviation(reach: f32, depth: f32) -> f32 {
    reach / (depth - reach).max(f32::MIN_POSITIVE)
}

/// A direction, turned by a thousandth where it lies in a plane of two axes. So no cube is seen
/// exactly along one of its sides.
#[inline(always)]
fn inclined(direction: Vec3A) -> Vec3A {
    let least = Vec3A::splat(direction.abs().max_element() * 1.0e-3);
    let signs = Vec3A::select(direction.cmplt(Vec3A::ZERO), -Vec3A::ONE, Vec3A::ONE);
    direction.abs().max(least) * signs
}

/// The form of bricks of 4 × 4 × 4 cells: which cells the line of sight through a pixel may meet.
pub(super) struct BrickForm {
    /// Which axes are mirrored so that lines of sight go upwards along all: a bit for each.
    pub(super) flip: u8,
    /// The rows of the look-up table for the slope of the lines, one for each of [`PLANES`].
    pub(super) rows: [&'static CellRow; 3],
    /// By how many entries of a row lines differ from pixel to pixel, to the right and downwards.
    across: [f32; 3],
    down: [f32; 3],
    /// The entry of a line through the brick's centre.
    start: [f32; 3],
    /// Entries from the first pixel of a line to the others, with [`FRACTION`] fractional bits.
    steps: [[i32; 8]; 3],
    steps_down: [i32; 3],
    /// How much deeper than the brick's centre the octants' centres lie, in metres.
    octants_deeper: [f32; 8],
    /// How much deeper than an octant's centre its cells' centres lie, in metres.
    cells_deeper: [f32; 8],
}

impl BrickForm {
    /// The form of the bricks whose cells are `levels` below a node in which depths differ little.
    ///
    /// **Margin.** A brick's centre is placed exactly ([`Form::middle`]). Its cells are moved by
    /// the perspective that is left out. In the node, whose centre is seen at `middle`, depths
    /// differ from the centre's by a share ε at most, and so does the direction of sight. Each of
    /// the two moves a cell by at most ε times half the brick's size in the picture. The look-ups
    /// have a margin of both, so no cell is missed.
    #[inline(always)]
    pub(super) fn new(view: &BandView, half: f32, centre: Vec4, middle: Vec2, levels: u32) -> Self {
        let towards = inclined(Vec3A::from_vec4(centre));
        let flip = towards.cmplt(Vec3A::ZERO).bitmask() as u8;
        let sign = |axis: usize| if flip >> axis & 1 == 1 { -1.0 } else { 1.0 };
        let beside = view.project(towards - Vec3A::from_vec4(centre)) / centre.w;
        let from = middle + Vec2::new(beside.x, beside.y) - middle * beside.z;
        let edge = 2.0 * half * halved(levels);
        let cells = edges(view, from, edge / centre.w);
        let cells = [0, 1, 2].map(|axis| cells[axis] * sign(axis));
        let deep = [0, 1, 2].map(|axis| view.axes[axis].z * edge * sign(axis));
        let reach: f32 = view.axes.iter().map(|axis| axis.z.abs()).sum();
        let deviation = deviation(reach * half, centre.w);
        let corner = -2.0 * (cells[0] + cells[1] + cells[2]);
        let slack = cells.iter().map(|cell| cell.abs()).sum::<Vec2>() * (2.0 * 2.0 * deviation);
        let share = [0, 1, 2].map(|axis| cells[(axis + 1) % 3].perp_dot(cells[(axis + 2) % 3]));
        let sign = if share[0] + share[1] + share[2] < 0.0 { -1.0 } else { 1.0 };
        let mut margin = 0.0f32;
        let (mut across, mut down, mut start) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        let mut slopes = [0; 3];
        for (plane, [first, second]) in PLANES.into_iter().enumerate() {
            let third = cells[3 - first - second];
            let (along, up) = (share[first] * sign, share[second] * sign);
            let both = (along + up).max(f32::MIN_POSITIVE);
            // The grid is four times as wide as `both`.
            margin = margin.max((slack.x * third.y.abs() + slack.y * third.x.abs()) / both);
            let per_unit = (PLACES / 4) as f32 * sign / both;
            (across[plane], down[plane]) = (third.y * per_unit, -third.x * per_unit);
            let nearest = up / both * PLACES as f32 + FIRST as f32;
            start[plane] = nearest - corner.x * across[plane] - corner.y * down[plane];
            slopes[plane] = Lines::index(plane, along / both);
        }
        let lines = Lines::with_margin(margin);
        let cells_deeper: [f32; 8] = std::array::from_fn(|cell| {
            (0..3).map(|axis| deep[axis] * ((cell >> axis & 1) as f32 - 0.5)).sum()
        });
        let steps = |of: f32| std::array::from_fn(|x| whole(of).wrapping_mul(x as i32));
        Self {
            flip,
            rows: slopes.map(|slope| lines.row(slope)),
            steps: across.map(steps),
            steps_down: down.map(whole),
            across,
            down,
            start,
            octants_deeper: cells_deeper.map(|deeper| 2.0 * deeper),
            cells_deeper,
        }
    }

    /// How much deeper than the brick's centre a cell's centre lies, in metres.
    #[inline(always)]
    pub(super) fn deeper(&self, cell: usize) -> f32 {
        self.octants_deeper[cell >> 3 & 7] + self.cells_deeper[cell & 7]
    }

    /// The entries of the rows for the line of sight through the first pixel of a block, for a
    /// brick whose centre is seen at `middle`.
    #[inline(always)]
    pub(super) fn places(&self, middle: Vec2, block: [usize; 2]) -> [i32; 3] {
        let [x, y] = [block[0] as f32 - middle.x, block[1] as f32 - middle.y];
        [0, 1, 2]
            .map(|plane| whole(x * self.across[plane] + y * self.down[plane] + self.start[plane]))
    }

    /// The entries for the first pixel of a line, `y` lines further down.
    #[inline(always)]
    pub(super) fn line(&self, places: [i32; 3], y: usize) -> [i32; 3] {
        [0, 1, 2]
            .map(|plane| places[plane].wrapping_add(self.steps_down[plane].wrapping_mul(y as i32)))
    }

    /// The cells that the line of sight through a pixel of a line may meet: a bit for each.
    #[inline(always)]
    pub(super) fn cells(&self, line: [i32; 3], x: usize) -> u64 {
        let cells = |plane: usize| {
            let place = line[plane].wrapping_add(self.steps[plane][x]) >> FRACTION;
            self.rows[plane][(place as u32 as usize).min(ENTRIES - 1)]
        };
        cells(0) & cells(1) & cells(2)
    }
}

/// A number with [`FRACTION`] fractional bits. It saturates where it does not fit.
#[inline(always)]
pub(super) fn whole(number: f32) -> i32 {
    (number * (1 << FRACTION) as f32) as i32
}
