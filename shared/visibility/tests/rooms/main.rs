//! Rooms and windows: small scenes whose answers can be checked by hand, and random scenes against
//! sight lines.

mod picture;
mod reference_model;
mod scenes;
mod sets;
mod stage;
