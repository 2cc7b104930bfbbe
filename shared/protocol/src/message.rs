//! Control messages between client and server, on the reliable stream.

use std::{net::SocketAddr, num::NonZeroU32};

use serde::{Deserialize, Serialize};

use super::{
    DecodeError,
    fingerprint::{Fingerprint, VisitorSecret},
    frame,
    pose_stream::Ack,
    quantise::{WirePose, WirePosition, WireReport, WireTbv, WireTolerance},
    text::{ChatLine, Name},
};
use sightline_world::motion::AvatarId;

/// A message from a client. The first is [`ClientMessage::Hello`]. Once the client has the world
/// that the server offers, [`ClientMessage::Enter`] follows, and again for each later world.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ClientMessage {
    /// Asks to join. The version is the first field, so that every version can read that of every
    /// other.
    Hello {
        /// The client's [`VERSION`](super::VERSION).
        version: u32,
        /// The name it wants.
        name: Name,
        /// The colour it wants, in sRGB.
        colour: [u8; 3],
        /// An invitation, where not everybody is let in.
        invitation: Option<ChatLine>,
        /// The secret of a visitor with a browser, which can show no certificate.
        secret: Option<VisitorSecret>,
    },
    /// Asks for the offered world, which is sent on a stream of its own. The stream begins with the
    /// number of the world: four bytes, the lowest first.
    FetchWorld {
        /// The number of the offered world. A world that is offered no more is not sent.
        world: u32,
    },
    /// Asks to enter the offered world, which the client has now.
    Enter {
        /// The number of the offered world. A world that is offered no more is not entered.
        world: u32,
        /// The wanted position of the eye. `None` for any spawn point.
        place: Option<WirePosition>,
        /// The time from which reports are about this world, as [`WireReport::made`] counts. A
        /// datagram with an older one was overtaken.
        reports_from: u32,
    },
    /// Reports the pose: the avatar departs from its course, or is about to leave its TBV, or the
    /// server asked. Clients that report at every tick do it in datagrams.
    Report {
        /// The report.
        report: WireReport,
        /// The datagrams that the client has received.
        ack: Ack,
    },
    /// Says something to the avatars in sight.
    Chat {
        /// The text.
        text: ChatLine,
    },
    /// Leaves the world.
    Goodbye,
    /// Asks to be put back to a spawn point. The answer is [`ServerMessage::Correct`].
    Respawn,
}

