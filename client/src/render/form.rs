//! Orthogonal mode: the form pattern of a node, from which those below it are placed without any
//! projection.
//!
//! Where perspective inside of a node is below a pixel, all its octants look alike: the same
//! hexagon, half as large. Their places follow from the node's own by halving offsets, which is
//! a shift, and adding.
//!
//! **Precision.** Places are in pixels with 16 fractional bits. An offset is rounded once and then
//! shifted, so each level errs by less than 2⁻¹⁵ pixels; sixteen levels make 2⁻¹¹ at most, and half a
//! pixel is far away. A picture is at most 8,192 pixels wide: what is drawn fits into 31 bits.

use glam::{Vec2, Vec3A, Vec4};

use super::{
    hull::Hull,
    lines::{ENTRIES, FIRST, LINES, Lines, PLACES, PLANES, Row},
    view::{BandView, NEAR},
};

/// How far apart, in pixels, a node's front and back may be seen when perspective inside is left
/// out.
const TOLERANCE_PX: f32 = 0.5;

/// Fractional bits of places in pixels.
pub(super) const FRACTION: u32 = 16;

/// The least ratio of nearest to farthest distance with which a node may be drawn in orthogonal mode,
/// for a focal length in pixels: see the paper, box 101. By bisection: where a cube of edge 2 must
/// stand so that its corners (1, 1, -1) and (1, 1, 1) are seen so far apart.
pub(super) fn ratio_min(focal: f32) -> f32 {
    let apart = |z: f32| focal / (z - 1.0) - focal / (z + 1.0);
    let (mut near, mut far) = (1.0 + NEAR, 1.0e5);
    for _ in 0..40 {
        let middle = 0.5 * (near + far);
        if apart(middle) > TOLERANCE_PX {
            near = middle;
        } else {
            far = middle;
        }
    }
    (far - 1.0) / (far + 1.0)
}

/// A place in the picture: pixels with [`FRACTION`] bits.
pub(super) type Place = [i32; 2];

#[inline(always)]
fn fixed(pixels: Vec2) -> Place {
    pixels.to_array().map(|part| (part * (1 << FRACTION) as f32) as i32)
}

/// What all nodes below one have in common.
pub(super) struct Form {
    /// Which axes are mirrored so that lines of sight go upwards along all.
    pub(super) flip: u8,
    /// The bounding box's size.
    size: Place,
    /// From the bounding box's corner to those of the octants, in mirrored order.
    octants: [Place; 8],
    /// How much farther away than the cube's nearest corner those of the octants are, in metres.
    deeper: [f32; 8],
    /// The edges in pixels, mirrored.
    pub(super) edges: [Vec2; 3],
    /// Likewise, how much deeper an edge's far end lies.
    pub(super) edges_deep: [f32; 3],
    /// By how much places may be wrong, in pixels: nodes are drawn larger by that.
    pub(super) slack: Vec2,
}

/// A node in the orthogonal mode: the index, how many levels below the form's own node, the
/// bounding box's corner, the distance of the nearest corner.
#[derive(Clone, Copy, Default)]
pub(super) struct Flat {
    pub(super) index: u32,
    pub(super) below: u32,
    pub(super) at: Place,
    pub(super) depth: f32,
}

impl Form {
    /// The form of a node, and its own place.
    #[inline(always)]
    pub(super) fn new(
        view: &BandView,
        index: u32,
        edge: f32,
        centre: Vec3A,
        projected: Vec4,
    ) -> (Self, Flat) {
        let scale = edge / projected.z;
        let at = Vec2::new(projected.x, projected.y) / projected.z;
        let towards = inclined(centre);
        let flip = towards.cmplt(Vec3A::ZERO).bitmask() as u8;
        let direction = view.project(towards);
        let from = Vec2::new(direction.x, direction.y) / direction.z;
        let sign = |axis: usize| if flip >> axis & 1 == 1 { -1.0 } else { 1.0 };
        let edges = [0, 1, 2].map(|axis| {
            let step = view.axes[axis];
            (Vec2::new(step.x, step.y) - from * step.z) * (scale * sign(axis))
        });
        let edges_deep = [0, 1, 2].map(|axis| view.axes[axis].z * edge * sign(axis));
        let half = edges.iter().map(|edge| edge.abs()).sum::<Vec2>() * 0.5;
        let depth_half = edges_deep.iter().map(|deep| deep.abs()).sum::<f32>() * 0.5;
        let octants = std::array::from_fn(|octant| {
            let part = |axis: usize| {
                let far = Vec2::splat((octant >> axis & 1) as f32);
                let edge = edges[axis];
                Vec2::select(edge.cmplt(Vec2::ZERO), edge * (far - 1.0), edge * far) * 0.5
            };
            fixed(part(0) + part(1) + part(2))
        });
        let deeper = std::array::from_fn(|octant| {
            (0..3).map(|axis| edges_deep[axis] * (octant >> axis & 1) as f32 * 0.5).sum()
        });
        let form = Self {
            flip,
            size: fixed(half * 2.0),
            octants,
            deeper,
            edges,
            edges_deep,
            slack: half * (depth_half / (projected.z - depth_half)) + 1.0 / 64.0,
        };
        let nearest = projected.z - edges_deep.iter().sum::<f32>() * 0.5;
        (form, Flat { index, below: 0, at: fixed(at - half), depth: nearest })
    }

