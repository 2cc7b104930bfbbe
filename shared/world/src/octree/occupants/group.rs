//! Several objects at once.

use super::{Change, OccupantError, OccupantId, Occupants};
use crate::geometry::Aabb;

/// How far below a group's node the node of one of its objects may be.
const HEIGHT_MAX: u8 = 2;

/// A move, and the least node that holds its object before and after.
struct PlannedMove {
    /// The node's least cell of the deepest level as a Morton key, and the node's depth: in this
    /// order ancestors come before what is below them.
    node: (u64, u8),
    /// A primitive of its object.
    anchor: u32,
    /// Which move.
    index: usize,
}

impl Occupants {
    /// Moves several objects. Those whose common ancestors are the same node, or one not far below
    /// another, are moved together: all leave before any enters, and what one leaves and another
    /// enters is never deleted. The tree is the same as after moving one by one.
    ///
    /// # Errors
    ///
    /// As [`Occupants::move_to`]; then nothing has moved. An object may be named once only: the
    /// second time it is [`OccupantError::Unknown`].
    pub fn move_all(&mut self, moves: &[(OccupantId, &[Aabb])]) -> Result<(), OccupantError> {
        self.check_all(moves)?;
        let mut plans = Vec::with_capacity(moves.len());
        for (index, &(object, primitives)) in moves.iter().enumerate() {
            self.measure(primitives);
            if let Some(change) = self.change(object) {
                plans.push(PlannedMove {
                    node: self.least_node(&change),
                    anchor: change.anchor,
                    index,
                });
            } else {
                self.leave(object, primitives);
            }
        }
        plans.sort_unstable_by_key(|plan| (plan.node, plan.index));
        for group in self.groups(&plans) {
            self.move_group(&group, moves);
        }
        Ok(())
    }

    fn check_all(&self, moves: &[(OccupantId, &[Aabb])]) -> Result<(), OccupantError> {
        let mut named = vec![false; self.objects.len()];
        let mut more = 0;
        for &(object, primitives) in moves {
            let held = self.held(object)?.len();
            self.check(primitives, held)?;
            more += primitives.len().saturating_sub(held);
            if std::mem::replace(&mut named[object.0 as usize], true) {
                return Err(OccupantError::Unknown);
            }
        }
        if self.tree.primitive_count() + more > super::PRIMITIVES_MAX {
            return Err(OccupantError::TooMany);
        }
        Ok(())
    }

    fn least_node(&self, change: &Change) -> (u64, u8) {
        let depth = self.tree.grid.common_depth(&change.span);
        let shift = u32::from(self.tree.grid.depth - depth);
        (crate::octree::morton((change.span.low >> shift) << shift), depth)
    }

    /// Which moves to make together, and the depth of the node that holds them all.
    fn groups(&self, plans: &[PlannedMove]) -> Vec<MoveGroup> {
        let mut groups: Vec<MoveGroup> = Vec::new();
        // The groups whose nodes hold the one at hand, the highest first.
        let mut open: Vec<usize> = Vec::new();
        for plan in plans {
            let holds = |group: &MoveGroup| {
                let below = 3 * u32::from(self.tree.grid.depth - group.node.1);
                group.node.0 >> below == plan.node.0 >> below
            };
            while open.last().is_some_and(|&last| !holds(&groups[last])) {
                open.pop();
            }
            let near = |&&group: &&usize| plan.node.1 - groups[group].node.1 <= HEIGHT_MAX;
            if let Some(&group) = open.iter().find(near) {
                groups[group].moves.push(plan.index);
            } else {
                open.push(groups.len());
                let PlannedMove { node, anchor, index } = *plan;
                groups.push(MoveGroup { node, anchor, moves: vec![index] });
            }
        }
        groups
    }

    fn move_group(&mut self, group: &MoveGroup, moves: &[(OccupantId, &[Aabb])]) {
        let start = self.tree.ancestor(group.anchor, group.node.1);
        for &index in &group.moves {
            let (object, primitives) = moves[index];
            self.measure(primitives);
            self.leave(object, primitives);
        }
        self.enter(start);
        self.tidy();
    }
}

/// Moves to make together.
struct MoveGroup {
    node: (u64, u8),
    anchor: u32,
    moves: Vec<usize>,
}
