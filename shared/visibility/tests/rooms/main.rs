//! Rooms and windows: small scenes whose answer can be checked by hand, and random ones against rays.

mod picture;
mod scenes;
mod sets;
mod stage;
mod twin;
