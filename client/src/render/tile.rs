//! One tile of the picture: the front-to-back walk through the octree, and the mask buffer.

use glam::{Vec3, Vec3A, Vec4};
use sightline_shared::octree::{Cursor, Look, Octree};

use super::{
    shade,
    view::{NEAR, TileView},
};

/// Pixels along each side of a tile: a row's mask is one word.
pub(super) const TILE: usize = 64;

/// A voxel is drawn larger by this part, so that no ray slips between two that share a face.
const SEAM: f32 = 1.0 + 1.0e-4;

/// Colours and depths of a tile, and what is known of each pixel.
pub(super) struct Tile {
    /// Row by row, [`TILE`] pixels each.
    pub(super) colour: Vec<u32>,
    /// Likewise.
    pub(super) depth: Vec<f32>,
    glass: Vec<u32>,
    /// The mask buffer: bit x of word y is set when the pixel is written, or not in the picture.
    covered: [u64; TILE],
    /// Likewise, when glass is in front of the pixel.
    tinted: [u64; TILE],
    /// Rows that are not all covered.
    rows_open: u64,
}

impl Default for Tile {
    fn default() -> Self {
        Self {
            colour: vec![0; TILE * TILE],
            depth: vec![0.0; TILE * TILE],
            glass: vec![0; TILE * TILE],
            covered: [0; TILE],
            tinted: [0; TILE],
            rows_open: 0,
        }
    }
}

impl Tile {
    /// Draws the part of the view that falls into the first columns and rows of this tile.
    pub(super) fn draw(&mut self, octree: &Octree, view: &TileView, [width, height]: [usize; 2]) {
        self.covered = [!low_bits(width); TILE];
        self.covered[height..].fill(!0);
        self.tinted = [0; TILE];
        self.rows_open = low_bits(height);
        if let Some(root) = octree.root() {
            let cube = Cube { centre: view.centre, projected: view.projected };
            Walk { view, tile: self }.consider(root, cube);
        }
        for y in 0..height {
            self.finish_row(view, y, low_bits(width));
        }
    }

    /// Puts the sky where nothing is, and glass over what is behind it.
    fn finish_row(&mut self, view: &TileView, y: usize, inside: u64) {
        // Pixels outside the picture count as covered, and keep it so.
        for x in bits(!self.covered[y]) {
            self.colour[y * TILE + x] = shade::sky(view.ray(x, y).into());
            self.depth[y * TILE + x] = f32::INFINITY;
        }
        for x in bits(self.tinted[y] & inside) {
            let pixel = &mut self.colour[y * TILE + x];
            *pixel = shade::through_glass(*pixel, self.glass[y * TILE + x]);
        }
    }

    /// Whether a pixel of the rectangle is not covered.
    fn is_open(&self, area: &Rectangle) -> bool {
        self.covered[area.top..=area.bottom].iter().any(|row| !row & area.columns != 0)
    }
}

/// Some columns (as bits) of some rows, both ends included.
struct Rectangle {
    columns: u64,
    top: usize,
    bottom: usize,
}

impl Rectangle {
    const ALL: Self = Self { columns: !0, top: 0, bottom: TILE - 1 };

    /// The pixels whose centres lie within bounds in pixels: least x, greatest x, least y,
    /// greatest y.
    fn within([left, right, top, bottom]: [f32; 4]) -> Option<Self> {
        let (left, right) = (first_from(left), first_from(right));
        let (top, bottom) = (first_from(top), first_from(bottom));
        let columns = low_bits(right) & !low_bits(left);
        (left < right && top < bottom).then(|| Self { columns, top, bottom: bottom - 1 })
    }
}

/// The first pixel at or behind a coordinate; [`TILE`] when there is none.
fn first_from(coordinate: f32) -> usize {
    // Casting rounds towards zero, and in this form that is upwards.
    TILE - (TILE as f32 - coordinate.max(0.0)).max(0.0) as usize
}

fn low_bits(count: usize) -> u64 {
    if count >= 64 { !0 } else { (1 << count) - 1 }
}

/// The places of the ones.
fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (word != 0).then(|| word.trailing_zeros() as usize)?;
        word &= word - 1;
        Some(place)
    })
}

/// Where a node is.
#[derive(Clone, Copy)]
struct Cube {
    /// Relative to the eye.
    centre: Vec3A,
    projected: Vec4,
}

struct Walk<'a> {
    view: &'a TileView,
    tile: &'a mut Tile,
}

