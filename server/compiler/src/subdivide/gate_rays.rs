//! Rays from space to space: blocked wherever they cross a boundary beside its gates.

use std::collections::HashMap;

use glam::DVec3;
use sightline_world::geometry::Aabb;

use super::{bsp_tree::BspNode, spaces::Spaces};

/// A ray may pass a gate this far beside its edge, in metres.
const BESIDE_GATE: f32 = 1e-3;

/// The spaces of a building, prepared for rays. What it says helps to choose cells. It does not
/// decide who sees whom: a gate counts as its box, and edges are not exact.
pub(super) struct GateRays<'a> {
    spaces: &'a Spaces,
    /// The boxes of the gates between two leaves, the lesser first.
    gates: HashMap<[u32; 2], Vec<Aabb>>,
}

/// The line between two points.
struct Segment {
    from: DVec3,
    along: DVec3,
}

impl Segment {
    fn at(&self, share: f64) -> DVec3 {
        self.from + self.along * share
    }
}

impl<'a> GateRays<'a> {
    pub(super) fn new(spaces: &'a Spaces) -> Self {
        let mut gates = HashMap::<_, Vec<Aabb>>::new();
        for (join, polygon) in &spaces.gates {
            let mut leaves = join.leaves;
            leaves.sort_unstable();
            gates.entry(leaves).or_default().push(polygon.bounds());
        }
        Self { spaces, gates }
    }

    /// Whether gates let the line between two points through.
    pub(super) fn between(&self, from: DVec3, to: DVec3) -> bool {
        self.passes(0, &Segment { from, along: to - from }, [0.0, 1.0], &mut None)
    }

    /// Follows a part of a line through a node. `last` is the leaf that the line comes from.
    fn passes(
        &self,
        node: u32,
        line: &Segment,
        [start, end]: [f64; 2],
        last: &mut Option<u32>,
    ) -> bool {
        match &self.spaces.tree.nodes[node as usize] {
            BspNode::Solid => false,
            BspNode::Leaf(leaf) => {
                let passes = last.is_none_or(|last| self.joined(last, *leaf, line.at(start)));
                *last = Some(*leaf);
                passes
            }
            BspNode::Split { cut, sides, .. } => {
                let heights = [start, end].map(|share| cut.height(line.at(share)));
                let [first, second] = heights.map(|height| sides[usize::from(height >= 0.0)]);
                if first == second {
                    return self.passes(first, line, [start, end], last);
                }
                let middle = start + (end - start) * heights[0] / (heights[0] - heights[1]);
                self.passes(first, line, [start, middle], last)
                    && self.passes(second, line, [middle, end], last)
            }
        }
    }

    /// Whether a point on the boundary of two leaves lies in a gate.
    fn joined(&self, a: u32, b: u32, point: DVec3) -> bool {
        let gates = self.gates.get(&[a.min(b), a.max(b)]);
        gates.is_some_and(|gates| gates.iter().any(|gate| is_within(gate, point)))
    }
}

fn is_within(gate: &Aabb, point: DVec3) -> bool {
    let point = point.as_vec3();
    let (low, high) = (gate.min - BESIDE_GATE, gate.max + BESIDE_GATE);
    (low.cmple(point) & point.cmple(high)).all()
}
