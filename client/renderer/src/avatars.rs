//! Avatars, drawn as simple figures: a trunk, a head with a face, and a name above.

use std::{
    ops::Range,
    sync::atomic::{AtomicBool, Ordering},
};

use glam::Vec3;
use pulp::WithSimd;
use sightline_world::{
    geometry::Aabb,
    motion::{Body, Pose},
};

use super::{Camera, Frame, band::BAND_ROWS, colour, panes::Panes, parallel, text, view::View};

/// The figure of one avatar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AvatarFigure<'a> {
    /// Where the avatar is, and where it looks.
    pub pose: Pose,
    /// The body of the avatar. The figure stays inside of it.
    pub body: Body,
    /// The colour of the trunk, in sRGB.
    pub colour: [u8; 3],
    /// The name that is written above the head.
    pub name: &'a str,
}

/// The height of the lower edge of a name above the head, in metres.
const NAME_ABOVE_M: f32 = 0.08;

/// A nearer name is left out, in metres: there is no room for it.
const NAME_FROM_M: f32 = 0.3;

/// A name farther away is left out, in metres: it could not be read.
const NAME_WITHIN_M: f32 = 40.0;

/// The number of letters of a name that are shown.
const NAME_LETTERS_MAX: usize = 24;

const FACE: Vec3 = Vec3::new(250.0, 240.0, 228.0);

/// Draws figures and their names into a frame that shows the building from the same camera, where
/// nothing in the frame is nearer. Returns for each figure whether it can be seen: whether at least
/// one pixel shows it.
pub fn draw(frame: &mut Frame, camera: &Camera, figures: &[AvatarFigure]) -> Vec<bool> {
    let seen: Vec<AtomicBool> = figures.iter().map(|_| AtomicBool::new(false)).collect();
    let (width, height) = (frame.width(), frame.height());
    if width == 0 || height == 0 || figures.is_empty() {
        return vec![false; figures.len()];
    }
    let view = View::new(camera, width, height);
    let mut parts: Vec<Ellipsoid> = figures
        .iter()
        .zip(&seen)
        .filter(|(figure, _)| figure.pose.is_finite())
        .flat_map(|(figure, seen)| parts(figure, &view, seen))
        .filter(|part| part.is_in(width, height))
        .collect();
    // Near parts come first, so that parts which they hide need no colouring.
    parts.sort_by(|a, b| a.nearest.total_cmp(&b.nearest));
    let bands = frame.colour.chunks_mut(BAND_ROWS * width);
    let bands = bands.zip(frame.depth.chunks_mut(BAND_ROWS * width));
    let (panes, processor) = (&frame.panes, pulp::Arch::new());
    parallel::for_each(bands.collect(), |band, (colour, depth)| {
        let (parts, view, first) = (&parts[..], &view, band * BAND_ROWS);
        processor.dispatch(FigureBand { parts, view, panes, width, first, colour, depth });
    });
    let mut named: Vec<&AvatarFigure> =
        figures.iter().filter(|figure| figure.pose.is_finite()).collect();
    let depth = |figure: &AvatarFigure| view.depth(figure.pose.eye);
    named.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
    for figure in named {
        name(frame, &view, figure);
    }
    seen.into_iter().map(AtomicBool::into_inner).collect()
}

/// The number of pixels that are worked out side by side.
const LANES: usize = 8;

/// The work on one band. It is a type and not a closure, because only functions without closures
/// are compiled as a whole for each kind of processor.
struct FigureBand<'a> {
    parts: &'a [Ellipsoid<'a>],
    view: &'a View,
    panes: &'a Panes,
    width: usize,
    /// The first row of the band.
    first: usize,
    colour: &'a mut [u32],
    depth: &'a mut [f32],
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

/// A part of a figure: an ellipsoid with upright axes.
struct Ellipsoid<'a> {
    /// Set when a pixel shows the part in the end.
    seen: &'a AtomicBool,
    /// The centre relative to the eye, in metres.
    centre: Vec3,
    radii: Vec3,
    colour: Vec3,
    /// The direction of the face, for a head; zero for a trunk.
    face: Vec3,
    /// Least and greatest column, in pixels.
    columns: [f32; 2],
    /// Least and greatest row, in pixels.
    rows: [f32; 2],
    /// The least depth of the part, in metres.
    nearest: f32,
}

/// The trunk and the head of a figure.
fn parts<'a>(figure: &AvatarFigure, view: &View, seen: &'a AtomicBool) -> [Ellipsoid<'a>; 2] {
    let body = &figure.body;
    let height = body.above_eye + body.below_eye;
    let colour = Vec3::from(figure.colour.map(f32::from));
    let top = figure.pose.eye + Vec3::Y * body.above_eye;
    let head = Vec3::new(body.half_width * 0.56, height * 0.085, body.half_width * 0.56);
    let trunk = Vec3::new(body.half_width, height * 0.5 - head.y * 0.9, body.half_width);
    let soles = figure.pose.eye - Vec3::Y * body.below_eye;
    [
        Ellipsoid::new(view, soles + Vec3::Y * trunk.y, trunk, colour, seen),
        Ellipsoid {
            face: figure.pose.forward(),
            ..Ellipsoid::new(view, top - Vec3::Y * head.y, head, colour * 0.8, seen)
        },
    ]
}

