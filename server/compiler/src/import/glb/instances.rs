//! Many copies of a mesh on one node (`EXT_mesh_gpu_instancing`).

use glam::{DMat4, DQuat, DVec3};
use gltf::{Accessor, Document, Node};

use super::{accessor, error::GlbError, resources::Resources};

/// The places of the copies of a node's mesh, relative to the node, one by one. One for a node
/// without the extension.
///
/// # Errors
/// When an attribute refers to no accessor, or cannot be read.
pub(super) fn places(
    node: &Node<'_>,
    document: &Document,
    resources: &Resources,
) -> Result<impl Iterator<Item = DMat4> + use<>, GlbError> {
    let attributes =
        node.extension_value("EXT_mesh_gpu_instancing").and_then(|value| value.get("attributes"));
    let attribute = |name: &str| -> Result<Option<Accessor<'_>>, GlbError> {
        let index = attributes.and_then(|all| all.get(name)?.as_u64());
        let Some(index) = index.and_then(|index| usize::try_from(index).ok()) else {
            return Ok(None);
        };
        let found = document.accessors().nth(index);
        found.map(Some).ok_or(GlbError::Accessor { index, reason: "is not there" })
    };
    let read3 = |name| -> Result<Option<Vec<[f32; 3]>>, GlbError> {
        attribute(name)?.map(|all| accessor::vectors::<3>(&all, resources, 3)).transpose()
    };
    let (moved, scaled) = (read3("TRANSLATION")?, read3("SCALE")?);
    let turned =
        attribute("ROTATION")?.map(|all| accessor::vectors::<4>(&all, resources, 4)).transpose()?;
    let lengths = [
        moved.as_ref().map(Vec::len),
        scaled.as_ref().map(Vec::len),
        turned.as_ref().map(Vec::len),
    ];
    let count = lengths.into_iter().flatten().min().unwrap_or(1);
    let vector = |all: &Option<Vec<[f32; 3]>>, i: usize, otherwise: DVec3| {
        all.as_ref().map_or(otherwise, |all| DVec3::from(all[i].map(f64::from)))
    };
    let place = move |i: usize| {
        let turn = turned.as_ref().map_or(DQuat::IDENTITY, |all| {
            let turn = DQuat::from_array(all[i].map(f64::from));
            if turn.length_squared() > 1e-6 { turn.normalize() } else { DQuat::IDENTITY }
        });
        let (scale, at) = (vector(&scaled, i, DVec3::ONE), vector(&moved, i, DVec3::ZERO));
        DMat4::from_scale_rotation_translation(scale, turn, at)
    };
    Ok((0..count).map(place))
}
