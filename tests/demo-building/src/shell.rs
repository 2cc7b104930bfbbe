//! Walls and slabs: all parts made of boxes, without inner faces and without cracks.

use super::{
    layout::srgb,
    mesh::{Face, Paint, Scene},
    plan::{CEILING, Plan, SLAB, SpaceKind, WallSide},
    rect::{LatticeRect, Patches, merge},
};

const OUTSIDE_WALL: Paint = Paint::opaque([214, 205, 190]);
const TRIM: Paint = Paint::opaque([245, 243, 236]);
const CEILING_PAINT: Paint = Paint::opaque([238, 238, 234]);
const ROOF: Paint = Paint::opaque([120, 124, 128]);
const LAWN: Paint = Paint::opaque([112, 150, 84]);
const SLAB_EDGE: Paint = Paint::opaque([196, 188, 176]);
/// How far the ground reaches beyond the building.
const GROUND_MARGIN: i32 = 384;
/// The edge of a tile of the hall's floor.
const TILE: i32 = 96;

/// What fills a patch of the plan of a storey.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Patch {
    Outside,
    Wall,
    Space(usize),
    Opening(usize),
}

/// Adds walls and slabs to the scene.
pub(super) fn build(plan: &Plan, scene: &mut Scene) {
    for storey in 0..plan.storeys {
        Walls::new(plan, storey).build(scene);
    }
    for level in 0..=plan.storeys {
        Slab::new(plan, level).build(scene);
    }
}

struct Walls<'a> {
    plan: &'a Plan,
    storey: usize,
    patches: Patches<Patch>,
    /// The heights above the floor at which an opening begins or ends.
    heights: Vec<i32>,
}

impl<'a> Walls<'a> {
    fn new(plan: &'a Plan, storey: usize) -> Self {
        let openings = &plan.openings[storey];
        let spaces = plan.spaces.iter().enumerate().filter(|(_, space)| space.storey == storey);
        let layers: Vec<(LatticeRect, Patch)> =
            (plan.outlines.iter().map(|&rect| (rect, Patch::Wall)))
                .chain(spaces.map(|(index, space)| (space.rect, Patch::Space(index))))
                .chain(plan.blocks[storey].iter().map(|&rect| (rect, Patch::Wall)))
                .chain(openings.iter().enumerate().map(|(i, o)| (o.rect, Patch::Opening(i))))
                .collect();
        let mut heights: Vec<i32> =
            openings.iter().flat_map(|o| [o.sill, o.head]).chain([0, CEILING]).collect();
        heights.sort_unstable();
        heights.dedup();
        Self { plan, storey, patches: Patches::paint(&layers, Patch::Outside), heights }
    }

    fn build(&self, scene: &mut Scene) {
        for axis in 0..2 {
            for cut in 0..self.patches.count(axis).saturating_sub(1) {
                self.faces_at_cut(axis, cut, scene);
            }
        }
        let floor = self.plan.floor(self.storey);
        for opening in &self.plan.openings[self.storey] {
            let LatticeRect { min, max } = opening.rect;
            let (min, max) = ([min[1], min[0]], [max[1], max[0]]);
            for (at, positive) in [(opening.sill, true), (opening.head, false)] {
                if at > 0 && at < CEILING {
                    let face = Face { axis: 1, at: floor + at, min, max, positive };
                    scene.face(scene.shell(), TRIM, face);
                }
            }
        }
    }

    /// Adds the faces of walls in one plane across an axis, between the patches before and behind
    /// the cut.
    fn faces_at_cut(&self, axis: usize, cut: usize, scene: &mut Scene) {
        let across = 1 - axis;
        let pair = |along: usize| {
            let at = |i: usize| {
                if axis == 0 { self.patches.at(i, along) } else { self.patches.at(along, i) }
            };
            (at(cut), at(cut + 1))
        };
        let label = |along: usize, band: usize| {
            let (before, behind) = pair(along);
            match (self.is_solid(before, band), self.is_solid(behind, band)) {
                (true, false) => Some((behind, true)),
                (false, true) => Some((before, false)),
                _ => None,
            }
        };
        let floor = self.plan.floor(self.storey);
        let cuts = &self.patches.cuts[across];
        let bands = self.heights.len() - 1;
        for ([from, low], [to, high], (open, positive)) in
            merge(self.patches.count(across), bands, label)
        {
            let along = [cuts[from], cuts[to]];
            let up = [floor + self.heights[low], floor + self.heights[high]];
            // The other two axes in cyclic order: after x comes y, after z comes x.
            let (min, max) = if axis == 0 {
                ([up[0], along[0]], [up[1], along[1]])
            } else {
                ([along[0], up[0]], [along[1], up[1]])
            };
            let at = self.patches.cuts[axis][cut + 1];
            let (node, paint) = self.paint(open, axis, positive, scene.shell());
            scene.face(node, paint, Face { axis: axis * 2, at, min, max, positive });
        }
    }

    fn is_solid(&self, patch: Patch, band: usize) -> bool {
        match patch {
            Patch::Wall => true,
            Patch::Outside | Patch::Space(_) => false,
            Patch::Opening(index) => {
                let opening = &self.plan.openings[self.storey][index];
                !(opening.sill..opening.head).contains(&self.heights[band])
            }
        }
    }

