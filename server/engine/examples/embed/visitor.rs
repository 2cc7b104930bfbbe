//! A client of the example: it walks, and reports when it must.

use std::{collections::BTreeMap, mem, time::Duration};

use glam::Vec3;
use sightline_engine::Output;
use sightline_world::motion::{Agility, AvatarId, KEEP_ALIVE, Pose, Report, Tbv, Tolerance};

/// Walking speed, in metres a second.
const WALKING: f32 = 1.5;

/// A client: where its avatar is, and what it was told.
pub struct Visitor {
    pub pose: Pose,
    /// The TBV in which it may be silent; `None` while it is live.
    pub tbv: Option<Tbv>,
    /// What it may leave unsaid while it is live.
    tolerance: Tolerance,
    /// How many orders it has heard.
    orders: u32,
    is_asked: bool,
    /// Its last report, with which its course begins.
    last: Option<Report>,
    /// The avatars that it was told of: where each one's course began, and when.
    pub sees: BTreeMap<AvatarId, (Duration, Pose)>,
}

impl Default for Visitor {
    fn default() -> Self {
        Self {
            pose: Pose::default(),
            tbv: None,
            tolerance: Tolerance::NONE,
            orders: 0,
            is_asked: false,
            last: None,
            sees: BTreeMap::new(),
        }
    }
}

impl Visitor {
    pub fn walk(&mut self, towards: Vec3, tick: Duration) {
        let step = (towards - self.pose.eye).clamp_length_max(WALKING * tick.as_secs_f32());
        self.pose.eye += step;
        self.pose.velocity = step / tick.as_secs_f32();
    }

    /// What it reports at a tick; `None` when it may be silent.
    pub fn report(&mut self, now: Duration, tick: Duration, agility: &Agility) -> Option<Report> {
        let is_silent = match (&self.tbv, &self.last) {
            (Some(tbv), _) => tbv.holds(&self.pose, tick, agility),
            (None, None) => false,
            (None, Some(last)) => {
                let elapsed = now - last.made;
                let course = last.pose.on_course(elapsed, agility);
                elapsed + tick <= KEEP_ALIVE
                    && self.tolerance.holds(&course, &self.pose, agility)
                    && self.tolerance.holds_turn(&course, &self.pose)
            }
        };
        let is_asked = mem::take(&mut self.is_asked);
        if is_silent && !is_asked {
            return None;
        }
        let report = Report { made: now, orders: self.orders, pose: self.pose };
        self.last = Some(report);
        Some(report)
    }

    pub fn hear(&mut self, now: Duration, output: Output) {
        match output {
            Output::Entered { pose, .. } | Output::Correct { pose, .. } => {
                (self.pose, self.last) = (pose, None);
            }
            Output::Appear { avatar, pose, .. } => drop(self.sees.insert(avatar, (now, pose))),
            Output::Poses { poses, .. } => {
                self.sees.extend(poses.into_iter().map(|(avatar, pose)| (avatar, (now, pose))));
            }
            Output::Vanish { avatar, .. } => drop(self.sees.remove(&avatar)),
            Output::Live { tolerance, .. } => {
                // Where less may be left unsaid, a report shows that the order was heard.
                let is_known = self.tbv.is_none() && !self.tolerance.is_none();
                self.is_asked |= !is_known || !self.tolerance.is_within(&tolerance);
                (self.tbv, self.tolerance) = (None, tolerance);
                self.orders += 1;
            }
            Output::Quiet { tbv, .. } => {
                self.tbv = Some(tbv);
                self.orders += 1;
            }
            Output::Ask { .. } => self.is_asked = true,
            Output::Chat { .. } => {}
            Output::Drop { reason, .. } => panic!("all clients here are honest: {reason}"),
        }
    }

    /// Where another avatar is shown.
    pub fn shows(&self, avatar: AvatarId, now: Duration) -> Vec3 {
        let (since, pose) = self.sees[&avatar];
        pose.straight_on(now - since).eye
    }
}
