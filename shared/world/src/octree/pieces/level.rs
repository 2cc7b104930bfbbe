//! One level of nodes as bytes.

use rustc_hash::FxHashMap;

use super::super::{
    Octree, OctreeError,
    codec::{PLANES, coded, known},
    palette::Palette,
};

/// The bytes of a material in the planes.
pub(super) type Code = [u8; PLANES];

/// What stands for each material in the planes.
#[derive(Clone, Debug)]
pub(super) struct MaterialCodes {
    codes: Vec<Code>,
    known: FxHashMap<Code, u16>,
}

impl MaterialCodes {
    pub(super) fn of(octree: &Octree) -> Self {
        let palette = Palette::closed(octree.keys.clone());
        Self { codes: coded(&palette.materials), known: known(&palette) }
    }

    /// The code of a material; zeros for an index beyond the palette.
    pub(super) fn code(&self, material: u16) -> Code {
        self.codes.get(usize::from(material)).copied().unwrap_or_default()
    }
}

/// A level of nodes: the child masks of the nodes above, and the materials of these children.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Level {
    pub(super) masks: Vec<u8>,
    pub(super) materials: Vec<u16>,
}

impl Level {
    /// Appends the bytes. `above` are the materials of the nodes above.
    pub(super) fn put(&self, out: &mut Vec<u8>, above: &[u16], codes: &MaterialCodes) {
        debug_assert_eq!(self.masks.len(), above.len(), "a mask for each node above");
        out.extend_from_slice(&self.masks);
        let parents = parents(&self.masks, above, codes);
        let own = self.materials.iter().map(|&material| codes.code(material));
        let differences: Vec<Code> = own
            .zip(parents)
            .map(|(own, above)| std::array::from_fn(|i| own[i].wrapping_sub(above[i])))
            .collect();
        for plane in 0..PLANES {
            out.extend(differences.iter().map(|difference| difference[plane]));
        }
    }

    /// Reads a level.
    ///
    /// # Errors
    /// When a node above has no child, bytes are missing, or a material is not in the palette.
    pub(super) fn take(
        bytes: &mut &[u8],
        above: &[u16],
        codes: &MaterialCodes,
    ) -> Result<Self, OctreeError> {
        let (masks, rest) = bytes.split_at_checked(above.len()).ok_or(OctreeError::Length)?;
        if masks.contains(&0) {
            return Err(OctreeError::Nonsense("mask"));
        }
        let count = masks.iter().map(|mask| mask.count_ones() as usize).sum::<usize>();
        let (planes, rest) = rest.split_at_checked(PLANES * count).ok_or(OctreeError::Length)?;
        *bytes = rest;
        let mut materials = Vec::with_capacity(count);
        let mut last = None;
        for (i, parent) in parents(masks, above, codes).enumerate() {
            let code: Code = std::array::from_fn(|plane| {
                parent[plane].wrapping_add(planes.get(plane * count + i).copied().unwrap_or(0))
            });
            let material = match last {
                Some((before, material)) if before == code => material,
                _ => *codes.known.get(&code).ok_or(OctreeError::Nonsense("material"))?,
            };
            last = Some((code, material));
            materials.push(material);
        }
        Ok(Self { masks: masks.to_vec(), materials })
    }
}

/// For each child of the nodes above, the code of the node above it.
fn parents<'a>(
    masks: &'a [u8],
    above: &'a [u16],
    codes: &'a MaterialCodes,
) -> impl Iterator<Item = Code> + 'a {
    masks.iter().zip(above).flat_map(|(mask, &material)| {
        std::iter::repeat_n(codes.code(material), mask.count_ones() as usize)
    })
}
