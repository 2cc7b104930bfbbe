//! Outputs of the engine as they are on the wire, for their lengths.

use std::time::Duration;

use sightline_protocol::{
    message::ServerMessage,
    quantise::WireTbv,
    text::{ChatLine, Name},
};

use sightline_engine::Output;

/// An output as it is on the wire; none when it is coded with others, or not at all.
pub(super) fn message(
    now: Duration,
    output: &Output,
    since_sequence: u32,
) -> Option<ServerMessage> {
    Some(match output {
        Output::Entered { pose, .. } => ServerMessage::Entered { pose: pose.into() },
        Output::Appear { avatar, name, colour, pose, .. } => ServerMessage::Appear {
            avatar: *avatar,
            name: Name::new(name).ok()?,
            colour: *colour,
            pose: pose.into(),
            since_sequence,
        },
        Output::Vanish { avatar, .. } => ServerMessage::Vanish { avatar: *avatar },
        Output::Live { .. } => ServerMessage::Live,
        Output::Quiet { tbv, .. } => ServerMessage::Quiet { tbv: WireTbv::new(tbv, now) },
        Output::Ask { .. } => ServerMessage::Ask,
        Output::Correct { pose, .. } => ServerMessage::Correct { pose: pose.into() },
        Output::Drop { reason, .. } => ServerMessage::Goodbye { reason: ChatLine::clipped(reason) },
        Output::Poses { .. } | Output::Chat { .. } => return None,
    })
}
