//! Movers, drawn as coloured triangles where nothing in the frame is nearer.
//!
//! A triangle is drawn as the cone of lines of sight that meet it: each side gives a plane through
//! the eye. So nothing is clipped, however near the triangle is or however far behind the eye it
//! reaches.

use std::time::Duration;

use glam::{DAffine3, Vec3};
use sightline_world::{Mover, World, light::ShownLight};

use super::{
    Camera, Frame, band::BAND_ROWS, colour, margins::NEAR, panes::Panes, parallel, view::View,
};

/// Draws the movers of a world as they are at a time of the server's clock into a frame that shows
/// the building from the same camera. A triggered mover rests where it begins.
pub fn draw(frame: &mut Frame, camera: &Camera, world: &World, now: Duration) {
    draw_selected(frame, camera, world, &world.movers.iter().collect::<Vec<_>>(), now);
}

/// Draws selected movers, such as those of a visibility set, in the light of a world, as [`draw`]
/// does.
pub fn draw_selected(
    frame: &mut Frame,
    camera: &Camera,
    world: &World,
    movers: &[&Mover],
    now: Duration,
) {
    let (width, height) = (frame.width(), frame.height());
    if width == 0 || height == 0 {
        return;
    }
    let view = View::new(camera, width, height);
    let facets = parallel::flat_map(movers, |mover| {
        let is_in_view = is_in_view(mover, now, &view, frame);
        let facets = is_in_view.then(|| facets(mover, world, now, &view));
        facets.into_iter().flatten().filter(|facet| facet.bounds.meets(width, height))
    });
    if facets.is_empty() {
        return;
    }
    let bands = frame.colour.chunks_mut(BAND_ROWS * width);
    let bands = bands.zip(frame.depth.chunks_mut(BAND_ROWS * width));
    let panes = &frame.panes;
    parallel::for_each(bands.collect(), |band, (colour, depth)| {
        let rows = band * BAND_ROWS..band * BAND_ROWS + colour.len() / width;
        for facet in &facets {
            for y in facet.bounds.rows_within(&rows) {
                let row = (y - rows.start) * width..(y - rows.start + 1) * width;
                let (colour, depth) = (&mut colour[row.clone()], &mut depth[row]);
                facet.draw_row(&view, panes, FacetRow { y, colour, depth });
            }
        }
    });
}

/// The time at which a mover's trajectory is evaluated: the beginning for a mover that rests.
fn time_of(mover: &Mover, now: Duration) -> Duration {
    use sightline_world::motion::trajectory::Playback;
    match mover.trajectory.playback() {
        Playback::Triggered => Duration::ZERO,
        _ => now,
    }
}

/// Where a mover is drawn: from its own coordinates to the world's.
pub(super) fn place(mover: &Mover, now: Duration) -> DAffine3 {
    mover.trajectory.at(time_of(mover, now))
}

/// Whether any part of a mover's box may be in the picture.
fn is_in_view(mover: &Mover, now: Duration, view: &View, frame: &Frame) -> bool {
    let now = time_of(mover, now);
    let bounds = mover.swept(now, now);
    let (columns, rows) = view.bounds(bounds.centre(), bounds.size() * 0.5);
    ScreenBounds { columns, rows }.meets(frame.width(), frame.height())
}

/// The triangles of a mover that are visible from some side.
fn facets<'a>(
    mover: &'a Mover,
    world: &World,
    now: Duration,
    view: &'a View,
) -> impl Iterator<Item = Facet> + use<'a> {
    let place = place(mover, now);
    let at = time_of(mover, now);
    let light = world.light_around(&mover.swept(at, at));
    let mesh = mover.mesh();
    let eye = view.eye.as_dvec3();
    let positions: Vec<Vec3> = mesh
        .positions
        .iter()
        .map(|position| (place.transform_point3(position.as_dvec3()) - eye).as_vec3())
        .collect();
    mesh.triangles.iter().zip(mover.colours()).filter_map(move |(triangle, &colour)| {
        Facet::new(triangle.map(|index| positions[index as usize]), colour, light.as_ref(), view)
    })
}

/// The bounding rectangle of a triangle in the picture: least and greatest column and row, in
/// pixels.
struct ScreenBounds {
    columns: [f32; 2],
    rows: [f32; 2],
}

impl ScreenBounds {
    fn meets(&self, width: usize, height: usize) -> bool {
        let meets = |[min, max]: [f32; 2], side: usize| min < side as f32 && max >= 0.0;
        meets(self.columns, width) && meets(self.rows, height)
    }

