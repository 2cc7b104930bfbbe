//! Traces: where every avatar's eye was at each sample, as CSV, gzipped or not.

use std::{
    collections::BTreeMap,
    f32::consts::{FRAC_PI_2, PI, TAU},
    fs::File,
    io::{self, BufRead, BufReader, Read},
    path::Path,
    time::Duration,
};

use flate2::bufread::MultiGzDecoder;
use glam::Vec3;
use sightline_world::motion::Pose;

/// The first line of every trace.
pub const HEADER: [&str; 10] = ["t_ms", "id", "x", "y", "z", "yaw", "pitch", "vx", "vy", "vz"];

/// No trace has more rows; at 48 bytes each, this is 1 GiB in memory.
const ROWS_MAX: usize = 20_000_000;
/// No line is longer, in bytes.
const LINE_BYTES_MAX: usize = 1_024;
/// No coordinate is greater, in metres.
const COORDINATE_MAX: f32 = 100_000.0;
/// No sample is later: about eleven days.
const TIME_MS_MAX: u64 = 1_000_000_000;

/// Where everyone was.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// The sample times, ascending.
    times: Vec<Duration>,
    tracks: BTreeMap<u32, Vec<Sample>>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Index into [`Trace::times`].
    time: u32,
    pose: Pose,
}

/// The walk of one avatar.
#[derive(Clone, Debug)]
pub struct Track {
    /// Which avatar, as the trace calls it.
    pub id: u32,
    /// Seconds since the start of the trace, ascending, and the pose then. Never empty.
    pub samples: Vec<(f64, Pose)>,
}

impl Track {
    /// The pose at a time: between two samples by interpolation, before the first and after the last at rest.
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

/// Why a trace cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TraceError {
    /// The file cannot be read.
    #[error("cannot read the trace")]
    Io(#[from] io::Error),
    /// The first line is another one.
    #[error("not a trace: its first line must be t_ms,id,x,y,z,yaw,pitch,vx,vy,vz")]
    Header,
    /// A line is not a sample.
    #[error("line {line} of the trace: {what}")]
    Line {
        /// Counted from 1.
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
    /// When it cannot be read or is no trace.
    pub fn open(path: &Path) -> Result<Self, TraceError> {
        Self::read(BufReader::with_capacity(1 << 16, File::open(path)?))
    }

    /// Reads a trace, gzipped or not.
    ///
    /// # Errors
    /// When it cannot be read or is no trace.
    pub fn read(mut bytes: impl BufRead) -> Result<Self, TraceError> {
        if bytes.fill_buf()?.starts_with(&[0x1f, 0x8b]) {
            Self::read_csv(MultiGzDecoder::new(bytes))
        } else {
            Self::read_csv(bytes)
        }
    }

    /// The ids of all who are in it at some time, ascending.
    pub fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.tracks.keys().copied()
    }

    /// Every avatar's walk by itself, by id.
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

    /// Where someone is at a moment, by interpolation between samples; `None` when absent at the
    /// last sample before it. Whoever moves faster than `speed_max` between two samples jumps: it
    /// stays where it was until the later one.
    pub fn pose_at(&self, id: u32, at: Duration, speed_max: f32) -> Option<Pose> {
        let track = self.tracks.get(&id)?;
        let now = self.times.partition_point(|time| *time <= at).checked_sub(1)? as u32;
        let place = track.binary_search_by_key(&now, |sample| sample.time).ok()?;
        let here = track.get(place)?;
        let next = track.get(place + 1).filter(|next| next.time == now + 1);
        Some(next.map_or(here.pose, |next| self.between(here, next, at, speed_max)))
    }

    fn between(&self, here: &Sample, next: &Sample, at: Duration, speed_max: f32) -> Pose {
        let (from, to) = (self.times[here.time as usize], self.times[next.time as usize]);
        let seconds = (to - from).as_secs_f32();
        let way = next.pose.eye - here.pose.eye;
        if way.length() > speed_max * 1.01 * seconds {
            return here.pose;
        }
        let part = (at - from).as_secs_f32() / seconds;
        Pose { eye: here.pose.eye + way * part, ..here.pose }
    }

    fn read_csv(bytes: impl Read) -> Result<Self, TraceError> {
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .buffer_capacity(1 << 16)
            .from_reader(ShortLines { bytes, line: 1, length: 0 });
        if !reader.headers().map_err(|e| csv_error(e, 1))?.iter().eq(HEADER) {
            return Err(TraceError::Header);
        }
        let mut rows = Rows::default();
        let mut record = csv::StringRecord::new();
        loop {
            let line = reader.position().line();
            match reader.read_record(&mut record) {
                Ok(true) => rows.push(&record, record.position().map_or(line, |p| p.line()))?,
                Ok(false) => return rows.finish(),
                Err(error) => return Err(csv_error(error, line)),
            }
        }
    }
}

/// A trace being read.
#[derive(Default)]
struct Rows {
    trace: Trace,
    count: usize,
    yaw_max: f32,
}

impl Rows {
    fn push(&mut self, record: &csv::StringRecord, line: u64) -> Result<(), TraceError> {
        let wrong = |what| TraceError::Line { line, what };
        if record.len() != HEADER.len() {
            return Err(wrong("it does not have ten fields"));
        }
        self.count += 1;
        if self.count > ROWS_MAX {
            return Err(wrong("a trace has at most 20 million samples"));
        }
        let field = |i| record.get(i).unwrap_or_default();
        let t_ms = field(0).parse().ok().filter(|t| *t <= TIME_MS_MAX);
        let t_ms = t_ms.ok_or_else(|| wrong("t_ms is not a whole number up to 1000000000"))?;
        let id = field(1).parse().map_err(|_| wrong("id is not a whole number"))?;
        let mut numbers = [0.0_f32; 8];
        for (i, number) in numbers.iter_mut().enumerate() {
            let value = field(i + 2).parse().ok().filter(|n: &f32| n.abs() <= COORDINATE_MAX);
            *number = value.ok_or_else(|| wrong("a number is missing or out of range"))?;
        }
        let [x, y, z, yaw, pitch, vx, vy, vz] = numbers;
        self.yaw_max = self.yaw_max.max(yaw.abs());
        let (eye, velocity) = (Vec3::new(x, y, z), Vec3::new(vx, vy, vz));
        let time = self.time(Duration::from_millis(t_ms));
        let time = time.ok_or_else(|| wrong("it is earlier than the line before"))?;
        let track = self.trace.tracks.entry(id).or_default();
        if track.last().is_some_and(|sample| sample.time == time) {
            return Err(wrong("the same id twice at one time"));
        }
        track.push(Sample { time, pose: Pose { eye, yaw, pitch, velocity } });
        Ok(())
    }

