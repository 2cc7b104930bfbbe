//! What travels between server and client.
//!
//! [`message`]: control messages, on streams. [`pose_stream`]: poses, in datagrams.

pub mod message;
pub mod pose_stream;