impl ClientMessage {
    /// The names of the kinds, in the order of their numbers on the wire.
    pub const KINDS: [&'static str; 7] =
        ["hello", "fetch_world", "enter", "report", "chat", "goodbye", "respawn"];

    /// Decodes the message of a frame.
    pub fn decode(frame: &[u8]) -> Result<Self, DecodeError> {
        frame::decode(frame)
    }

    /// The version in the first frame of a client. It can be read although the other fields may
    /// differ between versions.
    pub fn version(frame: &[u8]) -> Result<u32, DecodeError> {
        let hello: Result<(u8, u32), _> = postcard::from_bytes(frame);
        match hello {
            Ok((0, version)) => Ok(version),
            _ => Err(DecodeError::Malformed),
        }
    }
}

/// A message from the server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ServerMessage {
    /// Accepts a client, in answer to its hello. An offer of a world follows, at once or when the
    /// server has one.
    Welcome {
        /// The client's own avatar.
        avatar: AvatarId,
        /// The time between ticks, in microseconds.
        tick_interval_us: NonZeroU32,
    },
    /// Refuses a client, in answer to its hello. The connection closes. It stays the second
    /// message, and [`Refusal::Version`] the first refusal, so that every version can read it.
    Refused {
        /// The reason.
        reason: Refusal,
    },
    /// The server has no world yet.
    Loading {
        /// What it does meanwhile, to show to people.
        what: ChatLine,
    },
    /// Offers a world to fetch and to enter. Whoever was in an earlier one is in none from now on:
    /// nobody is in view, and no order stands.
    World {
        /// The number of the world: each is higher than the one before.
        number: u32,
        /// The content id of the world.
        id: [u8; 32],
        /// The length of the world's file, in bytes.
        bytes: u64,
        /// The head, where the world can be had in pieces.
        head: Option<HeadOffer>,
    },
    /// The client has entered the world.
    Entered {
        /// The pose at which it begins.
        pose: WirePose,
        /// The server's tick.
        tick: u32,
    },
    /// An avatar may come into view.
    Appear {
        /// The avatar.
        avatar: AvatarId,
        /// Its name.
        name: Name,
        /// Its colour, in sRGB.
        colour: [u8; 3],
        /// Its pose at the tick.
        pose: WirePose,
        /// The server's tick.
        tick: u32,
        /// The first pose datagram that concerns this appearance. Older ones concern an earlier
        /// one.
        since_sequence: u32,
    },
    /// An avatar cannot be seen any more, or has left the world.
    Vanish {
        /// The avatar.
        avatar: AvatarId,
    },
    /// Asks for one report at once.
    Ask,
    /// Nobody can see the client's avatar. The client is silent until it is asked or is about to
    /// leave the region.
    Quiet {
        /// The region and its validity.
        tbv: WireTbv,
    },
    /// The client reports whenever its avatar departs from its course. If this order allows less
    /// than the last one, or is the first, the client reports once, now.
    Live {
        /// What may be left unsaid.
        tolerance: WireTolerance,
    },
    /// A claim was refused. The avatar is at this pose instead.
    Correct {
        /// The avatar's pose.
        pose: WirePose,
    },
    /// An avatar in sight, or the client's own, said something.
    Chat {
        /// The speaker.
        from: AvatarId,
        /// The text.
        text: ChatLine,
    },
    /// The server itself says something to the client, for example in answer to a command.
    Notice {
        /// The text.
        text: ChatLine,
    },
    /// The server ends the connection.
    Goodbye {
        /// The reason, to show to people.
        reason: ChatLine,
        /// Whether the client may come back by itself: the server is started again, for example.
        may_return: bool,
    },
    /// Other servers of the same building, to which the client may go when this one is lost. Each
    /// list takes the place of the one before.
    Stations {
        /// At most [`STATIONS_TOLD_MAX`].
        others: Vec<StationAddress>,
    },
}

/// The most stations that a client is told of.
pub const STATIONS_TOLD_MAX: usize = 4;

/// Where visitors reach a station, and what it is known by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StationAddress {
    /// The UDP address for clients.
    pub address: SocketAddr,
    /// The fingerprint of its certificate.
    pub fingerprint: Fingerprint,
}

impl ServerMessage {
    /// The names of the kinds, in the order of their numbers on the wire.
    pub const KINDS: [&'static str; 15] = [
        "welcome", "refused", "loading", "world", "entered", "appear", "vanish", "ask", "quiet",
        "live", "correct", "chat", "notice", "goodbye", "stations",
    ];

    /// Decodes the message of a frame.
    pub fn decode(frame: &[u8]) -> Result<Self, DecodeError> {
        frame::decode(frame)
    }
}

/// The head of a world that can be had in pieces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeadOffer {
    /// Its content id.
    pub id: [u8; 16],
    /// Its length, in bytes.
    pub bytes: u32,
}

/// Why a client is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum Refusal {
    /// The client speaks another version of the protocol.
    #[error("the server speaks version {server} of the protocol")]
    Version {
        /// The server's version.
        server: u32,
    },
    /// The server has as many clients as it allows.
    #[error("the server is full")]
    Full,
    /// The server is shutting down.
    #[error("the server is closing")]
    Closing,
    /// The server has more to do than it can, for the moment.
    #[error("the server is busy: come again in {retry_ms} ms")]
    Busy {
        /// When the client may come again, in milliseconds.
        retry_ms: u32,
    },
    /// The client proved no key, by which the server could know it again.
    #[error("the server lets in nobody without a key")]
    NoKey,
    /// The owner of the key, or the client's network, is kept out.
    #[error("you are banned from this server")]
    Banned,
    /// Not everybody is let in.
    #[error("the server lets in invited visitors only: ask for an invitation, and give it once")]
    NotInvited,
}

