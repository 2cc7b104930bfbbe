//! Pictures of scenes from above, which show what a test says.

use std::path::Path;

use glam::{Vec2, Vec3};
use sightline_visibility::rooms::pieces::ConvexPiece;
use sightline_world::{geometry::Aabb, rooms::Rooms};

const SIDE_PX: u32 = 520;
const PAPER: [u8; 3] = [250, 250, 247];
const SHOWN: [u8; 3] = [214, 236, 205];
const INK: [u8; 3] = [40, 42, 48];
const WINDOW: [u8; 3] = [30, 110, 220];
const EYE: [u8; 3] = [220, 60, 40];
const RIGHT: [u8; 3] = [40, 140, 60];
const HIDDEN: [u8; 3] = [150, 150, 150];

/// A scene to draw.
pub struct Picture<'a> {
    pub rooms: &'a Rooms,
    pub eyes: Aabb,
    /// Boxes, and whether each is expected to be visible.
    pub targets: &'a [(Aabb, bool)],
    /// The part of the plan that is drawn: its least and its greatest x and z.
    pub area: [[f32; 2]; 2],
    /// Whether a point at the height of the eyes is visible.
    pub shows: &'a dyn Fn(Vec3) -> bool,
}

impl Picture<'_> {
    /// Writes the picture into the folder of the tests' output.
    pub fn save(&self, name: &str) {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rooms");
        std::fs::create_dir_all(&folder).unwrap();
        self.draw().save(&folder.join(format!("{name}.png"))).unwrap();
    }

    fn draw(&self) -> sightline_picture::Picture {
        let mut picture = sightline_picture::Picture::filled(SIDE_PX, SIDE_PX, PAPER);
        for (x, y) in (0..SIDE_PX).flat_map(|y| (0..SIDE_PX).map(move |x| (x, y))) {
            if let Some(pixel) = picture.pixel_mut(x, y).filter(|_| (self.shows)(self.point(x, y)))
            {
                *pixel = SHOWN;
            }
        }
        for (id, room) in self.rooms.list().iter().enumerate() {
            let colour = [[180, 90, 20], [120, 40, 150], [20, 130, 130], [90, 90, 20]][id % 4];
            for piece in
                room.shapes.iter().flat_map(|shape| ConvexPiece::of(shape, &Default::default()))
            {
                for face in &piece.faces {
                    self.ring(&mut picture, face, colour, 1);
                }
            }
            for window in &room.windows {
                self.ring(&mut picture, &window.corners, WINDOW, 3);
            }
        }
        for (target, expected) in self.targets {
            let colour = if *expected { RIGHT } else { HIDDEN };
            self.ring(&mut picture, &plan_of(target), colour, 3);
        }
        self.ring(&mut picture, &plan_of(&self.eyes.grown(0.06)), EYE, 3);
        picture
    }

    fn point(&self, x: u32, y: u32) -> Vec3 {
        let [from, to] = self.area.map(Vec2::from);
        let share = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / SIDE_PX as f32;
        let at = from + (to - from) * share;
        Vec3::new(at.x, self.eyes.centre().y, at.y)
    }

    fn ring(
        &self,
        picture: &mut sightline_picture::Picture,
        corners: &[Vec3],
        colour: [u8; 3],
        width: i32,
    ) {
        let [from, to] = self.area.map(Vec2::from);
        let place = |at: &Vec3| (Vec2::new(at.x, at.z) - from) / (to - from) * SIDE_PX as f32;
        for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            let (a, b) = (place(a), place(b));
            let steps = (b - a).abs().max_element().ceil().clamp(1.0, 4_000.0) as i32;
            for step in 0..=steps {
                let at = a.lerp(b, step as f32 / steps as f32);
                for (dx, dy) in (0..width * width).map(|i| (i % width, i / width)) {
                    let (x, y) = (at.x as i32 + dx - width / 2, at.y as i32 + dy - width / 2);
                    if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
                        && let Some(pixel) = picture.pixel_mut(x, y)
                    {
                        *pixel = if width > 0 { colour } else { INK };
                    }
                }
            }
        }
    }
}

fn plan_of(region: &Aabb) -> [Vec3; 4] {
    let Aabb { min, max } = *region;
    [min, Vec3::new(max.x, min.y, min.z), max, Vec3::new(min.x, min.y, max.z)]
}
