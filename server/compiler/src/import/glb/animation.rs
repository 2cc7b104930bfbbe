//! The animations of a document: translations, rotations and scales of nodes.

use std::collections::HashMap;

use glam::{DAffine3, DMat4, Quat, Vec3};
use gltf::{
    Accessor, Document, Node,
    animation::{Interpolation, Property},
    json::{self, validation::Checked},
    scene::Transform,
};
use sightline_world::motion::trajectory::{
    Interpolate, JOINTS_MAX, Joint, KEYS_MAX, KeyframeTrack, LENGTH_S_MAX, Playback, Trajectory,
};

use super::{accessor, error::GlbError, resources::Resources};

/// The most keys of all motions, instances counted one by one: about 80 MB.
const KEYS_OF_ALL_MAX: usize = 4 << 20;
/// The most warnings.
const WARNINGS_MAX: usize = 1_000;
/// How many straight pieces replace a cubic piece between two keys.
const CUBIC_PIECES: usize = 16;

/// The animated nodes of a document, by index. Every animation loops from the beginning of the
/// server's clock. When several move one node, the first counts.
#[derive(Default)]
pub(super) struct Animations {
    nodes: HashMap<usize, Motion>,
    /// Keys so far, instances counted one by one.
    keys: usize,
}

/// The motion of one node. Without a track, the node keeps its own value.
#[derive(Default)]
struct Motion {
    animation: usize,
    /// The length of the whole animation.
    length_s: f32,
    translation: Option<KeyframeTrack<Vec3>>,
    rotation: Option<KeyframeTrack<Quat>>,
    scale: Option<KeyframeTrack<Vec3>>,
}

/// The chain of joints that moves a node and its descendants.
#[derive(Clone, Default)]
pub(super) struct Chain {
    joints: Vec<Joint>,
    length_s: f32,
    /// Whether lengths of joints differ, or joints are invalid.
    faulty: bool,
}

/// A channel: the property of a node that it moves, and its data. The `gltf` crate has such a type
/// too, but does not check references and looks them up in linear time.
struct Channel<'a> {
    node: usize,
    property: Option<Property>,
    how: Option<Interpolation>,
    input: &'a Accessor<'a>,
    output: &'a Accessor<'a>,
}

impl<'a> Channel<'a> {
    /// `None` when the channel refers to something that does not exist.
    fn find(
        channel: &json::animation::Channel,
        animation: &json::Animation,
        accessors: &'a [Accessor<'a>],
        document: &Document,
    ) -> Option<Self> {
        let sampler = animation.samplers.get(channel.sampler.value())?;
        let node = channel.target.node.value();
        let valid = node < document.as_json().nodes.len();
        valid.then_some(Self {
            node,
            property: match channel.target.path {
                Checked::Valid(property) => Some(property),
                Checked::Invalid => None,
            },
            how: match sampler.interpolation {
                Checked::Valid(how) => Some(how),
                Checked::Invalid => None,
            },
            input: accessors.get(sampler.input.value())?,
            output: accessors.get(sampler.output.value())?,
        })
    }
}

impl Animations {
    /// Reads all animations of a document.
    pub(super) fn read(
        document: &Document,
        resources: &Resources,
        warnings: &mut Vec<String>,
    ) -> Result<Self, GlbError> {
        let mut animations = Self::default();
        let accessors: Vec<Accessor<'_>> = document.accessors().collect();
        for (index, animation) in document.as_json().animations.iter().enumerate() {
            let (mut faulty, mut twice, mut length_s) = (0, 0, 0.0f32);
            for channel in &animation.channels {
                let channel = Channel::find(channel, animation, &accessors, document)
                    .ok_or(GlbError::Animation { index })?;
                animations.count(CUBIC_PIECES * channel.input.count().min(KEYS_MAX))?;
                let known = animations.nodes.get(&channel.node);
                if known.is_some_and(|motion| motion.animation != index) {
                    twice += 1;
                    continue;
                }
                let motion = animations.nodes.entry(channel.node).or_default();
                motion.animation = index;
                match motion.add(&channel, resources)? {
                    Some(end_s) => length_s = length_s.max(end_s),
                    None => faulty += 1,
                }
            }
            for node in animation.channels.iter().map(|channel| channel.target.node.value()) {
                let motion = animations.nodes.get_mut(&node);
                if let Some(motion) = motion.filter(|motion| motion.animation == index) {
                    motion.length_s = length_s;
                }
            }
            for (count, what) in
                [(faulty, "are invalid"), (twice, "move a node that moves already")]
            {
                if count > 0 && warnings.len() < WARNINGS_MAX {
                    let all = format!("animation {index}: {count} channels left out: they {what}");
                    warnings.push(all);
                }
            }
        }
        Ok(animations)
    }

