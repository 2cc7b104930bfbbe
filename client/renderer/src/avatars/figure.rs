//! The parts of a figure: which ellipsoids a person is made of.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat3, Vec3};

use super::AvatarFigure;

/// An ellipsoid of a figure, in the world's axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    pub(super) centre: Vec3,
    /// The columns are the ellipsoid's half axes: it is the image of the unit ball.
    pub(super) shape: Mat3,
    pub(super) colour: Vec3,
    /// Whether it has a face and hair.
    pub(super) is_head: bool,
}

const SKIN: Vec3 = Vec3::new(232.0, 190.0, 160.0);
const SHOES: Vec3 = Vec3::new(38.0, 34.0, 34.0);
/// The colour of trousers, of which the person's own colour makes a quarter.
const TROUSERS: Vec3 = Vec3::new(52.0, 58.0, 78.0);
/// The width of a person as a share of the height, at most.
const WIDTH_SHARE: f32 = 0.12;
/// How fast legs swing with all their strength, in metres a second.
const STRIDE_M_PER_S: f32 = 1.4;

/// The parts of a figure. One that is `small` in the picture has fewer.
pub(super) fn parts(figure: &AvatarFigure, small: bool) -> Vec<Part> {
    let build = Build::of(figure);
    if small {
        return vec![build.head(), build.far_trunk(), build.far_legs()];
    }
    let mut parts = vec![build.head(), build.neck(), build.chest(), build.belly(), build.hips()];
    for side in [-1.0, 1.0] {
        parts.extend(build.arm(side));
        parts.extend(build.leg(side));
    }
    parts
}

/// The head of a figure.
pub(super) fn head(figure: &AvatarFigure) -> Part {
    Build::of(figure).head()
}

/// The measures of a figure. Places are given as right, up from the soles and forward: `right` and
/// `forward` in units of half the width, `up` as a share of the height.
struct Build {
    soles: Vec3,
    height: f32,
    /// Half the width, in metres.
    half: f32,
    /// From the person's own axes (right, up, backward) to the world's.
    turn: Mat3,
    pitch: f32,
    /// By how much the right leg is ahead, from -1 to 1.
    swing: f32,
    colour: Vec3,
}

impl Build {
    fn of(figure: &AvatarFigure) -> Self {
        let AvatarFigure { pose, body, .. } = figure;
        let height = body.above_eye + body.below_eye;
        let speed = pose.velocity.with_y(0.0).length();
        Self {
            soles: pose.eye - Vec3::Y * body.below_eye,
            height,
            half: body.half_width.min(WIDTH_SHARE * height),
            turn: Mat3::from_rotation_y(pose.yaw),
            pitch: pose.pitch,
            swing: figure.stride.sin() * (speed / STRIDE_M_PER_S).min(1.0),
            colour: Vec3::from(figure.colour.map(f32::from)),
        }
    }

    /// An upright part. Its radii are in the units of its place.
    fn part(&self, [right, up, forward]: [f32; 3], radii: [f32; 3], colour: Vec3) -> Part {
        let own = self.metres([right, up, -forward]);
        let shape = self.turn * Mat3::from_diagonal(self.metres(radii));
        Part { centre: self.soles + self.turn * own, shape, colour, is_head: false }
    }

    fn metres(&self, [right, up, back]: [f32; 3]) -> Vec3 {
        Vec3::new(right * self.half, up * self.height, back * self.half)
    }

    /// A limb that hangs from a joint and is swung forward by an angle in radians.
    fn limb(&self, joint: [f32; 2], length: f32, width: [f32; 2], angle: f32) -> Part {
        let [right, up] = joint;
        let tilt = self.turn * Mat3::from_rotation_x(angle);
        let radii = self.metres([width[0], length * 0.5, width[1]]);
        let hung = tilt * Vec3::NEG_Y * radii.y;
        Part {
            centre: self.soles + self.turn * self.metres([right, up, 0.0]) + hung,
            shape: tilt * Mat3::from_diagonal(radii),
            colour: self.colour,
            is_head: false,
        }
    }

