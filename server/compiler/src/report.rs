//! The figures of one compilation.

use serde::Serialize;

use crate::{
    carve::CarveReport, light::LightFigures, octree_statistics::OctreeStatistics, progress::Stage,
    rooms::RoomError,
};

/// The figures of one compilation.
#[derive(Clone, Debug, Serialize)]
pub struct CompileReport {
    /// The size of the box around all triangles, in metres.
    pub size_m: [f32; 3],
    /// All triangles that are drawn.
    pub triangles: usize,
    /// Opaque triangles. The oracle traces every one of them.
    pub opaque: usize,
    /// The angle about the vertical by which most walls are turned, in radians.
    pub turn: f64,
    /// What carving did, in the building's own axes.
    pub carving: CarveReport,
    /// Spaces: convex parts of the building between occluders.
    pub spaces: usize,
    /// Gates: polygons where two spaces join.
    pub gates: usize,
    /// Cells: the parts into which spaces are split.
    pub cells: usize,
    /// Portals: polygons where two cells join.
    pub portals: usize,
    /// The part of all pairs of cells that the PVS holds, from 0 to 1.
    pub pvs_density: f64,
    /// Objects that move by themselves.
    pub movers: usize,
    /// Rooms that the author declared.
    pub rooms: usize,
    /// The windows of all rooms together.
    pub windows: usize,
    /// Spawn points: those of the author, or those that were found.
    pub spawns: usize,
    /// What the author should know, one line each.
    pub warnings: Vec<String>,
    /// Declarations of rooms that are valid but probably not meant, or that have no effect yet.
    pub room_warnings: Vec<RoomError>,
    /// The figures of radiosity. None when it was not used.
    pub light: Option<LightFigures>,
    /// The octree that clients draw.
    #[serde(flatten)]
    pub octree: OctreeStatistics,
    /// Wall-clock seconds of each stage.
    pub seconds: Vec<(Stage, f64)>,
    /// Seconds of processor time of each stage, over all threads of the process. Empty where the
    /// system does not tell.
    pub cpu_seconds: Vec<(Stage, f64)>,
}