    /// The columns and rows that a node's bounding box meets.
    #[inline(always)]
    pub(super) fn span(&self, node: &Flat, slack: Place) -> [[i32; 2]; 2] {
        [0, 1].map(|axis| {
            let low = node.at[axis].saturating_sub(slack[axis]);
            let high = low.saturating_add(self.size[axis] >> node.below);
            let high = high.saturating_add(2 * slack[axis]);
            [low.saturating_add((1 << FRACTION) - 1) >> FRACTION, (high >> FRACTION) + 1]
        })
    }

    /// How long the longest edge of a cell so many levels below looks, in pixels.
    #[inline(always)]
    pub(super) fn cell_px(&self, levels: u32) -> f32 {
        let longest = self.edges.iter().map(|edge| edge.length_squared()).fold(0.0, f32::max);
        longest.sqrt() * halved(levels)
    }

    /// The slack as a place.
    #[inline(always)]
    pub(super) fn slack_place(&self) -> Place {
        fixed(self.slack)
    }

    /// The place of a node's octant, in mirrored order.
    #[inline(always)]
    pub(super) fn octant(&self, node: &Flat, octant: usize, index: u32) -> Flat {
        let offset = self.octants[octant];
        Flat {
            index,
            below: node.below + 1,
            at: [0, 1].map(|axis| node.at[axis].saturating_add(offset[axis] >> node.below)),
            depth: node.depth + self.deeper[octant] * halved(node.below),
        }
    }
}

/// Two to the power of minus so many.
#[inline(always)]
pub(super) fn halved(times: u32) -> f32 {
    f32::from_bits((127 - times) << 23)
}

/// A direction turned by a thousandth where it lies in a plane of two axes, so that no cube is seen
/// exactly along a side.
#[inline(always)]
fn inclined(direction: Vec3A) -> Vec3A {
    let least = Vec3A::splat(direction.abs().max_element() * 1.0e-3);
    let signs = Vec3A::select(direction.cmplt(Vec3A::ZERO), -Vec3A::ONE, Vec3A::ONE);
    direction.abs().max(least) * signs
}

/// How bricks of 4 × 4 × 4 cells below a form look: which cells a pixel's line of sight meets.
#[derive(Default)]
pub(super) struct BrickForm {
    /// Indices of the rows of [`LINES`], for each of [`PLANES`].
    rows: [usize; 3],
    /// Places for each pixel to the right and downwards.
    across: [f32; 3],
    down: [f32; 3],
    /// The place of a line through the bounding box's corner.
    start: [f32; 3],
    /// Places from the first pixel of a block to others, with [`FRACTION`] bits.
    steps: [[i32; 8]; 3],
    steps_down: [i32; 3],
    /// How much deeper than the nearest corner the centres of octants' first cells lie.
    octants_deeper: [f32; 8],
    /// How much deeper than the first the other cells of an octant lie.
    cells_deeper: [f32; 8],
}

