//! The rooms that an author declared, as coloured wire frames with their names and with
//! cross-hatched windows. Lines that the building hides are drawn faintly if they are near.

use glam::{Vec2, Vec3};
use sightline_visibility::rooms::pieces::ConvexPiece;
use sightline_world::{
    World,
    geometry::{Aabb, Axes},
    rooms::{Room, RoomId, Rooms, Window},
};

use super::{Camera, Frame, margins::NEAR, text, view::View};

/// The distance between the lines of a window's hatching, in metres; greater in large windows.
const HATCH_M: f32 = 0.2;
/// The greatest number of lines of a window's hatching each way.
const HATCHES_MAX: f32 = 40.0;
/// A room's boundary lies in the walls. It counts as visible when it is at most this far behind a
/// surface, in metres …
const BEHIND_M: f32 = 0.06;
/// … and this share of its depth more.
const BEHIND_SHARE: f32 = 0.01;
/// A hidden line is drawn faintly when it is no farther away, in metres.
const FAINT_M: f32 = 8.0;
/// A name is written when it is no farther away, in metres.
const NAME_M: f32 = 60.0;
/// A line with more pixels is not drawn.
const PIXELS_MAX: f32 = 4.0 * super::SIDE_MAX as f32;

/// The wire frames of all rooms.
#[derive(Clone, Debug, Default)]
pub struct RoomWireframes {
    rooms: Vec<RoomWireframe>,
}

#[derive(Clone, Debug)]
struct RoomWireframe {
    name: String,
    /// Where the name is written.
    centre: Vec3,
    colour: [u8; 3],
    edges: Vec<[Vec3; 2]>,
    hatches: Vec<[Vec3; 2]>,
}

impl RoomWireframes {
    /// The wire frames of a world's rooms.
    pub fn new(world: &World) -> Self {
        Self::of(&world.rooms, &world.bounds())
    }

    fn of(rooms: &Rooms, bounds: &Aabb) -> Self {
        let ids = (0..).map(RoomId);
        let wire = |(room, id)| RoomWireframe::new(room, id, bounds);
        Self { rooms: rooms.list().iter().zip(ids).filter_map(wire).collect() }
    }

    /// Draws the wire frames into a frame that shows the building from the same camera.
    pub fn draw(&self, frame: &mut Frame, camera: &Camera) {
        if frame.width() == 0 || frame.height() == 0 {
            return;
        }
        let view = View::new(camera, frame.width(), frame.height());
        for room in &self.rooms {
            let mut pen = Pen { frame, view: &view, colour: room.colour };
            room.hatches.iter().for_each(|line| pen.line(line, 0));
            room.edges.iter().for_each(|line| pen.line(line, 1));
        }
        for room in &self.rooms {
            room.draw_name(frame, &view);
        }
    }
}

impl RoomWireframe {
    /// The wire frame of a room; `None` for a room without volume.
    fn new(room: &Room, id: RoomId, bounds: &Aabb) -> Option<Self> {
        let pieces: Vec<_> =
            room.shapes.iter().flat_map(|shape| ConvexPiece::of(shape, &Axes::WORLD)).collect();
        // A room that is given by its plan alone has no height of its own.
        let within = |at: Vec3| at.clamp(bounds.min, bounds.max);
        let mut edges: Vec<[Vec3; 2]> = Vec::new();
        for piece in &pieces {
            let start = edges.len();
            for face in &piece.faces {
                for (a, b) in face.iter().zip(face.iter().cycle().skip(1)) {
                    let edge = [within(*a), within(*b)];
                    let is_same =
                        |[a, b]: &[Vec3; 2]| [*a, *b] == edge || (*a == edge[1] && *b == edge[0]);
                    if !edges[start..].iter().any(is_same) {
                        edges.push(edge);
                    }
                }
            }
        }
        let mut hatches = Vec::new();
        for window in &room.windows {
            let ring = window.corners.iter().zip(window.corners.iter().cycle().skip(1));
            edges.extend(ring.map(|(a, b)| [*a, *b]));
            hatches.extend(hatching(window));
        }
        let size = |bounds: &Aabb| bounds.size().as_dvec3().element_product();
        let boxes = pieces.iter().map(|piece| piece.bounds.intersection(bounds));
        let largest = boxes.max_by(|a, b| size(a).total_cmp(&size(b)))?;
        let name = room.title().to_owned();
        Some(Self { name, centre: largest.centre(), colour: id.colour(), edges, hatches })
    }

    fn draw_name(&self, frame: &mut Frame, view: &View) {
        let at = view.project(self.centre);
        if at.z < NEAR || at.z > NAME_M || !at.is_finite() {
            return;
        }
        let scale = if at.z < 8.0 { 2 } else { 1 };
        let width = text::width(&self.name, scale) as i32;
        let corner = [(at.x as i32).saturating_sub(width / 2), at.y as i32];
        let shade = corner.map(|place| place.saturating_add(scale as i32));
        text::draw_at_depth(frame, shade, scale, 0x0010_1418, &self.name, at.z);
        text::draw_at_depth(frame, corner, scale, packed(self.colour), &self.name, at.z);
    }
}

