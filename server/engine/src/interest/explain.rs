//! Explanations: why a viewer is told of an avatar, or is not.

use std::fmt;

use sightline_visibility::box_visibility::SightLine;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, ReportingState, Tbv},
};

use crate::{
    pair::{Pair, SightResult},
    population::{Avatar, Population},
    regions::{RegionFootprint, RegionKind},
    tick_context::TickContext,
};

/// What the engine knows about a viewer and an avatar. Boxes and lines are in the building's own
/// axes, in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// What is expected of the viewer's client.
    pub viewer: ReportingState,
    /// The viewer's TBV, unless it is live.
    pub viewer_tbv: Option<Tbv>,
    /// What is expected of the avatar's client.
    pub avatar: ReportingState,
    /// The avatar's TBV, unless it is live.
    pub avatar_tbv: Option<Tbv>,
    /// Whether the viewer's client has been told of the avatar.
    pub is_held: bool,
    /// Where the viewer's eye can be until the next tick takes effect; nowhere while it is hidden.
    pub eyes: Vec<Aabb>,
    /// Where the avatar's body can be until then; nowhere while it is hidden.
    pub bodies: Vec<Aabb>,
    /// Whether the avatar has moved against its own claims, so that its body may be anywhere that
    /// top speed leads to.
    pub is_doubted: bool,
    /// What decided.
    pub reason: Reason,
}

/// What decided whether a viewer is told of an avatar.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// The policy does not ask who sees whom.
    Policy,
    /// One of the two is hidden from everyone.
    Silence,
    /// No gates join their regions, or no cells of their regions see each other.
    Cells,
    /// One of the two is in a sealed room that the other is not in.
    Sealed,
    /// No room that the viewer can be in shows a place where the avatar can be.
    Rooms,
    /// Every line between their regions is blocked.
    Blocked,
    /// Every line between their regions is blocked, but one was not until a moment ago.
    Held,
    /// This line between their regions is free.
    Free(SightLine),
    /// A line may be free: the budget did not suffice to tell.
    Undecided,
}

/// Explains the last tick's decision; `None` when one of the two is not present.
pub(crate) fn explain(
    context: TickContext<'_>,
    population: &Population,
    viewer: AvatarId,
    avatar: AvatarId,
) -> Option<Explanation> {
    let (from, to) = (population.find(viewer)?, population.find(avatar)?);
    let pair = from.pairs.get(avatar);
    let delay = context.horizons.delay(from.round_trip);
    let boxes = |avatar: &Avatar, kind: RegionKind| {
        avatar.regions.known_cover(kind, &context.building.body).boxes().to_vec()
    };
    Some(Explanation {
        viewer: from.state,
        viewer_tbv: from.tbv,
        avatar: to.state,
        avatar_tbv: to.tbv,
        is_held: pair.is_some_and(|pair| pair.is_held),
        eyes: boxes(from, RegionKind::EYES),
        bodies: boxes(to, to.regions.bodies(delay)),
        is_doubted: !to.consistency.is_consistent(context.now),
        reason: reason(context, from, to, pair),
    })
}

fn reason(
    context: TickContext<'_>,
    viewer: &Avatar,
    avatar: &Avatar,
    pair: Option<&Pair>,
) -> Reason {
    match pair {
        _ if !context.config.policy.uses_cells() => Reason::Policy,
        _ if !viewer.is_live() || !avatar.is_live() => Reason::Silence,
        _ if !viewer.sealed.agrees(&avatar.sealed) => Reason::Sealed,
        _ if is_ruled_out(context, viewer, avatar) => Reason::Rooms,
        None => Reason::Cells,
        Some(Pair { sight: SightResult::Free(line), .. }) => Reason::Free(*line),
        Some(Pair { sight: SightResult::Together, .. }) => {
            let [from, to] = [viewer, avatar].map(|a| context.building.axes().own(a.pose.eye));
            Reason::Free(SightLine { from, to })
        }
        Some(Pair { sight: SightResult::Unknown | SightResult::Undecided { .. }, .. }) => {
            Reason::Undecided
        }
        Some(Pair { is_held: true, .. }) => Reason::Held,
        Some(Pair { sight: SightResult::Hidden(_) | SightResult::HiddenIn(_), .. }) => {
            Reason::Blocked
        }
    }
}

/// Whether rooms alone keep a viewer from being told of an avatar.
fn is_ruled_out(context: TickContext<'_>, viewer: &Avatar, avatar: &Avatar) -> bool {
    let bodies = avatar.regions.bodies(context.horizons.delay(viewer.round_trip));
    let eyes = footprint(viewer, RegionKind::EYES);
    let footprints = eyes.zip(footprint(avatar, bodies));
    footprints.is_some_and(|(eyes, bodies)| !eyes.rooms_allow(bodies, &context.building.rooms))
}

/// The footprint of a region, or of the coarse region if the closer one was not computed.
fn footprint(avatar: &Avatar, kind: RegionKind) -> Option<&RegionFootprint> {
    avatar.regions.known_footprint(kind).or_else(|| {
        let coarse = avatar.regions.coarse()?;
        let is_eye = kind == RegionKind::EYES;
        Some(if is_eye { &coarse.eye_footprint } else { &coarse.body_footprint })
    })
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "{name:<34} {value}");
        row("the viewer's client is", state(self.viewer, self.viewer_tbv))?;
        row("the avatar's client is", state(self.avatar, self.avatar_tbv))?;
        let told = if self.is_held { "is told of the avatar" } else { "is not told of the avatar" };
        row("the viewer's client", told.to_owned())?;
        row("because", self.reason.to_string())?;
        for (whose, tbv) in [("the viewer's", self.viewer_tbv), ("the avatar's", self.avatar_tbv)] {
            if let Some(tbv) = tbv {
                row(&format!("{whose} TBV is"), region(&tbv.within))?;
            }
        }
        if self.is_doubted {
            let why = "has moved against its own claims, so it may be anywhere near";
            row("the avatar", why.to_owned())?;
        }
        self.eyes.iter().try_for_each(|part| row("the eye can be in", region(part)))?;
        self.bodies.iter().try_for_each(|part| row("the body can be in", region(part)))
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Policy => "the policy does not ask who sees whom",
            Self::Silence => "one of the two is hidden from everyone",
            Self::Cells => "no gates join their regions, or no cells of these see each other",
            Self::Sealed => "one of the two is in a sealed room that the other is not in",
            Self::Rooms => "no room of the viewer shows a place where the avatar can be",
            Self::Blocked => "every line between their regions is blocked",
            Self::Held => "a line was free a moment ago, though none is now",
            Self::Undecided => "a line may be free: the budget did not suffice to tell",
            Self::Free(SightLine { from, to }) => {
                return write!(
                    f,
                    "the line from {:.2}, {:.2}, {:.2} to {:.2}, {:.2}, {:.2} is free",
                    from.x, from.y, from.z, to.x, to.y, to.z
                );
            }
        })
    }
}

fn state(state: ReportingState, tbv: Option<Tbv>) -> String {
    match (state, tbv) {
        (ReportingState::Quiet, Some(Tbv { expiry, .. })) => {
            format!("quiet until {:.3} s", expiry.as_secs_f64())
        }
        _ => state.to_string(),
    }
}

fn region(part: &Aabb) -> String {
    let (min, max) = (part.min, part.max);
    format!(
        "{:.2} to {:.2}, {:.2} to {:.2}, {:.2} to {:.2} m",
        min.x, max.x, min.y, max.y, min.z, max.z
    )
}
