//! What the engine's thread tells of the avatars when somebody looks.

use std::{collections::BTreeMap, time::Duration};

use sightline_engine::Engine;
use sightline_world::motion::{AvatarId, ReportingState};

use crate::operate::{PersonState, Place, Prism};

/// All avatars at one tick.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// The time from tick to tick at present.
    pub interval: Duration,
    pub avatars: BTreeMap<AvatarId, (PersonState, Place)>,
}

impl Survey {
    /// Looks at all avatars of an engine.
    pub fn take(engine: &Engine, interval: Duration) -> Self {
        let places = engine.avatars().filter_map(|avatar| Some((avatar, look(engine, avatar)?)));
        Self { interval, avatars: places.collect() }
    }
}

fn look(engine: &Engine, avatar: AvatarId) -> Option<(PersonState, Place)> {
    let known = engine.known_course(avatar);
    let is_on_course = known.is_some_and(|known| known.after > engine.config().tick);
    let state = match engine.state(avatar)? {
        ReportingState::Live if is_on_course => PersonState::OnCourse,
        ReportingState::Live => PersonState::Live,
        ReportingState::Quiet => PersonState::Quiet,
        ReportingState::Asked => PersonState::Asked,
    };
    let tbv = engine.tbv(avatar);
    let pose = known.filter(|_| tbv.is_none()).map_or(engine.pose(avatar)?, |known| known.pose);
    let place = Place {
        eye: pose.eye.into(),
        yaw: pose.yaw,
        tbv: tbv.map(|tbv| Prism::new(&tbv.within, &tbv.axes)),
        held: engine.held_by(avatar).count(),
    };
    Some((state, place))
}
