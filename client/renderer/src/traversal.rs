//! The front-to-back traversal of the octree: in perspective, and then by form patterns.
//!
//! The steps are those of Dell 2012, Figs. 26 to 28. A node is clipped to the picture, tested
//! against the mask buffer and halved. Its octants follow in the order of the eye's sector, nearest
//! first. Where orthogonal mode begins, [`orthogonal`](super::orthogonal) goes on.

use glam::{Vec3, Vec3A, Vec4};
use sightline_visibility::{Containment, rooms::BuildingSight};
use sightline_world::{geometry::Aabb, octree::Octree};

use super::{
    band::Band,
    form::OrthoNode,
    hull::Hull,
    margins::{NEAR, SPARE_PX},
    mask::Area,
    view::BandView,
};

/// How nodes are projected. All modes show the same picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Mode {
    /// Each node for itself, at all levels.
    Perspective,
    /// By form patterns below all nodes in which perspective is too small to see (Dell 2012), and
    /// all layers as layers.
    Forms,
    /// The cheaper way at each node: by form patterns, as a layer, or each octant for itself.
    #[default]
    Orthogonal,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::Perspective, Self::Forms, Self::Orthogonal];
}

/// What drawing a picture took, in counts that do not depend on the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counters {
    /// Nodes projected from space to the picture.
    pub projections: u64,
    /// Nodes visited.
    pub nodes: u64,
    /// Nodes tested against the mask buffer.
    pub mask_tests: u64,
    /// Pixels written.
    pub pixels: u64,
}

impl Counters {
    pub(super) fn add(&mut self, other: &Self) {
        self.projections += other.projections;
        self.nodes += other.nodes;
        self.mask_tests += other.mask_tests;
        self.pixels += other.pixels;
    }
}

/// No more nodes wait on a stack: seven on each level, and one.
const WAITING_MAX: usize = 128;

/// The stacks of a traversal, kept from one picture to the next: nodes that wait to be drawn.
pub(super) struct TraversalStacks {
    perspective: Vec<PerspectiveNode>,
    pub(super) orthogonal: Vec<OrthoNode>,
}

impl Default for TraversalStacks {
    fn default() -> Self {
        Self {
            perspective: Vec::with_capacity(WAITING_MAX),
            orthogonal: Vec::with_capacity(WAITING_MAX),
        }
    }
}

/// A node in perspective mode.
#[derive(Clone, Copy)]
pub(super) struct PerspectiveNode {
    /// The index among the inner nodes, or among the leaves at the octree's depth.
    pub(super) index: u32,
    pub(super) level: u8,
    /// The level at which nodes are drawn as a whole; [`UNDECIDED`] while perspective inside of the
    /// node can be seen.
    last: u8,
    /// Whether nothing is in front of the node.
    pub(super) unoccluded: bool,
    /// Whether rooms may hide some of it.
    restricted: bool,
    /// The centre relative to the eye, in metres.
    pub(super) centre: Vec3A,
    /// The centre, projected as in [`BandView`].
    pub(super) projected: Vec4,
}

const UNDECIDED: u8 = u8::MAX;

/// What is known in advance of the octree's inner nodes, as seen from the eye: a bit for each.
#[derive(Clone, Copy)]
pub(super) struct NodeClasses<'a> {
    /// Nodes that cannot be seen. They are left out.
    pub(super) hidden: &'a [u64],
    /// Nodes with nothing in front. They are not tested against the mask buffer. An error takes
    /// time and changes no picture.
    pub(super) unoccluded: &'a [u64],
    /// Hidden nodes are known down to this level, unoccluded ones on this level only.
    pub(super) level: u8,
}

impl NodeClasses<'_> {
    /// Nothing is known of any node.
    pub(super) const UNKNOWN: Self = Self { hidden: &[0], unoccluded: &[0], level: 0 };

    #[inline(always)]
    fn is_in(nodes: &[u64], index: u32) -> bool {
        debug_assert!((index as usize) < 64 * nodes.len(), "{index} of {} words", nodes.len());
        nodes[index as usize / 64] >> (index % 64) & 1 == 1
    }

    /// Whether a node is known to be hidden.
    #[inline(always)]
    pub(super) fn is_hidden(&self, index: u32, level: u8) -> bool {
        level <= self.level && Self::is_in(self.hidden, index)
    }

    /// Whether a node is known to have nothing in front.
    #[inline(always)]
    pub(super) fn is_unoccluded(&self, index: u32, level: u8) -> bool {
        level == self.level && Self::is_in(self.unoccluded, index)
    }
}

