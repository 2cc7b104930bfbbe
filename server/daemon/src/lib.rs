//! The server: a thin shell around the engine that speaks QUIC.
//!
//! * [`net`]: the endpoint, admission and sessions. It is the only module that knows QUIC. Start
//!   with [`net::Server`]: it binds an address and serves a [`net::ServedWorld`].
//! * [`operate`]: what an operator sees of a running server: [`operate::ServerStats`].
//!
//! The engine decides everything that a client is told; nothing here does. The binary
//! `sightline-server` adds the commands.

pub mod net;
pub mod operate;
