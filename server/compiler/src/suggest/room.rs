//! Suggested rooms and windows.

use glam::Vec3;
use sightline_world::{CellId, geometry::Aabb};

/// A suggested room.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedRoom {
    /// A name made of the storey and a number.
    pub name: String,
    /// The boxes that it fills, in the building's own axes.
    pub boxes: Vec<Aabb>,
    /// The windows, through which lines of sight leave it.
    pub windows: Vec<SuggestedWindow>,
    /// Its cells, ascending.
    pub cells: Vec<CellId>,
}

/// A suggested window.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedWindow {
    /// A name that says where the window leads.
    pub name: String,
    /// The corners in order, in the world's axes.
    pub corners: Vec<Vec3>,
}
