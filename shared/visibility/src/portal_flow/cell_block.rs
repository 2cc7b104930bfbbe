//! Blocks of cells that are searched from together.

use std::ops::Range;

use sightline_world::{CellId, Cells, Node};

use super::daabb::DAabb;

/// The most cells in a block.
const BLOCK_CELLS_MAX: u32 = 8;

/// A few cells of one space that lie close together.
#[derive(Clone, Debug)]
pub struct CellBlock {
    /// The smallest box around the cells, widened.
    pub bounds: DAabb,
    /// Indices into [`Cells::cells`].
    pub cells: Range<u32>,
    /// Index into [`Cells::spaces`].
    pub space: u32,
}

/// All cells as blocks, each of which is a subtree. `targets` has the widened box of each cell.
pub(super) fn blocks(cells: &Cells, targets: &[DAabb]) -> Vec<CellBlock> {
    let mut blocks = Vec::new();
    if let Some(all) = block(cells, targets, 0, &mut blocks) {
        blocks.push(all);
    }
    blocks.sort_unstable_by_key(|block| block.cells.start);
    debug_assert!(blocks.windows(2).all(|pair| pair[0].cells.end <= pair[1].cells.start));
    blocks
}

/// The cells of a subtree as one block, if they are few and of one space. If not, adds blocks of
/// them to those found.
fn block(
    cells: &Cells,
    targets: &[DAabb],
    node: u32,
    found: &mut Vec<CellBlock>,
) -> Option<CellBlock> {
    let sides = match cells.tree[node as usize] {
        Node::Solid => return None,
        Node::Leaf(CellId(cell)) => {
            let space = cells.cells[cell as usize].space;
            let bounds = targets[cell as usize];
            return Some(CellBlock { bounds, cells: cell..cell + 1, space });
        }
        Node::Axial { sides, .. } | Node::Plane { sides, .. } => sides,
    };
    let [lesser, greater] = sides.map(|side| block(cells, targets, side, found));
    if let (Some(lesser), Some(greater)) = (&lesser, &greater) {
        let bounds = lesser.bounds.union(&greater.bounds);
        if lesser.space == greater.space
            && lesser.cells.end == greater.cells.start
            && greater.cells.end - lesser.cells.start <= BLOCK_CELLS_MAX
        {
            let cells = lesser.cells.start..greater.cells.end;
            return Some(CellBlock { bounds, cells, space: lesser.space });
        }
    }
    found.extend(lesser.into_iter().chain(greater));
    None
}