    /// The node and the paint of a face of a wall, by what is in front of it.
    fn paint(&self, open: Patch, axis: usize, positive: bool, shell: usize) -> (usize, Paint) {
        match open {
            Patch::Space(index) => {
                let space = &self.plan.spaces[index];
                let stands_out = space.accent == WallSide { axis, positive };
                (index, Paint::opaque(space.colours[usize::from(stands_out)]))
            }
            Patch::Opening(_) => (shell, TRIM),
            Patch::Outside | Patch::Wall => (shell, OUTSIDE_WALL),
        }
    }
}

/// A floor and the ceiling below it.
struct Slab {
    level: usize,
    top: i32,
    patches: Patches<Option<Paint>>,
    ceiling: Paint,
}

impl Slab {
    fn new(plan: &Plan, level: usize) -> Self {
        let mut layers: Vec<(LatticeRect, Option<Paint>)> = Vec::new();
        if level == 0 {
            layers.push((ground(plan), Some(LAWN)));
        }
        let floor = if level == plan.storeys { ROOF } else { floor_paint(level, 0.35) };
        layers.extend(plan.outlines.iter().map(|&rect| (rect, Some(floor))));
        for space in plan.spaces.iter().filter(|space| space.storey == level) {
            if matches!(space.kind, SpaceKind::Corridor | SpaceKind::Gallery) {
                layers.push((space.rect, Some(floor_paint(level, 0.18))));
            }
        }
        match plan.void {
            Some(void) if level == 0 => layers.extend(tiles(&void)),
            Some(void) => layers.push((void, None)),
            None => {}
        }
        let arriving = plan.stairs.iter().filter(|stair| stair.storey + 1 == level);
        layers.extend(arriving.map(|stair| (stair.flight, None)));
        let ceiling = if level == 0 { SLAB_EDGE } else { CEILING_PAINT };
        let patches = Patches::paint(&layers, None);
        Self { level, top: plan.floor(level), patches, ceiling }
    }

    fn build(&self, scene: &mut Scene) {
        let shell = scene.shell();
        let (columns, rows) = (self.patches.count(0), self.patches.count(1));
        let [xs, zs] = &self.patches.cuts;
        let bounds =
            |from: [usize; 2], to: [usize; 2]| ([zs[from[1]], xs[from[0]]], [zs[to[1]], xs[to[0]]]);
        for (from, to, paint) in merge(columns, rows, |x, z| self.patches.at(x, z)) {
            let (min, max) = bounds(from, to);
            scene.face(shell, paint, Face { axis: 1, at: self.top, min, max, positive: true });
        }
        let covered = |x: usize, z: usize| self.patches.at(x, z).map(|_| ());
        for (from, to, ()) in merge(columns, rows, covered) {
            let (min, max) = bounds(from, to);
            let at = self.top - SLAB;
            scene.face(shell, self.ceiling, Face { axis: 1, at, min, max, positive: false });
        }
        self.edges(scene);
    }

    fn edges(&self, scene: &mut Scene) {
        let up = [self.top - SLAB, self.top];
        for axis in 0..2 {
            let cuts = &self.patches.cuts[1 - axis];
            for cut in 0..self.patches.count(axis).saturating_sub(1) {
                let covered = |i: usize, along: usize| {
                    let (x, z) = if axis == 0 { (i, along) } else { (along, i) };
                    self.patches.at(x, z).is_some()
                };
                let label = |along: usize, _: usize| {
                    let (before, behind) = (covered(cut, along), covered(cut + 1, along));
                    (before != behind).then_some(before)
                };
                for ([from, _], [to, _], positive) in merge(self.patches.count(1 - axis), 1, label)
                {
                    let along = [cuts[from], cuts[to]];
                    let (min, max) = if axis == 0 {
                        ([up[0], along[0]], [up[1], along[1]])
                    } else {
                        ([along[0], up[0]], [along[1], up[1]])
                    };
                    let at = self.patches.cuts[axis][cut + 1];
                    let paint = if self.level == 0 { LAWN } else { SLAB_EDGE };
                    let face = Face { axis: axis * 2, at, min, max, positive };
                    scene.face(scene.shell(), paint, face);
                }
            }
        }
    }
}

/// The paint of the floor of a storey.
fn floor_paint(storey: usize, saturation: f32) -> Paint {
    Paint::opaque(srgb(0.06 + 0.27 * storey as f32, saturation, 0.72))
}

/// The ground that the building stands on.
fn ground(plan: &Plan) -> LatticeRect {
    let around = plan.outlines.iter().fold(None, |all: Option<LatticeRect>, rect| {
        let Some(all) = all else { return Some(*rect) };
        let min = [0, 1].map(|axis| all.min[axis].min(rect.min[axis]));
        let max = [0, 1].map(|axis| all.max[axis].max(rect.max[axis]));
        Some(LatticeRect::new(min, max))
    });
    around.unwrap_or(LatticeRect::new([0, 0], [0, 0])).grown(GROUND_MARGIN)
}

/// The chequered floor of the hall.
fn tiles(void: &LatticeRect) -> impl Iterator<Item = (LatticeRect, Option<Paint>)> + use<> {
    let void = *void;
    let count = [0, 1].map(|axis| (void.size(axis) + TILE - 1) / TILE);
    (0..count[0] * count[1]).map(move |i| {
        let (column, row) = (i % count[0], i / count[0]);
        let min = [void.min[0] + column * TILE, void.min[1] + row * TILE];
        let max = [0, 1].map(|axis| (min[axis] + TILE).min(void.max[axis]));
        let colour = if (column + row) % 2 == 0 { [232, 228, 214] } else { [70, 78, 92] };
        (LatticeRect::new(min, max), Some(Paint::opaque(colour)))
    })
}