    fn rows_within(&self, rows: &std::ops::Range<usize>) -> std::ops::Range<usize> {
        whole(self.rows, rows.start, rows.end)
    }
}

/// The whole numbers between two numbers that lie in a range.
fn whole([min, max]: [f32; 2], start: usize, end: usize) -> std::ops::Range<usize> {
    // Casts saturate infinities, and make zero of NaN.
    let (first, after) = (min.max(0.0).ceil() as usize, (max.max(-1.0) + 1.0).floor() as usize);
    first.clamp(start, end)..after.clamp(start, end)
}

/// A row of the picture that triangles are drawn into.
struct FacetRow<'a> {
    y: usize,
    colour: &'a mut [u32],
    depth: &'a mut [f32],
}

/// A triangle as seen from the eye.
struct Facet {
    /// The inward normals of the planes through the eye and a side. A line of sight meets the
    /// triangle when its dot product with none of them is negative.
    sides: [Vec3; 3],
    /// The triple product of the corners, made positive.
    volume: f32,
    colour: u32,
    bounds: ScreenBounds,
}

impl Facet {
    /// A triangle by its corners relative to the eye; `None` when it is seen from its edge, or a
    /// corner is not finite.
    fn new(
        [a, b, c]: [Vec3; 3],
        colour: [u8; 3],
        light: Option<&ShownLight>,
        view: &View,
    ) -> Option<Self> {
        let volume = a.dot(b.cross(c));
        if !(volume.abs() > 0.0 && volume.is_finite()) {
            return None;
        }
        let sign = volume.signum();
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let middle = (a + b + c) / 3.0;
        Some(Self {
            sides: [b.cross(c), c.cross(a), a.cross(b)].map(|side| side * sign),
            volume: volume.abs(),
            colour: colour::lit(Vec3::from(colour.map(f32::from)), normal, middle, light),
            bounds: ScreenBounds::of([a, b, c], view),
        })
    }

    /// Draws a row of the triangle into that row of the picture.
    fn draw_row(&self, view: &View, panes: &Panes, row: FacetRow) {
        let FacetRow { y, colour, depth } = row;
        let ray = view.ray(0.0, y as f32);
        let step = view.ray(1.0, y as f32) - ray;
        let start = self.sides.map(|side| side.dot(ray));
        let step = self.sides.map(|side| side.dot(step));
        for x in whole(self.bounds.columns, 0, colour.len()) {
            let [a, b, c] = [0, 1, 2].map(|i| start[i] + step[i] * x as f32);
            if a < 0.0 || b < 0.0 || c < 0.0 {
                continue;
            }
            let t = self.volume / (a + b + c);
            if t >= NEAR && t < depth[x] {
                depth[x] = t;
                colour[x] = panes.over([x, y], t, self.colour);
            }
        }
    }
}

impl ScreenBounds {
    /// The bounds of a triangle, by its corners relative to the eye.
    fn of(corners: [Vec3; 3], view: &View) -> Self {
        let at = corners.map(|corner| view.project(view.eye + corner));
        if at.iter().any(|corner| corner.z < NEAR) {
            let all = [f32::NEG_INFINITY, f32::INFINITY];
            let none = [0.0, -1.0];
            let is_behind = at.iter().all(|corner| corner.z < NEAR) || view.are_beside(corners);
            let span = if is_behind { none } else { all };
            return Self { columns: span, rows: span };
        }
        let span = |axis: usize| {
            let values = at.map(|corner| corner[axis]);
            [values[0].min(values[1]).min(values[2]), values[0].max(values[1]).max(values[2])]
        };
        Self { columns: span(0), rows: span(1) }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3, Quat};
    use sightline_fixtures::two_rooms;
    use sightline_world::{
        Mesh,
        motion::trajectory::{Joint, KeyframeTrack, Playback, Trajectory},
    };

    use super::*;

    const CAMERA: Camera =
        Camera { eye: Vec3::new(1.0, 1.6, 5.0), yaw: 0.2, pitch: -0.1, fov_y: 1.0 };
    const SIZE: (usize, usize) = (120, 90);

    fn mover(corners: &[[f32; 3]], joint: Joint, course: Playback) -> Mover {
        let positions: Vec<Vec3> = corners.iter().map(|&corner| Vec3::from(corner)).collect();
        let count = positions.len() as u32 / 3;
        let triangles: Vec<_> = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let colours = vec![[200, 40, 40]; triangles.len()];
        let trajectory = Trajectory::new(vec![joint], 4.0, course).unwrap();
        Mover::new("it".into(), Mesh { positions, triangles }, colours, trajectory).unwrap()
    }