impl Walk<'_> {
    /// Draws a node unless it is out of view or covered.
    fn consider(&mut self, node: Cursor<'_>, cube: Cube) {
        let pattern = &self.view.patterns[usize::from(node.level())];
        let (z, reach) = (cube.projected.z, pattern.reach.z);
        if z + reach < NEAR {
            return;
        }
        let area = if z - reach >= NEAR {
            match Rectangle::within(pattern.bounds(cube.projected)) {
                Some(area) => area,
                None => return,
            }
        } else if self.is_beside(&cube, pattern.reach) {
            return;
        } else {
            Rectangle::ALL
        };
        if !self.tile.is_open(&area) {
            return;
        }
        if node.is_leaf() || z > pattern.small_from {
            self.fill(&cube, pattern.half, node.look(), &area);
        } else {
            self.descend(&cube, node);
        }
    }

    /// Whether a node that is partly nearer than [`NEAR`] lies beside all lines of sight.
    fn is_beside(&self, cube: &Cube, reach: Vec4) -> bool {
        let last = (TILE - 1) as f32;
        let [x, y, z, _] = cube.projected.to_array();
        let far = z + reach.z;
        x + reach.x < 0.0
            || y + reach.y < 0.0
            || x - reach.x > last * far
            || y - reach.y > last * far
    }

    /// Goes through the octants, the one towards the eye first: among octants that differ in one
    /// axis only, the nearer one always comes before the other.
    fn descend(&mut self, cube: &Cube, node: Cursor<'_>) {
        let pattern = &self.view.patterns[usize::from(node.level())];
        let nearest = cube.centre.cmplt(Vec3A::ZERO).bitmask() as u8;
        for octant in (0..8).map(|order| order ^ nearest) {
            let Some(child) = node.child(octant) else { continue };
            let octant = usize::from(octant);
            let cube = Cube {
                centre: cube.centre + pattern.octants[octant],
                projected: cube.projected + pattern.octants_projected[octant],
            };
            self.consider(child, cube);
            if self.tile.rows_open == 0 {
                return;
            }
        }
    }

    /// Writes the pixels whose lines of sight meet the node.
    fn fill(&mut self, cube: &Cube, half: f32, look: &Look, area: &Rectangle) {
        let half = half * SEAM;
        if cube.centre.abs().max_element() < half {
            // The eye is inside: better to look out of it than to see nothing.
            return;
        }
        let (low, high) = (cube.centre - half, cube.centre + half);
        let colour = shade::surface(look, Vec3::from(cube.centre));
        for y in area.top..=area.bottom {
            let mut open = area.columns & !self.tile.covered[y];
            if look.is_glass() {
                open &= !self.tile.tinted[y];
            }
            let mut met = 0;
            for x in bits(open) {
                let Some(depth) = entry(self.view.ray(x, y), low, high) else { continue };
                met |= 1 << x;
                if look.is_glass() {
                    self.tile.glass[y * TILE + x] = colour;
                } else {
                    self.tile.colour[y * TILE + x] = colour;
                    self.tile.depth[y * TILE + x] = depth;
                }
            }
            if look.is_glass() {
                self.tile.tinted[y] |= met;
            } else {
                self.tile.cover(y, met);
            }
        }
    }
}

impl Tile {
    fn cover(&mut self, y: usize, met: u64) {
        self.covered[y] |= met;
        if self.covered[y] == !0 {
            self.rows_open &= !(1 << y);
        }
    }
}

/// Where a ray from the eye enters a box, in its own lengths.
fn entry(ray: Vec3A, low: Vec3A, high: Vec3A) -> Option<f32> {
    let inverse = ray.recip();
    let (a, b) = (low * inverse, high * inverse);
    let enters = a.min(b).max_element();
    let leaves = a.max(b).min_element();
    (enters <= leaves && leaves > 0.0).then(|| enters.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_lie_within_bounds_when_their_centres_do() {
        let check = |left: f32, right: f32, expected: Option<u64>| {
            let area = Rectangle::within([left, right, 3.0, 3.5]);
            assert_eq!(area.map(|area| area.columns), expected, "{left} to {right}");
        };
        check(0.1, 0.9, None);
        check(0.5, 1.5, Some(0b10));
        check(-7.5, 2.25, Some(0b111));
        check(62.5, 99.0, Some(1 << 63));
        check(-9.0, 1.0e9, Some(!0));
        check(64.0, 65.0, None);
        check(-9.0, -1.0, None);
        check(f32::NEG_INFINITY, f32::INFINITY, Some(!0));
    }
}
