//! The floor: how often clients would have to report if they knew the future.
//!
//! An oracle that knows where everybody will go describes an avatar only while somebody sees it,
//! and by as few straight courses as its true way allows. The floor counts these courses: each is
//! one report.
//!
//! * An avatar counts as seen between two comparisons when it was seen at one of them. So the floor
//!   depends a little on how often the audit compares.
//! * A course leads from one sample of the trace to another, at an even speed. No sample between
//!   them is off by more than [`TOLERANCE_M`] along any axis. Each course is as long as it can be.
//! * Only the eye counts. Yaw, pitch and velocity are free.
//!
//! The floor is a yardstick and not a proven least number: courses that begin beside the true way
//! could be fewer. No client can reach it, since none knows its future, nor who sees it.

use std::{collections::BTreeMap, ops::Range, time::Duration};

use glam::Vec3;

use super::super::simulated_clients::SimulatedClients;

/// By how much an avatar may be off its course along each axis, in metres.
const TOLERANCE_M: f32 = 0.05;

/// When each avatar was seen.
#[derive(Default)]
pub(super) struct Sightings {
    /// By the trace's ids.
    avatars: BTreeMap<u32, Sighting>,
    /// When the audit compared last.
    newest: Option<Duration>,
}

/// When one avatar was seen.
#[derive(Default)]
struct Sighting {
    /// The last comparison at which it was present, and whether it was seen then.
    last: Option<(Duration, bool)>,
    /// The spans in which it counts as seen, in ascending order and apart.
    seen: Vec<Range<Duration>>,
    /// For how long it was watched over.
    present: Duration,
}

/// What the floor comes to.
pub(super) struct Floor {
    /// Reports of a client, a second.
    pub(super) reports: f64,
    /// The share of time in which an avatar need not be described to anybody.
    pub(super) hidden_share: f64,
}

impl Sightings {
    /// Takes in a comparison: the avatars that are present, and which of them somebody sees.
    pub(super) fn add(&mut self, now: Duration, avatars: impl Iterator<Item = (u32, bool)>) {
        for (id, is_seen) in avatars {
            let sighting = self.avatars.entry(id).or_default();
            let last = sighting.last.replace((now, is_seen));
            let Some((before, was_seen)) = last.filter(|last| Some(last.0) == self.newest) else {
                continue;
            };
            sighting.present += now.saturating_sub(before);
            if !is_seen && !was_seen {
                continue;
            }
            match sighting.seen.last_mut() {
                Some(span) if span.end == before => span.end = now,
                _ => sighting.seen.push(before..now),
            }
        }
        self.newest = Some(now);
    }

    /// The floor of the whole run, from the trace's samples at each tick.
    pub(super) fn floor(&self, clients: &SimulatedClients<'_>, tick: Duration) -> Floor {
        let (mut courses, mut present, mut seen) = (0, Duration::ZERO, Duration::ZERO);
        for (id, sighting) in &self.avatars {
            present += sighting.present;
            for span in &sighting.seen {
                seen += span.end - span.start;
                let ticks = (span.end - span.start).div_duration_f64(tick).round() as u32;
                let samples = (0..=ticks).map(|k| clients.pose_of(*id, span.start + tick * k));
                let samples: Vec<Option<Vec3>> = samples.map(|pose| Some(pose?.eye)).collect();
                courses += samples.split(Option::is_none).map(courses_of).sum::<u64>();
            }
        }
        let present_s = present.as_secs_f64().max(f64::MIN_POSITIVE);
        Floor {
            reports: courses as f64 / present_s,
            hidden_share: 1.0 - (seen.as_secs_f64() / present_s).min(1.0),
        }
    }
}

/// How many straight courses describe a way, of which there is a sample at each tick.
fn courses_of(samples: &[Option<Vec3>]) -> u64 {
    let eyes: Vec<Vec3> = samples.iter().flatten().copied().collect();
    let (mut courses, mut from) = (0, 0);
    while from + 1 < eyes.len() {
        let length = longest_course(&eyes[from..]);
        debug_assert!(length > 0, "a course leads to the next sample at least");
        from += length;
        courses += 1;
    }
    // Whoever is there for a moment is described once.
    courses + u64::from(eyes.len() == 1)
}

/// How many ticks the longest course lasts that begins with the first sample.
fn longest_course(eyes: &[Vec3]) -> usize {
    // The velocities that pass all samples up to now, in metres a tick.
    let (mut least, mut most) = (Vec3::NEG_INFINITY, Vec3::INFINITY);
    let mut longest = 1;
    for (ticks, eye) in eyes.iter().enumerate().skip(1) {
        let way = *eye - eyes[0];
        let velocity = way / ticks as f32;
        if least.cmple(velocity).all() && velocity.cmple(most).all() {
            longest = ticks;
        }
        least = least.max((way - TOLERANCE_M) / ticks as f32);
        most = most.min((way + TOLERANCE_M) / ticks as f32);
        if !least.cmple(most).all() {
            break;
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn courses(eyes: impl Iterator<Item = Vec3>) -> u64 {
        courses_of(&eyes.map(Some).collect::<Vec<_>>())
    }

    #[test]
    fn a_straight_walk_is_one_course_and_each_corner_begins_another() {
        assert_eq!(courses((0..400).map(|k| Vec3::X * 0.06 * k as f32)), 1);
        assert_eq!(courses((0..400).map(|_| Vec3::X)), 1);
        let corner = |k: usize| Vec3::new(0.06 * k.min(100) as f32, 0.0, 0.06 * k.max(100) as f32);
        assert_eq!(courses((0..200).map(corner)), 2);
        let jitter = |k: usize| Vec3::new(0.06 * k as f32, 0.0, 0.02 * (k % 2) as f32);
        assert_eq!(courses((0..200).map(jitter)), 1);
        assert_eq!(courses([Vec3::X].into_iter()), 1);
        assert_eq!(courses([].into_iter()), 0);
    }

    #[test]
    fn a_circle_takes_more_courses_than_its_chords_allow_and_fewer_than_its_samples() {
        // A chord that bulges by 5 cm on a circle of 2 m spans about 0.45 rad.
        let count = courses((0..1_000).map(|k| {
            let (sin, cos) = (0.02 * k as f32).sin_cos();
            Vec3::new(cos, 0.0, sin) * 2.0
        }));
        assert!((30..70).contains(&count), "{count}");
    }

    #[test]
    fn an_avatar_counts_as_seen_on_both_sides_of_a_sighting() {
        let s = Duration::from_secs;
        let mut sightings = Sightings::default();
        for (at, is_seen) in [(0, false), (1, true), (2, false), (3, false), (4, true)] {
            sightings.add(s(at), [(7, is_seen)].into_iter());
        }
        sightings.add(s(5), [].into_iter());
        sightings.add(s(6), [(7, true)].into_iter());
        let sighting = &sightings.avatars[&7];
        assert_eq!((&sighting.seen[..], sighting.present), (&[s(0)..s(2), s(3)..s(4)][..], s(4)));
    }
}
