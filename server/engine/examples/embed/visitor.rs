use std::{collections::BTreeMap, mem, time::Duration};

use glam::Vec3;
use sightline_engine::Output;
use sightline_world::motion::{Agility, AvatarId, Pose, Tbv};

/// Walking speed, in metres a second.
const WALKING: f32 = 1.5;

/// A client: where its avatar is, and what it was told.
#[derive(Default)]
pub struct Visitor {
    pub pose: Pose,
    pub sequence: u32,
    /// The TBV in which it may be silent; `None` while it is live.
    pub tbv: Option<Tbv>,
    is_asked: bool,
    /// The avatars that it was told of, with their last poses.
    pub sees: BTreeMap<AvatarId, Pose>,
}

impl Visitor {
    pub fn walk(&mut self, towards: Vec3, tick: Duration) {
        let step = (towards - self.pose.eye).clamp_length_max(WALKING * tick.as_secs_f32());
        self.pose.eye += step;
        self.pose.velocity = step / tick.as_secs_f32();
    }

    /// Whether it must report at this tick.
    pub fn must_report(&mut self, tick: Duration, agility: &Agility) -> bool {
        let is_silent = self.tbv.is_some_and(|tbv| tbv.holds(&self.pose, tick, agility));
        mem::take(&mut self.is_asked) || !is_silent
    }

    pub fn hear(&mut self, output: Output) {
        match output {
            Output::Entered { pose, .. } | Output::Correct { pose, .. } => self.pose = pose,
            Output::Appear { avatar, pose, .. } => drop(self.sees.insert(avatar, pose)),
            Output::Poses { poses, .. } => self.sees.extend(poses),
            Output::Vanish { avatar, .. } => drop(self.sees.remove(&avatar)),
            Output::Live { .. } => self.tbv = None,
            Output::Quiet { tbv, .. } => self.tbv = Some(tbv),
            Output::Ask { .. } => self.is_asked = true,
            Output::Chat { .. } => {}
            Output::Drop { reason, .. } => panic!("all clients here are honest: {reason}"),
        }
    }
}
