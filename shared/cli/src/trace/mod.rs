//! Traces: where every avatar's eye was at each sample time, as CSV, gzipped or not.

mod reader;

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufRead, BufReader},
    path::Path,
    time::Duration,
};

use glam::Vec3;
use sightline_world::motion::Pose;

/// The columns of a trace, as its first line names them.
///
/// `t_ms` is the time in whole milliseconds, `id` the avatar. `x`, `y` and `z` are its eye in
/// metres, in the world's axes. Yaw and pitch are in radians, or in degrees when some yaw exceeds a
/// full turn. The velocity is in metres a second; where it is zero in all lines, it is derived from
/// the eyes.
pub const HEADER: [&str; 10] = ["t_ms", "id", "x", "y", "z", "yaw", "pitch", "vx", "vy", "vz"];

/// How much faster than the limit an avatar may move from sample to sample: rounding in the file
/// may add a hundredth.
const SPEED_ROUNDING: f32 = 1.01;

/// The poses of all avatars at all sample times. An avatar is absent at a sample time without a
/// line of its own.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// The sample times, ascending.
    times: Vec<Duration>,
    /// Each avatar's samples, in ascending order of time and never empty.
    tracks: BTreeMap<u32, Vec<Sample>>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Index into [`Trace::times`].
    time: u32,
    pose: Pose,
}

/// The recorded walk of one avatar.
#[derive(Clone, Debug)]
pub struct Track {
    /// The trace's id of the avatar.
    pub id: u32,
    /// Seconds since the start of the trace, ascending, each with the pose then. Never empty.
    pub samples: Vec<(f64, Pose)>,
}

impl Track {
    /// The pose at a time in seconds. Between two samples it is interpolated; before the first and
    /// after the last the avatar stands still.
    pub fn at(&self, seconds: f64) -> Pose {
        let after = self.samples.partition_point(|(t, _)| *t <= seconds);
        let before = after.checked_sub(1).and_then(|i| self.samples.get(i));
        match (before, self.samples.get(after)) {
            (Some((t, a)), Some((u, b))) => {
                debug_assert!(t < u, "samples ascend in time");
                let share = ((seconds - t) / (u - t)) as f32;
                a.on_the_way_to(b, share)
            }
            (Some((_, end)), None) => Pose { velocity: Vec3::ZERO, ..*end },
            (None, Some((_, start))) => Pose { velocity: Vec3::ZERO, ..*start },
            (None, None) => Pose::default(),
        }
    }
}

/// Why a trace cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TraceError {
    /// The file cannot be read.
    #[error("cannot read the trace")]
    Io(#[from] io::Error),
    /// The first line is not [`HEADER`].
    #[error("not a trace: its first line must be t_ms,id,x,y,z,yaw,pitch,vx,vy,vz")]
    Header,
    /// A line is not a sample.
    #[error("line {line} of the trace: {what}")]
    Line {
        /// The number of the line, counted from 1.
        line: u64,
        /// What is wrong with it.
        what: &'static str,
    },
    /// There are no samples.
    #[error("the trace has no samples")]
    Empty,
}

impl Trace {
    /// Reads a file, gzipped or not.
    ///
    /// # Errors
    /// When the file cannot be read or is no trace.
    pub fn open(path: &Path) -> Result<Self, TraceError> {
        Self::read(BufReader::with_capacity(1 << 16, File::open(path)?))
    }

    /// Reads a trace, gzipped or not.
    ///
    /// # Errors
    /// When the bytes cannot be read or are no trace.
    pub fn read(bytes: impl BufRead) -> Result<Self, TraceError> {
        let trace = reader::read(bytes)?;
        debug_assert!(trace.times.is_sorted() && !trace.tracks.is_empty(), "a trace has samples");
        Ok(trace)
    }

