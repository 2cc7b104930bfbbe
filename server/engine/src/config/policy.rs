//! Policies: who is told what about whom.

use std::{fmt, str::FromStr};

/// Who is told what about whom. All policies but [`Policy::Tbv`] exist for comparison: under them
/// every client is always live.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Policy {
    /// Everyone is told about everyone.
    Broadcast,
    /// A viewer is told of everyone within this distance in metres, eye to eye.
    Radius(f32),
    /// A grid divides the world into cubes whose edges have this length in metres. A viewer is told
    /// of everyone in its own cube and in the 26 cubes around it.
    Grid(f32),
    /// A viewer is told of everyone in its square of a horizontal grid or in one of the eight
    /// around it, at any height, as in voxel games. An avatar stays in its square until it is
    /// further outside than the margin.
    Region {
        /// The edge of a square, in metres.
        edge: f32,
        /// The margin, in metres.
        margin: f32,
    },
    /// A viewer is told of everyone in its own room, and in the rooms that at most `doors` doors
    /// lead to.
    ///
    /// Rooms are found from the world's spaces. Two spaces are in one room if both sides of a gate
    /// between them are longer than 1.6 m, or if the gate fills at least half of the side of both.
    /// A part with less than 2 m² of floor belongs to the room that its largest gate leads to.
    Room {
        /// The most doors in between. With 0, a viewer is told of its own room alone, as if each
        /// room were a channel.
        doors: u32,
    },
    /// A viewer is told of everyone who may be visible from its region: by cells first, then by box
    /// visibility.
    Pvs,
    /// As [`Policy::Pvs`], and avatars that nobody can see are silent in a TBV.
    Tbv,
}

impl Policy {
    /// Whether cells and the PVS decide who is told of whom.
    pub fn uses_cells(self) -> bool {
        matches!(self, Self::Pvs | Self::Tbv)
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Broadcast => f.write_str("broadcast"),
            Self::Radius(metres) => write!(f, "radius:{metres}"),
            Self::Grid(metres) => write!(f, "grid:{metres}"),
            Self::Region { edge, margin } => write!(f, "region:{edge}:{margin}"),
            Self::Room { doors: 0 } => f.write_str("room"),
            Self::Room { doors } => write!(f, "room:{doors}"),
            Self::Pvs => f.write_str("pvs"),
            Self::Tbv => f.write_str("tbv"),
        }
    }
}

/// The most doors between two rooms of any building.
const DOORS_MAX: u32 = 100;

/// Why a policy's name was not understood.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolicyError {
    /// No policy has this name.
    #[error(
        "no such policy: use broadcast, radius:METRES, grid:METRES, region:METRES[:MARGIN], \
         room[:DOORS], pvs or tbv"
    )]
    Unknown,
    /// A length is missing, or is not a length above zero.
    #[error("the policy needs a length above 0 in metres, as in radius:20")]
    Length,
    /// The number of doors is not one, or is too large.
    #[error("the number of doors must be 0 to 100, as in room:1")]
    Doors,
}

impl FromStr for Policy {
    type Err = PolicyError;

    fn from_str(text: &str) -> Result<Self, PolicyError> {
        let (name, length) = match text.split_once(':') {
            Some((name, length)) => (name, Some(length)),
            None => (text, None),
        };
        let metres = || above_zero(length.ok_or(PolicyError::Length)?);
        match (name, length) {
            ("broadcast", None) => Ok(Self::Broadcast),
            ("pvs", None) => Ok(Self::Pvs),
            ("tbv", None) => Ok(Self::Tbv),
            ("radius", _) => metres().map(Self::Radius),
            ("grid", _) => metres().map(Self::Grid),
            ("region", _) => region(length.ok_or(PolicyError::Length)?),
            ("room", None) => Ok(Self::Room { doors: 0 }),
            ("room", Some(doors)) => match doors.parse() {
                Ok(doors) if doors <= DOORS_MAX => Ok(Self::Room { doors }),
                _ => Err(PolicyError::Doors),
            },
            _ => Err(PolicyError::Unknown),
        }
    }
}

fn above_zero(metres: &str) -> Result<f32, PolicyError> {
    let metres = metres.parse::<f32>().ok().filter(|m| m.is_finite() && *m > 0.0);
    metres.ok_or(PolicyError::Length)
}

/// Parses an edge and, after a colon, a margin, which is an eighth of the edge by default.
fn region(lengths: &str) -> Result<Policy, PolicyError> {
    let (edge, margin) = match lengths.split_once(':') {
        Some((edge, margin)) => (above_zero(edge)?, Some(above_zero(margin)?)),
        None => (above_zero(lengths)?, None),
    };
    Ok(Policy::Region { edge, margin: margin.unwrap_or(edge / 8.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_are_parsed_as_they_are_displayed() {
        for text in [
            "broadcast",
            "radius:20",
            "radius:2.5",
            "grid:16",
            "region:16:2.5",
            "room",
            "room:2",
            "pvs",
            "tbv",
        ] {
            assert_eq!(text.parse::<Policy>().unwrap().to_string(), text);
        }
        assert_eq!("region:16".parse(), Ok(Policy::Region { edge: 16.0, margin: 2.0 }));
        assert_eq!("room:0".parse(), Ok(Policy::Room { doors: 0 }));
        for (text, error) in [
            ("radius", PolicyError::Length),
            ("radius:", PolicyError::Length),
            ("radius:-1", PolicyError::Length),
            ("grid:NaN", PolicyError::Length),
            ("grid:inf", PolicyError::Length),
            ("region", PolicyError::Length),
            ("region:16:", PolicyError::Length),
            ("region:16:-2", PolicyError::Length),
            ("room:", PolicyError::Doors),
            ("room:-1", PolicyError::Doors),
            ("room:101", PolicyError::Doors),
            ("tbv:1", PolicyError::Unknown),
            ("", PolicyError::Unknown),
            ("Broadcast", PolicyError::Unknown),
        ] {
            assert_eq!(text.parse::<Policy>(), Err(error), "{text}");
        }
    }
}
