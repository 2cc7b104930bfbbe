//! What stations tell each other, as bytes on a bus. Needs the feature `engine`.
//!
//! A *parcel* is some messages to the same receivers, one after the other. Numbers are as exact as
//! the engine has them, so that another station computes with the same places and times. A parcel
//! that decodes has finite numbers, text that is fit to be shown, and not more messages than
//! [`MESSAGES_MAX`]. Whether what it says can be true is for the engine to judge.

use std::time::Duration;

use glam::Vec3;
use serde::{Deserialize, Serialize};
use sightline_engine::{
    GuestReport, HeardOf, Heartbeat, Lags, StationId, StationMessage, StationWord, Stay,
};
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, Pose, Tolerance},
};

use crate::{
    DecodeError, frame,
    message::StationAddress,
    text::{ChatLine, Name},
};

/// The greatest length of a parcel, in bytes: what a NATS server takes by default.
pub const PARCEL_BYTES_MAX: usize = 1_048_576;
/// A parcel of more than this many bytes takes no further message.
const PARCEL_BYTES_FULL: usize = 32_768;
/// The most messages in a parcel.
pub const MESSAGES_MAX: usize = 4_096;

/// Parcels to the same receivers, in order.
#[derive(Debug, Default)]
pub struct Parcels {
    parcels: Vec<Vec<u8>>,
    /// How many messages the last one holds.
    count: usize,
}

impl Parcels {
    /// Adds a message. Returns how many bytes it takes.
    pub fn push(&mut self, message: &StationMessage) -> usize {
        let last = self.parcels.pop();
        let is_full = |p: &Vec<u8>| p.len() >= PARCEL_BYTES_FULL || self.count == MESSAGES_MAX;
        let parcel = match last {
            Some(last) if !is_full(&last) => last,
            full => {
                self.parcels.extend(full);
                self.count = 0;
                Vec::new()
            }
        };
        let before = parcel.len();
        let parcel = postcard::to_extend(&WireMessage::from(message), parcel)
            .expect("messages hold nothing but plain data");
        let bytes = parcel.len() - before;
        self.parcels.push(parcel);
        self.count += 1;
        bytes
    }

    /// All of them.
    pub fn take(self) -> Vec<Vec<u8>> {
        self.parcels
    }
}

/// Decodes a parcel into its messages, each with the number of bytes that it takes.
///
/// # Errors
/// When the bytes are no parcel, or more than one may hold.
pub fn decode(parcel: &[u8]) -> Result<Vec<(StationMessage, usize)>, DecodeError> {
    let (bytes, bytes_max) = (parcel.len(), PARCEL_BYTES_MAX);
    if bytes > bytes_max {
        return Err(DecodeError::TooLong { bytes, bytes_max });
    }
    let (mut messages, mut rest) = (Vec::new(), parcel);
    while !rest.is_empty() {
        if messages.len() == MESSAGES_MAX {
            return Err(DecodeError::Trailing);
        }
        let (message, after): (WireMessage, _) =
            postcard::take_from_bytes(rest).map_err(|_| DecodeError::Malformed)?;
        messages.push((message.into(), rest.len() - after.len()));
        rest = after;
    }
    Ok(messages)
}

/// Encodes where visitors reach a station.
pub fn encode_address(address: &StationAddress) -> Vec<u8> {
    postcard::to_stdvec(address).expect("an address is plain data")
}

/// Decodes where visitors reach a station.
///
/// # Errors
/// When the bytes are no address.
pub fn decode_address(bytes: &[u8]) -> Result<StationAddress, DecodeError> {
    frame::decode(bytes)
}

/// A finite number.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(try_from = "f32", into = "f32")]
struct Finite(f32);

impl TryFrom<f32> for Finite {
    type Error = &'static str;

    fn try_from(number: f32) -> Result<Self, Self::Error> {
        number.is_finite().then_some(Self(number)).ok_or("a number that is not finite")
    }
}

impl From<Finite> for f32 {
    fn from(number: Finite) -> Self {
        number.0
    }
}

/// Three finite numbers.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Finite3([Finite; 3]);

impl From<Vec3> for Finite3 {
    fn from(vector: Vec3) -> Self {
        Self(vector.to_array().map(Finite))
    }
}

impl From<Finite3> for Vec3 {
    fn from(Finite3(numbers): Finite3) -> Self {
        Self::from_array(numbers.map(f32::from))
    }
}

