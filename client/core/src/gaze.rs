//! Where a person looks: turned by mouse, keys, fingers and sticks.

use std::f32::consts::{FRAC_PI_2, TAU};

use sightline_world::motion::Pose;

/// Just below straight up, where the view would turn over.
const PITCH_MAX: f32 = FRAC_PI_2 - 0.01;

/// The direction of view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gaze {
    yaw: f32,
    pitch: f32,
}

impl Gaze {
    /// Takes the direction of view from a pose.
    pub fn face(&mut self, pose: &Pose) {
        (self.yaw, self.pitch) = (pose.yaw, pose.pitch);
    }

    /// Turns by angles, in radians. The view never turns over. Angles that are not finite are
    /// ignored.
    pub fn turn(&mut self, left: f32, up: f32) {
        if left.is_finite() && up.is_finite() {
            self.yaw = (self.yaw + left).rem_euclid(TAU);
            self.pitch = (self.pitch + up).clamp(-PITCH_MAX, PITCH_MAX);
        }
    }

    /// The heading, as in [`Pose::yaw`].
    pub fn yaw(&self) -> f32 {
        self.yaw
    }

    /// The elevation, as in [`Pose::pitch`].
    pub fn pitch(&self) -> f32 {
        self.pitch
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_view_never_turns_over() {
        let mut gaze = Gaze::default();
        gaze.turn(-1.0e4, 1.0e4);
        gaze.turn(f32::NAN, 0.0);
        assert!(gaze.pitch() < FRAC_PI_2 && gaze.pitch() > 1.5);
        assert!((0.0..=TAU).contains(&gaze.yaw()));
    }
}
