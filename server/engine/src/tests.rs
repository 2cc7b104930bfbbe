//! The engine on hand-made worlds, and against a naive twin on random ones.

mod anything;
mod rooms;
pub(super) mod stage;
mod story;
mod turns;
mod twin;
mod walls;
