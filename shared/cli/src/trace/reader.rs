//! The reader of traces. A hostile file costs a bounded amount of memory, and is one clear error.

use std::{
    f32::consts::{FRAC_PI_2, PI, TAU},
    io::{self, BufRead, Read},
    time::Duration,
};

use flate2::bufread::MultiGzDecoder;
use glam::Vec3;
use sightline_world::motion::Pose;

use super::{HEADER, Sample, Trace, TraceError};

/// The first bytes of a gzipped file.
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// The most samples of a trace. At 48 bytes each they take 1 GiB of memory.
const ROWS_MAX: usize = 20_000_000;
/// The longest line, in bytes.
const LINE_BYTES_MAX: usize = 1_024;
/// The greatest coordinate, in metres.
const COORDINATE_MAX: f32 = 100_000.0;
/// The latest sample time: about eleven days.
const TIME_MS_MAX: u64 = 1_000_000_000;
/// A yaw beyond a full turn by more than this, in radians, is in degrees.
const YAW_SPARE: f32 = 0.01;

/// Reads a trace, gzipped or not.
pub(super) fn read(mut bytes: impl BufRead) -> Result<Trace, TraceError> {
    if bytes.fill_buf()?.starts_with(&GZIP_MAGIC) {
        read_csv(MultiGzDecoder::new(bytes))
    } else {
        read_csv(bytes)
    }
}

fn read_csv(bytes: impl Read) -> Result<Trace, TraceError> {
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

/// The rows of a trace that have been read.
#[derive(Default)]
struct Rows {
    trace: Trace,
    count: usize,
    /// The greatest yaw, either way, in the file's unit.
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
        let pose = Pose { eye, yaw, pitch, velocity, ..Pose::default() };
        track.push(Sample { time, pose });
        Ok(())
    }

    /// The index of a sample time. It is `None` for a time before the last one.
    fn time(&mut self, time: Duration) -> Option<u32> {
        let times = &mut self.trace.times;
        match times.last() {
            Some(last) if *last > time => return None,
            Some(last) if *last == time => {}
            _ => times.push(time),
        }
        Some(times.len() as u32 - 1)
    }

    /// Converts angles, and derives velocities where the file has none. A yaw beyond a full turn
    /// can only be in degrees; then all angles are.
    fn finish(mut self) -> Result<Trace, TraceError> {
        if self.count == 0 {
            return Err(TraceError::Empty);
        }
        let unit = if self.yaw_max > TAU + YAW_SPARE { PI / 180.0 } else { 1.0 };
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

/// Sets each velocity to the movement since the sample before, over the time that it took.
fn derive_velocities(times: &[Duration], track: &mut [Sample]) {
    for place in (1..track.len()).rev() {
        let (before, here) = (track[place - 1], &mut track[place]);
        if here.time == before.time + 1 {
            let seconds = times[here.time as usize] - times[before.time as usize];
            here.pose.velocity = (here.pose.eye - before.pose.eye) / seconds.as_secs_f32();
        }
    }
}

/// The error for a line that the CSV reader rejects.
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

/// Passes bytes through, and rejects overlong lines, so that a small gzipped file cannot fill the
/// memory.
struct ShortLines<R> {
    bytes: R,
    /// The number of the line that is being read, counted from 1.
    line: u64,
    /// How many bytes of it have been read.
    length: usize,
}

/// The error for an overlong line: its number.
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
