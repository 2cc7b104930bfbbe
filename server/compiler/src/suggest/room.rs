//! Suggested rooms and windows.

use glam::Vec3;
use sightline_world::{CellId, geometry::Aabb};

/// A room that is suggested.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedRoom {
    /// Storey and number.
    pub name: String,
    /// What it takes up, in own axes.
    pub boxes: Vec<Aabb>,
    /// Where one sees out of it.
    pub windows: Vec<SuggestedWindow>,
    /// The cells that it consists of, ascending.
    pub cells: Vec<CellId>,
}

/// A window that is suggested.
#[derive(Clone, Debug, PartialEq)]
pub struct SuggestedWindow {
    /// Where it leads.
    pub name: String,
    /// In the world, in order around it.
    pub corners: Vec<Vec3>,
}
