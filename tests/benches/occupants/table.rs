//! A table for four with chairs, plates, glasses and candles: 5,745 polygons, each given as its
//! bounding box, in metres.

use glam::Vec3;
use sightline_world::geometry::Aabb;

/// The foot of one of the two candlesticks.
pub const CANDLESTICK: Vec3 = Vec3::new(0.24, TOP, 0.03);

/// The height of the table, in metres.
const TOP: f32 = 0.75;

/// All polygons of the scene.
pub fn polygons() -> Vec<Aabb> {
    let mut model = TableModel(Vec::with_capacity(5_745));
    model.table();
    for quarter in 0..4 {
        let (sine, cosine) = (quarter as f32 * std::f32::consts::FRAC_PI_2).sin_cos();
        let out = Vec3::new(cosine, 0.0, sine);
        let aside = Vec3::new(-sine, 0.0, cosine);
        model.chair(out, aside);
        model.lathe(out * 0.42 + Vec3::Y * TOP, 32, &PLATE);
        model.lathe(out * 0.30 + aside * 0.19 + Vec3::Y * TOP, 24, &glass());
    }
    for foot in [CANDLESTICK, Vec3::new(-0.22, TOP, -0.02)] {
        model.lathe(foot, 32, &candlestick());
        model.lathe(foot + Vec3::Y * 0.18, 32, &CANDLE);
        model.lathe(foot + Vec3::Y * 0.34, 16, &WICK);
    }
    assert_eq!(model.0.len(), 5_745);
    model.0
}

/// Pairs of a radius and a height, in metres: a profile for turning.
type Outline = [(f32, f32)];

const PLATE: [(f32, f32); 10] = [
    (0.0, 0.004),
    (0.04, 0.004),
    (0.08, 0.005),
    (0.09, 0.010),
    (0.12, 0.018),
    (0.13, 0.020),
    (0.128, 0.016),
    (0.09, 0.004),
    (0.05, 0.001),
    (0.0, 0.001),
];

const CANDLE: [(f32, f32); 5] =
    [(0.011, 0.0), (0.011, 0.05), (0.0105, 0.1), (0.01, 0.16), (0.0, 0.16)];

const WICK: [(f32, f32); 7] = [
    (0.0008, 0.0),
    (0.0008, 0.001),
    (0.0008, 0.002),
    (0.0008, 0.003),
    (0.0007, 0.004),
    (0.0005, 0.005),
    (0.0, 0.006),
];

/// The profile of a foot, a stem and a bowl, outside and inside.
fn glass() -> Vec<(f32, f32)> {
    let mut outline = vec![(0.0, 0.003), (0.034, 0.003), (0.032, 0.006), (0.008, 0.010)];
    outline.extend((0..6).map(|i| (0.004, 0.02 + i as f32 * 0.012)));
    let bowl = |i: i32| (0.035 * (i as f32 * 0.24).sin().max(0.1), 0.09 + i as f32 * 0.014);
    outline.extend((1..=7).map(bowl));
    outline.extend((2..=7).rev().map(bowl).map(|(radius, height)| (radius - 0.001, height)));
    outline
}

/// The profile of a foot and a turned shaft with a cup.
fn candlestick() -> Vec<(f32, f32)> {
    let mut outline = vec![(0.0, 0.0), (0.05, 0.0), (0.05, 0.006)];
    outline.extend((0..20).map(|i| {
        let swell = 0.004 * (i as f32 * 0.9).sin();
        (0.012 + swell, 0.012 + i as f32 * 0.008)
    }));
    outline.extend([(0.022, 0.172), (0.022, 0.19), (0.012, 0.19), (0.012, 0.18)]);
    outline
}

struct TableModel(Vec<Aabb>);

impl TableModel {
    fn polygon(&mut self, corners: &[Vec3]) {
        self.0.push(Aabb::from_points(corners.iter().copied()));
    }

    /// A top of 6 polygons, four legs, and a cloth of 99.
    fn table(&mut self) {
        self.block(Vec3::new(0.0, TOP - 0.02, 0.0), Vec3::new(0.6, 0.018, 0.6));
        for (x, z) in [(-0.52, -0.52), (-0.52, 0.52), (0.52, -0.52), (0.52, 0.52)] {
            self.block(Vec3::new(x, 0.355, z), Vec3::new(0.03, 0.355, 0.03));
        }
        let corner = |i: u8, j: u8| {
            let (x, z) = (f32::from(i) / 11.0 - 0.5, f32::from(j) / 9.0 - 0.5);
            Vec3::new(x * 1.1, TOP, z * 0.4)
        };
        for (i, j) in (0..11).flat_map(|i| (0..9).map(move |j| (i, j))) {
            self.polygon(&[corner(i, j), corner(i + 1, j + 1)]);
        }
    }

    /// A seat, four legs, two posts and three slats: 60 polygons.
    fn chair(&mut self, out: Vec3, aside: Vec3) {
        let size = |outwards: f32, up: f32, sideways: f32| {
            (out * outwards + aside * sideways).abs() + Vec3::Y * up
        };
        let at = |outwards: f32, up: f32, sideways: f32| {
            out * (0.85 + outwards) + Vec3::Y * up + aside * sideways
        };
        self.block(at(0.0, 0.45, 0.0), size(0.21, 0.02, 0.21));
        for (x, z) in [(-0.18, -0.18), (-0.18, 0.18), (0.18, -0.18), (0.18, 0.18)] {
            self.block(at(x, 0.215, z), size(0.02, 0.215, 0.02));
        }
        for z in [-0.18, 0.18] {
            self.block(at(0.19, 0.70, z), size(0.02, 0.23, 0.02));
        }
        for height in [0.58, 0.72, 0.86] {
            self.block(at(0.19, height, 0.0), size(0.008, 0.03, 0.16));
        }
    }

    /// A box, by its centre and half its size: 6 polygons.
    fn block(&mut self, middle: Vec3, half: Vec3) {
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let mut face = Aabb::new(middle - half, middle + half);
                face.min[axis] = middle[axis] + half[axis] * side;
                face.max[axis] = face.min[axis];
                self.0.push(face);
            }
        }
    }

    /// A profile turned about the vertical axis: a ring of polygons for each of its parts.
    fn lathe(&mut self, foot: Vec3, sides: u16, outline: &Outline) {
        let corner = |(radius, height): (f32, f32), side: u16| {
            let angle = f32::from(side) / f32::from(sides) * std::f32::consts::TAU;
            foot + Vec3::new(radius * angle.cos(), height, radius * angle.sin())
        };
        for pair in outline.windows(2) {
            for side in 0..sides {
                let of = |end: usize, side| corner(pair[end], side);
                self.polygon(&[of(0, side), of(0, side + 1), of(1, side), of(1, side + 1)]);
            }
        }
    }
}
