//! The engine on hand-made worlds, and against a naive reference model on random ones.

mod absence;
mod anything;
mod reference_model;
mod rooms;
pub(super) mod stage;
mod stations;
mod story;
mod turns;
mod walls;
