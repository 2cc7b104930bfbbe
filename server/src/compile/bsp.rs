//! Quake III BSP, version 46.

use std::path::PathBuf;

use super::model::Model;

/// Why a BSP file cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BspError {
    /// The importer is still to come.
    #[error("BSP files cannot be read yet")]
    Unsupported,
}

/// Reads the bytes of a BSP.
pub fn read_slice(_bytes: &[u8], _pk3s: &[PathBuf], _title: &str) -> Result<Model, BspError> {
    Err(BspError::Unsupported)
}