/// The traversal of the octree for one band.
pub(super) struct Traversal<'a> {
    pub(super) octree: &'a Octree,
    pub(super) view: &'a BandView,
    pub(super) classes: NodeClasses<'a>,
    /// What rooms show, if they do not show everything.
    pub(super) sight: Option<&'a BuildingSight>,
    /// The first material that is glass.
    pub(super) glass_from: usize,
    pub(super) band: &'a mut Band,
    pub(super) stacks: &'a mut TraversalStacks,
    pub(super) counters: &'a mut Counters,
}

impl Traversal<'_> {
    /// Draws everything in view, until every pixel is written.
    #[inline(always)]
    pub(super) fn run(&mut self) {
        if self.octree.inner.is_empty() {
            return;
        }
        self.stacks.perspective.clear();
        self.stacks.perspective.push(PerspectiveNode {
            index: 0,
            level: 0,
            last: UNDECIDED,
            unoccluded: false,
            restricted: self.sight.is_some(),
            centre: self.view.centre,
            projected: self.view.projected,
        });
        while let Some(cube) = self.stacks.perspective.pop() {
            self.consider(cube);
            debug_assert!(self.stacks.perspective.len() <= WAITING_MAX);
            if self.band.mask.is_full() {
                return;
            }
        }
    }

    /// Draws a node, or puts its octants on the stack, unless it is out of view or covered.
    #[inline(always)]
    fn consider(&mut self, mut cube: PerspectiveNode) {
        if self.classes.is_hidden(cube.index, cube.level) {
            return;
        }
        cube.unoccluded |= self.classes.is_unoccluded(cube.index, cube.level);
        self.counters.nodes += 1;
        let Some(area) = self.open_area(&cube) else { return };
        if cube.restricted {
            match self.shown(&cube) {
                Containment::Outside => return,
                Containment::Inside => cube.restricted = false,
                Containment::Partial => {}
            }
        }
        let depth = cube.projected.z;
        if cube.last == UNDECIDED && self.has_ratio(depth, cube.level, self.view.ratio_min) {
            cube.last = self.last_level(depth, cube.level);
        }
        if cube.level >= cube.last.min(self.octree.depth) {
            let material_id = self.material_id(cube.index, cube.level);
            self.fill(cube.centre.extend(depth), cube.level, material_id, &area);
        } else if cube.restricted {
            self.descend(&cube);
        } else if depth >= self.view.ways.forms_from
            && self.has_ratio(depth, cube.level, self.view.coarse_ratio_min)
        {
            self.draw_orthogonal(&cube);
        } else if !self.draw_near_layer(cube.index, cube.level, cube.centre.extend(depth), &area) {
            self.descend(&cube);
        }
    }

    /// How much of a node rooms show. Of a layer of voxels, only the layer's own box counts. This
    /// stays out of the traversal's loop, which mostly does without.
    #[inline(never)]
    fn shown(&self, cube: &PerspectiveNode) -> Containment {
        let Some(sight) = self.sight else { return Containment::Inside };
        let half = self.view.patterns[usize::from(cube.level)].half;
        let centre = sight.eye() + Vec3::from(cube.centre);
        let mut region = Aabb::around(centre, half);
        if cube.level == self.octree.depth {
            let is_shown = sight.shows(&region);
            return if is_shown { Containment::Inside } else { Containment::Outside };
        }
        if let Some((axis, place)) = self.octree.inner[cube.index as usize].flat() {
            let voxel = self.octree.voxel();
            region.min[axis] += f32::from(place) * voxel;
            region.max[axis] = region.min[axis] + voxel;
        }
        sight.containment(&region)
    }

    /// How far the corners of a level's nodes reach from the centre, projected.
    #[inline(always)]
    fn reach(&self, level: u8) -> Vec4 {
        self.view.patterns[usize::from(level)].reach
    }

    /// The pixels that a node's bounding box meets; none when it is out of view or covered.
    #[inline(always)]
    fn open_area(&mut self, cube: &PerspectiveNode) -> Option<Area> {
        let area = self.area(cube)?;
        self.is_open(&area, cube.unoccluded).then_some(area)
    }

    /// Whether a node may be seen in an area: nothing is in front of it, or the area is not
    /// covered.
    #[inline(always)]
    pub(super) fn is_open(&mut self, area: &Area, unoccluded: bool) -> bool {
        if unoccluded {
            return true;
        }
        self.counters.mask_tests += 1;
        self.band.mask.is_open(area)
    }

    /// Whether the ratio of nearest to farthest distance of a node is at least `ratio_min`, for a
    /// node of this level with its centre at this depth.
    #[inline(always)]
    pub(super) fn has_ratio(&self, depth: f32, level: u8, ratio_min: f32) -> bool {
        let reach = self.reach(level).z;
        let (nearest, farthest) = (depth - reach, depth + reach);
        nearest >= NEAR && nearest >= farthest * ratio_min
    }

    /// The pixels that a node's bounding box meets; none when it is out of view.
    #[inline(always)]
    fn area(&mut self, cube: &PerspectiveNode) -> Option<Area> {
        let pattern = &self.view.patterns[usize::from(cube.level)];
        let (z, reach) = (cube.projected.z, pattern.reach.z);
        if z + reach < NEAR {
            return None;
        }
        if z - reach >= NEAR {
            self.counters.projections += 1;
            let [left, right, top, bottom] = pattern.bounds(cube.projected);
            // A cast saturates where a number does not fit.
            let span = |low: f32, high: f32| {
                [
                    (low - SPARE_PX).ceil() as i32,
                    ((high + SPARE_PX).floor() as i32).saturating_add(1),
                ]
            };
            return self.band.clip([span(left, right), span(top, bottom)]);
        }
        let all = [[0, self.band.width as i32], [0, self.band.height as i32]];
        if self.is_beside(cube) { None } else { self.band.clip(all) }
    }

    /// Whether a node surely lies beside all lines of sight.
    #[inline(always)]
    fn is_beside(&self, cube: &PerspectiveNode) -> bool {
        let reach = self.reach(cube.level);
        let [x, y, z, _] = cube.projected.to_array();
        let far = z + reach.z;
        x + reach.x < 0.0
            || y + reach.y < 0.0
            || x - reach.x > (self.band.width - 1) as f32 * far
            || y - reach.y > (self.band.height - 1) as f32 * far
    }

    /// The first level, from a node's own on, at which nodes at this depth are no larger than a
    /// pixel; the octree's depth if there is none.
    #[inline(always)]
    pub(super) fn last_level(&self, depth: f32, level: u8) -> u8 {
        let is_small = |&level: &u8| depth > self.view.patterns[usize::from(level)].small_from;
        (level..self.octree.depth).find(is_small).unwrap_or(self.octree.depth)
    }

    /// Puts the octants on the stack so that the one towards the eye comes off first. Of two
    /// octants that differ along one axis only, the nearer one always comes first.
    #[inline(always)]
    fn descend(&mut self, cube: &PerspectiveNode) {
        let pattern = &self.view.patterns[usize::from(cube.level)];
        let node = &self.octree.inner[cube.index as usize];
        let nearest = cube.centre.cmplt(Vec3A::ZERO).bitmask() as u8;
        for octant in (0..8).rev().map(|order| order ^ nearest) {
            let Some(index) = node.child(octant) else { continue };
            let octant = usize::from(octant);
            self.stacks.perspective.push(PerspectiveNode {
                index,
                level: cube.level + 1,
                last: cube.last,
                unoccluded: cube.unoccluded,
                restricted: cube.restricted,
                centre: cube.centre + pattern.octants[octant],
                projected: cube.projected + pattern.octants_projected[octant],
            });
        }
    }

    /// Writes the pixels whose lines of sight meet a node. `centre` is relative to the eye, with
    /// the depth as its last number.
    #[inline(always)]
    pub(super) fn fill(&mut self, centre: Vec4, level: u8, material_id: u16, area: &Area) {
        let half = self.view.patterns[usize::from(level)].half;
        let (centre, depth) = (Vec3A::from_vec4(centre), centre.w);
        if centre.abs().max_element() <= half {
            // The eye is inside of the node, and looks out of it rather than see nothing.
            return;
        }
        let grown = half + self.view.seam(depth);
        let hull = Hull::new(self.view, centre - grown, centre + grown);
        let is_glass = usize::from(material_id) >= self.glass_from;
        self.band.fill(area, &hull, material_id, depth.max(NEAR), is_glass);
    }

    /// The material of a node, by its index and its level.
    #[inline(always)]
    pub(super) fn material_id(&self, index: u32, level: u8) -> u16 {
        if level == self.octree.depth {
            self.octree.leaves[index as usize]
        } else {
            self.octree.inner[index as usize].material
        }
    }
}
