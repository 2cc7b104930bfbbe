//! Portal flood: the spaces that lines between two boxes can enter, through gates they can meet.
//!
//! Consider all lines from a point `a` of one box to a point `b` of another. At share `t` of its
//! length (0 at `a`, 1 at `b`), each of them lies in the box whose corners are interpolated between
//! those of the two boxes: the [`SweptBox`]. So these lines pass only through gates that the swept
//! box meets. They pass them in the order of growing `t`, and only in directions that some line
//! takes.
//!
//! A gate that a line passes at the point `g` narrows both boxes. With `s = 1 / t`,
//! `b = g s - a (s - 1)`, and along each axis this is extreme where `s` is. The same holds for `a`
//! with the ends exchanged.
//!
//! The boxes are hidden from each other if no sequence of gates leads from a space of the first box
//! to a space of the second. It does not matter what blocks the lines. That covers walls that only
//! touch each other, and hollow walls that are open elsewhere.

mod exit;
mod scratch;
mod simd_box;
mod space_tree;
mod swept_box;
#[cfg(test)]
mod tests;

use glam::Vec3A;
use sightline_world::{Cells, Polygon, geometry::Aabb};

pub(super) use scratch::FloodScratch;

use super::sight_line::{BoxInSpaces, SightLine};
use exit::{AXIAL_DIRECTIONS, Exit, ExitDirection};
use scratch::FloodStep;
use simd_box::SimdBox;
use space_tree::SpaceTree;
use swept_box::SweptBox;

/// A flood that looks at more gates than this gives up and says that the boxes are joined.
const GATES_MAX: u32 = 200;
/// A line that passes through more spaces than this is not followed further.
const SPACES_MAX: u32 = 64;

/// The spaces of a building and the gates between them. It takes 32 bytes for each side of a gate.
#[derive(Clone, Debug, Default)]
pub(super) struct PortalFlood {
    tree: SpaceTree,
    /// For each space the index of its first exit, and at the end the number of exits.
    starts: Vec<u32>,
    exits: Vec<Exit>,
    /// The directions of exits that are not axial.
    normals: Vec<Vec3A>,
}

impl PortalFlood {
    pub fn new(cells: &Cells) -> Self {
        let mut flood = Self { tree: SpaceTree::new(cells), ..Self::default() };
        for (index, space) in (0..).zip(&cells.spaces) {
            flood.starts.push(flood.exits.len() as u32);
            for &gate in &space.gates {
                let gate = &cells.gates[gate as usize];
                debug_assert!(gate.spaces.contains(&index), "a space lists its own gates");
                let is_lesser = gate.spaces[0] == index;
                let direction = match gate.polygon {
                    Polygon::Rectangle { axis, .. } => 2 * u32::from(axis) + u32::from(is_lesser),
                    Polygon::Other { normal, .. } => {
                        let normal = normal.as_vec3a();
                        flood.normals.push(if is_lesser { normal } else { -normal });
                        AXIAL_DIRECTIONS + flood.normals.len() as u32 - 1
                    }
                };
                let beyond = gate.spaces[usize::from(is_lesser)];
                flood.exits.push(Exit::new(&gate.polygon.bounds(), beyond, direction));
            }
        }
        flood.starts.push(flood.exits.len() as u32);
        assert_eq!(flood.starts.len(), cells.spaces.len() + 1, "one start for each space");
        flood
    }

    /// Whether gates let no line pass from one box to another. Boxes are in own axes. `visited`
    /// grows by the number of tree nodes and gates visited.
    pub fn are_closed(
        &self,
        scratch: &mut FloodScratch,
        from: &Aabb,
        to: &Aabb,
        visited: &mut u32,
    ) -> bool {
        if self.tree.is_empty() {
            return false;
        }
        let [mut starts, mut goals] = std::mem::take(&mut scratch.ends);
        self.tree.overlapping(from, &mut scratch.nodes, &mut starts, visited);
        self.tree.overlapping(to, &mut scratch.nodes, &mut goals, visited);
        let from = BoxInSpaces { bounds: from, spaces: &starts };
        let to = BoxInSpaces { bounds: to, spaces: &goals };
        let is_closed = self.are_apart(scratch, from, to, visited);
        scratch.ends = [starts, goals];
        is_closed
    }