    fn head(&self) -> Part {
        let head = self.part([0.0, 0.922, 0.0], [0.46, 0.076, 0.5], SKIN);
        let nod = Mat3::from_rotation_x((self.pitch * 0.6).clamp(-FRAC_PI_2, FRAC_PI_2));
        let radii = Mat3::from_diagonal(self.metres([0.46, 0.076, 0.5]));
        Part { shape: self.turn * nod * radii, is_head: true, ..head }
    }

    fn neck(&self) -> Part {
        self.part([0.0, 0.845, 0.0], [0.24, 0.04, 0.24], SKIN)
    }

    /// The shoulders and the upper part of the trunk.
    fn chest(&self) -> Part {
        self.part([0.0, 0.735, 0.0], [0.86, 0.1, 0.48], self.colour)
    }

    fn belly(&self) -> Part {
        self.part([0.0, 0.6, 0.0], [0.62, 0.15, 0.44], self.colour)
    }

    fn hips(&self) -> Part {
        self.part([0.0, 0.49, 0.0], [0.64, 0.06, 0.46], self.trousers())
    }

    fn trousers(&self) -> Vec3 {
        TROUSERS.lerp(self.colour, 0.25)
    }

    /// An arm with its hand: the left one at side -1, the right one at side 1.
    fn arm(&self, side: f32) -> [Part; 2] {
        let angle = -side * self.swing_angle();
        let sleeve = self.limb([side * 0.76, 0.8], 0.36, [0.16, 0.2], angle);
        let reach = self.turn * Mat3::from_rotation_x(angle) * Vec3::NEG_Y * (0.37 * self.height);
        let shoulder = self.soles + self.turn * self.metres([side * 0.76, 0.8, 0.0]);
        let hand = self.part([0.0; 3], [0.13, 0.03, 0.16], SKIN);
        let colour = self.colour * 0.88;
        [Part { colour, ..sleeve }, Part { centre: shoulder + reach, ..hand }]
    }

    /// A leg with its shoe: the left one at side -1, the right one at side 1.
    fn leg(&self, side: f32) -> [Part; 2] {
        let angle = side * self.swing_angle();
        let leg = self.limb([side * 0.33, 0.52], 0.5, [0.29, 0.3], angle);
        let ahead = angle.sin() * 0.5 * self.height / self.half;
        let shoe = self.part([side * 0.33, 0.026, 0.12 + ahead], [0.24, 0.026, 0.36], SHOES);
        [Part { colour: self.trousers(), ..leg }, shoe]
    }

    /// The angle between a swung limb and the vertical, in radians: such that shoes stay inside the
    /// body.
    fn swing_angle(&self) -> f32 {
        self.swing * 0.8 * self.half / self.height
    }

    fn far_trunk(&self) -> Part {
        self.part([0.0, 0.65, 0.0], [0.9, 0.22, 0.6], self.colour)
    }

    fn far_legs(&self) -> Part {
        self.part([0.0, 0.26, 0.0], [0.62, 0.26, 0.5], self.trousers())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use sightline_world::{
        geometry::Aabb,
        motion::{Body, Pose},
    };

    use super::*;

    proptest! {
        #[test]
        fn every_part_stays_inside_the_body(
            [yaw, pitch, stride] in prop::array::uniform3(-3.2f32..3.2),
            speed in 0.0f32..6.0,
            (half_width, below_eye) in (0.15f32..0.5, 0.8f32..1.9),
        ) {
            let body = Body { half_width, below_eye, above_eye: 0.1 };
            let pose =
                Pose { yaw, pitch: pitch * 0.49, velocity: Vec3::X * speed, ..Pose::default() };
            let figure = AvatarFigure { pose, body, colour: [1; 3], name: "", stride, light: None };
            let around = body.around(Vec3::ZERO).grown(1e-4);
            for small in [false, true] {
                for part in parts(&figure, small) {
                    let rows = part.shape.transpose();
                    let reach = Vec3::new(
                        rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length(),
                    );
                    let bounds = Aabb::new(part.centre - reach, part.centre + reach);
                    prop_assert!(around.contains_box(&bounds), "{part:?}, {bounds:?}");
                }
            }
        }
    }
}
