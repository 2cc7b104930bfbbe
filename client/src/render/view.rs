//! The camera as numbers: how points become pixels, and pixels lines of sight.

use glam::{Vec3, Vec3A, Vec4};
use sightline_shared::{
    geometry::Aabb,
    octree::{DEPTH_MAX, Octree},
};

use super::Camera;

/// Nothing nearer is projected, in metres; such nodes are halved, or tested pixel by pixel.
pub(super) const NEAR: f32 = 0.01;

/// An inner node is drawn as a whole when its edge spans no more pixels.
const EDGE_PX: f32 = 0.9;

/// Levels of an octree, the root's included.
const LEVELS: usize = DEPTH_MAX as usize + 1;

/// A camera and the size of its picture.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub(super) eye: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    /// Pixels for each unit of the tangent.
    focal: f32,
    /// The centre of the picture, with pixels' centres at whole numbers.
    centre: [f32; 2],
}

impl View {
    pub(super) fn new(camera: &Camera, width: usize, height: usize) -> Self {
        let (sin_yaw, cos_yaw) = camera.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = camera.pitch.sin_cos();
        let forward = Vec3::new(-sin_yaw * cos_pitch, sin_pitch, -cos_yaw * cos_pitch);
        let right = Vec3::new(cos_yaw, 0.0, -sin_yaw);
        let (width, height) = (width as f32, height as f32);
        let half_angle = (camera.fov_y * 0.5).clamp(0.01, 1.5);
        Self {
            eye: camera.eye,
            right,
            up: right.cross(forward),
            forward,
            focal: height * 0.5 / half_angle.tan(),
            centre: [(width - 1.0) * 0.5, (height - 1.0) * 0.5],
        }
    }

    /// The line of sight through a pixel's centre; its share in the camera's direction is one.
    pub(super) fn ray(&self, x: f32, y: f32) -> Vec3 {
        let across = (x - self.centre[0]) / self.focal;
        let down = (y - self.centre[1]) / self.focal;
        self.forward + self.right * across - self.up * down
    }

    /// Where a point is in the picture and how far in the camera's direction: pixels, pixels and
    /// metres. Only of use when the distance is positive.
    pub(super) fn project(&self, point: Vec3) -> Vec3 {
        let point = point - self.eye;
        let z = self.forward.dot(point);
        let scale = self.focal / z;
        let x = self.centre[0] + self.right.dot(point) * scale;
        Vec3::new(x, self.centre[1] - self.up.dot(point) * scale, z)
    }

    /// Pixels that a length of a metre spans at a distance of a metre.
    pub(super) fn focal(&self) -> f32 {
        self.focal
    }

    /// The columns and rows, in pixels, that a box spans: all of them when it is partly behind the
    /// eye, none when wholly. Infinite ends are fine.
    pub(super) fn bounds(&self, centre: Vec3, radii: Vec3) -> ([f32; 2], [f32; 2]) {
        let corner = |i: u8| {
            let sign = |bit: u8| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            self.project(centre + radii * Vec3::new(sign(0), sign(1), sign(2)))
        };
        let (nearest, farthest) = (0..8)
            .map(|i| corner(i).z)
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), z| (a.min(z), b.max(z)));
        if farthest < NEAR {
            return ([0.0, -1.0], [0.0, -1.0]);
        }
        if nearest < NEAR {
            return ([f32::NEG_INFINITY, f32::INFINITY], [f32::NEG_INFINITY, f32::INFINITY]);
        }
        let bounds = Aabb::from_points((0..8).map(corner));
        ([bounds.min.x, bounds.max.x], [bounds.min.y, bounds.max.y])
    }

    /// The same view, seen from a tile's corner.
    pub(super) fn tile(&self, corner: [usize; 2], octree: &Octree) -> TileView {
        let corner = corner.map(|c| c as f32);
        let [x, y] = [self.centre[0] - corner[0], self.centre[1] - corner[1]];
        let to_x = self.right * self.focal + self.forward * x;
        let to_y = self.forward * y - self.up * self.focal;
        let axes = [0, 1, 2].map(|i| Vec4::new(to_x[i], to_y[i], self.forward[i], 0.0));
        let centre = octree.origin + octree.edge * 0.5 - self.eye;
        TileView {
            first_ray: self.ray(corner[0], corner[1]).into(),
            ray_step: [self.right / self.focal, -self.up / self.focal].map(Vec3A::from),
            centre: centre.into(),
            projected: axes[0] * centre.x + axes[1] * centre.y + axes[2] * centre.z,
            patterns: std::array::from_fn(|level| {
                Pattern::new(&axes, octree.edge * 0.5f32.powi(level as i32), self.focal)
            }),
        }
    }
}

