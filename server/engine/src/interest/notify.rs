//! Telling viewers what has changed for them.

use std::time::Duration;

use glam::Vec3;
use sightline_world::motion::{ACUITY_DISTANCES, AvatarId, COURSE_MAX, Pose, turn_between};

use super::{
    certificates::CertificateInputs,
    snapshot::{LiveAvatar, LiveAvatars, Snapshot, is_in_turn},
};
use crate::{
    acuity::Acuity,
    baselines,
    messages::Output,
    pair::Pair,
    pairs::Pairs,
    population::Population,
    slot::{Member, Slot},
    tick_context::TickContext,
    worker_pool::WorkerPool,
};

/// Decides what each live viewer is told, and returns it by viewer.
pub(crate) fn notify(
    context: TickContext<'_>,
    pool: &WorkerPool,
    inputs: &CertificateInputs,
    snapshot: &mut Snapshot<'_>,
) -> Vec<Output> {
    let Snapshot { live, pairs } = snapshot;
    let mut outputs = pool.gather(pairs, |workspace, index, pairs, outputs| {
        let viewer = &live.all()[index];
        if viewer.is_guest {
            return;
        }
        if !context.config.policy.uses_cells() {
            pairs.match_to(told_without_cells(context, live, viewer));
        }
        let poses = &mut workspace.poses;
        Notifier { context, inputs, live, viewer }.notify(pairs, poses, outputs);
    });
    outputs.sort_by_key(Output::to);
    outputs
}

/// Counts in the population how many clients hold each avatar, after these outputs.
pub(crate) fn count_watchers(population: &mut Population, outputs: &[Output]) {
    for output in outputs {
        let (Output::Appear { to, avatar, .. } | Output::Vanish { to, avatar }) = output else {
            continue;
        };
        let Some(slot) = population.slot(*avatar) else { continue };
        if matches!(output, Output::Vanish { .. }) {
            population.at_mut(slot).lose_watcher();
        } else if let Some(viewer) = population.find(*to) {
            let from = viewer.pose.eye;
            let avatar = population.at_mut(slot);
            avatar.gain_watcher(from.distance(avatar.pose.eye));
        }
    }
}

/// Takes in how far away some viewers are from the avatars that they hold, by the avatars' slots.
pub(crate) fn update_nearest(population: &mut Population, round: u32, distances: &[(Slot, f32)]) {
    for (slot, avatar) in (0..).map(Slot).zip(population.slots_mut()) {
        if let Some(avatar) = avatar.filter(|_| is_in_turn(slot, round)) {
            avatar.nearest_m = std::mem::replace(&mut avatar.nearest_m_so_far, f32::INFINITY);
        }
    }
    for (slot, away_m) in distances {
        population.at_mut(*slot).see_from(*away_m);
    }
}

/// Tells one viewer what has changed.
struct Notifier<'a> {
    context: TickContext<'a>,
    inputs: &'a CertificateInputs,
    live: &'a LiveAvatars<'a>,
    viewer: &'a LiveAvatar<'a>,
}

impl Notifier<'_> {
    /// Tells the viewer what has changed of the pairs that are due, and renews their certificates.
    fn notify(
        &self,
        pairs: &mut Pairs,
        poses: &mut Vec<(AvatarId, Pose)>,
        outputs: &mut Vec<Output>,
    ) {
        let Self { context, viewer, .. } = *self;
        let to = viewer.member.id;
        poses.clear();
        let mut has_ended = false;
        let crowd = pairs.len();
        for at in 0..pairs.len() {
            if !pairs.is_due(at, context.tick) {
                continue;
            }
            let (pair, certificate) = pairs.at_mut(at);
            let avatar = self.live.at(pair.slot);
            let is_hidden = pair.sight.is_hidden();
            if !is_hidden {
                pair.held_until = context.tick + context.config.hold_ticks;
            } else if certificate.grounds.may_see() {
                pair.held_until = context.tick - 1 + context.config.hold_ticks;
            }
            let is_kept = pair.is_held && context.tick < pair.held_until;
            // Sealed rooms apply to the last accepted places, whatever the regions say.
            let agrees = avatar.sealed.agrees(&viewer.sealed);
            let wanted = pair.is_candidate && agrees && (!is_hidden || is_kept);
            let mut tell = u32::MAX;
            match (pair.is_held, wanted) {
                // A viewer is told nothing of an avatar that it merely keeps, not even that it
                // moved.
                (true, true) if !is_hidden && avatar.version != pair.told_version => {
                    match ticks_until_it_tells(context, viewer, avatar, pair, crowd) {
                        0 => {
                            note_told(context, avatar, pair);
                            poses.push((pair.id, avatar.shown));
                        }
                        ticks => tell = context.tick.saturating_add(ticks),
                    }
                }
                (true, true) if is_hidden => tell = pair.held_until,
                (true, false) => outputs.push(Output::Vanish { to, avatar: pair.id }),
                (false, true) => {
                    note_told(context, avatar, pair);
                    outputs.push(appear(context, to, avatar));
                }
                (true, true) | (false, false) => {}
            }
            pair.is_held = wanted;
            has_ended |= !pair.is_candidate;
            *certificate = self.inputs.renewed(certificate, pair, tell);
        }
        if has_ended {
            pairs.remove_ended();
        }
        if !poses.is_empty() {
            let from = viewer.shown.eye;
            outputs.push(Output::Poses { to, from, tick: context.tick, poses: poses.clone() });
        }
    }
}

