//! Projection: how points become pixels, and pixels lines of sight.

use glam::{Mat3, Vec3, Vec3A, Vec4};
use sightline_world::{
    geometry::Aabb,
    octree::{DEPTH_MAX, Octree},
};

use super::{
    Camera, Mode,
    margins::{NEAR, SEAM_PX},
    ratio::{coarse_ratio_min, ratio_min},
    ways::Ways,
};

/// An inner node is drawn as a whole when its edge spans no more than this many pixels.
const EDGE_PX: f32 = 1.0;

/// The number of levels of the deepest octree, with that of the root.
const LEVELS: usize = DEPTH_MAX as usize + 1;

/// A camera and the size of its picture.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub(super) eye: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    /// The focal length in pixels.
    focal: f32,
    /// The centre of the picture, in pixels. The centres of pixels have whole coordinates.
    centre: [f32; 2],
    /// [`ratio_min`] for this focal length.
    ratio_min: f32,
    /// [`coarse_ratio_min`] for this focal length.
    coarse_ratio_min: f32,
}

impl View {
    pub(super) fn new(camera: &Camera, width: usize, height: usize) -> Self {
        let (sin_yaw, cos_yaw) = camera.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = camera.pitch.sin_cos();
        let forward = Vec3::new(-sin_yaw * cos_pitch, sin_pitch, -cos_yaw * cos_pitch);
        let right = Vec3::new(cos_yaw, 0.0, -sin_yaw);
        let focal = camera.focal(height);
        let (width, height) = (width as f32, height as f32);
        Self {
            eye: camera.eye,
            right,
            up: right.cross(forward),
            forward,
            focal,
            ratio_min: ratio_min(focal),
            coarse_ratio_min: coarse_ratio_min(focal),
            centre: [(width - 1.0) * 0.5, (height - 1.0) * 0.5],
        }
    }

    /// The line of sight through the centre of a pixel. Its component along the camera's direction
    /// is one.
    pub(super) fn ray(&self, x: f32, y: f32) -> Vec3 {
        let across = (x - self.centre[0]) / self.focal;
        let down = (y - self.centre[1]) / self.focal;
        self.forward + self.right * across - self.up * down
    }

    /// The difference between the lines of sight through a pixel and through the one to its left.
    pub(super) fn ray_step(&self) -> Vec3 {
        self.right / self.focal
    }

    /// The depth of a point: its distance along the camera's direction, in metres.
    pub(super) fn depth(&self, point: Vec3) -> f32 {
        self.forward.dot(point - self.eye)
    }

    /// By how much the nearest point of an ellipsoid is less deep than its centre, in metres. The
    /// columns of its shape are its half axes.
    pub(super) fn depth_reach(&self, shape: &Mat3) -> f32 {
        (shape.transpose() * self.forward).length()
    }

    /// The column and the row of a point in pixels, and its depth in metres. Column and row mean
    /// nothing unless the depth is positive.
    pub(super) fn project(&self, point: Vec3) -> Vec3 {
        let point = point - self.eye;
        let z = self.forward.dot(point);
        let scale = self.focal / z;
        let x = self.centre[0] + self.right.dot(point) * scale;
        Vec3::new(x, self.centre[1] - self.up.dot(point) * scale, z)
    }

    /// The focal length in pixels: how many pixels a length of one metre spans at a distance of one
    /// metre.
    pub(super) fn focal(&self) -> f32 {
        self.focal
    }

    /// Whether all points, relative to the eye, lie beyond the same side of the picture. Then so
    /// does their convex hull, even where it reaches behind the eye.
    pub(super) fn are_beside<const N: usize>(&self, points: [Vec3; N]) -> bool {
        let reach = self.centre.map(|centre| (centre + 1.0) / self.focal);
        let beyond = |side: Vec3, reach: f32| {
            points.iter().all(|point| side.dot(*point) > reach * self.forward.dot(*point))
        };
        beyond(self.right, reach[0])
            || beyond(-self.right, reach[0])
            || beyond(self.up, reach[1])
            || beyond(-self.up, reach[1])
    }

