//! The engine's outputs on their way to the clients.

use std::{collections::BTreeMap, io, time::Duration};

use rayon::prelude::*;
use sightline_engine::Output;
use sightline_protocol::{frame, message::ServerMessage, outbound::Outbound};
use sightline_world::motion::{AvatarId, Pose, ReportingState};

use super::Run;
use crate::{
    dump::EventKind,
    packets::{Downlink, Packet},
};

/// What one tick has in store for each viewer: the poses of avatars, in ascending order of id.
type PosesByViewer<'a> = BTreeMap<AvatarId, &'a [(AvatarId, Pose)]>;

/// The datagrams of one client at a tick.
struct ClientDatagrams<'a> {
    to: AvatarId,
    poses: &'a [(AvatarId, Pose)],
    /// The number that the datagram after these will have.
    next_sequence: u32,
    /// The length of each datagram, in bytes.
    lengths: Vec<usize>,
}

impl Run<'_> {
    /// Sends what the engine wants told.
    pub(super) fn send_down(&mut self, now: Duration, outputs: &[Output]) -> io::Result<()> {
        let mut poses = PosesByViewer::new();
        for output in outputs {
            self.note(now, output)?;
            let to = output.to();
            // A client that has left is sent nothing more, yet the message counts.
            let mut absent = Outbound::default();
            let outbound = self.outbound.get_mut(&to).unwrap_or(&mut absent);
            match (outbound.convert(output, now), output) {
                (Some(message), _) => self.send_control(now, output, &message),
                (None, Output::Poses { poses: of_viewer, .. }) => {
                    let before = poses.insert(to, of_viewer);
                    debug_assert!(before.is_none(), "the engine tells poses once a tick");
                }
                (None, _) => debug_assert!(false, "only poses wait: {output:?}"),
            }
        }
        self.send_poses(now, poses);
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
            Output::Live { to } if self.engine.state(*to) == Some(ReportingState::Asked) => {
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

    fn send_control(&mut self, now: Duration, output: &Output, message: &ServerMessage) {
        let sampled = |avatar: &AvatarId| self.sampled.get(avatar).copied().unwrap_or(now);
        let downlink = match output {
            Output::Entered { .. } => Downlink::Entered,
            Output::Appear { avatar, .. } => Downlink::Appear(*avatar, sampled(avatar)),
            Output::Vanish { avatar, .. } => Downlink::Vanish(*avatar),
            Output::Live { .. } => Downlink::Live,
            Output::Quiet { tbv, .. } => Downlink::Quiet(*tbv),
            Output::Ask { .. } => Downlink::Ask,
            Output::Correct { .. } => Downlink::Correct,
            Output::Drop { .. } => Downlink::Drop,
            // Nobody chats in a trace, and poses are no control message.
            Output::Poses { .. } | Output::Chat { .. } => return,
        };
        let to = output.to();
        self.statistics.client(to).received.add(frame::encode(message).len());
        self.network.send(now, self.margin(to), Packet::Down(to, downlink));
    }

    /// Sends every client's datagrams. Even without new poses a client may get a datagram, since
    /// lost ones are sent again. Poses that equal the last ones, to the last bit on the wire, need
    /// no datagram: what the client holds is then as good as fresh.
    fn send_poses(&mut self, now: Duration, poses: PosesByViewer<'_>) {
        let datagrams = self.encode_poses(poses);
        for ClientDatagrams { to, poses, next_sequence, lengths } in datagrams {
            if poses.is_empty() && lengths.is_empty() {
                continue;
            }
            let client = self.statistics.client(to);
            lengths.iter().for_each(|bytes| client.received.add(*bytes));
            let sampled = |id: &AvatarId| self.sampled.get(id).copied().unwrap_or(now);
            let poses = poses.iter().map(|(id, _)| (*id, sampled(id))).collect();
            debug_assert!(lengths.len() < next_sequence as usize, "numbers begin with 1");
            let sequences = next_sequence - lengths.len() as u32..next_sequence;
            let downlink = Downlink::Poses { sequences, poses };
            self.network.send(now, self.margin(to), Packet::Down(to, downlink));
        }
    }

    /// Encodes every client's datagrams, on all cores, in ascending order of client.
    fn encode_poses<'b>(&mut self, mut poses: PosesByViewer<'b>) -> Vec<ClientDatagrams<'b>> {
        let tick = self.engine.ticks();
        let mut work: Vec<_> = self
            .outbound
            .iter_mut()
            .map(|(to, outbound)| (*to, outbound, poses.remove(to).unwrap_or_default()))
            .collect();
        let encode = |(to, outbound, poses): &mut (AvatarId, &mut Outbound, &'b [_])| {
            let lengths = outbound.encode_poses(tick).iter().map(Vec::len).collect();
            let next_sequence = outbound.next_sequence();
            ClientDatagrams { to: *to, poses, next_sequence, lengths }
        };
        work.par_iter_mut().map(encode).collect()
    }
}
