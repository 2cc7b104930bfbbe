//! Contact shadows: the floor is darker below a figure.
//!
//! A pixel is darkened where the frame shows something near the soles. So a shadow lies on whatever
//! is there, and is hidden by whatever is nearer.

use glam::{Vec2, Vec3};
use sightline_world::{geometry::Aabb, octree::Octree};

use super::AvatarFigure;
use crate::{Frame, band::BAND_ROWS, parallel, view::View};

/// The radius of a shadow, in metres.
pub(crate) const RADIUS_M: f32 = 0.45;
/// What is this much higher or lower than the soles is not darkened, in metres.
pub(crate) const HEIGHT_M: f32 = 0.14;
/// The share of light that is taken away below the middle of a figure.
const DARK: f32 = 0.62;
/// Walls end a shadow. They are looked for in this range of heights above the soles, in metres.
const WALL_M: [f32; 2] = [0.2, 0.5];
/// A shadow that spans fewer columns is not drawn.
const COLUMNS_MIN: f32 = 3.0;

/// The shadow of one figure.
struct Shadow {
    /// Relative to the eye, in metres.
    soles: Vec3,
    /// How far it reaches along x and z, relative to the soles, in metres.
    reach: [Vec2; 2],
    /// Least and greatest column and row, in pixels.
    columns: [f32; 2],
    rows: [f32; 2],
}

/// Darkens the floor below figures in a frame that does not show them yet.
pub(super) fn draw(frame: &mut Frame, view: &View, octree: &Octree, figures: &[AvatarFigure]) {
    let (width, height) = (frame.width(), frame.height());
    let shadows: Vec<Shadow> = figures
        .iter()
        .filter(|figure| figure.pose.is_finite())
        .filter_map(|figure| Shadow::new(figure, view, octree))
        .filter(|shadow| shadow.is_in(width, height))
        .collect();
    if shadows.is_empty() {
        return;
    }
    let bands = frame.colour.chunks_mut(BAND_ROWS * width);
    let bands = bands.zip(frame.depth.chunks(BAND_ROWS * width));
    parallel::for_each(bands.collect(), |band, (colour, depth)| {
        let rows = colour.chunks_mut(width).zip(depth.chunks(width));
        for (y, (colour, depth)) in (band * BAND_ROWS..).zip(rows) {
            shadows.iter().for_each(|shadow| shadow.draw_row(view, y, colour, depth));
        }
    });
}

impl Shadow {
    /// None when it is small in the picture, or seen from below.
    fn new(figure: &AvatarFigure, view: &View, octree: &Octree) -> Option<Self> {
        let soles = figure.pose.eye - Vec3::Y * figure.body.below_eye;
        if view.eye.y <= soles.y {
            return None;
        }
        let around = Vec3::new(RADIUS_M, HEIGHT_M, RADIUS_M);
        let (columns, rows) = view.bounds(soles, around);
        if columns[1] - columns[0] < COLUMNS_MIN {
            return None;
        }
        let reach = reach(soles, figure.body.half_width.min(RADIUS_M), octree);
        Some(Self { soles: soles - view.eye, reach, columns, rows })
    }

    fn is_in(&self, width: usize, height: usize) -> bool {
        let meets = |[min, max]: [f32; 2], side: usize| min < side as f32 && max >= 0.0;
        meets(self.columns, width) && meets(self.rows, height)
    }

    fn draw_row(&self, view: &View, y: usize, colour: &mut [u32], depth: &[f32]) {
        if !(self.rows[0]..=self.rows[1]).contains(&(y as f32)) {
            return;
        }
        let first = self.columns[0].max(0.0).ceil() as usize;
        let after = (self.columns[1].min(colour.len() as f32 - 1.0) + 1.0).max(0.0) as usize;
        let (ray, step) = (view.ray(0.0, y as f32), view.ray_step());
        for x in first..after {
            let away = (ray + step * x as f32) * depth[x] - self.soles;
            let flat = Vec2::new(away.x, away.z);
            let share = flat.length_squared() / (RADIUS_M * RADIUS_M);
            let beside = flat.cmplt(self.reach[0]).any() || flat.cmpgt(self.reach[1]).any();
            if share < 1.0 && away.y.abs() < HEIGHT_M && !beside {
                let near = (2.0 - 2.0 * away.y.abs() / HEIGHT_M).min(1.0);
                colour[x] = darkened(colour[x], DARK * near * (1.0 - share) * (1.0 - share));
            }
        }
    }
}

