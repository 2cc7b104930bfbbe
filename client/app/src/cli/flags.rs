//! What flags of several commands have in common.

use std::{path::PathBuf, time::Duration};

use anyhow::Context;
use glam::Vec3;
use sightline_cli::trace::{Trace, Track};
use sightline_client::camera_path::CameraPath;
use sightline_renderer::SIDE_MAX;
use sightline_world::World;

/// A way for the camera.
#[derive(clap::Args)]
pub struct PathFlags {
    /// The way of the camera: a trace, gzipped or not (CSV with the columns
    /// t_ms,id,x,y,z,yaw,pitch,vx,vy,vz: eyes in metres, angles in radians). When absent, a walk from
    /// spawn point to spawn point.
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// Which avatar of the trace to follow; the first when absent.
    #[arg(long, value_name = "N", requires = "path")]
    id: Option<u32>,
    /// Begin so many seconds after the path does.
    #[arg(long, value_name = "S", value_parser = time, default_value = "0")]
    from: Duration,
    /// End so many seconds after the path begins; where it ends when absent.
    #[arg(long, value_name = "S", value_parser = time)]
    until: Option<Duration>,
}

impl PathFlags {
    /// Whether a file was named.
    pub fn is_named(&self) -> bool {
        self.path.is_some()
    }

    /// The part of the path that was asked for: the path, and from when to when, in seconds.
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

/// A point in metres.
pub fn point(text: &str) -> Result<Vec3, String> {
    let numbers: Option<Vec<f32>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|x: &f32| x.is_finite()))
        .collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Vec3::new(x, y, z)),
        _ => Err("a point is three numbers, as in 1.5,1.6,-2".into()),
    }
}

/// A time in seconds.
pub fn time(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    seconds.ok_or_else(|| "a time is a number of seconds, as in 12.5".into())
}

/// The size of a picture in pixels.
pub fn size(text: &str) -> Result<(usize, usize), String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let fits = |&(w, h): &(usize, usize)| [w, h].iter().all(|s| (1..=SIDE_MAX).contains(s));
    sides.filter(fits).ok_or_else(|| format!("a size is like 960x540, at most {SIDE_MAX} each"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_times_and_sizes_are_read() {
        assert_eq!(point("1,-2.5, 3"), Ok(Vec3::new(1.0, -2.5, 3.0)));
        for wrong in ["", "1,2", "1,2,3,4", "a,b,c", "1,2,nan", "1,2,inf"] {
            assert!(point(wrong).is_err(), "{wrong}");
        }
        assert_eq!(time("1.5"), Ok(Duration::from_millis(1_500)));
        for wrong in ["", "a", "-1", "nan", "inf", "1e300"] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
        assert_eq!(size("640x360"), Ok((640, 360)));
        for wrong in ["", "640", "0x9", "9x0", "-1x5", "99999x2", "2x99999"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