/// A time in nanoseconds.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Nanoseconds(u64);

impl From<Duration> for Nanoseconds {
    fn from(time: Duration) -> Self {
        Self(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX))
    }
}

impl From<Nanoseconds> for Duration {
    fn from(Nanoseconds(time): Nanoseconds) -> Self {
        Self::from_nanos(time)
    }
}

/// Numbers in ascending order, as the steps between them.
#[derive(Serialize, Deserialize)]
struct Ascending(Vec<u32>);

impl From<&[u32]> for Ascending {
    fn from(numbers: &[u32]) -> Self {
        let before = [0].iter().chain(numbers);
        Self(numbers.iter().zip(before).map(|(number, last)| number.wrapping_sub(*last)).collect())
    }
}

impl From<Ascending> for Vec<u32> {
    fn from(Ascending(steps): Ascending) -> Self {
        let mut last = 0u32;
        let add = |step: u32| {
            last = last.wrapping_add(step);
            last
        };
        steps.into_iter().map(add).collect()
    }
}

#[derive(Serialize, Deserialize)]
struct WireMessage {
    epoch: u32,
    known: u32,
    number: u32,
    sent: Nanoseconds,
    word: WireWord,
}

#[derive(Serialize, Deserialize)]
enum WireWord {
    Heartbeat { slowest: Nanoseconds, silent: Nanoseconds, heard: Vec<WireHeard> },
    Subscribe { number: u32, added: Ascending, removed: Ascending },
    Synced { number: u32 },
    Announce { avatar: u32, name: Name, colour: [u8; 3], stay: Option<WireStay>, report: WireGuest },
    Report { avatar: u32, report: WireGuest },
    Leave { avatar: u32 },
    Ask { avatar: u32, tolerance: WireExactTolerance },
    Quiet { avatar: u32, stay: WireStay },
    Chat { avatar: u32, text: ChatLine },
}

#[derive(Serialize, Deserialize)]
struct WireHeard {
    station: u32,
    epoch: u32,
    sent: Nanoseconds,
    held: Nanoseconds,
    messages: u32,
}

#[derive(Serialize, Deserialize)]
struct WireStay {
    min: Finite3,
    max: Finite3,
    notice: Nanoseconds,
}

#[derive(Serialize, Deserialize)]
struct WireExactTolerance {
    metres: Finite,
    radians: Finite,
    ahead: Nanoseconds,
}

#[derive(Serialize, Deserialize)]
struct WireGuest {
    orders: u32,
    eye: Finite3,
    yaw: Finite,
    pitch: Finite,
    velocity: Finite3,
    yaw_rate: Finite,
    made: Option<Nanoseconds>,
    heard: Nanoseconds,
    course_for: Nanoseconds,
    tolerance: WireExactTolerance,
    space: Option<u32>,
    /// One bit for each of the pose's and the report's flags.
    flags: u8,
    round_trip: Nanoseconds,
    margin: Nanoseconds,
    lags_us: [i64; 3],
}

const FALLS: u8 = 1;
const IS_STUCK: u8 = 2;
const IS_BELIEVED: u8 = 4;
const IS_ABSENT: u8 = 8;

impl From<&StationMessage> for WireMessage {
    fn from(message: &StationMessage) -> Self {
        let StationMessage { epoch, known, number, sent, word } = message;
        let (epoch, known, number) = (*epoch, *known, *number);
        Self { epoch, known, number, sent: (*sent).into(), word: word.into() }
    }
}

impl From<WireMessage> for StationMessage {
    fn from(message: WireMessage) -> Self {
        let WireMessage { epoch, known, number, sent, word } = message;
        Self { epoch, known, number, sent: sent.into(), word: word.into() }
    }
}

impl From<&StationWord> for WireWord {
    fn from(word: &StationWord) -> Self {
        match word {
            StationWord::Heartbeat(Heartbeat { slowest, silent, heard }) => Self::Heartbeat {
                slowest: (*slowest).into(),
                silent: (*silent).into(),
                heard: heard.iter().map(WireHeard::from).collect(),
            },
            StationWord::Subscribe { number, added, removed } => Self::Subscribe {
                number: *number,
                added: added.as_slice().into(),
                removed: removed.as_slice().into(),
            },
            StationWord::Synced { number } => Self::Synced { number: *number },
            StationWord::Announce { avatar, name, colour, stay, report } => Self::Announce {
                avatar: avatar.0,
                name: Name::clipped(name),
                colour: *colour,
                stay: stay.as_ref().map(WireStay::from),
                report: report.into(),
            },
            StationWord::Report { avatar, report } => {
                Self::Report { avatar: avatar.0, report: report.into() }
            }
            StationWord::Leave { avatar } => Self::Leave { avatar: avatar.0 },
            StationWord::Ask { avatar, tolerance } => {
                Self::Ask { avatar: avatar.0, tolerance: tolerance.into() }
            }
            StationWord::Quiet { avatar, stay } => {
                Self::Quiet { avatar: avatar.0, stay: stay.into() }
            }
            StationWord::Chat { avatar, text } => {
                Self::Chat { avatar: avatar.0, text: ChatLine::clipped(text) }
            }
        }
    }
}