#[cfg(test)]
mod tests {
    use sightline_world::motion::Pose;

    use super::*;
    use crate::{VERSION, quantise::COORDINATE_MAX, text};

    fn pose() -> WirePose {
        WirePose {
            position: WirePosition::new([COORDINATE_MAX, -COORDINATE_MAX, 77]).unwrap(),
            yaw: u16::MAX,
            pitch: i16::MIN,
            velocity: [i16::MIN, i16::MAX, -1],
            yaw_rate: i16::MIN,
            falls: true,
        }
    }

    fn longest_name() -> Name {
        Name::new(&"🦉".repeat(text::NAME_CHARS_MAX)).unwrap()
    }

    fn longest_line() -> ChatLine {
        ChatLine::new(&"🦉".repeat(text::LINE_CHARS_MAX)).unwrap()
    }

    /// The longest message of each kind.
    fn client_messages() -> Vec<ClientMessage> {
        vec![
            ClientMessage::Hello {
                version: u32::MAX,
                name: longest_name(),
                colour: [255; 3],
                invitation: Some(longest_line()),
                secret: Some(VisitorSecret([255; 32])),
            },
            ClientMessage::FetchWorld { world: u32::MAX },
            ClientMessage::Enter { world: 1, place: None, reports_from: 0 },
            ClientMessage::Enter {
                world: u32::MAX,
                place: Some(pose().position),
                reports_from: u32::MAX,
            },
            ClientMessage::Report {
                report: WireReport { made: u32::MAX, orders: u32::MAX, pose: pose() },
                ack: Ack { newest: u32::MAX, earlier: u32::MAX },
            },
            ClientMessage::Chat { text: longest_line() },
            ClientMessage::Goodbye,
            ClientMessage::Respawn,
        ]
    }

    fn server_messages() -> Vec<ServerMessage> {
        let avatar = AvatarId(u32::MAX);
        vec![
            ServerMessage::Welcome { avatar, tick_interval_us: NonZeroU32::MAX },
            ServerMessage::Loading { what: longest_line() },
            ServerMessage::World {
                number: u32::MAX,
                id: [9; 32],
                bytes: u64::MAX,
                head: Some(HeadOffer { id: [9; 16], bytes: u32::MAX }),
            },
            ServerMessage::World { number: 1, id: [9; 32], bytes: 0, head: None },
            ServerMessage::Refused { reason: Refusal::Version { server: u32::MAX } },
            ServerMessage::Refused { reason: Refusal::Full },
            ServerMessage::Refused { reason: Refusal::Closing },
            ServerMessage::Refused { reason: Refusal::Busy { retry_ms: u32::MAX } },
            ServerMessage::Refused { reason: Refusal::NoKey },
            ServerMessage::Refused { reason: Refusal::Banned },
            ServerMessage::Refused { reason: Refusal::NotInvited },
            ServerMessage::Entered { pose: pose(), tick: u32::MAX },
            ServerMessage::Appear {
                avatar,
                name: longest_name(),
                colour: [1, 2, 3],
                pose: pose(),
                tick: u32::MAX,
                since_sequence: u32::MAX,
            },
            ServerMessage::Vanish { avatar },
            ServerMessage::Stations {
                others: vec![
                    StationAddress {
                        address: "[2001:db8:ffff:ffff:ffff:ffff:ffff:ffff]:65535".parse().unwrap(),
                        fingerprint: Fingerprint([255; 32]),
                    };
                    STATIONS_TOLD_MAX
                ],
            },
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
            ServerMessage::Live {
                tolerance: WireTolerance {
                    millimetres: u16::MAX,
                    angle: u8::MAX,
                    ahead_ms: u16::MAX,
                },
            },
            ServerMessage::Correct { pose: pose() },
            ServerMessage::Chat { from: avatar, text: longest_line() },
            ServerMessage::Notice { text: longest_line() },
            ServerMessage::Goodbye { reason: longest_line(), may_return: true },
        ]
    }