    /// Whether gates let no line pass from one box to another, for lines that begin and end in the
    /// given spaces.
    pub fn are_apart(
        &self,
        scratch: &mut FloodScratch,
        from: BoxInSpaces<'_>,
        to: BoxInSpaces<'_>,
        visited: &mut u32,
    ) -> bool {
        if self.tree.is_empty() || from.spaces.is_empty() {
            // Eyes are never inside a wall. Where they seem to be, nothing is known.
            return false;
        }
        scratch.begin(self.starts.len());
        scratch.set_goals(to.spaces);
        let starts = from.spaces;
        let (from, to) = (SimdBox::new(from.bounds), SimdBox::new(to.bounds));
        for &space in starts {
            if scratch.is_goal(space) {
                return false;
            }
            scratch.enter(FloodStep { space, entry_t: 0.0, from, to, next: None });
        }
        let visited_max = *visited + GATES_MAX;
        while let Some(FloodStep { space, entry_t, from, to, .. }) = scratch.pop() {
            if *visited > visited_max {
                return false;
            }
            let swept = SweptBox::new(&from, &to);
            let exits = self.exits_of(space);
            *visited += exits.len() as u32;
            for exit in exits {
                let gate = exit.gate();
                if swept.takes(exit.direction(), &self.normals)
                    && let Some(ts) = swept.meets(&gate, entry_t)
                    && let Some([from, to]) = swept.narrowed(&gate, ts)
                {
                    let (space, entry_t) = (exit.beyond(), ts[0]);
                    if scratch.is_goal(space) {
                        return false;
                    }
                    scratch.enter(FloodStep { space, entry_t, from, to, next: None });
                }
            }
        }
        true
    }

    /// Whether gates let a line pass from the space it begins in to the space it ends in. Gates
    /// count as the boxes around them.
    pub fn lets_pass(&self, line: &SightLine, [start, goal]: [u32; 2]) -> bool {
        let (from, along) = (Vec3A::from(line.from), Vec3A::from(line.to - line.from));
        let inverse = along.recip();
        let (mut space, mut entry_t) = (start, 0.0);
        for _ in 0..SPACES_MAX {
            if space == goal {
                return true;
            }
            let next = self.exits_of(space).iter().find_map(|exit| {
                if !self.is_along(along, exit.direction()) {
                    return None;
                }
                // Along an axis in which the line does not move, both quotients are infinite: the
                // line is between the gate's faces or it never is.
                let gate = exit.gate();
                let (a, b) = ((gate.low - from) * inverse, (gate.high - from) * inverse);
                let first = a.min(b).max_element().max(entry_t);
                let last = a.max(b).min_element().min(1.0);
                (first <= last).then(|| (exit.beyond(), first))
            });
            let Some(next) = next else { return false };
            (space, entry_t) = next;
        }
        false
    }

    /// Whether a line with this direction goes out by exits with that one.
    fn is_along(&self, along: Vec3A, direction: ExitDirection) -> bool {
        match direction {
            0..AXIAL_DIRECTIONS => (along[direction as usize / 2] > 0.0) == (direction % 2 == 1),
            _ => self.normals[(direction - AXIAL_DIRECTIONS) as usize].dot(along) > 0.0,
        }
    }

    fn exits_of(&self, space: u32) -> &[Exit] {
        let (first, end) = (self.starts[space as usize], self.starts[space as usize + 1]);
        &self.exits[first as usize..end as usize]
    }

    /// Heap memory in use, in bytes.
    pub fn bytes(&self) -> usize {
        self.tree.bytes()
            + self.starts.len() * size_of::<u32>()
            + self.exits.len() * size_of::<Exit>()
            + self.normals.len() * size_of::<Vec3A>()
    }
}