    /// The index of a sample time, which is the last one or later.
    fn time(&mut self, time: Duration) -> Option<u32> {
        let times = &mut self.trace.times;
        match times.last() {
            Some(last) if *last > time => return None,
            Some(last) if *last == time => {}
            _ => times.push(time),
        }
        Some(times.len() as u32 - 1)
    }

    /// Angles beyond a full turn can only be degrees; then all are. Where nobody ever has a velocity
    /// there are none in the trace, and each is what its way since the sample before was.
    fn finish(mut self) -> Result<Trace, TraceError> {
        if self.count == 0 {
            return Err(TraceError::Empty);
        }
        let unit = if self.yaw_max > TAU + 0.01 { PI / 180.0 } else { 1.0 };
        for sample in self.trace.tracks.values_mut().flatten() {
            let pose = &mut sample.pose;
            pose.yaw = (pose.yaw * unit + PI).rem_euclid(TAU) - PI;
            pose.pitch = (pose.pitch * unit).clamp(-FRAC_PI_2, FRAC_PI_2);
        }
        let Trace { times, tracks } = &mut self.trace;
        if tracks.values().flatten().all(|sample| sample.pose.velocity == Vec3::ZERO) {
            tracks.values_mut().for_each(|track| derive_velocities(times, track));
        }
        Ok(self.trace)
    }
}

fn derive_velocities(times: &[Duration], track: &mut [Sample]) {
    for place in (1..track.len()).rev() {
        let (before, here) = (track[place - 1], &mut track[place]);
        if here.time == before.time + 1 {
            let seconds = times[here.time as usize] - times[before.time as usize];
            here.pose.velocity = (here.pose.eye - before.pose.eye) / seconds.as_secs_f32();
        }
    }
}

fn csv_error(error: csv::Error, line: u64) -> TraceError {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => {
            let long = error.get_ref().and_then(|inner| inner.downcast_ref::<LongLine>());
            match long {
                Some(LongLine(1)) => TraceError::Header,
                Some(LongLine(line)) => {
                    TraceError::Line { line: *line, what: "the line is too long" }
                }
                None => TraceError::Io(error),
            }
        }
        _ => TraceError::Line { line, what: "it is not text" },
    }
}

/// Refuses endless lines, so that a small gzipped file cannot fill the memory.
struct ShortLines<R> {
    bytes: R,
    /// The number of the line being read, and how much of it has been.
    line: u64,
    length: usize,
}

/// The line of this number is too long.
#[derive(Debug, thiserror::Error)]
#[error("line {0} is too long")]
struct LongLine(u64);

impl<R: Read> Read for ShortLines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.bytes.read(buffer)?;
        for byte in &buffer[..count] {
            self.length += 1;
            if *byte == b'\n' {
                self.line += 1;
                self.length = 0;
            }
            if self.length > LINE_BYTES_MAX {
                return Err(io::Error::new(io::ErrorKind::InvalidData, LongLine(self.line)));
            }
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

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
    fn tracks_are_sorted_out_and_joined() {
        let trace =
            read("500,7,0,1,0,0,0,1,0,0\n500,3,9,1,9,0,0,0,0,0\n1500,7,2,1,0,0,0,1,0,0\n").unwrap();
        let tracks = trace.tracks();
        assert_eq!(tracks.iter().map(|track| track.id).collect::<Vec<_>>(), [3, 7]);
        let x = |seconds: f64| tracks[1].at(seconds).eye.x;
        assert_eq!([x(-1.0), x(0.0), x(0.5), x(1.0), x(9.0)], [0.0, 0.0, 1.0, 2.0, 2.0]);
    }

    #[test]
    fn places_are_interpolated_and_absence_is_kept() {
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
    fn gzip_is_noticed_and_degrees_are_turned() {
        let mut gz = GzEncoder::new(Vec::new(), Compression::default());
        gz.write_all(format!("{HEAD}0,1,0,0,0,270,90,0,0,0\r\n0,2,0,0,0,1,0,0,0,0").as_bytes())
            .unwrap();
        let trace = Trace::read(&gz.finish().unwrap()[..]).unwrap();
        let pose = trace.pose_at(1, Duration::ZERO, 1.0).unwrap();
        assert!((pose.yaw + FRAC_PI_2).abs() < 1e-5 && (pose.pitch - FRAC_PI_2).abs() < 1e-5);
        assert!((trace.pose_at(2, Duration::ZERO, 1.0).unwrap().yaw - PI / 180.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_trace_is_one_clear_error() {
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
}
