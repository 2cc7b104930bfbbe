//! The octree in pieces, so that a client can draw before it has all of them.
//!
//! The **trunk** has the palette and the nodes down to a fixed level, with their mean materials.
//! Each node on that level is the root of a **branch**. What lies below it comes in up to three
//! **grades**: a coarse one, the level above the voxels, and the voxels. The bytes of each are a
//! piece of its own. [`Octree::to_pieces`](super::Octree::to_pieces) cuts a tree up. A
//! [`PartialOctree`] takes pieces in, and is drawn meanwhile.
//!
//! ```text
//! trunk:  origin 3 × f32 · edge f32 · depth u8 · height of a branch u8     (little-endian)
//!         materials u32 · branches u32
//!         two times: length u32 · a zstd frame: the palette, and the levels
//! grade:  a zstd frame: the levels
//! level:  the child masks of the nodes above, and six planes of a byte for each node
//! ```
//!
//! The planes are those of the octree's file, each byte less that of the node above: what is
//! below a node mostly looks like it. Nodes of a level are in the order of
//! [`morton`](super::morton).

mod level;
mod partial;
mod split;
#[cfg(test)]
mod tests;

pub use partial::PartialOctree;
pub use split::OctreePieces;

/// The greatest number of grades of a branch.
pub const GRADES: u8 = 3;

/// The least and the greatest height of a branch in levels, unless the tree itself is lower.
const HEIGHTS: std::ops::RangeInclusive<u8> = 5..=8;

/// Branches are as low as they can be while there are no more of them.
const BRANCHES_AIM: usize = 2_048;

/// A piece that is unpacked takes no more bytes. Branches of six levels cannot take as many.
const UNPACKED_MAX: usize = 1 << 22;

/// The levels of a grade, counted from the root of its branch, whose height is given: none when the
/// branch has no such grade.
fn grade_levels(height: u8, grade: u8) -> std::ops::RangeInclusive<u8> {
    match grade {
        0 => 1..=height.saturating_sub(2),
        1 => height.saturating_sub(1).max(1)..=height.saturating_sub(1),
        _ => height..=height,
    }
}