impl From<WireWord> for StationWord {
    fn from(word: WireWord) -> Self {
        match word {
            WireWord::Heartbeat { slowest, silent, heard } => Self::Heartbeat(Heartbeat {
                slowest: slowest.into(),
                silent: silent.into(),
                heard: heard.into_iter().map(HeardOf::from).collect(),
            }),
            WireWord::Subscribe { number, added, removed } => {
                Self::Subscribe { number, added: added.into(), removed: removed.into() }
            }
            WireWord::Synced { number } => Self::Synced { number },
            WireWord::Announce { avatar, name, colour, stay, report } => Self::Announce {
                avatar: AvatarId(avatar),
                name: name.into(),
                colour,
                stay: stay.map(Stay::from),
                report: report.into(),
            },
            WireWord::Report { avatar, report } => {
                Self::Report { avatar: AvatarId(avatar), report: report.into() }
            }
            WireWord::Leave { avatar } => Self::Leave { avatar: AvatarId(avatar) },
            WireWord::Ask { avatar, tolerance } => {
                Self::Ask { avatar: AvatarId(avatar), tolerance: tolerance.into() }
            }
            WireWord::Quiet { avatar, stay } => {
                Self::Quiet { avatar: AvatarId(avatar), stay: stay.into() }
            }
            WireWord::Chat { avatar, text } => {
                Self::Chat { avatar: AvatarId(avatar), text: text.into() }
            }
        }
    }
}

impl From<&HeardOf> for WireHeard {
    fn from(heard: &HeardOf) -> Self {
        let HeardOf { station, epoch, sent, held, messages } = *heard;
        Self { station: station.0, epoch, sent: sent.into(), held: held.into(), messages }
    }
}

impl From<WireHeard> for HeardOf {
    fn from(heard: WireHeard) -> Self {
        let WireHeard { station, epoch, sent, held, messages } = heard;
        let (sent, held) = (sent.into(), held.into());
        Self { station: StationId(station), epoch, sent, held, messages }
    }
}

impl From<&Stay> for WireStay {
    fn from(stay: &Stay) -> Self {
        let Stay { within: Aabb { min, max }, notice } = *stay;
        Self { min: min.into(), max: max.into(), notice: notice.into() }
    }
}

impl From<WireStay> for Stay {
    fn from(stay: WireStay) -> Self {
        let within = Aabb { min: stay.min.into(), max: stay.max.into() };
        Self { within, notice: stay.notice.into() }
    }
}

impl From<&Tolerance> for WireExactTolerance {
    fn from(tolerance: &Tolerance) -> Self {
        let Tolerance { metres, radians, ahead } = *tolerance;
        Self { metres: Finite(metres), radians: Finite(radians), ahead: ahead.into() }
    }
}

impl From<WireExactTolerance> for Tolerance {
    fn from(tolerance: WireExactTolerance) -> Self {
        let WireExactTolerance { metres, radians, ahead } = tolerance;
        Self { metres: metres.into(), radians: radians.into(), ahead: ahead.into() }
    }
}

impl From<&GuestReport> for WireGuest {
    fn from(report: &GuestReport) -> Self {
        let Pose { eye, yaw, pitch, velocity, yaw_rate, falls } = report.pose;
        let Lags { margin, least_us, slowest_us, quickest_us } = report.lags;
        let flag = |is: bool, bit: u8| if is { bit } else { 0 };
        Self {
            orders: report.orders,
            eye: eye.into(),
            yaw: Finite(yaw),
            pitch: Finite(pitch),
            velocity: velocity.into(),
            yaw_rate: Finite(yaw_rate),
            made: report.made.map(Nanoseconds::from),
            heard: report.heard.into(),
            course_for: report.course_for.into(),
            tolerance: (&report.tolerance).into(),
            space: report.space,
            flags: flag(falls, FALLS)
                | flag(report.is_stuck, IS_STUCK)
                | flag(report.is_believed, IS_BELIEVED)
                | flag(report.is_absent, IS_ABSENT),
            round_trip: report.round_trip.into(),
            margin: margin.into(),
            lags_us: [least_us, slowest_us, quickest_us],
        }
    }
}

