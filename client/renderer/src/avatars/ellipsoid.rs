//! Ellipsoids, drawn as the lines of sight that enter them, eight pixels at a time.

use std::{
    ops::Range,
    sync::atomic::{AtomicBool, Ordering},
};

use glam::{Mat3, Vec3};
use pulp::WithSimd;
use sightline_world::light::ShownLight;

use super::figure::Part;
use crate::{colour, panes::Panes, view::View};

/// The number of pixels that are worked out side by side.
const LANES: usize = 8;

const HAIR: Vec3 = Vec3::new(70.0, 52.0, 40.0);
const EYES: Vec3 = Vec3::new(36.0, 32.0, 34.0);

/// The work on one band. It is a type and not a closure, because only functions without closures
/// are compiled as a whole for each kind of processor.
pub(super) struct FigureBand<'a> {
    /// Near ones first.
    pub(super) parts: &'a [Ellipsoid<'a>],
    pub(super) view: &'a View,
    pub(super) panes: &'a Panes,
    pub(super) width: usize,
    /// The first row of the band.
    pub(super) first: usize,
    pub(super) colour: &'a mut [u32],
    pub(super) depth: &'a mut [f32],
}

impl WithSimd for FigureBand<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let rows = self.colour.chunks_mut(self.width).zip(self.depth.chunks_mut(self.width));
        // The index of the part that each pixel of a row shows, plus one; zero where it shows none.
        let mut shown = vec![0; self.width];
        for (y, (colour, depth)) in (self.first..).zip(rows) {
            let mut drawn = self.width..0;
            for (part, number) in self.parts.iter().zip(1..) {
                let mut row = PixelRow { y, colour, depth, shown: &mut shown };
                let columns = part.draw_row(self.view, self.panes, number, &mut row);
                drawn = drawn.start.min(columns.start)..drawn.end.max(columns.end);
            }
            let mut last = 0;
            for number in shown.get_mut(drawn).unwrap_or_default() {
                if *number != last && *number != 0 {
                    self.parts[*number as usize - 1].seen.store(true, Ordering::Relaxed);
                }
                last = std::mem::take(number);
            }
        }
    }
}

/// A row of the picture, and which part each pixel shows.
struct PixelRow<'a> {
    y: usize,
    colour: &'a mut [u32],
    depth: &'a mut [f32],
    shown: &'a mut [u32],
}

/// A part of a figure as seen from the eye.
pub(super) struct Ellipsoid<'a> {
    /// Set when a pixel shows the part in the end.
    seen: &'a AtomicBool,
    /// The centre relative to the eye, in metres.
    centre: Vec3,
    /// From the world's axes to those in which the ellipsoid is the unit ball.
    to_ball: Mat3,
    /// The colours of skin or clothes, of hair and of eyes, in light without strength.
    colours: [[f32; 3]; 3],
    /// Baked light on each side. Without it, two fixed lamps light the part.
    light: Option<[f32; 6]>,
    is_head: bool,
    /// Least and greatest column, in pixels.
    columns: [f32; 2],
    /// Least and greatest row, in pixels.
    rows: [f32; 2],
    /// The least depth of the part, in metres.
    pub(super) nearest: f32,
}

impl<'a> Ellipsoid<'a> {
    pub(super) fn new(
        view: &View,
        part: &Part,
        light: Option<&ShownLight>,
        seen: &'a AtomicBool,
    ) -> Self {
        let Part { centre, shape, colour, is_head } = *part;
        let axes = shape.transpose();
        let reach = Vec3::new(axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length());
        let (columns, rows) = view.bounds(centre, reach);
        let nearest = view.depth(centre) - view.depth_reach(&shape);
        let (centre, to_ball) = (centre - view.eye, shape.inverse());
        let tint = light.map_or(Vec3::ONE, |light| light.tint);
        let colours = [colour, HAIR, EYES].map(|own| (own * tint).to_array());
        let light = light.map(|light| light.sides);
        Self { seen, centre, to_ball, colours, light, is_head, columns, rows, nearest }
    }

    pub(super) fn is_in(&self, width: usize, height: usize) -> bool {
        let meets = |[min, max]: [f32; 2], side: usize| min < side as f32 && max >= 0.0;
        meets(self.columns, width) && meets(self.rows, height)
    }

