//! Avatars, drawn as figures of people with their names above.

mod ellipsoid;
mod figure;
mod names;
pub(crate) mod shadow;

use std::sync::atomic::AtomicBool;

use sightline_world::{
    light::ShownLight,
    motion::{Body, Pose},
    octree::Octree,
};

use self::ellipsoid::{Ellipsoid, FigureBand};
use super::{Camera, Frame, band::BAND_ROWS, parallel, view::View};

/// The figure of one avatar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AvatarFigure<'a> {
    /// Where the avatar is, and where it looks. Its legs swing as its velocity says.
    pub pose: Pose,
    /// The body of the avatar. The figure stays inside of it.
    pub body: Body,
    /// The colour of the clothes, in sRGB.
    pub colour: [u8; 3],
    /// The name that is written above the head.
    pub name: &'a str,
    /// How far the legs are in their swing, in radians; a whole turn is two steps.
    pub stride: f32,
    /// The light where it is. Without one, two fixed lamps light it.
    pub light: Option<ShownLight>,
}

/// The height of a name above the head, in metres.
const NAME_ABOVE_M: f32 = 0.08;
/// A figure that is lower in the picture has fewer parts, in pixels.
const SMALL_PX: f32 = 24.0;

/// Draws figures, their shadows on the floor, and the names of those that can be seen, into a frame
/// that shows a building from the same camera, where nothing in the frame is nearer. Returns for
/// each figure whether it can be seen: whether at least one pixel shows it.
pub fn draw(
    frame: &mut Frame,
    camera: &Camera,
    building: &Octree,
    figures: &[AvatarFigure],
) -> Vec<bool> {
    let seen: Vec<AtomicBool> = figures.iter().map(|_| AtomicBool::new(false)).collect();
    let (width, height) = (frame.width(), frame.height());
    if width == 0 || height == 0 || figures.is_empty() {
        return vec![false; figures.len()];
    }
    let view = View::new(camera, width, height);
    shadow::draw(frame, &view, building, figures);
    let mut parts: Vec<Ellipsoid> = figures
        .iter()
        .zip(&seen)
        .filter(|(figure, _)| figure.pose.is_finite())
        .flat_map(|(figure, seen)| {
            let parts = figure::parts(figure, is_small(figure, &view));
            let light = figure.light.as_ref();
            let seen = move |part| Ellipsoid::new(&view, &part, light, seen);
            parts.into_iter().map(seen).collect::<Vec<_>>()
        })
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
    let seen: Vec<bool> = seen.into_iter().map(AtomicBool::into_inner).collect();
    let named = figures.iter().zip(&seen).filter(|(_, is_seen)| **is_seen);
    names::draw(frame, &view, &named.map(|(figure, _)| figure).collect::<Vec<_>>());
    seen
}

/// Whether a figure is too small in the picture for arms and legs.
fn is_small(figure: &AvatarFigure, view: &View) -> bool {
    let height = figure.body.above_eye + figure.body.below_eye;
    view.depth(figure.pose.eye) * SMALL_PX > view.focal() * height
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};

    use super::*;

    const CAMERA: Camera =
        Camera { eye: Vec3::new(1.0, 1.6, 5.0), yaw: 0.0, pitch: 0.0, fov_y: 1.0 };

    fn figure(eye: Vec3, colour: [u8; 3]) -> AvatarFigure<'static> {
        let pose = Pose { eye, yaw: 0.5, ..Pose::default() };
        AvatarFigure { pose, body: Body::PERSON, colour, name: "Ada", stride: 1.0, light: None }
    }

    fn nothing() -> Octree {
        Octree::empty(Vec3::ZERO, 1.0, 1)
    }

    fn drawn(figures: &[AvatarFigure], wall: f32) -> Frame {
        let mut frame = Frame::new(200, 160);
        frame.depth.fill(wall);
        let seen = draw(&mut frame, &CAMERA, &nothing(), figures);
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
        let wide = Body { half_width: 0.6, above_eye: 4.0, below_eye: 1.6 };
        let people =
            [(Vec3::new(0.235, 2.1, -3.0), Body::PERSON), (Vec3::new(0.0, 1.6, -2.6), wide)];
        let both = people.map(|(eye, body)| {
            let pose = Pose { eye, ..Pose::default() };
            AvatarFigure { pose, body, name: "", ..figure(eye, [9; 3]) }
        });
        let seen = |figures: &[AvatarFigure]| {
            draw(&mut Frame::new(960, 540), &camera, &nothing(), figures)
        };
        // Part of the first is nearer than any of the second, and drawn before it.
        assert_eq!((seen(&both[..1]), seen(&both)), (vec![true], vec![false, true]));
    }

    #[test]
    fn a_far_figure_has_no_holes_and_is_no_nearer() {
        let mut frame = Frame::new(1200, 900);
        let eye = Vec3::new(31.0, 1.6, -400.0);
        let narrow = Camera { fov_y: 0.03, ..Camera::looking_at(Vec3::Y, eye) };
        assert_eq!(draw(&mut frame, &narrow, &nothing(), &[figure(eye, [200; 3])]), [true]);
        let shown = frame.depth.iter().filter(|depth| depth.is_finite()).count();
        assert!(shown > 2_000, "{shown}");
        let view = View::new(&narrow, 1200, 900);
        let around = Body::PERSON.around(eye);
        let nearest = view.depth(around.centre())
            - view.depth_reach(&Mat3::from_diagonal(around.size() * 0.5));
        for row in frame.depth.chunks(1200) {
            assert!(row.iter().all(|depth| *depth >= nearest - 1e-3));
            // The trunk, two arms and air between them.
            let edges = row.windows(2).filter(|two| two[0].is_finite() != two[1].is_finite());
            assert!(edges.count() <= 6);
        }
    }

    #[test]
    fn odd_figures_are_survived() {
        let beside = [Vec3::NAN, Vec3::splat(1.0e30), CAMERA.eye, CAMERA.eye + Vec3::Z * 0.1];
        let figures: Vec<AvatarFigure> = beside.map(|eye| figure(eye, [9; 3])).to_vec();
        drawn(&figures, f32::INFINITY);
        draw(&mut Frame::new(0, 0), &CAMERA, &nothing(), &figures);
    }
}