    /// The ids of all avatars, ascending.
    pub fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.tracks.keys().copied()
    }

    /// Each avatar's walk, in ascending order of id.
    pub fn tracks(&self) -> Vec<Track> {
        let (start, _) = self.span();
        let seconds = |sample: &Sample| (self.times[sample.time as usize] - start).as_secs_f64();
        let samples = |track: &[Sample]| track.iter().map(|s| (seconds(s), s.pose)).collect();
        self.tracks.iter().map(|(id, track)| Track { id: *id, samples: samples(track) }).collect()
    }

    /// The first and the last sample time.
    pub fn span(&self) -> (Duration, Duration) {
        let first = self.times.first().copied().unwrap_or_default();
        (first, self.times.last().copied().unwrap_or_default())
    }

    /// The pose of an avatar at a time, interpolated between samples. It is `None` when the avatar
    /// is absent at the last sample time before. An avatar that would move faster than `speed_max`,
    /// in metres a second, jumps: it stays where it was until the later sample.
    pub fn pose_at(&self, id: u32, at: Duration, speed_max: f32) -> Option<Pose> {
        let track = self.tracks.get(&id)?;
        let now = self.times.partition_point(|time| *time <= at).checked_sub(1)? as u32;
        let place = track.binary_search_by_key(&now, |sample| sample.time).ok()?;
        let here = track.get(place)?;
        let next = track.get(place + 1).filter(|next| next.time == now + 1);
        Some(next.map_or(here.pose, |next| self.interpolated(here, next, at, speed_max)))
    }

    fn interpolated(&self, here: &Sample, next: &Sample, at: Duration, speed_max: f32) -> Pose {
        let (from, to) = (self.times[here.time as usize], self.times[next.time as usize]);
        debug_assert!(from <= at && at < to, "{at:?} is between the samples");
        let seconds = (to - from).as_secs_f32();
        let way = next.pose.eye - here.pose.eye;
        if way.length() > speed_max * SPEED_ROUNDING * seconds {
            return here.pose;
        }
        let part = (at - from).as_secs_f32() / seconds;
        here.pose.on_the_way_to(&next.pose, part)
    }
}

#[cfg(test)]
mod tests {
    use std::{
        f32::consts::{FRAC_PI_2, PI},
        io::Write,
    };

    use flate2::{Compression, write::GzEncoder};

    use super::*;

    const HEAD: &str = "t_ms,id,x,y,z,yaw,pitch,vx,vy,vz\n";

    fn read(rows: &str) -> Result<Trace, TraceError> {
        Trace::read(format!("{HEAD}{rows}").as_bytes())
    }

    fn x_at(trace: &Trace, id: u32, ms: u64) -> Option<f32> {
        trace.pose_at(id, Duration::from_millis(ms), 10.0).map(|pose| pose.eye.x)
    }

    #[test]
    fn samples_are_sorted_into_tracks_and_interpolated() {
        let trace =
            read("500,7,0,1,0,0,0,1,0,0\n500,3,9,1,9,0,0,0,0,0\n1500,7,2,1,0,0,0,1,0,0\n").unwrap();
        let tracks = trace.tracks();
        assert_eq!(tracks.iter().map(|track| track.id).collect::<Vec<_>>(), [3, 7]);
        let x = |seconds: f64| tracks[1].at(seconds).eye.x;
        assert_eq!([x(-1.0), x(0.0), x(0.5), x(1.0), x(9.0)], [0.0, 0.0, 1.0, 2.0, 2.0]);
        let turning = read("0,7,0,1,0,0,0,1,0,0\n1000,7,2,1,0,1,0.5,1,0,0\n").unwrap();
        let Pose { yaw, pitch, .. } = turning.tracks()[0].at(0.5);
        assert!((yaw - 0.5).abs() < 1e-6 && (pitch - 0.25).abs() < 1e-6);
    }