    /// Draws a row of the part. Returns the columns that may have changed.
    #[inline(always)]
    fn draw_row(
        &self,
        view: &View,
        panes: &Panes,
        number: u32,
        row: &mut PixelRow,
    ) -> Range<usize> {
        let y = row.y;
        if !(self.rows[0]..=self.rows[1]).contains(&(y as f32)) {
            return row.depth.len()..0;
        }
        let first = self.columns[0].max(0.0).ceil() as usize;
        let last = self.columns[1].min(row.depth.len() as f32 - 1.0);
        let after = (last + 1.0).max(0.0) as usize;
        let step = view.ray_step();
        for from in (first..after).step_by(LANES) {
            let columns = from..after.min(from + LANES);
            let behind = &row.depth[columns.clone()];
            if behind.iter().all(|behind| *behind <= self.nearest) {
                continue;
            }
            let entries = self.entries(view.ray(from as f32, y as f32), step);
            if !behind.iter().zip(entries).any(|(behind, entry)| entry < *behind) {
                continue;
            }
            let ray = view.ray(from as f32, y as f32);
            let colours = match &self.light {
                Some(sides) => self.colours(ray, step, &entries, |normal, square| {
                    colour::baked_outside(sides, normal, 1.0 / square)
                }),
                None => self.colours(ray, step, &entries, |normal, square| {
                    colour::light_outside(normal, 1.0 / square.sqrt())
                }),
            };
            for (x, (entry, colour)) in columns.zip(entries.into_iter().zip(colours)) {
                if entry < row.depth[x] {
                    (row.depth[x], row.shown[x]) = (entry, number);
                    row.colour[x] = panes.over([x, y], entry, colour);
                }
            }
        }
        first..after
    }

    /// Where eight rays from the eye, each a step beside the one before, enter the ellipsoid, in
    /// multiples of each ray; infinite for rays that miss it.
    #[inline(always)]
    fn entries(&self, ray: Vec3, step: Vec3) -> [f32; LANES] {
        let [ray, step, centre] = [ray, step, self.centre].map(|of| (self.to_ball * of).to_array());
        let mut entries = [f32::INFINITY; LANES];
        for (i, entry) in entries.iter_mut().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|axis| ray[axis] + step[axis] * i as f32);
            let a = x * x + y * y + z * z;
            // The point of the ray nearest to the centre. A difference of squares would be too
            // coarse far away.
            let middle = (x * centre[0] + y * centre[1] + z * centre[2]) / a;
            let [u, v, w] =
                [centre[0] - x * middle, centre[1] - y * middle, centre[2] - z * middle];
            let inside = 1.0 - (u * u + v * v + w * w);
            let met = if inside > 0.0 { inside } else { 0.0 };
            let t = middle - (met / a).sqrt();
            *entry = if inside >= 0.0 && t > 0.0 { t } else { f32::INFINITY };
        }
        entries
    }

    /// The colours of the points where eight rays enter the ellipsoid. `light` takes a normal and
    /// the square of its length.
    #[inline(always)]
    fn colours(
        &self,
        ray: Vec3,
        step: Vec3,
        entries: &[f32; LANES],
        light: impl Fn([f32; 3], f32) -> f32,
    ) -> [u32; LANES] {
        let [ray, step, centre] = [ray, step, self.centre].map(|of| (self.to_ball * of).to_array());
        let ([colour, hair, eyes], is_head) = (self.colours, self.is_head);
        let outward = self.to_ball.transpose();
        let rows = [outward.row(0), outward.row(1), outward.row(2)].map(|row| row.to_array());
        let mut packed = [0; LANES];
        for (i, (packed, &t)) in packed.iter_mut().zip(entries).enumerate() {
            let out = [0, 1, 2].map(|axis| (ray[axis] + step[axis] * i as f32) * t - centre[axis]);
            let normal = rows.map(|row| row[0] * out[0] + row[1] * out[1] + row[2] * out[2]);
            let length = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
            let light = light(normal, length);
            // A head looks along -z: its hair is above and behind, its eyes are in front.
            let is_hair = is_head & ((out[1] > 0.5) | ((out[2] > 0.1) & (out[1] > -0.45)));
            let [across, up] = [out[0].abs() - 0.36, out[1] - 0.08];
            let is_eye = is_head & (out[2] < 0.0) & (across * across + up * up < 0.018);
            for channel in 0..3 {
                let plain = if is_hair { hair[channel] } else { colour[channel] };
                let own = if is_eye { eyes[channel] } else { plain };
                let level = if own * light < 255.0 { own * light } else { 255.0 };
                // At this size one step of a float is 1, so its lowest bits hold the whole number.
                // This takes less time than a cast.
                *packed = *packed << 8 | (level + 8_388_608.0).to_bits() & 0xff;
            }
        }
        packed
    }
}
