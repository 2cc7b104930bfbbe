//! What the original model says: which points are empty, and which are in sight.

use glam::Vec3;
use rand::rngs::SmallRng;
use sightline_oracle::Oracle;
use sightline_world::tolerance::EYE_CLEARANCE_M;
use sightline_world::{Origin, OriginTree, World};

use super::{boxes::Boxes, brushes::Brushes, exact, hull, locate::Locator};

/// After this many points that are not empty, space is taken to be full.
const TRIES_MAX: usize = 100_000;

/// The original of a world.
pub(super) struct Original<'a> {
    world: &'a World,
    oracle: Oracle,
    brushes: Option<Brushes>,
    tree: Option<Tree<'a>>,
    boxes: Boxes,
}

/// The BSP tree of a map.
struct Tree<'a> {
    tree: &'a OriginTree,
    locator: Locator<'a>,
    /// For each leaf, whether it lies inside the hull of the map.
    inside: Vec<bool>,
}

/// A point of empty space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pub point: Vec3,
    /// The cluster of the map; none when the map has none there.
    pub cluster: Option<u32>,
}

impl<'a> Original<'a> {
    pub(super) fn new(world: &'a World) -> Self {
        let oracle = Oracle::new(&world.mesh);
        let mut boxes = Boxes::new([(0, world.bounds())]);
        let Some(origin) = &world.origin else {
            return Self { world, oracle, brushes: None, tree: None, boxes };
        };
        let brushes = Brushes::new(origin, &world.bounds());
        let tree = origin.tree.as_ref().map(|tree| Tree::new(origin, tree, &oracle, &brushes));
        if let Some(Tree { tree, inside, .. }) = &tree {
            boxes = Boxes::of_leafs(tree, (0..inside.len()).filter(|&leaf| inside[leaf]));
        }
        Self { world, oracle, brushes: Some(brushes), tree, boxes }
    }

    /// The space that [`Original::draw`] samples, in words.
    pub(super) fn sampled(&self) -> &'static str {
        match (&self.brushes, &self.tree) {
            (None, _) => "the model's bounds and the margin that the compiler adds, walls included",
            (_, None) => "the world's bounds where there is no brush",
            _ => "where the map's own leaf has a cluster, inside the hull, and no brush",
        }
    }

    /// A uniform random spot of empty space. None when there seems to be no empty space.
    pub(super) fn draw(&self, rng: &mut SmallRng) -> Option<Spot> {
        (0..TRIES_MAX).find_map(|_| {
            let (owner, point) = self.boxes.draw(rng)?;
            let leaf = self.tree.as_ref().map(|tree| tree.locator.leaf_at(point));
            if leaf.is_none_or(|leaf| leaf == owner) { self.spot_in(point, leaf) } else { None }
        })
    }

    /// The spot at a point, if the point is empty.
    pub(super) fn spot(&self, point: Vec3) -> Option<Spot> {
        self.spot_in(point, self.leaf_at(point))
    }

    fn spot_in(&self, point: Vec3, leaf: Option<u32>) -> Option<Spot> {
        // The box around a turned world has corners where no eye can be.
        if !self.world.confines().contains(point) {
            return None;
        }
        let cluster = match (&self.tree, leaf) {
            (Some(tree), Some(leaf)) if tree.inside[leaf as usize] => {
                tree.tree.leafs[leaf as usize].cluster
            }
            (Some(_), _) => return None,
            (None, _) => None,
        };
        let is_held =
            self.brushes.as_ref().is_some_and(|brushes| brushes.hold(point, EYE_CLEARANCE_M));
        (!is_held).then_some(Spot { point, cluster })
    }

    /// The leaf of the map's tree that contains a point. None when the map has no tree.
    pub(super) fn leaf_at(&self, point: Vec3) -> Option<u32> {
        self.tree.as_ref().map(|tree| tree.locator.leaf_at(point))
    }

    /// Whether a ray in single precision finds nothing between two points.
    pub(super) fn in_sight(&self, from: Vec3, to: Vec3) -> bool {
        self.oracle.between(from, to)
    }

    /// Whether the line between two points is free in double precision too ([`exact`]). Slow: only
    /// for misses.
    pub(super) fn confirms(&self, from: Vec3, to: Vec3) -> bool {
        let solids = self.world.origin.as_ref();
        exact::is_free(&self.world.mesh, solids, from.as_dvec3(), to.as_dvec3())
    }
}

impl<'a> Tree<'a> {
    fn new(origin: &'a Origin, tree: &'a OriginTree, oracle: &Oracle, brushes: &Brushes) -> Self {
        let locator = Locator::new(origin, tree);
        let inside = hull::inside(tree, &locator, oracle, brushes);
        Self { tree, locator, inside }
    }
}
