//! Doors, lifts and trains: brush models that move by the rules of Quake III, with its keys and
//! defaults.
//!
//! | class | keys | motion |
//! | --- | --- | --- |
//! | func_door | angle or angles, lip 8, speed 400, wait 2, spawnflags 1 | when set off: opens, waits, closes |
//! | func_plat | height, lip 8, speed 200 | when set off: from below up, waits 1 s, and down |
//! | func_train | target, speed 100; of each path_corner target, speed, wait | for ever, or until its last corner |
//! | func_bobbing | height 32, speed 4, phase, spawnflags 1 and 2 | for ever, a sine |
//! | func_pendulum | speed 30, phase, angle or angles | for ever, a sine |
//! | func_rotating | speed 100, angle or angles, spawnflags 4 and 8 | for ever |
//!
//! A door with a negative wait stays open. As in the game, the box of a brush model is one unit
//! larger on each side than in the map. When the path of a train leads into a loop, only the loop
//! is kept.

use std::{
    collections::{HashMap, HashSet},
    f64::consts::TAU,
    ops::Range,
};

use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};
use sightline_world::motion::trajectory::{Joint, KeyframeTrack, Playback, Trajectory};

use super::{
    entities::{Entities, Keys},
    map::{Map, SubModel},
    units::placed,
};

/// Keys for one period of a sine: straight lines between them are off by half a per cent.
const SINE_KEYS: u32 = 32;
/// The most corners of a train.
const CORNERS_MAX: usize = 1_000;
/// In Quake units per second squared.
const GRAVITY: f64 = 800.0;

/// A brush model that moves: its faces, in coordinates about the origin of the entity, and its
/// trajectory.
pub(super) struct Moving {
    pub name: String,
    pub faces: Range<usize>,
    pub trajectory: Trajectory,
}

/// All brush models that move. One with invalid keys gives a warning and stays in place.
pub(super) fn moving(
    map: &Map<'_>,
    entities: &Entities,
    warnings: &mut Vec<String>,
) -> Vec<Moving> {
    let mut all = Vec::new();
    for keys in &entities.brush_models {
        let class = keys.text("classname").to_ascii_lowercase();
        let number = keys.text("model").strip_prefix('*').and_then(|n| n.parse::<usize>().ok());
        // Model 0 is the world.
        let model = number.filter(|&number| number > 0).and_then(|number| map.models.get(number));
        let Some(model) = model else { continue };
        let Some(trajectory) = trajectory(&class, keys, model, &entities.corners) else { continue };
        let name = [keys.text("targetname"), keys.text("team"), keys.text("model")];
        let name = name.into_iter().find(|name| !name.is_empty()).unwrap_or_default();
        match trajectory {
            Some(trajectory) => {
                let (name, faces) = (format!("{class} {name}"), model.faces.clone());
                all.push(Moving { name, faces, trajectory });
            }
            None => warnings.push(format!("{class} {name} has invalid keys; it does not move")),
        }
    }
    all
}

/// The trajectory of an entity. The outer `None`: its class does not move. The inner `None`: its
/// keys are invalid.
fn trajectory(
    class: &str,
    keys: &Keys,
    model: &SubModel,
    corners: &HashMap<String, Keys>,
) -> Option<Option<Trajectory>> {
    let origin = keys.vector("origin").unwrap_or(DVec3::ZERO);
    Some(match class {
        "func_door" => door(keys, model, origin),
        "func_plat" => plat(keys, model, origin),
        "func_train" => train(keys, corners),
        "func_bobbing" => bobbing(keys, origin),
        "func_pendulum" => pendulum(keys, model, origin),
        "func_rotating" => rotating(keys, origin),
        _ => return None,
    })
}

fn door(keys: &Keys, model: &SubModel, origin: DVec3) -> Option<Trajectory> {
    let direction = match keys.angles().y {
        -1.0 => DVec3::Z,
        -2.0 => DVec3::NEG_Z,
        _ => forward(keys.angles()),
    };
    let distance = direction.abs().dot(model.size()) - keys.number("lip").unwrap_or(8.0);
    let mut ends = [origin, origin + direction * distance];
    if keys.flags() & 1 != 0 {
        ends.reverse();
    }
    there_and_back(ends, keys.number_not_0("speed", 400.0), keys.number_not_0("wait", 2.0))
}

fn plat(keys: &Keys, model: &SubModel, top: DVec3) -> Option<Trajectory> {
    let lip = keys.number("lip").unwrap_or(8.0);
    let height = keys.number_not_0("height", model.size().z - lip);
    there_and_back([top - DVec3::Z * height, top], keys.number_not_0("speed", 200.0), 1.0)
}

/// A triggered motion to the end and back. With a negative wait it does not come back.
fn there_and_back([start, end]: [DVec3; 2], speed: f64, wait_s: f64) -> Option<Trajectory> {
    let way_s = start.distance(end) / speed.abs();
    let mut keys = vec![(0.0, start), (way_s, end)];
    if wait_s >= 0.0 {
        keys.extend([(way_s + wait_s, end), (2.0 * way_s + wait_s, start)]);
    }
    along(&keys, Playback::Triggered)
}

