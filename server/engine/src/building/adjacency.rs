//! What is beside each space: gates with the spaces beyond them, and spaces behind thin walls.

use sightline_world::{Cells, Polygon, geometry::Aabb, tolerance::POKE_M};

/// A gate of a space, as seen from there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exit {
    /// The box around the gate, in own axes.
    pub(crate) bounds: Aabb,
    pub(crate) gate: u32,
    /// The space on the other side.
    pub(crate) beyond: u32,
    pub(crate) side: ExitSide,
}

/// The side of a space's bounding box that an exit is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ExitSide {
    /// The side with the least coordinate along an axis.
    Low(u8),
    /// The side with the greatest coordinate along an axis.
    High(u8),
    /// A slanted gate may be part of any side.
    Slanted,
}

/// A space beside another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Beside {
    pub(crate) space: u32,
    /// The box around that space, in own axes.
    pub(crate) bounds: Aabb,
}

/// What is beside each space, in one list each, so that a search through many spaces reads memory
/// in order.
#[derive(Clone, Debug)]
pub(crate) struct Adjacency {
    exits: Lists<Exit>,
    near: Lists<Beside>,
}

impl Adjacency {
    pub(crate) fn new(cells: &Cells) -> Self {
        let (mut exits, mut near) = (Lists::default(), Lists::default());
        let mut found = Vec::new();
        for (id, space) in (0..).zip(&cells.spaces) {
            exits.push(space.gates.iter().map(|gate| exit(cells, id, *gate)));
            found.clear();
            cells.overlapping(&space.bounds.grown(POKE_M), &mut found);
            let mut spaces: Vec<u32> =
                found.iter().map(|cell| cells.cells[cell.0 as usize].space).collect();
            spaces.dedup();
            let beside = spaces.into_iter().filter(|space| *space != id);
            let bounds = |space: u32| cells.spaces[space as usize].bounds;
            near.push(beside.map(|space| Beside { space, bounds: bounds(space) }));
        }
        Self { exits, near }
    }

    /// The gates of a space.
    pub(crate) fn exits(&self, space: u32) -> &[Exit] {
        self.exits.get(space)
    }

    /// The other spaces that a body can stick into from a space: through gates, or through a wall
    /// that is thinner than [`POKE_M`].
    pub(crate) fn near(&self, space: u32) -> &[Beside] {
        self.near.get(space)
    }
}

fn exit(cells: &Cells, space: u32, index: u32) -> Exit {
    let gate = &cells.gates[index as usize];
    let bounds = gate.polygon.bounds();
    let side = match gate.polygon {
        Polygon::Rectangle { axis, .. } => {
            let along = usize::from(axis);
            let is_low = bounds.min[along] <= cells.spaces[space as usize].bounds.min[along];
            if is_low { ExitSide::Low(axis) } else { ExitSide::High(axis) }
        }
        Polygon::Other { .. } => ExitSide::Slanted,
    };
    let beyond = gate.spaces[usize::from(gate.spaces[0] == space)];
    Exit { bounds, gate: index, beyond, side }
}

/// Many lists in one block of memory.
#[derive(Clone, Debug)]
struct Lists<T> {
    items: Vec<T>,
    /// Where each list ends.
    ends: Vec<u32>,
}

impl<T> Default for Lists<T> {
    fn default() -> Self {
        Self { items: Vec::new(), ends: Vec::new() }
    }
}

impl<T> Lists<T> {
    fn push(&mut self, list: impl Iterator<Item = T>) {
        self.items.extend(list);
        self.ends.push(self.items.len() as u32);
    }

    fn get(&self, index: u32) -> &[T] {
        let end = self.ends[index as usize] as usize;
        let start = index.checked_sub(1).map_or(0, |before| self.ends[before as usize] as usize);
        &self.items[start..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::stage;

    #[test]
    fn a_space_has_its_gates_and_the_spaces_beside_it() {
        let cells = stage::row(3).cells;
        let adjacency = Adjacency::new(&cells);
        let exits = |space: u32| adjacency.exits(space).iter().map(|exit| (exit.beyond, exit.side));
        assert_eq!(exits(0).collect::<Vec<_>>(), [(1, ExitSide::High(0))]);
        let middle = [(0, ExitSide::Low(0)), (2, ExitSide::High(0))];
        assert_eq!(exits(1).collect::<Vec<_>>(), middle);
        let near = |space: u32| adjacency.near(space).iter().map(|beside| beside.space);
        assert_eq!(near(1).collect::<Vec<_>>(), [0, 2]);
        assert_eq!(adjacency.near(0), [Beside { space: 1, bounds: cells.spaces[1].bounds }]);
    }
}
