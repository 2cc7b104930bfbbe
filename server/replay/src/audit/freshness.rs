//! Where a viewer shows an avatar, compared with where the avatar was.

use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

use glam::Vec3;
use sightline_world::motion::AvatarId;

use super::super::{
    simulated_clients::{SimulatedClient, SimulatedClients},
    stations::Stations,
};

/// What rounding adds to the tolerance, in metres: poses on the wire, and courses of rounded rates.
const ROUNDING_M: f32 = 0.02;

/// By how much a shown eye may be off, in metres.
#[derive(Clone, Copy)]
pub(super) struct Within {
    /// Along the ground.
    pub(super) level_m: f32,
    pub(super) height_m: f32,
}

impl Within {
    /// The tolerance of a client, which is half as much in height, and the same more in all
    /// directions.
    pub(super) fn new(tolerance_m: f32, more_m: f32) -> Self {
        Self { level_m: tolerance_m + more_m, height_m: 0.5 * tolerance_m + more_m }
    }
}

/// Where an avatar's eye was in the past, newest first. Between two samples it went straight.
pub(super) struct Past {
    now: Duration,
    samples: Vec<(Duration, Vec3)>,
}

impl Past {
    /// The places of a client's avatar now and at each of its earlier ticks, back to a time and
    /// farther by up to a tick. Before it settled it was elsewhere.
    pub(super) fn new(
        clients: &SimulatedClients<'_>,
        client: &SimulatedClient,
        [now, since]: [Duration; 2],
        tick: Duration,
    ) -> Self {
        debug_assert!(since <= now, "the past ends now");
        let since = since.max(client.settled_at);
        let mut samples = vec![(now, client.pose.eye)];
        let mut at = now;
        while at > since {
            at = at.saturating_sub(tick).max(since);
            let Some(pose) = clients.pose_at(client.avatar, at) else { break };
            samples.push((at, pose.eye));
        }
        Self { now, samples }
    }

    /// How long ago the eye was last within a tolerance of a shown eye, along the ground and in
    /// height; `None` when it never was.
    pub(super) fn age_within(&self, shown: Vec3, within: Within) -> Option<Duration> {
        let [level_m, height_m] = [within.level_m, within.height_m].map(|m| m + ROUNDING_M);
        if let [(at, eye)] = self.samples[..] {
            let off = shown - eye;
            let is_near = off.with_y(0.0).length() <= level_m && off.y.abs() <= height_m;
            return is_near.then(|| self.now.saturating_sub(at));
        }
        self.samples.windows(2).find_map(|pair| {
            let [(newer, from), (older, to)] = [pair[0], pair[1]];
            let share = first_within(from - shown, to - from, level_m, height_m)?;
            let at = newer.saturating_sub(newer.saturating_sub(older).mul_f32(share));
            Some(self.now.saturating_sub(at))
        })
    }

    /// The greatest speed of the eye since a time, in metres a second.
    pub(super) fn speed_max(&self, since: Duration) -> f32 {
        let speed = |pair: &[(Duration, Vec3)]| {
            let [(newer, from), (older, to)] = [pair[0], pair[1]];
            from.distance(to) / newer.saturating_sub(older).as_secs_f32()
        };
        let segments = self.samples.windows(2).filter(|pair| pair[0].0 > since);
        segments.map(speed).fold(0.0, f32::max)
    }

    /// How far the eye was at most, at a tick of its client since a time, from where it would have
    /// been if it had gone on evenly since the tick before. In metres.
    pub(super) fn departure_max_m(&self, since: Duration) -> f32 {
        let departure_m = |ticks: &[(Duration, Vec3)]| {
            let [(newest, eye), (before, from), (oldest, start)] = [ticks[0], ticks[1], ticks[2]];
            let share =
                newest.saturating_sub(before).div_duration_f32(before.saturating_sub(oldest));
            eye.distance(from + (from - start) * share)
        };
        let ticks = self.samples.windows(3).filter(|ticks| ticks[0].0 > since);
        ticks.map(departure_m).fold(0.0, f32::max)
    }

    /// The least distance of the eye from a shown eye, in metres.
    pub(super) fn distance_m(&self, shown: Vec3) -> f32 {
        let to_segment = |pair: &[(Duration, Vec3)]| {
            let (from, way) = (pair[0].1, pair[1].1 - pair[0].1);
            let share = (shown - from).dot(way) / way.length_squared().max(f32::MIN_POSITIVE);
            shown.distance(from + way * share.clamp(0.0, 1.0))
        };
        let segments = self.samples.windows(2).map(to_segment);
        segments.fold(shown.distance(self.samples[0].1), f32::min)
    }
}