fn packed([r, g, b]: [u8; 3]) -> u32 {
    u32::from_be_bytes([0, r, g, b])
}

/// Two families of lines across a window, at right angles to each other.
fn hatching(window: &Window) -> Vec<[Vec3; 2]> {
    let corners = &window.corners;
    let Some(first) = corners.first() else { return Vec::new() };
    let sum: Vec3 = corners.windows(2).map(|two| (two[0] - first).cross(two[1] - first)).sum();
    let Some(normal) = sum.try_normalize() else { return Vec::new() };
    // These axes follow the edges of an upright window, so the hatching is at an angle to them.
    let side = normal.cross(Vec3::Y).try_normalize().unwrap_or(normal.any_orthonormal_vector());
    let up = side.cross(normal);
    let flat = |at: &Vec3| Vec2::new(side.dot(*at - first), up.dot(*at - first));
    let ring: Vec<Vec2> = corners.iter().map(flat).collect();
    let lines = [Vec2::new(1.0, 1.0), Vec2::new(1.0, -1.0)].into_iter().flat_map(|across| {
        let across = across.normalize();
        let places = ring.iter().map(|at| across.dot(*at));
        let (low, high) = places.fold((f32::MAX, f32::MIN), |(a, b), at| (a.min(at), b.max(at)));
        let step = HATCH_M.max((high - low) / HATCHES_MAX);
        let count = ((high - low) / step) as u32;
        let ring = &ring;
        (0..count).flat_map(move |i| crossing(ring, across, low + (i as f32 + 0.5) * step))
    });
    lines.map(|ends| ends.map(|at| first + side * at.x + up * at.y)).collect()
}

/// The parts of a line that are inside of a polygon. The line holds the points whose component
/// along `across` is `place`.
fn crossing(ring: &[Vec2], across: Vec2, place: f32) -> Vec<[Vec2; 2]> {
    let ends = ring.iter().zip(ring.iter().cycle().skip(1));
    let mut met: Vec<Vec2> = ends
        .filter_map(|(a, b)| {
            let [da, db] = [a, b].map(|at| across.dot(*at) - place);
            ((da < 0.0) != (db < 0.0)).then(|| a.lerp(*b, da / (da - db)))
        })
        .collect();
    let along = |at: &Vec2| across.perp_dot(*at);
    met.sort_by(|a, b| along(a).total_cmp(&along(b)));
    met.chunks_exact(2).map(|two| [two[0], two[1]]).collect()
}

struct Pen<'a> {
    frame: &'a mut Frame,
    view: &'a View,
    colour: [u8; 3],
}

impl Pen<'_> {
    /// Draws a line in space, `wide` pixels thicker than one pixel.
    fn line(&mut self, ends: &[Vec3; 2], wide: i32) {
        let Some([from, to]) = self.projected(ends) else { return };
        let steps = (to - from).truncate().abs().max_element().ceil().max(1.0);
        if !steps.is_finite() || steps > PIXELS_MAX {
            return;
        }
        let is_level = (to.x - from.x).abs() > (to.y - from.y).abs();
        for step in 0..=steps as u32 {
            let share = step as f32 / steps;
            let at = from.truncate().lerp(to.truncate(), share);
            // Along a line in the picture, one over the depth is linear.
            let depth = 1.0 / (1.0 / from.z + (1.0 / to.z - 1.0 / from.z) * share);
            for aside in 0..=wide {
                let (x, y) = (at.x.round() as i32, at.y.round() as i32);
                let (x, y) = if is_level { (x, y + aside) } else { (x + aside, y) };
                self.dot(x, y, depth);
            }
        }
    }

    /// Both ends of a line as columns, rows and depths, cut to the near plane and to the picture;
    /// `None` when nothing of it is left.
    fn projected(&self, ends: &[Vec3; 2]) -> Option<[Vec3; 2]> {
        let near = NEAR * 4.0;
        let depth = |at: Vec3| self.view.project(at).z;
        let [a, b] = *ends;
        let (za, zb) = (depth(a), depth(b));
        if za < near && zb < near {
            return None;
        }
        let cut = |inside: Vec3, outside: Vec3, zi: f32, zo: f32| {
            if zo < near { inside.lerp(outside, (zi - near) / (zi - zo)) } else { outside }
        };
        let [a, b] = [cut(b, a, zb, za), cut(a, b, za, zb)].map(|at| self.view.project(at));
        let (mut from, mut to) = (a, b);
        let (width, height) = (self.frame.width() as f32, self.frame.height() as f32);
        for (axis, side) in [(0, width), (1, height)] {
            for (limit, sign) in [(-2.0, 1.0), (side + 2.0, -1.0)] {
                let [out_from, out_to] = [from, to].map(|at| sign * (at[axis] - limit));
                if out_from < 0.0 && out_to < 0.0 {
                    return None;
                }
                let share = out_from / (out_from - out_to);
                let at = |share: f32| {
                    let flat = from.truncate().lerp(to.truncate(), share);
                    flat.extend(1.0 / (1.0 / from.z + (1.0 / to.z - 1.0 / from.z) * share))
                };
                if out_from < 0.0 {
                    from = at(share);
                } else if out_to < 0.0 {
                    to = at(share);
                }
            }
        }
        Some([from, to])
    }

    fn dot(&mut self, x: i32, y: i32, depth: f32) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x >= self.frame.width() || y >= self.frame.height() {
            return;
        }
        let at = y * self.frame.width() + x;
        let is_seen = depth < self.frame.depth[at] * (1.0 + BEHIND_SHARE) + BEHIND_M;
        let share = if is_seen { 224 } else { 32 };
        if is_seen || depth < FAINT_M {
            let old = self.frame.colour[at].to_be_bytes();
            let mixed = |old: u8, new: u8| {
                ((u32::from(old) * (256 - share) + u32::from(new) * share) >> 8) as u8
            };
            let [r, g, b] = self.colour;
            let new = [0, mixed(old[1], r), mixed(old[2], g), mixed(old[3], b)];
            self.frame.colour[at] = u32::from_be_bytes(new);
        }
    }
}