fn train(keys: &Keys, corners: &HashMap<String, Keys>) -> Option<Trajectory> {
    let speed = keys.number_not_0("speed", 100.0);
    let mut way: Vec<&Keys> = Vec::new();
    let mut seen = HashSet::new();
    let mut next = keys.text("target");
    while let Some(corner) = corners.get(next)
        && way.len() < CORNERS_MAX
        && seen.insert(next)
    {
        way.push(corner);
        next = corner.text("target");
    }
    // The corner to which the path returns, if any.
    let again = way.iter().position(|corner| corner.text("targetname") == next);
    way.drain(..again.unwrap_or(0));
    way.extend(again.and_then(|_| way.first().copied()));
    let mut time_s = 0.0;
    let mut places = vec![(0.0, way.first()?.vector("origin")?)];
    for pair in way.windows(2) {
        let [from, to] = [pair[0].vector("origin")?, pair[1].vector("origin")?];
        time_s += pair[0].number("wait").unwrap_or(0.0).max(0.0);
        places.push((time_s, from));
        time_s += from.distance(to) / pair[0].number_not_0("speed", speed).max(1.0);
        places.push((time_s, to));
    }
    along(&places, if again.is_some() && time_s > 0.0 { Playback::Loop } else { Playback::Once })
}

fn bobbing(keys: &Keys, origin: DVec3) -> Option<Trajectory> {
    let axis = match keys.flags() {
        flags if flags & 1 != 0 => DVec3::X,
        flags if flags & 2 != 0 => DVec3::Y,
        _ => DVec3::Z,
    };
    let reach = axis * keys.number("height").unwrap_or(32.0);
    let swing = swing(keys.number_not_0("speed", 4.0), keys.number("phase").unwrap_or(0.0));
    let places: Vec<_> = swing.map(|(at_s, sine)| (at_s, origin + reach * sine)).collect();
    along(&places, Playback::Loop)
}

fn pendulum(keys: &Keys, model: &SubModel, origin: DVec3) -> Option<Trajectory> {
    let length = model.min.z.abs().max(8.0);
    let cycle_s = TAU * (3.0 * length / GRAVITY).sqrt();
    let (angles, most) = (keys.angles(), keys.number("speed").unwrap_or(30.0));
    let swing = swing(cycle_s, keys.number("phase").unwrap_or(0.0));
    turning(origin, swing.map(|(at_s, sine)| (at_s, angles + DVec3::Z * (most * sine))))
}

fn rotating(keys: &Keys, origin: DVec3) -> Option<Trajectory> {
    // Pitch, yaw and roll, in this order.
    let axis = match keys.flags() {
        flags if flags & 4 != 0 => DVec3::Z,
        flags if flags & 8 != 0 => DVec3::X,
        _ => DVec3::Y,
    };
    let speed = keys.number_not_0("speed", 100.0);
    let quarter_s = 90.0 / speed.abs();
    let quarters = (0..=4).map(f64::from);
    let turn = |i: f64| (quarter_s * i, keys.angles() + axis * (90.0 * speed.signum() * i));
    turning(origin, quarters.map(turn))
}

/// Times and sines over one period.
fn swing(cycle_s: f64, phase: f64) -> impl Iterator<Item = (f64, f64)> {
    (0..=SINE_KEYS).map(move |i| {
        let share = f64::from(i) / f64::from(SINE_KEYS);
        (share * cycle_s, ((share - phase) * TAU).sin())
    })
}

/// A trajectory through places in Quake units, by seconds.
fn along(places: &[(f64, DVec3)], course: Playback) -> Option<Trajectory> {
    let mut keys: Vec<(f32, Vec3)> = Vec::with_capacity(places.len());
    for &(at_s, place) in places {
        let key = (at_s as f32, placed(place));
        match keys.last_mut() {
            // No time has passed.
            Some(last) if last.0 >= key.0 => last.1 = key.1,
            _ => keys.push(key),
        }
    }
    let length_s = keys.last()?.0;
    let joint =
        Joint { translation: KeyframeTrack::linear(keys), ..Joint::still(DAffine3::IDENTITY) };
    Trajectory::new(vec![joint], length_s, course).ok()
}

/// A trajectory that turns about a place for ever: seconds, and pitch, yaw and roll in degrees.
fn turning(about: DVec3, turns: impl Iterator<Item = (f64, DVec3)>) -> Option<Trajectory> {
    let frame = DAffine3::from_translation(placed(about).as_dvec3());
    let keys: Vec<(f32, Quat)> =
        turns.map(|(at_s, angles)| (at_s as f32, rotation(angles).as_quat())).collect();
    let length_s = keys.last()?.0;
    let joint = Joint { rotation: KeyframeTrack::linear(keys), ..Joint::still(frame) };
    Trajectory::new(vec![joint], length_s, Playback::Loop).ok()
}

/// The rotation in our axes. Positive pitch looks down, yaw turns left, roll tilts to the right.
fn rotation(angles: DVec3) -> DQuat {
    let DVec3 { x: pitch, y: yaw, z: roll } = angles.map(f64::to_radians);
    // Quake's axes x, y and z are our x, -z and y.
    DQuat::from_rotation_y(yaw)
        * DQuat::from_axis_angle(DVec3::NEG_Z, pitch)
        * DQuat::from_rotation_x(roll)
}

/// The direction of angles, in Quake's axes.
fn forward(angles: DVec3) -> DVec3 {
    let (sin_pitch, cos_pitch) = angles.x.to_radians().sin_cos();
    let (sin_yaw, cos_yaw) = angles.y.to_radians().sin_cos();
    DVec3::new(cos_pitch * cos_yaw, cos_pitch * sin_yaw, -sin_pitch)
}

impl SubModel {
    /// The size of the box, in Quake units.
    fn size(&self) -> DVec3 {
        self.max - self.min
    }
}
