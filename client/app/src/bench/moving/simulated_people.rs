//! The messages about people that a server would send, without a server.

use std::time::Duration;

use glam::Vec3;
use sightline_client_core::replica::Replica;
use sightline_protocol::{message::ServerMessage, pose_stream::PoseEncoder, text::Name};
use sightline_world::motion::{Agility, AvatarId, Body, Pose};

const TICK: Duration = Duration::from_millis(50);
/// The top speed of the onlooker, in metres per second. It stands still.
const SPEED_MAX: f32 = 4.0;
const NAME: &str = "somebody";

/// People whose poses a client receives at each tick, as datagrams.
pub struct SimulatedPeople {
    count: usize,
    encoder: PoseEncoder,
    replica: Replica,
    tick: u32,
}

impl SimulatedPeople {
    /// A number of people, with ids from 0.
    pub fn new(count: usize) -> Self {
        let agility = Agility::of(&Body::PERSON, SPEED_MAX);
        let replica = Replica::new(AvatarId(u32::MAX), TICK, agility);
        Self { count, encoder: PoseEncoder::new(TICK), replica, tick: 0 }
    }

    /// The client's replica.
    pub fn replica(&mut self) -> &mut Replica {
        &mut self.replica
    }

    /// Advances to a time: encodes all poses, by number and time, at each tick up to it.
    pub fn advance(&mut self, now: Duration, pose: impl Fn(usize, Duration) -> Pose) {
        while TICK * self.tick <= now {
            let time = TICK * self.tick;
            if self.tick == 0 {
                (0..self.count).for_each(|at| self.appear(at, time, &pose(at, time)));
            }
            let poses = (0..self.count).map(|at| (AvatarId(at as u32), pose(at, time)));
            self.encoder.tell(self.tick, Vec3::ZERO, &poses.collect::<Vec<_>>());
            while let Some(datagram) = self.encoder.encode(self.tick) {
                // The datagram was just encoded, so it is valid.
                let _ = self.replica.datagram(time, &datagram);
            }
            self.tick += 1;
        }
    }

    /// Lets one person vanish and appear again.
    pub fn reappear(&mut self, at: usize, now: Duration, pose: &Pose) {
        let vanish = ServerMessage::Vanish { avatar: AvatarId(at as u32) };
        let _ = self.replica.message(now, vanish);
        self.appear(at, now, pose);
    }

    fn appear(&mut self, at: usize, now: Duration, pose: &Pose) {
        let Ok(name) = Name::new(NAME) else { return };
        let appear = ServerMessage::Appear {
            avatar: AvatarId(at as u32),
            name,
            colour: [200, at as u8, 90],
            pose: pose.into(),
            tick: self.tick,
            since_sequence: self.encoder.next_sequence(),
        };
        let _ = self.replica.message(now, appear);
    }
}
