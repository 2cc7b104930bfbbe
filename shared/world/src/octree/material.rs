//! How a voxel materials.

/// What is drawn where a voxel is, or a node that is too small to halve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Material {
    /// sRGB colour; the light that comes with the building is in it.
    pub colour: [u8; 3],
    /// The surface normal, outwards, as signed hundred-and-twenty-sevenths; zero when it has none.
    pub normal: [i8; 3],
    /// Material bits: see [`Material::GLASS`].
    pub flags: u8,
}

impl Material {
    /// Blocks bodies, not sight; drawn as a tint. An inner node has it when all its leaves do.
    pub const GLASS: u8 = 1;

    /// Whether it can be seen through.
    pub fn is_glass(&self) -> bool {
        self.flags & Self::GLASS != 0
    }
}
