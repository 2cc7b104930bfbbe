//! Why a model cannot be compiled.

use crate::{rooms::RoomErrors, voxelise::VoxeliseError};

/// Why a model cannot be compiled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompileError {
    /// The model has nothing to draw and nothing that blocks sight.
    #[error("the model has no triangles: export its meshes too")]
    Empty,
    /// The progress callback broke the compilation.
    #[error("cancelled")]
    Cancelled,
    /// The octree could not be made.
    #[error(transparent)]
    Voxels(VoxeliseError),
    /// The cells would be too many.
    #[error("cells of {width} m are too many for this model; --cell {enough} would do")]
    Cells {
        /// The width that was asked for, in metres.
        width: f32,
        /// A width that is large enough, in metres.
        enough: f32,
    },
    /// The declared rooms are faulty.
    #[error(transparent)]
    Rooms(#[from] RoomErrors),
}

impl From<VoxeliseError> for CompileError {
    fn from(error: VoxeliseError) -> Self {
        match error {
            VoxeliseError::Cancelled => Self::Cancelled,
            other => Self::Voxels(other),
        }
    }
}
