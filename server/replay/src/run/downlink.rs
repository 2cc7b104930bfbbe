//! The engine's outputs on their way to the clients.

use std::{io, time::Duration};

use rayon::prelude::*;
use sightline_engine::Output;
use sightline_protocol::outbound::Outbound;
use sightline_world::motion::{AvatarId, ReportingState};

use super::Run;
use crate::{
    dump::EventKind,
    packets::{Packet, Payload},
};

impl Run<'_> {
    /// Sends what the engine wants told.
    pub(super) fn send_down(&mut self, now: Duration, outputs: &[Output]) -> io::Result<()> {
        for output in outputs {
            self.note(now, output)?;
            let to = output.to();
            // A client that has left is sent nothing more, yet the message counts.
            let mut absent = Outbound::new(to, self.engine().config().tick);
            let outbound = self.outbound.get_mut(&to).unwrap_or(&mut absent);
            if let Some(message) = outbound.convert(output, now) {
                self.send(now, to, Payload::of(&message));
            }
        }
        self.send_poses(now);
        Ok(())
    }

    /// Counts an output, and writes the events that it makes.
    fn note(&mut self, now: Duration, output: &Output) -> io::Result<()> {
        match output {
            Output::Appear { to, avatar, .. } => {
                self.statistics.updates += 1;
                self.statistics.enter(now, *to, *avatar);
                self.note_pair(now, *to, *avatar, EventKind::Enter)?;
                self.note_pair(now, *to, *avatar, EventKind::Update)?;
            }
            Output::Vanish { to, avatar } => {
                self.statistics.leave(now, *to, *avatar);
                self.note_pair(now, *to, *avatar, EventKind::Leave)?;
            }
            Output::Poses { to, poses, .. } => {
                self.statistics.updates += poses.len() as u64;
                for (avatar, _) in poses {
                    self.note_pair(now, *to, *avatar, EventKind::Update)?;
                }
            }
            Output::Ask { to } => self.note_ask(now, *to)?,
            // For a client whose TBV was revealed, `Live` is an ask as well.
            Output::Live { to, .. }
                if self.stations.engine_of(*to).state(*to) == Some(ReportingState::Asked) =>
            {
                self.note_ask(now, *to)?;
            }
            Output::Correct { .. } => self.statistics.corrections += 1,
            _ => {}
        }
        Ok(())
    }

    fn note_ask(&mut self, now: Duration, to: AvatarId) -> io::Result<()> {
        self.statistics.asks += 1;
        self.dump.write(now, None, self.clients.trace_id(to), EventKind::Ask)
    }

    /// Sends every client's datagram, encoded on all cores, in ascending order of client. Even
    /// without new poses a client may get one, since lost ones are sent again.
    fn send_poses(&mut self, now: Duration) {
        let tick = self.engine().ticks();
        let mut work: Vec<(AvatarId, &mut Outbound)> =
            self.outbound.iter_mut().map(|(to, outbound)| (*to, outbound)).collect();
        let encode = |(to, outbound): &mut (AvatarId, &mut Outbound)| {
            let datagram =
                if outbound.has_poses(tick) { outbound.encode_poses(tick) } else { None };
            (*to, datagram)
        };
        let datagrams: Vec<(AvatarId, Option<Vec<u8>>)> = work.par_iter_mut().map(encode).collect();
        for (to, datagram) in datagrams {
            if let Some(bytes) = datagram {
                self.send(now, to, Payload::Datagram(bytes));
            }
        }
    }

    fn send(&mut self, now: Duration, to: AvatarId, payload: Payload) {
        self.statistics.client(to).received.add(payload.length());
        self.network.send(now, self.margin(to), Packet::Down(to, payload));
    }
}
