//! The material of a voxel.

/// The appearance of a voxel, or the mean appearance of the voxels below a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Material {
    /// The sRGB colour, baked light included.
    pub colour: [u8; 3],
    /// The outward surface normal in units of 1/127; zero when there is none.
    pub normal: [i8; 3],
    /// The flags of the material: see [`Material::GLASS`].
    pub flags: u8,
}

impl Material {
    /// Set for glass, which blocks bodies but not sight and is drawn as a tint. Black glass tints
    /// nothing: it is there for bodies alone. An inner node is glass when all leaves below are.
    pub const GLASS: u8 = 1;

    /// Whether the material can be seen through.
    pub fn is_glass(&self) -> bool {
        self.flags & Self::GLASS != 0
    }
}