    fn drawn(movers: &[Mover], wall: f32, now_s: f64) -> Frame {
        let mut frame = Frame::new(SIZE.0, SIZE.1);
        frame.depth.fill(wall);
        let world = World { movers: movers.to_vec(), ..two_rooms::world() };
        draw(&mut frame, &CAMERA, &world, Duration::from_secs_f64(now_s));
        frame
    }

    /// Where a ray meets a triangle, in multiples of the ray (Möller and Trumbore 1997).
    fn hit(ray: Vec3, [a, b, c]: [Vec3; 3]) -> Option<f32> {
        let (u, v, origin) = (b - a, c - a, -a);
        let p = ray.cross(v);
        let q = origin.cross(u);
        let det = u.dot(p);
        let (s, t) = (origin.dot(p) / det, ray.dot(q) / det);
        (s >= 0.0 && t >= 0.0 && s + t <= 1.0).then_some(v.dot(q) / det)
    }

    #[test]
    fn a_pixel_shows_what_its_ray_meets_first() {
        // One of the triangles reaches from in front of the eye to behind it.
        let corners = [
            [-1.0, 0.5, -2.0],
            [2.0, 0.7, -1.0],
            [0.5, 3.0, 1.0],
            [-3.0, 0.4, 3.0],
            [4.0, 0.5, 2.0],
            [1.0, 1.0, 9.0],
            [0.9, 1.5, 4.6],
            [1.0, 1.5, 4.6],
            [0.9, 1.6, 4.7],
        ];
        let still = Joint::still(DAffine3::from_translation(DVec3::new(0.1, 0.0, 0.0)));
        let frame = drawn(&[mover(&corners, still, Playback::Loop)], f32::INFINITY, 1.0);
        let view = View::new(&CAMERA, SIZE.0, SIZE.1);
        let (mut seen, mut differ) = (0, 0);
        for (i, &depth) in frame.depth.iter().enumerate() {
            let ray = view.ray((i % SIZE.0) as f32, (i / SIZE.0) as f32);
            let place = |corner: [f32; 3]| Vec3::from(corner) + Vec3::X * 0.1 - CAMERA.eye;
            let hits = corners.as_chunks::<3>().0.iter().filter_map(|t| hit(ray, t.map(place)));
            let nearest = hits.filter(|&t| t >= NEAR).fold(f32::INFINITY, f32::min);
            seen += usize::from(nearest.is_finite());
            // Pixels on an edge may differ.
            let same = depth == nearest || (depth - nearest).abs() < 1e-3 * depth;
            differ += usize::from(!same);
            assert_eq!(depth.is_finite(), frame.colour[i] != 0);
        }
        assert!(seen > 1_000 && differ <= 5, "{seen} seen, {differ} differ");
    }

    #[test]
    fn movers_are_where_they_are_at_the_time_and_behind_what_is_nearer() {
        let corners = [[-0.5, 1.0, 0.0], [0.5, 1.0, 0.0], [0.0, 2.0, 0.0]];
        let mut joint = Joint::still(DAffine3::IDENTITY);
        joint.translation = KeyframeTrack::linear(vec![(0.0, Vec3::ZERO), (4.0, Vec3::X * 40.0)]);
        joint.rotation = KeyframeTrack::constant(Quat::IDENTITY);
        let seen = |course: Playback, wall: f32, now_s: f64| {
            let frame = drawn(&[mover(&corners, joint.clone(), course)], wall, now_s);
            frame.colour.iter().any(|&colour| colour != 0)
        };
        for (course, wall, now_s, expected) in [
            (Playback::Loop, f32::INFINITY, 0.0, true),
            (Playback::Loop, 3.0, 0.0, false),
            (Playback::Loop, f32::INFINITY, 3.0, false),
            (Playback::Loop, f32::INFINITY, 4.01, true),
            (Playback::Once, f32::INFINITY, 4.01, false),
            (Playback::Triggered, f32::INFINITY, 3.0, true),
        ] {
            assert_eq!(seen(course, wall, now_s), expected, "{course:?}, {wall}, {now_s}");
        }
    }

    #[test]
    fn odd_pictures_are_survived() {
        let corners = [[1.0, 1.6, 5.0], [1.0, 1.6, 5.0], [1e6, -1e6, 1e6]];
        let odd = mover(&corners, Joint::still(DAffine3::IDENTITY), Playback::Loop);
        drawn(std::slice::from_ref(&odd), f32::INFINITY, 0.0);
        let world = World { movers: vec![odd], ..two_rooms::world() };
        draw(&mut Frame::new(0, 0), &CAMERA, &world, Duration::MAX);
    }
}
