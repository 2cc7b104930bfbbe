//! Control messages: what joins, appears, vanishes, is asked, and is said.

use std::num::NonZeroU32;

use serde::{Deserialize, Serialize};

use super::{
    DecodeError, frame,
    quantise::{WirePose, WirePosition, WireTbv},
    text::{ChatLine, Name},
};
use sightline_world::motion::AvatarId;

/// From a client. The first is [`ClientMessage::Hello`], then, once the world is at hand,
/// [`ClientMessage::Enter`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ClientMessage {
    /// Who comes. The version comes first, so that every version can read every other's.
    Hello {
        /// [`super::VERSION`] of the client.
        version: u32,
        /// How it wants to be called.
        name: Name,
        /// The colour it wants, sRGB.
        colour: [u8; 3],
    },
    /// Send the world, on a stream of its own.
    FetchWorld,
    /// The world is here: let me in.
    Enter {
        /// Where it wants its eye; a spawn point when `None`.
        place: Option<WirePosition>,
    },
    /// Where I am; the answer to an ask, or because I am about to leave my TBV. Of the same
    /// sequence as the reports in datagrams.
    Report {
        /// Grows with each report.
        sequence: u32,
        /// Where.
        pose: WirePose,
    },
    /// Says something to those it sees.
    Chat {
        /// What.
        text: ChatLine,
    },
    /// Leaves.
    Goodbye,
}

impl ClientMessage {
    /// The message that fills all of a frame.
    pub fn decode(frame: &[u8]) -> Result<Self, DecodeError> {
        frame::decode(frame)
    }

    /// The version in the first frame of a client that may be of another version, whose other
    /// fields may be other ones.
    pub fn version(frame: &[u8]) -> Result<u32, DecodeError> {
        let hello: Result<(u8, u32), _> = postcard::from_bytes(frame);
        match hello {
            Ok((0, version)) => Ok(version),
            _ => Err(DecodeError::Malformed),
        }
    }
}

/// From the server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ServerMessage {
    /// The answer to a hello.
    Welcome {
        /// Who you are.
        avatar: AvatarId,
        /// The content id of the world.
        world: [u8; 32],
        /// How long its file is.
        world_bytes: u64,
        /// From tick to tick, in microseconds.
        tick_interval_us: NonZeroU32,
    },
    /// The other answer to a hello. The connection closes.
    Refused {
        /// Why.
        reason: Refusal,
    },
    /// You are in.
    Entered {
        /// Where.
        pose: WirePose,
    },
    /// An avatar may come into view.
    Appear {
        /// Who.
        avatar: AvatarId,
        /// How it is called.
        name: Name,
        /// sRGB.
        colour: [u8; 3],
        /// Where it was last.
        pose: WirePose,
        /// Older pose datagrams are not about this appearance.
        since_sequence: u32,
    },
    /// An avatar cannot be seen any more, or has left.
    Vanish {
        /// Who.
        avatar: AvatarId,
    },
    /// Report once, now.
    Ask,
    /// Nobody can see you: be silent unless asked, or about to leave this region.
    Quiet {
        /// The region.
        tbv: WireTbv,
    },
    /// Report at every tick, from now on.
    Live,
    /// Your claim was refused: you are here.
    Correct {
        /// Where.
        pose: WirePose,
    },
    /// Somebody you can see, or you yourself, said something.
    Chat {
        /// Who.
        from: AvatarId,
        /// What.
        text: ChatLine,
    },
    /// The end, and why. The connection closes.
    Goodbye {
        /// Why, for people.
        reason: ChatLine,
    },
}

impl ServerMessage {
    /// The message that fills all of a frame.
    pub fn decode(frame: &[u8]) -> Result<Self, DecodeError> {
        frame::decode(frame)
    }
}

