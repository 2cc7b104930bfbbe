//! Moves of several objects at once.

use super::{Change, OccupantError, OccupantId, Occupants};
use crate::geometry::Aabb;

/// The greatest number of levels from a group's node down to the node of one of its moves.
const HEIGHT_MAX: u8 = 2;

/// A move, and the lowest node that contains its object before and after.
struct PlannedMove {
    /// The Morton key of the node's first cell at the deepest level, and the node's depth.
    /// Ancestors come before their descendants in this order.
    node: (u64, u8),
    /// A primitive of the object.
    anchor: u32,
    /// The index of the move.
    index: usize,
}

impl Occupants {
    /// Moves several objects. Moves with the same or a nearby common ancestor are made together:
    /// all objects leave before any enters, so a node that one leaves and another enters is never
    /// deleted. The resulting tree is that of single moves.
    ///
    /// # Errors
    ///
    /// The errors of [`Occupants::move_to`]; then nothing has moved. An object that is named twice
    /// gives [`OccupantError::Unknown`].
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

    /// Groups the moves that are made together.
    fn groups(&self, plans: &[PlannedMove]) -> Vec<MoveGroup> {
        let mut groups: Vec<MoveGroup> = Vec::new();
        // The groups whose nodes contain the node of this move, the highest first.
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

/// Moves that are made together, below one node.
struct MoveGroup {
    node: (u64, u8),
    anchor: u32,
    moves: Vec<usize>,
}