    fn count(&mut self, keys: usize) -> Result<(), GlbError> {
        self.keys += keys;
        if self.keys > KEYS_OF_ALL_MAX { Err(GlbError::TooMany("keys of motions")) } else { Ok(()) }
    }

    /// The chain of a node that moves: the chain above, in which `parent` is placed, and one more
    /// joint.
    pub(super) fn chain(
        &mut self,
        node: &Node<'_>,
        above: Option<&Chain>,
        parent: &DMat4,
    ) -> Result<Option<Chain>, GlbError> {
        let Some(motion) = self.nodes.get(&node.index()) else { return Ok(None) };
        let mut chain = above.cloned().unwrap_or_default();
        let frame = DAffine3::from_mat4(*parent);
        chain.faulty |= !chain.joints.is_empty() && chain.length_s != motion.length_s;
        chain.faulty |= chain.joints.len() == JOINTS_MAX;
        chain.length_s = chain.length_s.max(motion.length_s);
        if chain.joints.len() < JOINTS_MAX {
            chain.joints.push(motion.joint(&node.transform(), frame));
        }
        let keys = |joint: &Joint| {
            joint.translation.keys.len() + joint.rotation.keys.len() + joint.scale.keys.len()
        };
        self.count(chain.joints.iter().map(keys).sum())?;
        Ok(Some(chain))
    }
}

impl Chain {
    /// The trajectory, and whether the chain was invalid. An invalid chain does not move.
    pub(super) fn trajectory(&self) -> (Trajectory, bool) {
        let course = if self.length_s > 0.0 { Playback::Loop } else { Playback::Once };
        match Trajectory::new(self.joints.clone(), self.length_s, course) {
            Ok(trajectory) => (trajectory, self.faulty),
            Err(_) => (self.still(), true),
        }
    }

    /// A trajectory that stays where the chain begins.
    fn still(&self) -> Trajectory {
        let place = self.joints.iter().fold(DAffine3::IDENTITY, |above, joint| {
            let (turn, place) = (joint.rotation.keys[0].1, joint.translation.keys[0].1);
            let scale = joint.scale.keys[0].1.as_dvec3();
            let turn = turn.as_dquat().normalize();
            above
                * joint.frame
                * DAffine3::from_scale_rotation_translation(scale, turn, place.as_dvec3())
        });
        let place = if place.is_finite() { place } else { DAffine3::IDENTITY };
        let reach = place.to_cols_array().into_iter().fold(0.0f64, |most, v| most.max(v.abs()));
        let place = if reach <= 1e6 { place } else { DAffine3::IDENTITY };
        Trajectory::new(vec![Joint::still(place)], 0.0, Playback::Once)
            .expect("a finite joint that does not move is valid")
    }
}

