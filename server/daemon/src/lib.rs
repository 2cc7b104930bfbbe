//! The server: a thin shell around the engine that speaks QUIC.
//!
//! * [`net`]: the endpoint, sessions and admission; the only place of the server that knows QUIC.
//!
//! The binary `sightline-server` adds the commands.

pub mod net;