/// The least share of a straight way, from 0 to 1, at which a point is within a cylinder about the
/// origin. `from` is where the way begins.
fn first_within(from: Vec3, way: Vec3, level_m: f32, height_m: f32) -> Option<f32> {
    let (a, b) = (way.with_y(0.0).length_squared(), from.with_y(0.0).dot(way.with_y(0.0)));
    let c = from.with_y(0.0).length_squared() - level_m * level_m;
    let level = if a < 1e-12 {
        (c <= 0.0).then_some([0.0, 1.0])
    } else {
        let root = (b * b - a * c).max(-1.0).sqrt();
        (!root.is_nan()).then(|| [(-b - root) / a, (-b + root) / a])
    }?;
    let height = if way.y.abs() < 1e-6 {
        (from.y.abs() <= height_m).then_some([0.0, 1.0])?
    } else {
        let ends = [-height_m, height_m].map(|end| (end - from.y) / way.y);
        [ends[0].min(ends[1]), ends[0].max(ends[1])]
    };
    let (first, last) = (level[0].max(height[0]).max(0.0), level[1].min(height[1]).min(1.0));
    (first <= last).then_some(first)
}

/// By how much each avatar may have been off its course, now and a while ago.
#[derive(Default)]
pub(super) struct Tolerances {
    /// The tolerances in metres, oldest first, with the time since which each one stands.
    avatars: BTreeMap<AvatarId, VecDeque<(Duration, f32)>>,
}

impl Tolerances {
    /// Takes in the tolerances in force. What ended before `since` is forgotten.
    pub(super) fn add(&mut self, [now, since]: [Duration; 2], stations: &Stations) {
        let tolerance_m = |avatar| {
            let tolerance = stations.engine_of(avatar).tolerance(avatar);
            tolerance.map(|tolerance| tolerance.metres.max(0.0))
        };
        self.avatars.retain(|avatar, _| tolerance_m(*avatar).is_some());
        let all = stations.engines().flat_map(|engine| engine.avatars());
        for (avatar, metres) in all.filter_map(|id| Some((id, tolerance_m(id)?))) {
            let stood = self.avatars.entry(avatar).or_default();
            if stood.back().is_none_or(|(_, newest)| *newest != metres) {
                stood.push_back((now, metres));
            }
            while stood.get(1).is_some_and(|(ended, _)| *ended < since) {
                stood.pop_front();
            }
        }
    }

    /// The largest tolerance that has stood for an avatar since a time, in metres.
    pub(super) fn largest_m(&self, avatar: AvatarId, since: Duration) -> f32 {
        let Some(stood) = self.avatars.get(&avatar) else { return 0.0 };
        let ended = stood.iter().skip(1).map(|(ended, _)| *ended).chain([Duration::MAX]);
        let stood_since = stood.iter().zip(ended).filter(|(_, ended)| *ended >= since);
        stood_since.map(|((_, metres), _)| *metres).fold(0.0, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn past(places: &[Vec3]) -> Past {
        let ms = |k: usize| Duration::from_millis(1_000 - 50 * k as u64);
        let samples = places.iter().enumerate().map(|(k, eye)| (ms(k), *eye)).collect();
        Past { now: Duration::from_secs(1), samples }
    }

    #[test]
    fn the_age_is_that_of_the_newest_moment_within_the_tolerance() {
        let past = past(&[Vec3::X * 3.0, Vec3::X * 2.0, Vec3::X, Vec3::ZERO]);
        let age = |shown: Vec3| {
            past.age_within(shown, Within::new(0.08, 0.0)).map(|age| age.as_secs_f32() * 1e3)
        };
        let near = |a: Option<f32>, b: f32| a.is_some_and(|a| (a - b).abs() < 0.01);
        assert!(near(age(Vec3::X * 3.0), 0.0) && near(age(Vec3::X * 3.09), 0.0));
        assert!(age(Vec3::X * 3.11).is_none() && age(Vec3::new(1.0, 0.07, 0.0)).is_none());
        assert!(near(age(Vec3::X * 1.6), 65.0), "{:?}", age(Vec3::X * 1.6));
        assert!(near(age(Vec3::new(1.6, 0.05, 0.0)), 65.0));
        assert!(near(age(Vec3::X * -0.05), 147.5));
        assert!((past.distance_m(Vec3::new(1.6, 0.0, 0.5)) - 0.5).abs() < 1e-6);
        assert!((past.distance_m(Vec3::X * -0.5) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn who_stops_dead_departs_by_a_whole_tick_and_who_goes_on_evenly_does_not_depart() {
        let places = [3.0, 3.0, 3.0, 2.0, 1.0].map(|x| Vec3::X * x);
        let past = past(&places);
        let departs = |ms: u64| past.departure_max_m(Duration::from_millis(ms));
        assert_eq!([departs(0), departs(940), departs(950)], [1.0, 1.0, 0.0]);
    }

    #[test]
    fn an_avatar_that_stands_is_shown_at_its_age_zero() {
        let past = past(&[Vec3::X; 4]);
        assert_eq!(past.age_within(Vec3::X, Within::new(0.0, 0.0)), Some(Duration::ZERO));
        assert_eq!(past.age_within(Vec3::X * 1.03, Within::new(0.0, 0.0)), None);
    }
}