/// How far a shadow reaches along x and z, relative to the soles: no farther than to a wall.
fn reach(soles: Vec3, half_width: f32, octree: &Octree) -> [Vec2; 2] {
    let is_free = |low: Vec2, high: Vec2| {
        let [low, high] = [low, high].map(|flat| soles + Vec3::new(flat.x, 0.0, flat.y));
        let [from, to] = WALL_M.map(|height| Vec3::Y * height);
        !octree.solid_in(&Aabb::new(low + from, high + to))
    };
    let (least, most) = (Vec2::splat(half_width), Vec2::splat(RADIUS_M));
    let side = |axis: usize, sign: f32| {
        let [mut low, mut high] = [-most, most];
        let [near, far] = [half_width * sign, RADIUS_M * sign];
        (low[axis], high[axis]) = (near.min(far), near.max(far));
        if is_free(low, high) { RADIUS_M * sign } else { least[axis] * sign }
    };
    [-1.0, 1.0].map(|sign| Vec2::new(side(0, sign), side(1, sign)))
}

/// A colour as 0x00RRGGBB with a share of its light taken away.
fn darkened(colour: u32, share: f32) -> u32 {
    let kept = 256 - (share * 256.0) as u32;
    let red_blue = (((colour & 0x00ff_00ff) * kept) >> 8) & 0x00ff_00ff;
    let green = (((colour & 0x0000_ff00) * kept) >> 8) & 0x0000_ff00;
    red_blue | green
}

#[cfg(test)]
mod tests {
    use glam::UVec3;
    use sightline_world::{
        motion::{Body, Pose},
        octree::{Voxel, morton},
    };

    use super::*;
    use crate::{Camera, Renderer};

    /// A floor of 3.2 m with voxels of 10 cm, whose top is at a height of 10 cm, and a wall at
    /// x = 1.8 m.
    fn octree(has_wall: bool) -> Octree {
        let floor = (0..32).flat_map(|x| (0..32).map(move |z| UVec3::new(x, 0, z)));
        let wall = (1..12).flat_map(|y| (0..32).map(move |z| UVec3::new(18, y, z)));
        let voxel = |at| Voxel { key: morton(at), colour: [200; 3], ..Voxel::default() };
        let all = floor.chain(wall.filter(|_| has_wall)).map(voxel).collect();
        Octree::from_voxels(Vec3::ZERO, 0.1, 5, all).expect("small")
    }

    /// The levels of the floor at points of one line, without and with a figure that stands at
    /// x = 1.55 m with its soles at a height.
    fn levels(has_wall: bool, soles: f32, points: &[f32]) -> Vec<[u32; 2]> {
        let octree = octree(has_wall);
        let camera = Camera::looking_at(Vec3::new(1.5, 4.0, 1.49), Vec3::new(1.5, 0.1, 1.5));
        let mut frame = Frame::new(200, 200);
        Renderer::default().draw(&octree, &camera, &mut frame);
        let view = View::new(&camera, 200, 200);
        let pixels: Vec<usize> = points
            .iter()
            .map(|x| view.project(Vec3::new(*x, 0.1, 1.5)))
            .map(|at| at.y.round() as usize * 200 + at.x.round() as usize)
            .collect();
        let before: Vec<u32> = pixels.iter().map(|pixel| frame.colour[*pixel] & 0xff).collect();
        let body = Body::PERSON;
        let eye = Vec3::new(1.55, soles + body.below_eye, 1.5);
        let pose = Pose { eye, ..Pose::default() };
        let figure =
            AvatarFigure { pose, body, colour: [0; 3], name: "", stride: 0.0, light: None };
        draw(&mut frame, &view, &octree, &[figure]);
        let after = pixels.iter().map(|pixel| frame.colour[*pixel] & 0xff);
        before.into_iter().zip(after).map(|(before, after)| [before, after]).collect()
    }

    #[test]
    fn the_floor_is_darkest_below_a_figure_and_fades() {
        let points = [1.55, 1.7, 1.8, 1.9, 2.05, 2.45];
        let shares: Vec<f32> = levels(false, 0.1, &points)
            .iter()
            .map(|[before, after]| *after as f32 / *before as f32)
            .collect();
        assert!(shares[0] < 0.45, "{shares:?}");
        assert!(shares.windows(2).all(|two| two[0] <= two[1]), "{shares:?}");
        assert!(shares[2] < 0.9 && shares[4] == 1.0 && shares[5] == 1.0, "{shares:?}");
    }

    #[test]
    fn a_shadow_ends_at_a_wall_and_below_who_jumps() {
        let behind = &levels(true, 0.1, &[1.55, 1.93])[..];
        assert!(behind[0][1] < behind[0][0] && behind[1][1] == behind[1][0], "{behind:?}");
        let open = levels(false, 0.1, &[1.93]);
        assert!(open[0][1] < open[0][0], "without the wall there is shadow: {open:?}");
        let above = levels(false, 0.5, &[1.55]);
        assert_eq!(above[0][0], above[0][1]);
    }
}
