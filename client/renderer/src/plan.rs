//! Drawing the plan of a storey, and who is where on it.

use glam::{Vec2, Vec3};
use sightline_world::{motion::Pose, plan::Plan};

use super::{Frame, text};

/// Others are on a plan whose soles are less than this above or below it, in metres.
const HERE_M: f32 = 2.4;
const EDGE: u32 = 0x0012_161a;

/// Somebody on a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlanMark {
    /// The pixel of the plan.
    at: [i32; 2],
    colour: u32,
    /// Where somebody looks, in 32nds of a turn, as a yaw counts. Only one's own mark has it.
    looks: Option<i32>,
}

/// The marks of others on the storey of a plan and of oneself, which comes last. Eyes are
/// `below_eye` above soles, in metres.
pub fn marks(
    plan: &Plan,
    own: &Pose,
    others: impl Iterator<Item = (Pose, [u8; 3])>,
    below_eye: f32,
) -> Vec<PlanMark> {
    let is_here = |eye: Vec3| (eye.y - below_eye - plan.soles()).abs() < HERE_M;
    let others = others.filter(|(pose, _)| is_here(pose.eye));
    let mut marks: Vec<PlanMark> = others
        .filter_map(|(pose, [r, g, b])| {
            mark(plan, pose.eye, u32::from_be_bytes([0, r, g, b]), None)
        })
        .collect();
    let looks = (own.yaw / std::f32::consts::TAU * 32.0).round() as i32;
    marks.extend(mark(plan, own.eye, 0x00ff_3030, Some(looks)));
    marks
}

/// Draws a plan in the middle of a picture.
pub fn draw(plan: &Plan, frame: &mut Frame, marks: &[PlanMark]) {
    let [columns, rows] = plan.size();
    let free = [frame.width() / columns, frame.height() / rows];
    let zoom = free[0].min(free[1]).clamp(1, 2);
    let size = [columns * zoom, rows * zoom];
    let corner = [0, 1].map(|axis| {
        let side = if axis == 0 { frame.width() } else { frame.height() };
        (side as i32 - size[axis] as i32) / 2
    });
    let rim = 6;
    let around = [size[0] + 2 * rim, size[1] + 2 * rim];
    let outer = corner.map(|at| at - rim as i32);
    for _ in 0..2 {
        text::darken(frame, outer, around);
    }
    let place = |[x, y]: [i32; 2]| [corner[0] + x * zoom as i32, corner[1] + y * zoom as i32];
    for (i, pixel) in plan.pixels().iter().enumerate() {
        if let Some(colour) = pixel {
            let at = place([(i % columns) as i32, (i / columns) as i32]);
            text::fill(frame, at, [zoom, zoom], *colour);
        }
    }
    for mark in marks {
        draw_mark(frame, place(mark.at), mark);
    }
}

/// A mark for somebody at an eye; `None` beside the plan.
fn mark(plan: &Plan, eye: Vec3, colour: u32, looks: Option<i32>) -> Option<PlanMark> {
    let at = (Vec2::new(eye.x, eye.z) - plan.corner()) / plan.metres();
    let [columns, rows] = plan.size();
    let is_on = at.cmpge(Vec2::ZERO).all() && at.x < columns as f32;
    let at = [at.x as i32, at.y as i32];
    (is_on && at[1] < rows as i32).then_some(PlanMark { at, colour, looks })
}

/// Draws a disc with an edge, and for oneself a line to where one looks.
fn draw_mark(frame: &mut Frame, [x, y]: [i32; 2], mark: &PlanMark) {
    let radius = if mark.looks.is_some() { 4 } else { 3 };
    if let Some(looks) = mark.looks {
        let (sin, cos) = (looks as f32 / 32.0 * std::f32::consts::TAU).sin_cos();
        for step in 0..14 {
            let [right, down] = [-sin, -cos].map(|of| (of * step as f32).round() as i32);
            text::fill(frame, [x + right - 1, y + down - 1], [3, 3], mark.colour);
        }
    }
    for (reach, colour) in [(radius + 1, EDGE), (radius, mark.colour)] {
        for down in -reach..=reach {
            let across = ((reach * reach - down * down) as f32).sqrt() as i32;
            text::fill(frame, [x - across, y + down], [(2 * across + 1) as usize, 1], colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use sightline_fixtures::voxel_floor::{self, SPAWN};

    use super::*;

    #[test]
    fn marks_are_where_people_are_and_only_on_their_storey() {
        let world = voxel_floor::world(&[]);
        let plan = Plan::new(&world, 0.125);
        let own = Pose { eye: SPAWN.eye, yaw: std::f32::consts::PI, ..Pose::default() };
        let other = |eye: Vec3| (Pose { eye, ..Pose::default() }, [9, 8, 7]);
        let eyes = [Vec3::new(6.0, 1.7, 2.0), Vec3::new(6.0, 6.0, 2.0), Vec3::new(60.0, 1.7, 2.0)];
        let marks = marks(&plan, &own, eyes.map(other).into_iter(), world.body.below_eye);
        assert_eq!(marks.len(), 2, "one above, one beside the plan: {marks:?}");
        assert_eq!(marks[1].looks, Some(16));
        let off = marks[0].at[0] - marks[1].at[0];
        assert!((off as f32 * plan.metres() - 4.0).abs() < 0.05, "four metres east: {off} pixels");
        let mut frame = Frame::new(500, 500);
        draw(&plan, &mut frame, &marks);
        assert!(frame.colour.contains(&0x00ff_3030) && frame.colour.contains(&0x0009_0807));
    }
}