#[cfg(test)]
mod tests {
    use sightline_world::rooms::Shape;

    use super::*;

    const CAMERA: Camera =
        Camera { eye: Vec3::new(0.0, 1.5, 8.0), yaw: 0.0, pitch: 0.0, fov_y: 1.0 };

    fn wires(windows: Vec<Window>) -> RoomWireframes {
        let shapes =
            vec![Shape::Box(Aabb::new(Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 3.0, 2.0)))];
        let room = Room { name: "hall".into(), shapes, windows, ..Room::default() };
        RoomWireframes::of(
            &Rooms::new(vec![room], Vec::new()).unwrap(),
            &Aabb::around(Vec3::ZERO, 20.0),
        )
    }

    fn window() -> Window {
        let corner = |x: f32, y: f32| Vec3::new(x, y, 2.0);
        let corners =
            vec![corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, 2.0), corner(-1.0, 2.0)];
        Window { name: "w".into(), corners, behind: None }
    }

    fn drawn(wires: &RoomWireframes, wall: f32, camera: &Camera) -> Frame {
        let mut frame = Frame::new(240, 180);
        frame.depth.fill(wall);
        wires.draw(&mut frame, camera);
        frame
    }

    fn brightness(frame: &Frame) -> u32 {
        frame
            .colour
            .iter()
            .map(|pixel| pixel.to_be_bytes().iter().map(|b| u32::from(*b)).sum::<u32>())
            .sum()
    }

    #[test]
    fn a_box_has_twelve_edges_and_hatches_stay_in_their_window() {
        let plain = wires(Vec::new());
        assert_eq!(plain.rooms[0].edges.len(), 12);
        let hatched = wires(vec![window()]);
        assert_eq!(hatched.rooms[0].edges.len(), 16);
        let lines = &hatched.rooms[0].hatches;
        assert!(lines.len() > 15, "{}", lines.len());
        let region = Aabb::new(Vec3::new(-1.0, 1.0, 2.0), Vec3::new(1.0, 2.0, 2.0)).grown(1e-4);
        assert!(lines.iter().flatten().all(|at| region.contains(*at)), "{lines:?}");
        let both = [drawn(&plain, 99.0, &CAMERA), drawn(&hatched, 99.0, &CAMERA)];
        assert!(
            brightness(&both[0]) > 10_000 && brightness(&both[1]) > brightness(&both[0]) * 5 / 4
        );
    }

    /// Behind a wall a room that is near is drawn faintly, and its name is not.
    #[test]
    fn walls_hide_most_of_it() {
        let wires = wires(Vec::new());
        let [free, behind] = [99.0, 3.0].map(|wall| brightness(&drawn(&wires, wall, &CAMERA)));
        assert!(behind > 0 && behind * 3 < free, "{behind} {free}");
        let far = Camera { eye: Vec3::new(0.0, 1.5, 40.0), ..CAMERA };
        assert_eq!(brightness(&drawn(&wires, 3.0, &far)), 0);
    }

    #[test]
    fn it_is_drawn_from_anywhere() {
        let wires = wires(vec![window()]);
        for i in 0..400 {
            let turn = i as f32 * 0.37;
            let eye =
                Vec3::new(turn.sin() * 3.0, 1.5, turn.cos() * 3.0) * (1.0 + (i % 7) as f32 * 0.2);
            let eye = if i % 50 == 0 { Vec3::new(2.0, 0.0, 2.0) } else { eye };
            drawn(
                &wires,
                99.0,
                &Camera { eye, yaw: turn * 1.7, pitch: (turn * 0.3).sin(), fov_y: 1.1 },
            );
        }
        wires.draw(&mut Frame::new(0, 0), &CAMERA);
    }
}