    fn body<M: Serialize>(message: &M) -> Vec<u8> {
        frame::encode(message)[2..].to_vec()
    }

    #[test]
    fn every_message_decodes_to_itself() {
        for message in client_messages() {
            assert_eq!(ClientMessage::decode(&body(&message)), Ok(message));
        }
        for message in server_messages() {
            assert_eq!(ServerMessage::decode(&body(&message)), Ok(message));
        }
    }

    #[test]
    fn cut_and_extended_messages_are_refused() {
        let all = client_messages().iter().map(body).collect::<Vec<_>>();
        for bytes in all {
            for end in 0..bytes.len() {
                assert!(ClientMessage::decode(&bytes[..end]).is_err());
            }
            let longer = [bytes.as_slice(), &[0]].concat();
            assert_eq!(ClientMessage::decode(&longer), Err(DecodeError::Trailing));
        }
    }

    /// A message with a changed byte is refused, or is a message that encodes again and has finite
    /// numbers.
    #[test]
    fn every_changed_byte_is_refused_or_valid() {
        let mut valid = 0;
        for original in client_messages().iter().map(body) {
            for_each_flip(&original, |bytes| {
                if let Ok(message) = ClientMessage::decode(bytes) {
                    valid += 1;
                    assert_eq!(ClientMessage::decode(&body(&message)).as_ref(), Ok(&message));
                    if let ClientMessage::Report { report, .. } = message {
                        assert!(Pose::from(report.pose).is_finite());
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

    /// Calls `check` with each of the first bytes changed to every other value, and with each bit of
    /// the others changed.
    fn for_each_flip(original: &[u8], mut check: impl FnMut(&[u8])) {
        let flips = |i: usize| match i {
            0..4 => (1..=255).collect(),
            _ => Vec::from_iter((0..8).map(|bit| 1 << bit)),
        };
        let mut bytes = original.to_vec();
        for i in 0..bytes.len() {
            for flip in flips(i) {
                bytes[i] = original[i] ^ flip;
                check(&bytes);
            }
            bytes[i] = original[i];
        }
    }

    #[test]
    fn the_version_of_any_hello_can_be_read() {
        let name = Name::new("Ada").unwrap();
        let (colour, invitation, secret) = Default::default();
        let hello = ClientMessage::Hello { version: VERSION, name, colour, invitation, secret };
        assert_eq!(ClientMessage::version(&body(&hello)), Ok(VERSION));
        assert_eq!(ClientMessage::version(&[0, 9, 0xff, 0xff]), Ok(9));
        assert_eq!(
            ClientMessage::version(&body(&ClientMessage::Goodbye)),
            Err(DecodeError::Malformed)
        );
        assert_eq!(ClientMessage::version(&[]), Err(DecodeError::Malformed));
    }

    #[test]
    fn the_first_byte_of_a_message_is_the_number_of_its_kind() {
        let named = |said: String| {
            let name = said.split([' ', '{']).next().unwrap_or_default();
            let letters = name.char_indices().flat_map(|(i, letter)| {
                let gap = (letter.is_uppercase() && i > 0).then_some('_');
                gap.into_iter().chain(letter.to_lowercase())
            });
            letters.collect::<String>()
        };
        for message in client_messages() {
            let kind = usize::from(body(&message)[0]);
            assert_eq!(ClientMessage::KINDS[kind], named(format!("{message:?}")));
        }
        for message in server_messages() {
            let kind = usize::from(body(&message)[0]);
            assert_eq!(ServerMessage::KINDS[kind], named(format!("{message:?}")));
        }
    }

    #[test]
    fn every_version_can_read_why_it_is_refused() {
        let refused = ServerMessage::Refused { reason: Refusal::Version { server: 9 } };
        assert_eq!(body(&refused), [1, 0, 9]);
    }

    #[test]
    fn a_tick_interval_of_zero_is_refused() {
        let message = server_messages().remove(0);
        let bytes = body(&message);
        let zero = [&bytes[..bytes.len() - 5], &[0]].concat();
        assert_eq!(ServerMessage::decode(&zero), Err(DecodeError::Malformed));
    }
}
