//! Telling viewers what has changed for them.

use sightline_world::motion::{AvatarId, Tolerance, turn_between};

use super::{
    candidates::matched,
    snapshot::{LiveAvatar, LiveAvatars, Snapshot},
};
use crate::{
    acuity::Acuity, baselines, messages::Output, pair::Pair, population::Population, slot::Member,
    view::View, worker_pool::WorkerPool,
};

/// Decides what each live viewer is told, and returns it by viewer.
pub(crate) fn notify(
    view: View<'_>,
    pool: &WorkerPool,
    snapshot: &mut Snapshot<'_>,
) -> Vec<Output> {
    let Snapshot { live, pairs } = snapshot;
    let mut outputs = pool.gather(pairs, |_, index, pairs, outputs| {
        let viewer = &live.all()[index];
        if !view.config.policy.uses_cells() {
            **pairs = pairs_without_cells(view, live, viewer, pairs);
        }
        notify_viewer(view, live, viewer, pairs, outputs);
    });
    outputs.sort_by_key(Output::to);
    outputs
}

/// Counts in the population how many clients hold each avatar, after these outputs.
pub(crate) fn count_watchers(population: &mut Population, outputs: &[Output]) {
    for output in outputs {
        let (avatar, is_shown) = match output {
            Output::Appear { avatar, .. } => (avatar, true),
            Output::Vanish { avatar, .. } => (avatar, false),
            _ => continue,
        };
        if let Some(slot) = population.slot(*avatar) {
            let watchers = &mut population.at_mut(slot).watchers;
            debug_assert!(is_shown || *watchers > 0, "an avatar vanishes once it has appeared");
            *watchers = if is_shown { *watchers + 1 } else { *watchers - 1 };
        }
    }
}

fn notify_viewer(
    view: View<'_>,
    live: &LiveAvatars<'_>,
    viewer: &LiveAvatar<'_>,
    pairs: &mut Vec<Pair>,
    outputs: &mut Vec<Output>,
) {
    let to = viewer.member.id;
    let mut poses = Vec::with_capacity(pairs.iter().filter(|pair| pair.is_held).count());
    for pair in pairs.iter_mut() {
        let avatar = live.at(pair.slot);
        let is_hidden = pair.sight.is_hidden();
        if !is_hidden {
            pair.held_until = view.tick + view.config.hold_ticks;
        }
        let is_kept = pair.is_held && view.tick < pair.held_until;
        // Sealed rooms apply to the last accepted places, whatever the regions say.
        let agrees = avatar.sealed.agrees(&viewer.sealed);
        let wanted = pair.concerns && agrees && (!is_hidden || is_kept);
        match (pair.is_held, wanted) {
            // A viewer is told nothing of an avatar that it merely keeps, not even that it moved.
            (true, true) if !is_hidden && avatar.version != pair.version => {
                if can_tell(view, viewer, avatar, pair) {
                    note_told(view, avatar, pair);
                    poses.push((pair.id, avatar.shown));
                }
            }
            (true, false) => outputs.push(Output::Vanish { to, avatar: pair.id }),
            (false, true) => {
                note_told(view, avatar, pair);
                outputs.push(appear(view, to, avatar));
            }
            (true, true) | (false, false) => {}
        }
        pair.is_held = wanted;
    }
    pairs.retain(|pair| pair.concerns);
    if !poses.is_empty() {
        outputs.push(Output::Poses { to, tick: view.tick, poses });
    }
}

/// Whether a viewer could tell an avatar's course from the one that it was told last.
fn can_tell(view: View<'_>, viewer: &LiveAvatar<'_>, avatar: &LiveAvatar<'_>, pair: &Pair) -> bool {
    let Tolerance { metres, .. } = avatar.tolerance;
    let away_m = viewer.motion.from.distance(avatar.motion.from);
    let acuity = Acuity::at(&view.building.world, away_m);
    let told = pair.told.straight_on(view.config.tick * (view.tick - pair.told_tick));
    let off = avatar.shown.eye.distance(told.eye);
    let turned = turn_between(told.yaw, avatar.shown.yaw).abs();
    let tilted = (avatar.shown.pitch - told.pitch).abs();
    metres <= 0.0 || off > acuity.metres || turned.max(tilted) > acuity.radians
}

/// Takes in that a viewer is told of an avatar's course.
fn note_told(view: View<'_>, avatar: &LiveAvatar<'_>, pair: &mut Pair) {
    pair.version = avatar.version;
    (pair.told, pair.told_tick) = (avatar.shown, view.tick);
}

/// The pairs of a viewer under a policy that knows no walls.
fn pairs_without_cells(
    view: View<'_>,
    live: &LiveAvatars<'_>,
    viewer: &LiveAvatar<'_>,
    pairs: &[Pair],
) -> Vec<Pair> {
    let (policy, partition) = (view.config.policy, &view.building.partition);
    let is_told = |avatar: &&LiveAvatar<'_>| {
        avatar.member != viewer.member
            && baselines::tells(policy, partition, viewer.location, avatar.location)
    };
    // Such a policy makes no regions, so the snapshot is in the order of ids.
    let told: Vec<Member> = live.all().iter().filter(is_told).map(|avatar| avatar.member).collect();
    debug_assert!(told.is_sorted(), "pairs are by id");
    matched(pairs, told)
}

fn appear(view: View<'_>, to: AvatarId, avatar: &LiveAvatar<'_>) -> Output {
    Output::Appear {
        to,
        avatar: avatar.member.id,
        name: avatar.profile.name.clone(),
        colour: avatar.profile.colour,
        pose: avatar.shown,
        tick: view.tick,
    }
}