impl<'a> Ellipsoid<'a> {
    fn new(view: &View, centre: Vec3, radii: Vec3, colour: Vec3, seen: &'a AtomicBool) -> Self {
        let (columns, rows) = view.bounds(centre, radii);
        let nearest = view.depth(centre) - view.depth_reach(radii);
        let centre = centre - view.eye;
        Self { seen, centre, radii, colour, face: Vec3::ZERO, columns, rows, nearest }
    }

    fn is_in(&self, width: usize, height: usize) -> bool {
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
            let colours = self.colours(view.ray(from as f32, y as f32), step, &entries);
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
        // In units of the radii the ellipsoid is a sphere.
        let [ray, step, centre] = [ray, step, self.centre].map(|of| (of / self.radii).to_array());
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

    /// The colours of the points where eight rays enter the ellipsoid.
    #[inline(always)]
    fn colours(&self, ray: Vec3, step: Vec3, entries: &[f32; LANES]) -> [u32; LANES] {
        let [ray, step, centre] = [ray, step, self.centre].map(|of| of.to_array());
        let [radii, face, colour] = [self.radii, self.face, self.colour].map(|of| of.to_array());
        let mut packed = [0; LANES];
        for (i, (packed, &t)) in packed.iter_mut().zip(entries).enumerate() {
            let out = [0, 1, 2]
                .map(|axis| ((ray[axis] + step[axis] * i as f32) * t - centre[axis]) / radii[axis]);
            let normal = [0, 1, 2].map(|axis| out[axis] / radii[axis]);
            let length = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
            let light = colour::light_outside(normal, 1.0 / length.sqrt());
            let is_face = face[0] * out[0] + face[1] * out[1] + face[2] * out[2] > 0.55;
            for channel in 0..3 {
                let own = if is_face { FACE[channel] } else { colour[channel] };
                let level = if own * light < 255.0 { own * light } else { 255.0 };
                // The lowest bits of so large a number count ones; this takes less time than a
                // cast.
                *packed = *packed << 8 | (level + 8_388_608.0).to_bits() & 0xff;
            }
        }
        packed
    }
}

/// The box that contains a figure and the lower edge of its name while its eye is in a box.
pub(super) fn bounds(body: &Body, eyes: &Aabb) -> Aabb {
    let bounds = body.around_box(eyes);
    Aabb { max: bounds.max + Vec3::Y * NAME_ABOVE_M, ..bounds }
}

/// The number of letters of a name that are shown.
pub(super) fn letters(name: &str) -> usize {
    name.chars().take(NAME_LETTERS_MAX).count()
}

/// How many pixels a name of this many letters reaches from the middle of its lower edge, across
/// and up or down. The edge's depth is at least `nearest` metres.
pub(super) fn name_reach(view: &View, nearest: f32, letters: usize) -> [f32; 2] {
    if letters == 0 || nearest >= NAME_WITHIN_M {
        return [0.0; 2];
    }
    let scale = name_scale(view, nearest.max(NAME_FROM_M));
    // The shade of the name, and one pixel for rounding.
    let (side, more) = (text::LETTER * scale, scale + 1);
    [letters * side / 2 + more, side + more].map(|pixels| pixels as f32)
}

/// The scale of a name at a depth in metres: pixels of the picture for each pixel of a letter.
fn name_scale(view: &View, depth: f32) -> usize {
    ((view.focal() * 0.012 / depth).round() as usize).clamp(1, 3)
}

/// Writes the name of a figure above its head.
fn name(frame: &mut Frame, view: &View, figure: &AvatarFigure) {
    let above = figure.pose.eye + Vec3::Y * (figure.body.above_eye + NAME_ABOVE_M);
    let at = view.project(above);
    if !(at.z > NAME_FROM_M && at.z < NAME_WITHIN_M && at.abs().max_element() < 1.0e6) {
        return;
    }
    let shown: String = figure.name.chars().take(NAME_LETTERS_MAX).collect();
    let scale = name_scale(view, at.z);
    let (width, height) = (text::width(&shown, scale), text::LETTER * scale);
    let corner = [at.x as i32 - width as i32 / 2, at.y as i32 - height as i32];
    let shade = corner.map(|place| place + scale as i32);
    text::draw_at_depth(frame, shade, scale, 0x0010_1418, &shown, at.z);
    text::draw_at_depth(frame, corner, scale, 0x00ff_ffff, &shown, at.z);
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { eye: Vec3::new(1.0, 1.6, 5.0), yaw: 0.0, pitch: 0.0, fov_y: 1.0 };

    fn figure(eye: Vec3, colour: [u8; 3]) -> AvatarFigure<'static> {
        let pose = Pose { eye, yaw: 0.5, ..Pose::default() };
        AvatarFigure { pose, body: Body::PERSON, colour, name: "Ada" }
    }