    /// The columns and rows that a box spans, each as least and greatest number of pixels. A box
    /// that is wholly behind the eye or beside the picture spans none. A box that is partly behind
    /// the eye spans all, with infinite ends.
    pub(super) fn bounds(&self, centre: Vec3, radii: Vec3) -> ([f32; 2], [f32; 2]) {
        let corners = Aabb::new(centre - radii, centre + radii).corners();
        let projected = corners.map(|corner| self.project(corner));
        let (nearest, farthest) = projected
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), at| (a.min(at.z), b.max(at.z)));
        let is_beside = || self.are_beside(corners.map(|corner| corner - self.eye));
        if farthest < NEAR || nearest < NEAR && is_beside() {
            return ([0.0, -1.0], [0.0, -1.0]);
        }
        if nearest < NEAR {
            return ([f32::NEG_INFINITY, f32::INFINITY], [f32::NEG_INFINITY, f32::INFINITY]);
        }
        let bounds = Aabb::from_points(projected);
        ([bounds.min.x, bounds.max.x], [bounds.min.y, bounds.max.y])
    }

    /// The view for a band that begins at a row.
    pub(super) fn band(&self, row: usize, octree: &Octree, mode: Mode) -> BandView {
        debug_assert!(octree.depth <= DEPTH_MAX, "{} levels", octree.depth);
        let [x, y] = [self.centre[0], self.centre[1] - row as f32];
        let to_x = self.right * self.focal + self.forward * x;
        let to_y = self.forward * y - self.up * self.focal;
        let axes = [0, 1, 2].map(|i| Vec4::new(to_x[i], to_y[i], self.forward[i], 0.0));
        let centre = octree.origin + octree.edge * 0.5 - self.eye;
        let mut view = BandView {
            first_ray: self.ray(0.0, row as f32).into(),
            ray_step: [self.right / self.focal, -self.up / self.focal].map(Vec3A::from),
            axes,
            centre: centre.into(),
            projected: Vec4::ZERO,
            pixel: 1.0 / self.focal,
            ratio_min: self.ratio_min,
            coarse_ratio_min: self.coarse_ratio_min,
            ways: Ways::new(mode, octree.voxel() * self.focal),
            patterns: std::array::from_fn(|level| {
                LevelPattern::new(&axes, octree.edge * 0.5f32.powi(level as i32), self.focal)
            }),
        };
        view.projected = view.project(view.centre);
        view
    }
}

/// The view of one band. Points are relative to the eye. A *projected* point is (x·z, y·z, z) with
/// the depth z, and with x and y in pixels from the band's upper left corner. Projection is linear
/// in these numbers.
pub(super) struct BandView {
    /// The line of sight through the band's first pixel.
    pub(super) first_ray: Vec3A,
    /// The differences to the lines of sight through the next pixel on the right, and below.
    pub(super) ray_step: [Vec3A; 2],
    /// What one metre along each axis adds to a projected point.
    pub(super) axes: [Vec4; 3],
    /// The centre of the octree.
    pub(super) centre: Vec3A,
    /// The centre of the octree, projected.
    pub(super) projected: Vec4,
    /// The width of a pixel at a distance of one metre, in metres.
    pub(super) pixel: f32,
    /// [`ratio_min`] for this focal length.
    pub(super) ratio_min: f32,
    /// [`coarse_ratio_min`] for this focal length.
    pub(super) coarse_ratio_min: f32,
    /// The patterns of the nodes of each level, which are all of one shape.
    pub(super) patterns: [LevelPattern; LEVELS],
    /// Which way nodes are drawn.
    pub(super) ways: Ways,
}

impl BandView {
    /// The line of sight through a pixel's centre.
    #[inline(always)]
    pub(super) fn ray(&self, x: usize, y: usize) -> Vec3A {
        self.first_ray + self.ray_step[0] * x as f32 + self.ray_step[1] * y as f32
    }

    /// By how much a node at this depth is drawn larger on each side, in metres.
    #[inline(always)]
    pub(super) fn seam(&self, depth: f32) -> f32 {
        SEAM_PX * self.pixel * depth.max(NEAR)
    }

    /// Projects a point that is relative to the eye.
    #[inline(always)]
    pub(super) fn project(&self, point: Vec3A) -> Vec4 {
        self.axes[0] * point.x + self.axes[1] * point.y + self.axes[2] * point.z
    }
}

/// What the projections of all nodes of a level have in common.
pub(super) struct LevelPattern {
    /// Half the edge, in metres.
    pub(super) half: f32,
    /// From a node's centre to its corners, projected: four corners in each vector, for x, y and z.
    corners: [[Vec4; 2]; 3],
    /// How far the corners reach from the centre, projected.
    pub(super) reach: Vec4,
    /// From the centre to the octants' centres, in metres.
    pub(super) octants: [Vec3A; 8],
    /// From the centre to the octants' centres, projected.
    pub(super) octants_projected: [Vec4; 8],
    /// From this depth on, a node spans less than a pixel.
    pub(super) small_from: f32,
}

impl LevelPattern {
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

    /// The bounding box of a projected node that lies wholly beyond [`NEAR`], in pixels: least x,
    /// greatest x, least y, greatest y.
    #[inline(always)]
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