/// What one tile needs to know of a view. Points are relative to the eye; a *projected* point is
/// (x·z, y·z, z) with x and y in pixels from the tile's corner, so that it changes linearly.
pub(super) struct TileView {
    first_ray: Vec3A,
    ray_step: [Vec3A; 2],
    /// The centre of the octree.
    pub(super) centre: Vec3A,
    /// The same, projected.
    pub(super) projected: Vec4,
    /// For the nodes of each level, which are all of one shape.
    pub(super) patterns: [Pattern; LEVELS],
}

impl TileView {
    /// The line of sight through a pixel's centre.
    pub(super) fn ray(&self, x: usize, y: usize) -> Vec3A {
        self.first_ray + self.ray_step[0] * x as f32 + self.ray_step[1] * y as f32
    }
}

/// The form pattern of a level: what all its nodes' projections have in common.
pub(super) struct Pattern {
    /// Half the edge, in metres.
    pub(super) half: f32,
    /// From the centre to the corners, projected.
    corners: [[Vec4; 2]; 3],
    /// How far the corners are from the centre, projected.
    pub(super) reach: Vec4,
    /// From the centre to the octants' centres.
    pub(super) octants: [Vec3A; 8],
    /// The same, projected.
    pub(super) octants_projected: [Vec4; 8],
    /// From this distance on, a node spans less than a pixel.
    pub(super) small_from: f32,
}

impl Pattern {
    fn new(axes: &[Vec4; 3], edge: f32, focal: f32) -> Self {
        let half = edge * 0.5;
        let sign = |octant: usize, bit: usize| if octant >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let corner = |octant: usize| -> Vec4 {
            (0..3).map(|bit| axes[bit] * (sign(octant, bit) * half)).sum()
        };
        let four = |part: usize, first: usize| {
            Vec4::from_array([0, 1, 2, 3].map(|i| corner(first + i)[part]))
        };
        Self {
            half,
            corners: [0, 1, 2].map(|part| [four(part, 0), four(part, 4)]),
            reach: axes.iter().map(|axis| axis.abs()).sum::<Vec4>() * half,
            octants: std::array::from_fn(|o| {
                Vec3A::new(sign(o, 0), sign(o, 1), sign(o, 2)) * (half * 0.5)
            }),
            octants_projected: std::array::from_fn(|o| corner(o) * 0.5),
            small_from: edge * focal / EDGE_PX,
        }
    }

    /// The box around a projected node, in pixels: least x, greatest x, least y, greatest y. The
    /// node lies wholly beyond [`NEAR`].
    pub(super) fn bounds(&self, centre: Vec4) -> [f32; 4] {
        let at = |part: usize| self.corners[part].map(|corners| corners + centre[part]);
        let ([x0, x1], [y0, y1]) = (at(0), at(1));
        let [w0, w1] = at(2).map(|z| 1.0 / z);
        let (x0, x1, y0, y1) = (x0 * w0, x1 * w1, y0 * w0, y1 * w1);
        [
            x0.min(x1).min_element(),
            x0.max(x1).max_element(),
            y0.min(y1).min_element(),
            y0.max(y1).max_element(),
        ]
    }
}