    #[test]
    fn poses_are_interpolated_and_absent_avatars_stay_absent() {
        let trace = read(concat!(
            "0,7,0,1.6,0,0,0,0,0,0\n0,9,5,0,0,0,0,0,0,0\n",
            "100,7,1,1.6,0,0,0,0,0,0\n",
            "200,7,50,1.6,0,0,0,0,0,0\n200,9,6,0,0,0,0,0,0,0\n",
            "300,7,50,1.6,0,0,0,0,0,0\n",
        ))
        .unwrap();
        assert_eq!(trace.ids().collect::<Vec<_>>(), [7, 9]);
        assert_eq!(trace.span(), (Duration::ZERO, Duration::from_millis(300)));
        let walk = [(0, 0.0), (50, 0.5), (100, 1.0), (150, 1.0), (199, 1.0), (200, 50.0)];
        for (ms, x) in walk {
            assert_eq!(x_at(&trace, 7, ms), Some(x), "{ms}");
        }
        let visits = [(0, Some(5.0)), (60, Some(5.0)), (100, None), (150, None), (250, Some(6.0))];
        for (ms, x) in visits {
            assert_eq!(x_at(&trace, 9, ms), x, "{ms}");
        }
        assert_eq!(x_at(&trace, 8, 0), None);
    }

    #[test]
    fn gzipped_traces_are_recognised_and_degrees_are_converted() {
        let mut gz = GzEncoder::new(Vec::new(), Compression::default());
        gz.write_all(format!("{HEAD}0,1,0,0,0,270,90,0,0,0\r\n0,2,0,0,0,1,0,0,0,0").as_bytes())
            .unwrap();
        let trace = Trace::read(&gz.finish().unwrap()[..]).unwrap();
        let pose = trace.pose_at(1, Duration::ZERO, 1.0).unwrap();
        assert!((pose.yaw + FRAC_PI_2).abs() < 1e-5 && (pose.pitch - FRAC_PI_2).abs() < 1e-5);
        assert!((trace.pose_at(2, Duration::ZERO, 1.0).unwrap().yaw - PI / 180.0).abs() < 1e-6);
    }

    #[test]
    fn each_fault_of_a_trace_is_one_clear_error() {
        let long = format!("0,1,{},0,0,0,0,0,0,0", "1".repeat(2_000));
        for (rows, error) in [
            ("", "the trace has no samples"),
            ("0,1,2\n", "line 2 of the trace: it does not have ten fields"),
            ("0,1,NaN,0,0,0,0,0,0,0", "line 2 of the trace: a number is missing or out of range"),
            ("0,1,0,inf,0,0,0,0,0,0", "line 2 of the trace: a number is missing or out of range"),
            ("0,1,0,1e30,0,0,0,0,0,0", "line 2 of the trace: a number is missing or out of range"),
            (
                "-5,1,0,0,0,0,0,0,0,0",
                "line 2 of the trace: t_ms is not a whole number up to 1000000000",
            ),
            ("5,x,0,0,0,0,0,0,0,0", "line 2 of the trace: id is not a whole number"),
            (
                "5,1,0,0,0,0,0,0,0,0\n4,1,0,0,0,0,0,0,0,0",
                "line 3 of the trace: it is earlier than the line before",
            ),
            (
                "5,1,0,0,0,0,0,0,0,0\n5,1,0,0,0,0,0,0,0,0",
                "line 3 of the trace: the same id twice at one time",
            ),
            (&long, "line 2 of the trace: the line is too long"),
        ] {
            assert_eq!(read(rows).unwrap_err().to_string(), error, "{rows}");
        }
        for bytes in [&b""[..], b"hello\n", b"\x1f\x8b", b"\x1f\x8bnonsense", b"\xff\xfe\n\xff"] {
            assert!(Trace::read(bytes).is_err());
        }
    }

    #[test]
    fn velocities_are_derived_where_the_trace_has_none() {
        let trace = read("0,1,0,0,0,0,0,0,0,0\n500,1,1,0,0,0,0,0,0,0\n").unwrap();
        let velocity = |ms| trace.pose_at(1, Duration::from_millis(ms), 10.0).unwrap().velocity;
        assert_eq!([velocity(0), velocity(500)], [Vec3::ZERO, Vec3::X * 2.0]);
    }
}