impl BrickForm {
    /// The form of the bricks whose cells are so many levels below the form's own node.
    #[inline(always)]
    pub(super) fn new(form: &Form, levels: u32) -> Self {
        let scale = halved(levels);
        let cells = form.edges.map(|edge| edge * scale);
        let corner: Vec2 = form.edges.iter().map(|edge| -edge.min(Vec2::ZERO)).sum();
        let corner = corner * (4.0 * scale);
        let share = [0, 1, 2].map(|axis| cells[(axis + 1) % 3].perp_dot(cells[(axis + 2) % 3]));
        let sign = if share[0] + share[1] + share[2] < 0.0 { -1.0 } else { 1.0 };
        let mut brick = Self::default();
        for (plane, [first, second]) in PLANES.into_iter().enumerate() {
            let third = cells[3 - first - second];
            let (along, up) = (share[first] * sign, share[second] * sign);
            let both = (along + up).max(f32::MIN_POSITIVE);
            // The grid is 4 · both wide, and is drawn wider by the slack on both sides.
            let slack = form.slack.x * third.y.abs() + form.slack.y * third.x.abs();
            let wide = 4.0 * both + 2.0 * slack;
            let per_unit = PLACES as f32 * sign / wide;
            brick.across[plane] = third.y * per_unit;
            brick.down[plane] = -third.x * per_unit;
            let nearest = (4.0 * up + slack) / wide * PLACES as f32 + FIRST as f32;
            brick.start[plane] =
                nearest - corner.x * brick.across[plane] - corner.y * brick.down[plane];
            brick.rows[plane] = Lines::index(plane, along / both);
            let across = whole(brick.across[plane]);
            for x in 1..8 {
                brick.steps[plane][x] = brick.steps[plane][x - 1].wrapping_add(across);
            }
            brick.steps_down[plane] = whole(brick.down[plane]);
        }
        let deep = form.edges_deep.map(|deep| deep * scale);
        for octant in 0..8 {
            let at = |axis: usize| (octant >> axis & 1) as f32;
            let deeper: f32 = (0..3).map(|axis| deep[axis] * at(axis)).sum();
            brick.octants_deeper[octant] = 2.0 * deeper + 0.5 * (deep[0] + deep[1] + deep[2]);
            brick.cells_deeper[octant] = deeper;
        }
        brick
    }

    /// The outline of a brick, which may be a single cell.
    #[inline(always)]
    pub(super) fn outline(&self, brick: &Flat) -> Hull {
        let unit = 1.0 / (1 << FRACTION) as f32;
        let [x, y] = brick.at.map(|part| part as f32 * unit);
        Hull::of_bands([0, 1, 2].map(|plane| {
            let (across, down) = (self.across[plane], self.down[plane]);
            let start = self.start[plane] - FIRST as f32 - x * across - y * down;
            [across, down, start].map(|part| part / PLACES as f32)
        }))
    }

    /// How much deeper than the nearest corner a brick's centre lies.
    #[inline(always)]
    pub(super) fn middle_deeper(&self) -> f32 {
        0.5 * (self.deeper(0) + self.deeper(63))
    }

    /// How much deeper than the nearest corner a cell's centre lies.
    #[inline(always)]
    pub(super) fn deeper(&self, cell: usize) -> f32 {
        self.octants_deeper[cell >> 3 & 7] + self.cells_deeper[cell & 7]
    }

    /// The rows of [`LINES`].
    #[inline(always)]
    pub(super) fn rows(&self) -> [&'static Row; 3] {
        let lines = &*LINES;
        self.rows.map(|row| lines.row(row))
    }

    /// Where, in the rows, the line of sight through a block's first pixel lies.
    #[inline(always)]
    pub(super) fn places(&self, brick: &Flat, block: [i32; 2]) -> [i32; 3] {
        let unit = 1.0 / (1 << FRACTION) as f32;
        let [x, y] = [0, 1]
            .map(|axis| (block[axis] << FRACTION).saturating_sub(brick.at[axis]) as f32 * unit);
        [0, 1, 2]
            .map(|plane| whole(x * self.across[plane] + y * self.down[plane] + self.start[plane]))
    }

    /// The places of a line of pixels further down.
    #[inline(always)]
    pub(super) fn line(&self, places: [i32; 3], y: usize) -> [i32; 3] {
        [0, 1, 2]
            .map(|plane| places[plane].wrapping_add(self.steps_down[plane].wrapping_mul(y as i32)))
    }

    /// The cells that the line of sight through a pixel of a line meets.
    #[inline(always)]
    pub(super) fn cells(&self, rows: &[&Row; 3], line: [i32; 3], x: usize) -> u64 {
        let cells = |plane: usize| {
            let place = line[plane].wrapping_add(self.steps[plane][x]) >> FRACTION;
            rows[plane][(place as u32 as usize).min(ENTRIES - 1)]
        };
        cells(0) & cells(1) & cells(2)
    }
}

/// A number with [`FRACTION`] bits.
#[inline(always)]
pub(super) fn whole(number: f32) -> i32 {
    (number * (1 << FRACTION) as f32) as i32
}
