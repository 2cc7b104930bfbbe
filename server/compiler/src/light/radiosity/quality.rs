//! How much work goes into light.

/// How much time radiosity takes for even light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightQuality {
    /// Large surfaces in half-light look a little uneven.
    #[default]
    Fast,
    /// Even light, in about four times the time.
    Good,
    /// In about four times that time.
    Best,
}

/// How many rays are cast. Where a building has many points, each gets fewer.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayCounts {
    /// From each node, to find its form factors, and from all of them.
    pub(super) node: usize,
    pub(super) nodes: usize,
    /// From each point, to gather light, and from all of them.
    pub(super) point: usize,
    pub(super) points: usize,
    /// From each probe.
    pub(super) probe: usize,
    /// To the sun.
    pub(super) sun: usize,
    /// To a surface that gives light and is partly hidden.
    pub(super) area: usize,
    /// The most groups of such surfaces that each point asks for their light.
    pub(super) groups: usize,
}

/// A node and a point have at least this many rays.
const LEAST: usize = 16;

impl RayCounts {
    pub(super) fn of(quality: LightQuality) -> Self {
        let million = 1_000_000;
        match quality {
            LightQuality::Fast => Self {
                node: 128,
                nodes: 4 * million,
                point: 96,
                points: 24 * million,
                probe: 128,
                sun: 3,
                area: 8,
                groups: 24,
            },
            LightQuality::Good => Self {
                node: 512,
                nodes: 15 * million,
                point: 384,
                points: 160 * million,
                probe: 512,
                sun: 8,
                area: 24,
                groups: 64,
            },
            LightQuality::Best => Self {
                node: 2_048,
                nodes: 60 * million,
                point: 1_536,
                points: 640 * million,
                probe: 2_048,
                sun: 24,
                area: 96,
                groups: 256,
            },
        }
    }

    /// The rays from each of some nodes.
    pub(super) fn of_nodes(&self, count: usize) -> usize {
        (self.nodes / count.max(1)).clamp(LEAST, self.node)
    }

    /// The rays from each of some points.
    pub(super) fn of_points(&self, count: usize) -> usize {
        (self.points / count.max(1)).clamp(LEAST, self.point)
    }
}
