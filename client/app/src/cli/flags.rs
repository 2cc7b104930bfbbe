//! Flags that several commands share.

use std::{path::PathBuf, time::Duration};

use anyhow::Context;
use sightline_cli::{
    flags,
    trace::{Trace, Track},
};
use sightline_client::camera_path::CameraPath;
use sightline_renderer::{Mode, SIDE_MAX};
use sightline_world::World;

/// The path of the camera.
#[derive(clap::Args)]
pub struct PathFlags {
    /// The path of the camera: a trace, gzipped or not, as CSV with the columns
    /// t_ms,id,x,y,z,yaw,pitch,vx,vy,vz (eyes in metres, angles in radians). When absent, a walk
    /// from spawn point to spawn point.
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// The avatar of the trace to follow; when absent, the first one.
    #[arg(long, value_name = "N", requires = "path")]
    id: Option<u32>,
    /// Where to begin, in seconds after the start of the path.
    #[arg(long, value_name = "S", value_parser = flags::time, default_value = "0")]
    from: Duration,
    /// Where to end, in seconds after the start of the path; when absent, at its end.
    #[arg(long, value_name = "S", value_parser = flags::time)]
    until: Option<Duration>,
}

impl PathFlags {
    /// Whether a file was given.
    pub fn is_named(&self) -> bool {
        self.path.is_some()
    }

    /// The path, and the part of it to use: from and until, in seconds.
    ///
    /// # Errors
    /// When the file is no trace, or has no such avatar.
    pub fn read(&self, world: &World) -> anyhow::Result<(CameraPath, f64, f64)> {
        let path = match &self.path {
            Some(file) => self.recorded(file)?,
            None => CameraPath::through(world),
        };
        let from = self.from.as_secs_f64().min(path.duration_s());
        let until = self.until.map_or(path.duration_s(), |until| until.as_secs_f64());
        let until = until.clamp(from, path.duration_s());
        debug_assert!(0.0 <= from && from <= until, "a part of the path");
        Ok((path, from, until))
    }

    fn recorded(&self, file: &std::path::Path) -> anyhow::Result<CameraPath> {
        let trace = Trace::open(file).with_context(|| file.display().to_string())?;
        let tracks = trace.tracks();
        let track = tracks.iter().find(|track| self.id.is_none_or(|id| track.id == id));
        let ids = [tracks.first(), tracks.last()].map(|t: Option<&Track>| t.map_or(0, |t| t.id));
        let path = track.and_then(CameraPath::of_track);
        path.with_context(|| {
            format!("{}: no such avatar; the ids go from {} to {}", file.display(), ids[0], ids[1])
        })
    }
}

/// How the building is drawn. The picture is the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum ModeFlag {
    /// The cheaper way at each node.
    #[default]
    Orthogonal,
    /// By form patterns wherever perspective allows it.
    Forms,
    /// Each node is projected for itself.
    Perspective,
}

impl From<ModeFlag> for Mode {
    fn from(flag: ModeFlag) -> Self {
        match flag {
            ModeFlag::Orthogonal => Self::Orthogonal,
            ModeFlag::Forms => Self::Forms,
            ModeFlag::Perspective => Self::Perspective,
        }
    }
}

/// Parses the size of a picture in pixels.
pub fn size(text: &str) -> Result<(usize, usize), String> {
    flags::size(text, SIDE_MAX)
}
