//! What must be drawn anew: the building, what moves in it, or what is written over it. A picture
//! that would be the same is not drawn.

use sightline_renderer::{Camera, moving::InView};

use super::overlay::Overlay;

/// What the picture of the building depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BuildingView {
    pub(super) camera: Camera,
    /// Columns and rows, in pixels.
    pub(super) size: (usize, usize),
    /// How often the building was replaced.
    pub(super) world: u32,
    /// Whether what rooms hide is drawn, too.
    pub(super) hidden: bool,
    /// How many pieces of the building were taken in; `None` when too few for a picture.
    pub(super) pieces: Option<u64>,
}

/// What is shown of rooms.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RoomDisplay {
    /// Whether their outlines are drawn.
    pub(super) outlines: bool,
    /// Whether what they hide from the eye is drawn, too.
    pub(super) hidden: bool,
}

/// What the window shows, layer by layer. Each layer is drawn over the one before.
#[derive(Default)]
pub(super) struct ShownLayers {
    building: Option<BuildingView>,
    /// What moves, and whether rooms are drawn with it.
    moving: Option<(InView, bool)>,
    /// What is written, and the size of the window.
    overlay: Option<(Overlay, (usize, usize))>,
}

impl ShownLayers {
    /// Whether the building must be drawn anew to show this. Then so must be all that is over it.
    pub(super) fn building_changes(&mut self, view: BuildingView) -> bool {
        let changes = self.building != Some(view);
        if changes {
            *self = Self { building: Some(view), ..Self::default() };
        }
        changes
    }

    /// Whether what moves must be drawn anew to show this, with rooms or without. Then so must be
    /// what is written over it.
    pub(super) fn moving_changes(&mut self, in_view: InView, rooms: bool) -> bool {
        let is_same = |(shown, with_rooms): &(InView, bool)| {
            *with_rooms == rooms && shown.looks_like(&in_view)
        };
        let changes = !self.moving.as_ref().is_some_and(is_same);
        if changes {
            (self.moving, self.overlay) = (Some((in_view, rooms)), None);
        }
        changes
    }

    /// Whether the window must show this over the picture.
    pub(super) fn overlay_changes(&mut self, overlay: &Overlay, size: (usize, usize)) -> bool {
        let is_same = |(shown, of): &(Overlay, (usize, usize))| shown == overlay && *of == size;
        let changes = !self.overlay.as_ref().is_some_and(is_same);
        if changes {
            self.overlay = Some((overlay.clone(), size));
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    const SIZE: (usize, usize) = (9, 6);

    fn view(x: f32) -> BuildingView {
        let camera = Camera { eye: Vec3::X * x, yaw: 0.0, pitch: 0.0, fov_y: 1.0 };
        BuildingView { camera, size: SIZE, world: 0, hidden: false, pieces: Some(0) }
    }

    /// Which layers must be drawn to show this.
    fn drawn(layers: &mut ShownLayers, view: BuildingView, rooms: bool, status: &str) -> [bool; 3] {
        let overlay = Overlay { status: status.into(), ..Overlay::default() };
        [
            layers.building_changes(view),
            layers.moving_changes(InView::default(), rooms),
            layers.overlay_changes(&overlay, view.size),
        ]
    }

    #[test]
    fn a_still_scene_is_drawn_once_and_a_changed_layer_with_those_over_it() {
        let layers = &mut ShownLayers::default();
        assert_eq!(drawn(layers, view(1.0), false, "a"), [true; 3]);
        assert_eq!(drawn(layers, view(1.0), false, "a"), [false; 3]);
        assert_eq!(drawn(layers, view(1.0), false, "b"), [false, false, true]);
        assert_eq!(drawn(layers, view(1.0), true, "b"), [false, true, true]);
        assert_eq!(drawn(layers, view(1.001), true, "b"), [true; 3]);
        assert_eq!(drawn(layers, BuildingView { world: 1, ..view(1.001) }, true, "b"), [true; 3]);
        let all = BuildingView { hidden: true, world: 1, ..view(1.001) };
        assert_eq!(drawn(layers, all, true, "b"), [true; 3]);
        let sharper = BuildingView { pieces: Some(1), ..all };
        assert_eq!(drawn(layers, sharper, true, "b"), [true; 3]);
        let wider = BuildingView { size: (10, 6), world: 1, ..view(1.001) };
        assert_eq!(drawn(layers, wider, true, "b"), [true; 3]);
        assert_eq!(drawn(layers, wider, true, "b"), [false; 3]);
    }
}