/// Why a client may not come in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum Refusal {
    /// It speaks another version.
    #[error("the server speaks version {server} of the protocol")]
    Version {
        /// The server's.
        server: u32,
    },
    /// No more clients are taken.
    #[error("the server is full")]
    Full,
    /// The server is about to end.
    #[error("the server is closing")]
    Closing,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{VERSION, quantise::COORDINATE_MAX, text};
    use sightline_world::motion::Pose;

    fn pose() -> WirePose {
        WirePose {
            position: WirePosition::new([COORDINATE_MAX, -COORDINATE_MAX, 77]).unwrap(),
            yaw: u16::MAX,
            pitch: i16::MIN,
            velocity: [i16::MIN, i16::MAX, -1],
        }
    }

    fn longest_name() -> Name {
        Name::new(&"🦉".repeat(text::NAME_CHARS_MAX)).unwrap()
    }

    fn longest_line() -> ChatLine {
        ChatLine::new(&"🦉".repeat(text::LINE_CHARS_MAX)).unwrap()
    }

    /// One of each, as long as it can be.
    fn client_messages() -> Vec<ClientMessage> {
        vec![
            ClientMessage::Hello { version: u32::MAX, name: longest_name(), colour: [255; 3] },
            ClientMessage::FetchWorld,
            ClientMessage::Enter { place: None },
            ClientMessage::Enter { place: Some(pose().position) },
            ClientMessage::Report { sequence: u32::MAX, pose: pose() },
            ClientMessage::Chat { text: longest_line() },
            ClientMessage::Goodbye,
        ]
    }

    fn server_messages() -> Vec<ServerMessage> {
        let avatar = AvatarId(u32::MAX);
        vec![
            ServerMessage::Welcome {
                avatar,
                world: [9; 32],
                world_bytes: u64::MAX,
                tick_interval_us: NonZeroU32::MAX,
            },
            ServerMessage::Refused { reason: Refusal::Version { server: u32::MAX } },
            ServerMessage::Refused { reason: Refusal::Full },
            ServerMessage::Refused { reason: Refusal::Closing },
            ServerMessage::Entered { pose: pose() },
            ServerMessage::Appear {
                avatar,
                name: longest_name(),
                colour: [1, 2, 3],
                pose: pose(),
                since_sequence: u32::MAX,
            },
            ServerMessage::Vanish { avatar },
            ServerMessage::Ask,
            ServerMessage::Quiet {
                tbv: WireTbv {
                    min: pose().position,
                    max: pose().position,
                    turn: i32::MIN,
                    validity_ms: u32::MAX,
                    notice_ms: u16::MAX,
                },
            },
            ServerMessage::Live,
            ServerMessage::Correct { pose: pose() },
            ServerMessage::Chat { from: avatar, text: longest_line() },
            ServerMessage::Goodbye { reason: longest_line() },
        ]
    }

    fn body<M: Serialize>(message: &M) -> Vec<u8> {
        frame::encode(message)[2..].to_vec()
    }

    #[test]
    fn every_message_comes_back() {
        for message in client_messages() {
            assert_eq!(ClientMessage::decode(&body(&message)), Ok(message));
        }
        for message in server_messages() {
            assert_eq!(ServerMessage::decode(&body(&message)), Ok(message));
        }
    }

    #[test]
    fn every_cut_and_every_longer_message_is_refused() {
        let all = client_messages().iter().map(body).collect::<Vec<_>>();
        for bytes in all {
            for end in 0..bytes.len() {
                assert!(ClientMessage::decode(&bytes[..end]).is_err());
            }
            let longer = [bytes.as_slice(), &[0]].concat();
            assert_eq!(ClientMessage::decode(&longer), Err(DecodeError::Trailing));
        }
    }

    /// Whatever a flipped bit makes of a message, it is refused, or a message that can be encoded
    /// again and whose numbers are finite.
    #[test]
    fn every_flip_is_refused_or_valid() {
        let mut valid = 0;
        for original in client_messages().iter().map(body) {
            for_each_flip(&original, |bytes| {
                if let Ok(message) = ClientMessage::decode(bytes) {
                    valid += 1;
                    assert_eq!(ClientMessage::decode(&body(&message)).as_ref(), Ok(&message));
                    if let ClientMessage::Report { pose, .. } = message {
                        assert!(Pose::from(pose).is_finite());
                    }
                }
            });
        }
        for original in server_messages().iter().map(body) {
            for_each_flip(&original, |bytes| {
                if let Ok(message) = ServerMessage::decode(bytes) {
                    valid += 1;
                    assert_eq!(ServerMessage::decode(&body(&message)).as_ref(), Ok(&message));
                }
            });
        }
        assert!(valid > 100, "the flips must reach past the first byte");
    }

    /// Each byte, changed to every other value.
    fn for_each_flip(original: &[u8], mut check: impl FnMut(&[u8])) {
        let mut bytes = original.to_vec();
        for i in 0..bytes.len() {
            for flip in 1..=255 {
                bytes[i] = original[i] ^ flip;
                check(&bytes);
            }
            bytes[i] = original[i];
        }
    }

    #[test]
    fn a_hello_of_any_version_tells_its_version() {
        let name = Name::new("Ada").unwrap();
        let hello = ClientMessage::Hello { version: VERSION, name, colour: [0; 3] };
        assert_eq!(ClientMessage::version(&body(&hello)), Ok(VERSION));
        assert_eq!(ClientMessage::version(&[0, 9, 0xff, 0xff]), Ok(9));
        assert_eq!(
            ClientMessage::version(&body(&ClientMessage::Goodbye)),
            Err(DecodeError::Malformed)
        );
        assert_eq!(ClientMessage::version(&[]), Err(DecodeError::Malformed));
    }

    #[test]
    fn no_tick_interval_is_nothing() {
        let message = server_messages().remove(0);
        let bytes = body(&message);
        let zero = [&bytes[..bytes.len() - 5], &[0]].concat();
        assert_eq!(ServerMessage::decode(&zero), Err(DecodeError::Malformed));
    }
}