/// After how many ticks a viewer could tell an avatar's course from the one that it was told last,
/// at the soonest. Zero means that it can by now. `crowd` is the number of avatars that the viewer
/// has to do with.
fn ticks_until_it_tells(
    context: TickContext<'_>,
    viewer: &LiveAvatar<'_>,
    avatar: &LiveAvatar<'_>,
    pair: &Pair,
    crowd: usize,
) -> u32 {
    let elapsed = context.config.tick * (context.tick - pair.told_tick);
    let (told, shown) = (pair.told.straight_on(elapsed), avatar.shown);
    let away_m = viewer.motion.from.distance(avatar.motion.from);
    let acuity = Acuity::in_crowd(&context.building.world, away_m, crowd);
    let spare_m = acuity.metres - shown.eye.distance(told.eye);
    let turned = turn_between(told.yaw, shown.yaw).abs();
    let spare_radians = acuity.radians - turned.max((shown.pitch - told.pitch).abs());
    if avatar.tolerance.is_none() || spare_m < 0.0 || spare_radians < 0.0 {
        return 0;
    }
    if told.falls || shown.falls {
        return 1;
    }
    // Either course ends sometime, and the avatar is then shown where it ends.
    let (shown_for, told_for) = (avatar.shown_for, COURSE_MAX.saturating_sub(elapsed));
    let moving = |pose: Pose, time: Duration| {
        if time.is_zero() { (Vec3::ZERO, 0.0) } else { (pose.velocity, pose.yaw_rate) }
    };
    let [(velocity, yaw_rate), (told_velocity, told_yaw_rate)] =
        [moving(shown, shown_for), moving(told, told_for)];
    let ends = [shown_for, told_for].into_iter().filter(|time| !time.is_zero());
    let ends_s = ends.min().map_or(f32::INFINITY, |time| time.as_secs_f32());
    // Two that run towards each other tell more.
    let closing = 2.0 * context.building.agility.speed_max / ACUITY_DISTANCES;
    let parting = told_velocity.distance(velocity);
    let turning = (told_yaw_rate - yaw_rate).abs();
    let closing_turn = closing * acuity.radians / acuity.metres;
    let seconds = (spare_m / (parting + closing)).min(spare_radians / (turning + closing_turn));
    // As a number of ticks it saturates.
    ((seconds.min(ends_s) / context.config.tick.as_secs_f32()) as u32).saturating_add(1)
}

/// Takes in that a viewer is told of an avatar's course.
fn note_told(context: TickContext<'_>, avatar: &LiveAvatar<'_>, pair: &mut Pair) {
    pair.told_version = avatar.version;
    (pair.told, pair.told_tick) = (avatar.shown, context.tick);
}

/// The avatars that a viewer is told of under a policy that knows no walls.
fn told_without_cells(
    context: TickContext<'_>,
    live: &LiveAvatars<'_>,
    viewer: &LiveAvatar<'_>,
) -> Vec<Member> {
    let (policy, partition) = (context.config.policy, &context.building.partition);
    let is_told = |avatar: &&LiveAvatar<'_>| {
        avatar.member != viewer.member
            && baselines::tells(policy, partition, viewer.location, avatar.location)
    };
    // Such a policy makes no regions, so the snapshot is in the order of ids.
    live.all().iter().filter(is_told).map(|avatar| avatar.member).collect()
}

fn appear(context: TickContext<'_>, to: AvatarId, avatar: &LiveAvatar<'_>) -> Output {
    Output::Appear {
        to,
        avatar: avatar.member.id,
        name: avatar.profile.name.clone(),
        colour: avatar.profile.colour,
        pose: avatar.shown,
        tick: context.tick,
    }
}
