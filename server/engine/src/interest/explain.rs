//! Why an avatar is sent to a viewer, or not.

use std::{fmt, time::Duration};

use sightline_visibility::box_visibility::SightLine;
use sightline_world::{
    geometry::Aabb,
    motion::{AvatarId, ReportingState, Tbv},
};

use crate::{
    Engine, interest::candidates::Pair, interest::sight_tests::SightResult, population::Avatar,
    regions::live_regions::RegionKind,
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
    /// Where the viewer's eye can be until the next tick's word stands; nowhere while it is hidden.
    pub eyes: Vec<Aabb>,
    /// Where the avatar's body can be until then.
    pub bodies: Vec<Aabb>,
    /// Whether the avatar moved otherwise than it said a while ago, so that its body may be anywhere that top speed leads to.
    pub is_doubted: bool,
    /// What decided.
    pub reason: Reason,
}

/// What decided whether an avatar is sent to a viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// The policy does not ask who sees whom.
    Policy,
    /// One of the two is hidden from everyone.
    Silence,
    /// No gates lead from where the one can be before long to where the other can be, or no cells there see
    /// each other.
    Cells,
    /// One of the two is in a sealed room that the other is not in.
    Sealed,
    /// No room that the viewer can be in before long shows where the other can be.
    Rooms,
    /// Every line between their regions is blocked.
    Blocked,
    /// The same, but some line was not until a moment ago.
    Held,
    /// This line between their regions is free.
    Free(SightLine),
    /// A line may be free: the budget did not suffice to tell.
    Undecided,
}

impl Engine {
    /// Why an avatar is sent to a viewer, or not, as of the last tick; `None` when one of them is
    /// not there.
    pub fn explain(&self, viewer: AvatarId, avatar: AvatarId) -> Option<Explanation> {
        let (from, to) = (self.population.find(viewer)?, self.population.find(avatar)?);
        let pair = from.pairs.iter().find(|pair| pair.id == avatar);
        let delay = self.horizons.delay(from.round_trip);
        let boxes =
            |avatar: &Avatar, part: RegionKind| avatar.near.just(part, &self.body).boxes().to_vec();
        let reason = match pair {
            _ if !self.config.policy.uses_cells() => Reason::Policy,
            _ if [from, to].iter().any(|a| a.state != ReportingState::Live) => Reason::Silence,
            _ if !from.seal.agrees(&to.seal) => Reason::Sealed,
            _ if self.is_ruled_out(from, to, delay) => Reason::Rooms,
            None => Reason::Cells,
            Some(Pair { look: SightResult::Free(line), .. }) => Reason::Free(*line),
            Some(Pair { look: SightResult::Together, .. }) => {
                let [from, to] = [from, to].map(|a| self.world.cells.axes.own(a.pose.eye));
                Reason::Free(SightLine { from, to })
            }
            Some(Pair { look: SightResult::Unknown | SightResult::Undecided { .. }, .. }) => {
                Reason::Undecided
            }
            Some(Pair { is_held: true, .. }) => Reason::Held,
            Some(Pair { look: SightResult::Hidden(_) | SightResult::HiddenIn(_), .. }) => {
                Reason::Blocked
            }
        };
        Some(Explanation {
            viewer: from.state,
            viewer_tbv: from.tbv,
            avatar: to.state,
            avatar_tbv: to.tbv,
            is_held: pair.is_some_and(|pair| pair.is_held),
            eyes: boxes(from, RegionKind::EYES),
            bodies: boxes(to, to.near.bodies(delay)),
            is_doubted: !to.pledges.are_kept(self.now),
            reason,
        })
    }
}

impl Engine {
    /// Whether rooms alone keep a viewer from being told of an avatar.
    fn is_ruled_out(&self, viewer: &Avatar, avatar: &Avatar, delay: Duration) -> bool {
        let part = |avatar: &Avatar, part: RegionKind, place: usize| {
            let near = avatar.near.get(part)?.ground().cloned();
            near.or_else(|| Some(avatar.near.wide.as_ref()?.grounds[place].clone()))
        };
        let grounds =
            part(viewer, RegionKind::EYES, 0).zip(part(avatar, avatar.near.bodies(delay), 1));
        grounds.is_some_and(|(eyes, bodies)| !eyes.shows(&bodies, &self.rooms))
    }
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "{name:<34} {value}");
        row("the viewer's client is", state(self.viewer, self.viewer_tbv))?;
        row("the avatar's client is", state(self.avatar, self.avatar_tbv))?;
        row(
            "the viewer's client",
            if self.is_held { "is told" } else { "is not told" }.to_owned(),
        )?;
        row("because", self.reason.to_string())?;
        for (whose, tbv) in [("the viewer's", self.viewer_tbv), ("the avatar's", self.avatar_tbv)] {
            if let Some(tbv) = tbv {
                row(&format!("{whose} TBV is"), region(&tbv.within))?;
            }
        }
        if self.is_doubted {
            row(
                "the avatar",
                "moves otherwise than it says, so it may be anywhere near".to_owned(),
            )?;
        }
        self.eyes.iter().try_for_each(|part| row("the eye can be in", region(part)))?;
        self.bodies.iter().try_for_each(|part| row("the body can be in", region(part)))
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Policy => f.write_str("the policy does not ask who sees whom"),
            Self::Silence => f.write_str("one of the two is hidden from everyone"),
            Self::Cells => {
                f.write_str("no gates lead from the one to the other, or no cells see each other")
            }
            Self::Sealed => f.write_str("a sealed room has one of the two in it, not the other"),
            Self::Rooms => f.write_str("no room of the viewer's shows where the other can be"),
            Self::Blocked => f.write_str("every line between their regions is blocked"),
            Self::Held => {
                f.write_str("it was in sight a moment ago, though no line is free any more")
            }
            Self::Undecided => f.write_str("a line may be free: too little budget to tell"),
            Self::Free(SightLine { from, to }) => write!(
                f,
                "the line from {:.2}, {:.2}, {:.2} to {:.2}, {:.2}, {:.2} is free",
                from.x, from.y, from.z, to.x, to.y, to.z
            ),
        }
    }
}

fn state(state: ReportingState, tbv: Option<Tbv>) -> String {
    match (state, tbv) {
        (ReportingState::Quiet, Some(tbv)) => {
            format!("quiet until {:.3} s", tbv.expiry.as_secs_f64())
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
