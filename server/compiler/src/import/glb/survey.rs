//! How large a model is, and where, before any of its vertices are read.

use glam::{DMat4, DVec3};
use gltf::{Document, Node, Semantic};

use super::{
    accessor,
    error::{DEPTH_MAX, NODES_MAX},
};

/// What the nodes and the bounds of accessors tell of a model, in its own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Survey {
    pub(super) min: DVec3,
    pub(super) max: DVec3,
}

impl Survey {
    /// Surveys the default scene, or all scenes. `None` when nothing tells where it is.
    pub(super) fn of(document: &Document) -> Option<Self> {
        let scenes: Vec<_> = match document.default_scene() {
            Some(scene) => vec![scene],
            None => document.scenes().collect(),
        };
        let mut survey = Self::empty();
        let mut stack: Vec<(Node<'_>, DMat4, usize)> =
            scenes.iter().flat_map(|s| s.nodes()).map(|node| (node, DMat4::IDENTITY, 0)).collect();
        let mut visited = 0;
        while let Some((node, parent, depth)) = stack.pop() {
            visited += 1;
            // The reader refuses such a document.
            if visited > NODES_MAX || depth > DEPTH_MAX || stack.len() > NODES_MAX {
                return None;
            }
            let matrix = node.transform().matrix().map(|column| column.map(f64::from));
            let place = parent * DMat4::from_cols_array_2d(&matrix);
            survey.add(&node, &place);
            stack.extend(node.children().map(|child| (child, place, depth + 1)));
        }
        let is_sane = survey.min.is_finite() && survey.max.is_finite();
        is_sane.then_some(survey)
    }

    /// The survey of the same model after a transform.
    pub(super) fn transformed(&self, by: &DMat4) -> Self {
        let mut survey = Self::empty();
        survey.cover(self.min, self.max, by);
        survey
    }

    fn empty() -> Self {
        Self { min: DVec3::splat(f64::INFINITY), max: DVec3::splat(f64::NEG_INFINITY) }
    }

    /// Extends to a box that is transformed.
    fn cover(&mut self, min: DVec3, max: DVec3, by: &DMat4) {
        for i in 0..8 {
            let pick = |axis: usize| if i >> axis & 1 == 0 { min[axis] } else { max[axis] };
            let at = by.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
            self.min = self.min.min(at);
            self.max = self.max.max(at);
        }
    }

    /// The length of each side.
    pub(super) fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// The middle of the ground.
    pub(super) fn foot(&self) -> DVec3 {
        self.min.midpoint(self.max).with_y(self.min.y)
    }

    fn add(&mut self, node: &Node<'_>, place: &DMat4) {
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
            let Some(positions) = primitive.get(&Semantic::Positions) else { continue };
            let greatest = accessor::greatest(&positions);
            let corner = |value: Option<gltf::json::Value>| {
                let value = value?;
                let number = |i: usize| Some(value.get(i)?.as_f64()? / greatest);
                Some(DVec3::new(number(0)?, number(1)?, number(2)?))
            };
            let (Some(min), Some(max)) = (corner(positions.min()), corner(positions.max())) else {
                continue;
            };
            self.cover(min, max, place);
        }
    }
}