impl From<WireGuest> for GuestReport {
    fn from(guest: WireGuest) -> Self {
        let has = |bit: u8| guest.flags & bit != 0;
        let [least_us, slowest_us, quickest_us] = guest.lags_us;
        let pose = Pose {
            eye: guest.eye.into(),
            yaw: guest.yaw.into(),
            pitch: guest.pitch.into(),
            velocity: guest.velocity.into(),
            yaw_rate: guest.yaw_rate.into(),
            falls: has(FALLS),
        };
        Self {
            orders: guest.orders,
            pose,
            made: guest.made.map(Duration::from),
            heard: guest.heard.into(),
            course_for: guest.course_for.into(),
            tolerance: guest.tolerance.into(),
            space: guest.space,
            is_stuck: has(IS_STUCK),
            is_believed: has(IS_BELIEVED),
            is_absent: has(IS_ABSENT),
            round_trip: guest.round_trip.into(),
            lags: Lags { margin: guest.margin.into(), least_us, slowest_us, quickest_us },
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fingerprint::Fingerprint;

    fn time() -> impl Strategy<Value = Duration> {
        (0..u64::MAX / 2).prop_map(Duration::from_nanos)
    }

    fn vector() -> impl Strategy<Value = Vec3> {
        [-1e6f32..1e6, -1e6f32..1e6, -1e6f32..1e6].prop_map(Vec3::from_array)
    }

    fn tolerance() -> impl Strategy<Value = Tolerance> {
        (0f32..9.0, 0f32..9.0, time()).prop_map(|(metres, radians, ahead)| Tolerance {
            metres,
            radians,
            ahead,
        })
    }

    fn stay() -> impl Strategy<Value = Stay> {
        (vector(), vector(), time())
            .prop_map(|(min, max, notice)| Stay { within: Aabb { min, max }, notice })
    }

    fn report() -> impl Strategy<Value = GuestReport> {
        let pose = (vector(), vector(), [-9f32..9.0, -9f32..9.0, -9f32..9.0], any::<bool>());
        let times = ([time(), time(), time()], proptest::option::of(time()));
        let rest = (any::<u32>(), tolerance(), proptest::option::of(any::<u32>()));
        let flags = (any::<[bool; 3]>(), time(), any::<[i64; 3]>());
        (pose, times, rest, flags).prop_map(|(pose, times, rest, flags)| {
            let (eye, velocity, [yaw, pitch, yaw_rate], falls) = pose;
            let ([heard, course_for, round_trip], made) = times;
            let (orders, tolerance, space) = rest;
            let ([is_stuck, is_believed, is_absent], margin, lags) = flags;
            let [least_us, slowest_us, quickest_us] = lags;
            GuestReport {
                orders,
                pose: Pose { eye, yaw, pitch, velocity, yaw_rate, falls },
                made,
                heard,
                course_for,
                tolerance,
                space,
                is_stuck,
                is_believed,
                is_absent,
                round_trip,
                lags: Lags { margin, least_us, slowest_us, quickest_us },
            }
        })
    }

    fn word() -> impl Strategy<Value = StationWord> {
        let sectors = || proptest::collection::btree_set(any::<u32>(), 0..20);
        let heard = (any::<[u32; 3]>(), time(), time()).prop_map(|(numbers, sent, held)| {
            let [station, epoch, messages] = numbers;
            HeardOf { station: StationId(station), epoch, sent, held, messages }
        });
        let heartbeat = (time(), time(), proptest::collection::vec(heard, 0..4));
        let id = || any::<u32>().prop_map(AvatarId);
        prop_oneof![
            heartbeat.prop_map(|(slowest, silent, heard)| {
                StationWord::Heartbeat(Heartbeat { slowest, silent, heard })
            }),
            (any::<u32>(), sectors(), sectors()).prop_map(|(number, added, removed)| {
                let [added, removed] = [added, removed].map(|s| s.into_iter().collect());
                StationWord::Subscribe { number, added, removed }
            }),
            any::<u32>().prop_map(|number| StationWord::Synced { number }),
            (id(), "[a-zA-Zé]{1,32}", any::<[u8; 3]>(), proptest::option::of(stay()), report())
                .prop_map(|(avatar, name, colour, stay, report)| {
                    StationWord::Announce { avatar, name, colour, stay, report }
                }),
            (id(), report()).prop_map(|(avatar, report)| StationWord::Report { avatar, report }),
            id().prop_map(|avatar| StationWord::Leave { avatar }),
            (id(), tolerance())
                .prop_map(|(avatar, tolerance)| StationWord::Ask { avatar, tolerance }),
            (id(), stay()).prop_map(|(avatar, stay)| StationWord::Quiet { avatar, stay }),
            (id(), "[a-zA-Zé]{1,256}")
                .prop_map(|(avatar, text)| StationWord::Chat { avatar, text }),
        ]
    }

    fn message() -> impl Strategy<Value = StationMessage> {
        (any::<[u32; 3]>(), time(), word()).prop_map(|([epoch, known, number], sent, word)| {
            StationMessage { epoch, known, number, sent, word }
        })
    }

    fn encode(messages: &[StationMessage]) -> Vec<Vec<u8>> {
        let mut parcels = Parcels::default();
        let bytes: usize = messages.iter().map(|message| parcels.push(message)).sum();
        let parcels = parcels.take();
        assert_eq!(parcels.iter().map(Vec::len).sum::<usize>(), bytes);
        parcels
    }

    fn decoded(parcel: &[u8]) -> Result<Vec<StationMessage>, DecodeError> {
        let messages = decode(parcel)?;
        assert_eq!(messages.iter().map(|(_, bytes)| bytes).sum::<usize>(), parcel.len());
        Ok(messages.into_iter().map(|(message, _)| message).collect())
    }

    proptest! {
        #[test]
        fn messages_come_out_as_they_went_in(
            messages in proptest::collection::vec(message(), 0..30),
        ) {
            let parcels = encode(&messages);
            let all: Result<Vec<_>, _> = parcels.iter().map(|parcel| decoded(parcel)).collect();
            prop_assert_eq!(all.unwrap().concat(), messages);
        }

        #[test]
        fn whatever_arrives_is_decoded_or_refused(
            messages in proptest::collection::vec(message(), 1..4),
            changes in proptest::collection::vec((any::<usize>(), any::<u8>()), 0..8),
            noise in proptest::collection::vec(any::<u8>(), 0..300),
        ) {
            let _ = (decode(&noise), decode_address(&noise));
            let mut parcel = encode(&messages).concat();
            let length = parcel.len();
            changes.iter().for_each(|(at, byte)| parcel[at % length] ^= byte);
            if let Ok(messages) = decode(&parcel) {
                let messages: Vec<_> = messages.into_iter().map(|(message, _)| message).collect();
                prop_assert_eq!(decoded(&encode(&messages).concat()).unwrap(), messages);
            }
        }
    }

    #[test]
    fn an_address_reads_back() {
        for address in ["192.0.2.7:4777", "[2001:db8::7]:1"] {
            let (address, fingerprint) = (address.parse().unwrap(), Fingerprint([7; 32]));
            let address = StationAddress { address, fingerprint };
            assert_eq!(decode_address(&encode_address(&address)), Ok(address));
        }
    }

    #[test]
    fn a_number_that_is_not_finite_and_a_parcel_that_is_too_long_are_refused() {
        let tolerance = Tolerance { metres: f32::NAN, ..Tolerance::NONE };
        let word = StationWord::Ask { avatar: AvatarId(1), tolerance };
        let message = StationMessage { epoch: 1, known: 1, number: 0, sent: Duration::ZERO, word };
        let parcel = encode(std::slice::from_ref(&message)).concat();
        assert_eq!(decode(&parcel), Err(DecodeError::Malformed));
        let word = StationWord::Leave { avatar: AvatarId(1) };
        let many = vec![StationMessage { word, ..message }; MESSAGES_MAX + 1];
        let parcels = encode(&many);
        assert_eq!(parcels.len(), 2);
        assert!(parcels.iter().all(|parcel| decode(parcel).is_ok()));
        assert_eq!(decode(&parcels.concat()), Err(DecodeError::Trailing));
        let long = vec![0; PARCEL_BYTES_MAX + 1];
        assert!(matches!(decode(&long), Err(DecodeError::TooLong { .. })));
    }
}
