//! What a box of eyes sees of all patches.

use super::{
    buffer::FuzzyBuffer, faces::ViewpointBox, surfaces::Surfaces, visibility::PatchVisibility,
    visible,
};

/// What a box of eyes sees of each patch of all surfaces, in their order. Faces have `size` ×
/// `size` elements. [`FuzzyBuffer::find_hidden`] does the first half of the work, which is cheaper
/// and mostly the more useful half.
///
/// `settled` may have the result for a larger box around this one. What is settled there stays
/// settled.
///
/// ```
/// use glam::Vec3;
/// use sightline_visibility::fuzzy::{PatchVisibility, Surfaces, ViewpointBox, classify};
/// use sightline_world::geometry::Aabb;
///
/// // A wall of 4 m by 4 m, and a tile of 0.2 m behind it.
/// let square = |z: f32, half: f32| {
///     [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| Vec3::new(x, y, z))
/// };
/// let corners = [square(-2.0, 2.0), square(-3.0, 0.1)].concat();
/// let patches = [(0, vec![0, 1, 2, 3]), (1, vec![4, 5, 6, 7])];
/// let surfaces = Surfaces::new(&corners, &patches)?;
/// let eyes = ViewpointBox::all_round(Aabb::around(Vec3::ZERO, 0.25));
/// let found = classify(&surfaces, &eyes, 128, None);
/// assert_eq!(found, [PatchVisibility::Visible, PatchVisibility::Invisible]);
/// # Ok::<(), sightline_visibility::fuzzy::SurfaceError>(())
/// ```
pub fn classify(
    surfaces: &Surfaces,
    viewpoints: &ViewpointBox,
    size: usize,
    settled: Option<&[PatchVisibility]>,
) -> Vec<PatchVisibility> {
    let mut classes = match settled {
        Some(settled) if settled.len() == surfaces.len() => settled.to_vec(),
        _ => vec![PatchVisibility::Remaining; surfaces.len()],
    };
    let buffer = FuzzyBuffer::new(surfaces, viewpoints, size);
    buffer.find_hidden(surfaces, &mut classes);
    visible::find(surfaces, viewpoints, buffer.size(), &mut classes);
    debug_assert_eq!(classes.len(), surfaces.len());
    classes
}
