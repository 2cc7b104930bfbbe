//! Decodes arbitrary bytes as what a peer may send: control messages, poses, acknowledgements.

#![no_main]

use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use sightline_protocol::{
    message::{ClientMessage, ServerMessage},
    pose_stream::{ClientDatagram, PoseDecoder},
};

fuzz_target!(|bytes: &[u8]| {
    let _ = ClientMessage::decode(bytes);
    let _ = ServerMessage::decode(bytes);
    let _ = PoseDecoder::new(Duration::from_millis(50)).decode(bytes);
    let _ = ClientDatagram::decode(bytes);
});
