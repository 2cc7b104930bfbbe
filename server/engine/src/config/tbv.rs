//! What bounds TBVs in time and in space.

use std::{fmt, str::FromStr, time::Duration};

/// How long a TBV is made to last (Sudarsky and Gotsman 1996, section 3.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Validity {
    /// Every TBV lasts for so long.
    Constant(Duration),
    /// Half as long again after each TBV that expired, and half as long after each that was
    /// revealed.
    Adaptive,
    /// As long as the TBV stays unseen by all that is known now. Found by doubling, then bisection.
    Maximal,
    /// Until the client says that it is about to leave the TBV, which is as large a box as stays
    /// unseen by all that is known now.
    UntilLeft,
}

impl Validity {
    /// The longest validity that there can be.
    pub fn max(self, limit: Duration) -> Duration {
        if let Self::Constant(validity) = self { validity } else { limit }
    }
}

impl fmt::Display for Validity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Constant(validity) => write!(f, "{} ms", validity.as_millis()),
            Self::Adaptive => f.write_str("adaptive"),
            Self::Maximal => f.write_str("maximal"),
            Self::UntilLeft => f.write_str("until-left"),
        }
    }
}

impl FromStr for Validity {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match (text, text.parse()) {
            ("adaptive", _) => Ok(Self::Adaptive),
            ("maximal", _) => Ok(Self::Maximal),
            ("until-left", _) => Ok(Self::UntilLeft),
            (_, Ok(ms @ 1..=60_000)) => Ok(Self::Constant(Duration::from_millis(ms))),
            _ => Err("use until-left, maximal, adaptive, or milliseconds from 1 to 60000"),
        }
    }
}

/// What bounds a TBV in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TbvShape {
    /// A ball about the avatar's eye, with top speed times validity as its radius, whatever is in
    /// between (Sudarsky and Gotsman 1996, section 3.2).
    ///
    /// Claims are held against the ball, and the cells that an avatar can be in are those that the
    /// ball, or a body whose eye is in it, touches. Two parts use the box around the ball: sight
    /// tests, which take boxes, and [`Tbv`](sightline_world::motion::Tbv), which clients receive. A
    /// client cannot leave the ball before the TBV expires, so the box makes no client report
    /// later.
    Sphere,
    /// What a body can do from its present velocity, and what portals lead to on ways that are no
    /// longer than it can walk.
    Reach,
}

impl fmt::Display for TbvShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if *self == Self::Sphere { "sphere" } else { "reach" })
    }
}

impl FromStr for TbvShape {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "sphere" => Ok(Self::Sphere),
            "reach" => Ok(Self::Reach),
            _ => Err("use sphere or reach"),
        }
    }
}