impl Motion {
    /// Adds a channel and gives the time at which it ends. `None` when the channel is invalid.
    fn add(
        &mut self,
        channel: &Channel<'_>,
        resources: &Resources,
    ) -> Result<Option<f32>, GlbError> {
        let Channel { property, how, input, output, .. } = *channel;
        let (Some(property), Some(how)) = (property, how) else { return Ok(None) };
        if input.count() > KEYS_MAX || output.count() > 3 * KEYS_MAX {
            return Ok(None);
        }
        let times = accessor::scalars(input, resources)?;
        if property == Property::Rotation {
            let values = accessor::vectors::<4>(output, resources, 4)?;
            let turn = |value: [f32; 4]| Quat::from_array(value).normalize();
            self.rotation = keys(&times, &values, how, turn);
            return Ok(end_s(self.rotation.as_ref()));
        }
        let slot = match property {
            Property::Translation => &mut self.translation,
            Property::Scale => &mut self.scale,
            _ => return Ok(None),
        };
        let values = accessor::vectors::<3>(output, resources, 3)?;
        *slot = keys(&times, &values, how, Vec3::from_array);
        Ok(end_s(slot.as_ref()))
    }

    fn joint(&self, rest: &Transform, frame: DAffine3) -> Joint {
        let (translation, rotation, scale) = rest.clone().decomposed();
        let rotation = Quat::from_array(rotation);
        let rotation = if rotation.length() > 0.1 { rotation.normalize() } else { Quat::IDENTITY };
        Joint {
            frame,
            translation: self
                .translation
                .clone()
                .unwrap_or_else(|| KeyframeTrack::constant(Vec3::from(translation))),
            rotation: self.rotation.clone().unwrap_or_else(|| KeyframeTrack::constant(rotation)),
            scale: self.scale.clone().unwrap_or_else(|| KeyframeTrack::constant(Vec3::from(scale))),
        }
    }
}

fn end_s<V>(track: Option<&KeyframeTrack<V>>) -> Option<f32> {
    track.and_then(|track| track.keys.last()).map(|&(at_s, _)| at_s)
}

/// The keys of a track. `None` when they are invalid.
fn keys<const N: usize, V: Interpolate>(
    times: &[f32],
    values: &[[f32; N]],
    how: Interpolation,
    value: impl Fn([f32; N]) -> V,
) -> Option<KeyframeTrack<V>> {
    let keys: Vec<(f32, V)> = match how {
        Interpolation::CubicSpline => {
            cubic(times, values).map(|(at_s, v)| (at_s, value(v))).collect()
        }
        _ => times.iter().zip(values).map(|(&at_s, &v)| (at_s, value(v))).collect(),
    };
    let ascend = keys.windows(2).all(|pair| pair[0].0 < pair[1].0);
    let in_time = keys.iter().all(|(at_s, _)| (0.0..=LENGTH_S_MAX).contains(at_s));
    let sane = keys.iter().all(|(_, value)| value.is_sane());
    let track = KeyframeTrack { keys, steps: how == Interpolation::Step };
    (!track.keys.is_empty() && ascend && in_time && sane).then_some(track)
}

/// Points on a cubic spline. Each key has the tangent before it, the value, and the tangent after
/// it. Server and client both take the straight pieces for the motion.
fn cubic<'a, const N: usize>(
    times: &'a [f32],
    values: &'a [[f32; N]],
) -> impl Iterator<Item = (f32, [f32; N])> + 'a {
    let count = times.len().min(values.len() / 3);
    (0..count).flat_map(move |i| {
        let pieces = if i + 1 < count { CUBIC_PIECES } else { 1 };
        (0..pieces).map(move |piece| {
            let next = (i + 1).min(count - 1);
            let share = piece as f32 / CUBIC_PIECES as f32;
            let span_s = times[next] - times[i];
            let [from, leaving] = [values[3 * i + 1], values[3 * i + 2]];
            let [arriving, to] = [values[3 * next], values[3 * next + 1]];
            let value = std::array::from_fn(|k| {
                hermite(share, [from[k], leaving[k] * span_s, to[k], arriving[k] * span_s])
            });
            (times[i] + span_s * share, value)
        })
    })
}

/// The cubic Hermite curve through two values with their slopes.
fn hermite(t: f32, [from, leaving, to, arriving]: [f32; 4]) -> f32 {
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * from
        + (t3 - 2.0 * t2 + t) * leaving
        + (3.0 * t2 - 2.0 * t3) * to
        + (t3 - t2) * arriving
}
