//! Recorded walks: where every avatar's eye was at each sample.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufReader, Read},
    path::Path,
};

use flate2::bufread::MultiGzDecoder;
use glam::Vec3;
use serde::Deserialize;
use sightline_shared::motion::Pose;

/// No trace has more samples; each takes 48 bytes.
const SAMPLES_MAX: usize = 20_000_000;

/// The walks of a trace, in ascending order of id.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// One for each avatar; none is empty.
    pub tracks: Vec<Track>,
}

/// Where one avatar was.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// Which avatar, as the trace calls it.
    pub id: u64,
    /// Seconds since the start of the trace, ascending, and what was there.
    pub(crate) samples: Vec<(f64, Pose)>,
}

/// Why a trace cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TraceError {
    /// It cannot be read.
    #[error("cannot read the trace: {0}")]
    Io(#[from] io::Error),
    /// A line is not as it should be.
    #[error("the trace is malformed: {0}")]
    Csv(#[from] csv::Error),
    /// A number is not finite, or time goes back.
    #[error("line {line} of the trace: {reason}")]
    Sample {
        /// Which, from 1.
        line: usize,
        /// What is wrong.
        reason: &'static str,
    },
    /// It has no sample, or too many.
    #[error("the trace has {0} samples")]
    Size(usize),
}

#[derive(Deserialize)]
struct Row {
    t_ms: f64,
    id: u64,
    x: f32,
    y: f32,
    z: f32,
    yaw: f32,
    pitch: f32,
    vx: f32,
    vy: f32,
    vz: f32,
}

impl Trace {
    /// Reads a trace, gzipped or not.
    pub fn read(path: &Path) -> Result<Self, TraceError> {
        let mut file = BufReader::new(File::open(path)?);
        let is_gzip = io::BufRead::fill_buf(&mut file)?.starts_with(&[0x1f, 0x8b]);
        let reader: Box<dyn Read> =
            if is_gzip { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
        Self::parse(reader)
    }

    fn parse(reader: impl Read) -> Result<Self, TraceError> {
        let mut tracks: BTreeMap<u64, Track> = BTreeMap::new();
        let mut first_ms = None;
        let mut reader = csv::Reader::from_reader(reader);
        for (row, line) in reader.deserialize::<Row>().zip(2..) {
            let row = row?;
            let pose = Pose {
                eye: Vec3::new(row.x, row.y, row.z),
                yaw: row.yaw,
                pitch: row.pitch,
                velocity: Vec3::new(row.vx, row.vy, row.vz),
            };
            if !pose.is_finite() || !row.t_ms.is_finite() {
                return Err(TraceError::Sample { line, reason: "not a number" });
            }
            if line > SAMPLES_MAX {
                return Err(TraceError::Size(line));
            }
            let seconds = (row.t_ms - *first_ms.get_or_insert(row.t_ms)) / 1e3;
            let track = tracks.entry(row.id).or_default();
            track.id = row.id;
            let samples = &mut track.samples;
            if samples.last().is_some_and(|(before, _)| *before > seconds) {
                return Err(TraceError::Sample { line, reason: "time goes back" });
            }
            samples.push((seconds, pose));
        }
        if tracks.is_empty() {
            return Err(TraceError::Size(0));
        }
        Ok(Self { tracks: tracks.into_values().collect() })
    }
}

impl Track {
    /// Where it is at a time: between two samples, or at the first or last.
    pub fn at(&self, seconds: f64) -> Pose {
        let after = self.samples.partition_point(|(t, _)| *t <= seconds);
        let before = after.checked_sub(1).and_then(|i| self.samples.get(i));
        match (before, self.samples.get(after)) {
            (Some((t, a)), Some((u, b))) => {
                let share = ((seconds - t) / (u - t)) as f32;
                Pose { eye: a.eye.lerp(b.eye, share), ..*a }
            }
            (Some((_, end)), None) => Pose { velocity: Vec3::ZERO, ..*end },
            (None, Some((_, start))) => Pose { velocity: Vec3::ZERO, ..*start },
            (None, None) => Pose::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n";

    fn parse(rows: &str) -> Result<Trace, TraceError> {
        Trace::parse((HEADER.to_owned() + rows).as_bytes())
    }

    #[test]
    fn samples_are_sorted_out_and_joined() {
        let rows = "500,7,0,1,0,0,0,1,0,0\n500,3,9,1,9,0,0,0,0,0\n1500,7,2,1,0,0,0,1,0,0\n";
        let trace = parse(rows).unwrap();
        assert_eq!(trace.tracks.iter().map(|track| track.id).collect::<Vec<_>>(), [3, 7]);
        let x = |seconds: f64| trace.tracks[1].at(seconds).eye.x;
        assert_eq!([x(-1.0), x(0.0), x(0.5), x(1.0), x(9.0)], [0.0, 0.0, 1.0, 2.0, 2.0]);
    }

    #[test]
    fn what_is_no_trace_is_told() {
        for (rows, expected) in [
            ("", "0 samples"),
            ("1,2,3\n", "malformed"),
            ("1,2,nan,0,0,0,0,0,0,0\n", "line 2 of the trace: not a number"),
            ("2,2,0,0,0,0,0,0,0,0\n1,2,0,0,0,0,0,0,0,0\n", "line 3 of the trace: time goes back"),
        ] {
            let error = parse(rows).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
