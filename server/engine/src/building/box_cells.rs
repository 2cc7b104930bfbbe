//! Cells that are boxes, so that most points are found without a way down the tree.

use std::ops::Range;

use glam::Vec3;
use sightline_world::{CellId, Cells, Node, geometry::Aabb};

/// The most cells of a space that are tried one by one.
const CELLS_FEW: usize = 8;

/// The box that each cell fills.
#[derive(Clone, Debug)]
pub(crate) struct BoxCells {
    /// In own axes; empty for a cell that a slanted plane bounds.
    boxes: Vec<Aabb>,
}

impl BoxCells {
    pub(crate) fn new(cells: &Cells) -> Self {
        let mut boxes: Vec<Aabb> = cells.cells.iter().map(|cell| cell.bounds).collect();
        let mut is_slanted = vec![false; cells.tree.len()];
        for (index, node) in cells.tree.iter().enumerate() {
            match node {
                Node::Axial { sides, .. } => {
                    let slanted = is_slanted[index];
                    sides.iter().for_each(|side| is_slanted[*side as usize] = slanted);
                }
                Node::Plane { sides, .. } => {
                    sides.iter().for_each(|side| is_slanted[*side as usize] = true);
                }
                Node::Leaf(cell) if is_slanted[index] => boxes[cell.0 as usize] = Aabb::EMPTY,
                Node::Leaf(_) | Node::Solid => {}
            }
        }
        Self { boxes }
    }

    /// The cell of a point in own axes, which is probably in a certain cell or in another one of
    /// its space; `None` in something solid.
    pub(crate) fn at(&self, cells: &Cells, point: Vec3, likely: Option<CellId>) -> Option<CellId> {
        // As in the tree, a point on a boundary is on the greater side.
        let is_in = |cell: &CellId| {
            let Aabb { min, max } = &self.boxes[cell.0 as usize];
            (min.cmple(point) & point.cmplt(*max)).all()
        };
        let near = |cell: CellId| {
            let space = cells.cells[cell.0 as usize].space;
            let Range { start, end } = cells.spaces[space as usize].cells;
            (start..end).take(CELLS_FEW).map(CellId).find(is_in)
        };
        let found = likely.and_then(|cell| if is_in(&cell) { Some(cell) } else { near(cell) });
        found.or_else(|| cells.at_own(point))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::tests::stage;

    proptest! {
        #[test]
        fn whatever_cell_is_likely_a_point_is_found_where_the_tree_has_it(
            point in (-1.0..31.0f32, -1.0..4.0f32, -1.0..11.0f32),
            boundary in prop::option::of(0..4u8),
            likely in prop::option::of(0..3u32),
        ) {
            let cells = stage::row(3).cells;
            let x = boundary.map_or(point.0, |wall| f32::from(wall) * 10.0);
            let point = Vec3::new(x, point.1, point.2);
            let found = BoxCells::new(&cells).at(&cells, point, likely.map(CellId));
            // Beyond the building the tree says nothing.
            prop_assume!(cells.bounds.contains(point) && x < 30.0);
            prop_assert_eq!(found, cells.at_own(point));
        }
    }
}