    fn drawn(figures: &[AvatarFigure], wall: f32) -> Frame {
        let mut frame = Frame::new(200, 160);
        frame.depth.fill(wall);
        let seen = draw(&mut frame, &CAMERA, figures);
        assert_eq!(seen.contains(&true), frame.depth.iter().any(|&depth| depth != wall));
        frame
    }

    fn pixels(frame: &Frame) -> usize {
        frame.colour.iter().filter(|&&pixel| pixel != 0).count()
    }

    #[test]
    fn a_figure_stays_inside_its_body() {
        let figure = figure(Vec3::new(1.3, 1.7, 1.0), [200, 30, 30]);
        let frame = drawn(&[AvatarFigure { name: "", ..figure }], f32::INFINITY);
        let view = View::new(&CAMERA, 200, 160);
        let body = figure.body.around(figure.pose.eye).grown(1.0e-3);
        let mut seen = 0;
        for (i, &depth) in frame.depth.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
            let hit = CAMERA.eye + view.ray((i % 200) as f32, (i / 200) as f32) * depth;
            assert!(body.contains(hit), "{hit}");
            seen += 1;
        }
        assert!(seen > 500 && seen == pixels(&frame), "{seen}");
    }

    #[test]
    fn walls_hide_figures_and_their_names() {
        let figure = figure(Vec3::new(1.3, 1.7, 1.0), [200, 30, 30]);
        assert_eq!(pixels(&drawn(&[figure], 2.0)), 0);
        assert!(pixels(&drawn(&[figure], 9.0)) > 500);
    }

    #[test]
    fn the_nearer_figure_is_in_front_whatever_the_order() {
        let near = AvatarFigure { name: "", ..figure(Vec3::new(1.0, 1.6, 2.0), [255, 0, 0]) };
        let far = AvatarFigure { name: "", ..figure(Vec3::new(1.1, 1.6, 0.0), [0, 255, 0]) };
        let frame = drawn(&[near, far], f32::INFINITY);
        assert_eq!(frame, drawn(&[far, near], f32::INFINITY));
    }

    #[test]
    fn a_figure_behind_others_in_all_pixels_is_not_seen() {
        let camera = Camera { eye: Vec3::Y * 1.6, yaw: 0.0, pitch: -0.8, fov_y: Camera::FOV_Y };
        let eyes = [Vec3::new(0.0, 2.1, -3.0), Vec3::new(0.0, 1.6, -2.6)];
        let both = eyes.map(|eye| AvatarFigure { name: "", ..figure(eye, [9; 3]) });
        let seen = |figures: &[AvatarFigure]| draw(&mut Frame::new(960, 540), &camera, figures);
        // Part of the first is nearer than any of the second, and drawn before it.
        assert_eq!((seen(&both[..1]), seen(&both)), (vec![true], vec![false, true]));
    }

    #[test]
    fn a_far_figure_has_no_holes_and_is_no_nearer() {
        let mut frame = Frame::new(1200, 900);
        let eye = Vec3::new(31.0, 1.6, -400.0);
        let narrow = Camera { fov_y: 0.03, ..Camera::looking_at(Vec3::Y, eye) };
        assert_eq!(draw(&mut frame, &narrow, &[figure(eye, [200; 3])]), [true]);
        let shown = frame.depth.iter().filter(|depth| depth.is_finite()).count();
        assert!(shown > 2_000, "{shown}");
        let view = View::new(&narrow, 1200, 900);
        let around = Body::PERSON.around(eye);
        let nearest = view.depth(around.centre()) - view.depth_reach(around.size() * 0.5);
        for row in frame.depth.chunks(1200) {
            assert!(row.iter().all(|depth| *depth >= nearest - 1e-3));
            // The head is nowhere beside the trunk, so each row has one run of pixels.
            let edges = row.windows(2).filter(|two| two[0].is_finite() != two[1].is_finite());
            assert!(edges.count() <= 2);
        }
    }

    #[test]
    fn odd_figures_are_survived() {
        let beside = [Vec3::NAN, Vec3::splat(1.0e30), CAMERA.eye, CAMERA.eye + Vec3::Z * 0.1];
        let figures: Vec<AvatarFigure> = beside.map(|eye| figure(eye, [9; 3])).to_vec();
        drawn(&figures, f32::INFINITY);
        draw(&mut Frame::new(0, 0), &CAMERA, &figures);
    }
}
