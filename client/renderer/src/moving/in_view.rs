//! What moves and is in view at one moment, and drawing it.

use std::{f32::consts::TAU, time::Duration};

use glam::DAffine3;
use sightline_client_core::replica::ShownAvatar;
use sightline_visibility::rooms::BuildingSight;
use sightline_world::{Mover, World, octree::Octree};

use crate::{
    Camera, Frame,
    avatars::{self, AvatarFigure},
    movers,
};

/// How often a walking person makes two steps, per second.
const STRIDES_PER_S: f64 = 0.95;

/// The movers and avatars that may be in view at one moment.
#[derive(Clone, Debug, Default)]
pub struct InView {
    pub(super) now: Duration,
    /// The indices of the movers, and where they are.
    pub(super) movers: Vec<(u32, DAffine3)>,
    pub(super) avatars: Vec<ShownAvatar>,
}

impl InView {
    /// Whether this would be drawn just as another moment is: the same movers and avatars at the
    /// same places. A picture that shows one need not be drawn anew for the other.
    pub fn looks_like(&self, other: &Self) -> bool {
        self.movers == other.movers && self.avatars == other.avatars
    }

    /// Leaves out the movers that rooms do not show to the camera's eye.
    pub fn leave_out_hidden(&mut self, sight: &BuildingSight, world: &World) {
        let mover = |at: u32| world.movers.get(at as usize);
        self.movers.retain(|(at, _)| mover(*at).is_some_and(|mover| sight.may_show(mover)));
    }

    /// Draws what is in view into a frame that shows the octree of the building from the same
    /// camera. Returns the avatars that can be seen: those that at least one pixel shows.
    pub fn draw(
        &self,
        frame: &mut Frame,
        camera: &Camera,
        world: &World,
        octree: &Octree,
    ) -> Vec<ShownAvatar> {
        let doors: Vec<&Mover> =
            self.movers.iter().filter_map(|(at, _)| world.movers.get(*at as usize)).collect();
        movers::draw_selected(frame, camera, world, &doors, self.now);
        let stride = (self.now.as_secs_f64() * STRIDES_PER_S).fract() as f32 * TAU;
        let figure = |avatar| {
            let ShownAvatar { name, colour, pose, .. }: &'_ ShownAvatar = avatar;
            let light = world.light_at(world.body.middle(pose.eye));
            AvatarFigure { pose: *pose, body: world.body, colour: *colour, name, stride, light }
        };
        let figures: Vec<AvatarFigure> = self.avatars.iter().map(figure).collect();
        let is_seen = avatars::draw(frame, camera, octree, &figures);
        let seen = self.avatars.iter().zip(is_seen).filter(|(_, is_seen)| *is_seen);
        seen.map(|(avatar, _)| avatar.clone()).collect()
    }
}
