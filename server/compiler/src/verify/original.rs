//! What is empty and what is in sight, by the original alone.

use glam::Vec3;
use rand::{Rng, rngs::SmallRng};
use sightline_world::{
    Origin, OriginLeaf, OriginTree, World, geometry::Aabb, tolerance::EYE_CLEARANCE_M,
};

use super::{brushes::Brushes, exact, hull, locate::Locator};
use sightline_oracle::Oracle;

/// After so many points that are not empty, space is taken to be full.
const TRIES_MAX: usize = 100_000;

/// The original of a world, ready to be asked.
pub(super) struct Original<'a> {
    world: &'a World,
    sight: Oracle,
    brushes: Option<Brushes>,
    tree: Option<Tree<'a>>,
    boxes: Boxes,
}

/// A map's own tree.
struct Tree<'a> {
    tree: &'a OriginTree,
    locator: Locator<'a>,
    /// For each leaf, whether it is inside the hull.
    inside: Vec<bool>,
}

/// A point of empty space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pub point: Vec3,
    /// The cluster of the map's own that it is in; none without such.
    pub cluster: Option<u32>,
}

impl<'a> Original<'a> {
    pub fn new(world: &'a World) -> Self {
        let sight = Oracle::new(&world.mesh);
        let mut boxes = Boxes::new([(0, world.bounds())]);
        let Some(origin) = &world.origin else {
            return Self { world, sight, brushes: None, tree: None, boxes };
        };
        let brushes = Brushes::new(origin, &world.bounds());
        let tree = origin.tree.as_ref().map(|tree| Tree::new(origin, tree, &sight, &brushes));
        if let Some(Tree { tree, inside, .. }) = &tree {
            boxes = Boxes::of_leafs(tree, (0..inside.len()).filter(|&leaf| inside[leaf]));
        }
        Self { world, sight, brushes: Some(brushes), tree, boxes }
    }

    /// What [`Original::draw`] samples, in words.
    pub fn sampled(&self) -> &'static str {
        match (&self.brushes, &self.tree) {
            (None, _) => "the model's bounds and the margin that the compiler adds, walls included",
            (_, None) => "the world's bounds where there is no brush",
            _ => "where the map's own leaf has a cluster, inside the hull, and no brush",
        }
    }

    /// A spot of empty space, all equally likely; none when there seems to be no empty space.
    pub fn draw(&self, rng: &mut SmallRng) -> Option<Spot> {
        (0..TRIES_MAX).find_map(|_| {
            let (owner, point) = self.boxes.draw(rng)?;
            let leaf = self.tree.as_ref().map(|tree| tree.locator.leaf_at(point));
            if leaf.is_none_or(|leaf| leaf == owner) { self.spot_in(point, leaf) } else { None }
        })
    }

    /// The spot at a point, if nothing is there.
    pub fn spot(&self, point: Vec3) -> Option<Spot> {
        self.spot_in(point, self.leaf_at(point))
    }

    fn spot_in(&self, point: Vec3, leaf: Option<u32>) -> Option<Spot> {
        // Of a turned world, the box in which points are drawn has corners where no eye can be.
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

    /// The leaf of the map's own tree in which a point is.
    pub fn leaf_at(&self, point: Vec3) -> Option<u32> {
        self.tree.as_ref().map(|tree| tree.locator.leaf_at(point))
    }

    /// Whether rays find nothing between two points.
    pub fn in_sight(&self, from: Vec3, to: Vec3) -> bool {
        self.sight.between(from, to)
    }

    /// Whether that holds without rounding too ([`exact`]). Slow, so asked only about misses.
    pub fn confirms(&self, from: Vec3, to: Vec3) -> bool {
        let solids = self.world.origin.as_ref();
        exact::is_free(&self.world.mesh, solids, from.as_dvec3(), to.as_dvec3())
    }
}

impl<'a> Tree<'a> {
    fn new(origin: &'a Origin, tree: &'a OriginTree, sight: &Oracle, brushes: &Brushes) -> Self {
        let locator = Locator::new(origin, tree);
        let inside = hull::inside(tree, &locator, sight, brushes);
        Self { tree, locator, inside }
    }
}

/// Boxes to draw points from, each as likely as its volume.
pub(super) struct Boxes {
    /// What the box belongs to, and the box.
    boxes: Vec<(u32, Aabb)>,
    /// The volume of each box and all before it.
    volumes: Vec<f64>,
}

impl Boxes {
    pub fn new(boxes: impl IntoIterator<Item = (u32, Aabb)>) -> Self {
        let boxes: Vec<_> = boxes.into_iter().collect();
        let mut sum = 0.0;
        let volumes = boxes.iter().map(|(_, b)| {
            sum += b.size().as_dvec3().element_product();
            sum
        });
        Self { volumes: volumes.collect(), boxes }
    }

    /// The boxes of some of a map's leafs. In the map they are cut off to whole units.
    pub fn of_leafs(tree: &OriginTree, leafs: impl IntoIterator<Item = usize>) -> Self {
        let larger = |leaf: usize| tree.leafs[leaf].bounds.grown(0.0254);
        Self::new(leafs.into_iter().map(|leaf| (leaf as u32, larger(leaf))))
    }

    /// For each cluster of a map, the boxes of its leafs.
    pub fn of_clusters(tree: &OriginTree) -> Vec<Self> {
        let mut leafs_of = vec![Vec::new(); tree.clusters as usize];
        for (leaf, OriginLeaf { cluster, .. }) in tree.leafs.iter().enumerate() {
            if let Some(cluster) = *cluster {
                leafs_of[cluster as usize].push(leaf);
            }
        }
        leafs_of.into_iter().map(|leafs| Self::of_leafs(tree, leafs)).collect()
    }

    /// A point of some box, and what that belongs to. Where boxes overlap, keep the point only if
    /// it does belong there: then all points are equally likely.
    pub fn draw(&self, rng: &mut SmallRng) -> Option<(u32, Vec3)> {
        let at = rng.random::<f64>() * self.volumes.last()?;
        let index = self.volumes.partition_point(|&volume| volume <= at);
        let (owner, bounds) = self.boxes.get(index.min(self.boxes.len() - 1))?;
        Some((*owner, point_in(bounds, rng)))
    }
}

/// A point of a box, uniform.
pub(super) fn point_in(bounds: &Aabb, rng: &mut SmallRng) -> Vec3 {
    bounds.min + bounds.size() * Vec3::new(rng.random(), rng.random(), rng.random())
}
