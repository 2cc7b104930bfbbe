use std::collections::BTreeMap;

use glam::{UVec3, Vec3};
use proptest::prelude::*;

use super::{
    super::{Cursor, Material, Octree, Voxel, morton},
    OctreePieces, PartialOctree,
};
use crate::geometry::Aabb;

/// Walls, floors and glass in a cube of 2^`depth` voxels, and some voxels at random places.
fn octree(depth: u8, scattered: &[[u16; 3]]) -> Octree {
    let side = 1u32 << depth;
    let mut voxels = BTreeMap::new();
    let mut put = |at: UVec3, colour: [u8; 3], flags: u8| {
        voxels.insert(morton(at), (colour, flags));
    };
    for i in 0..side.min(96) {
        for j in 0..side.min(96) {
            put(UVec3::new(i, 5 % side, j), [(i / 9) as u8, 60, 200], 0);
            put(UVec3::new(side / 3, i, j), [9, (j / 5) as u8, 30], 0);
            let glass = if i % 16 == 0 { 0 } else { Material::GLASS };
            put(UVec3::new(i, j, side / 2), [40, 80, 120], glass);
        }
    }
    for (i, place) in scattered.iter().enumerate() {
        put(UVec3::from(place.map(|c| u32::from(c) % side)), [i as u8, 1, 2], 0);
    }
    let voxel = |(key, (colour, flags))| Voxel { key, colour, normal: [0, 127, 0], flags };
    let voxels = voxels.into_iter().map(voxel).collect();
    Octree::from_voxels(Vec3::new(-4.0, 0.0, 2.5), 0.125, depth, voxels).expect("small")
}

/// Whether two trees have the same nodes.
fn is_same(a: Cursor<'_>, b: Cursor<'_>) -> bool {
    let known = |node: Cursor<'_>| node.inner().map(|inner| (inner.mask, inner.flags));
    known(a) == known(b)
        && a.material_index() == b.material_index()
        && a.children().zip(b.children()).all(|((_, a), (_, b))| is_same(a, b))
}

/// Whether every node of a tree is in another one, and what is in the other alone is a stand-in.
fn stands_for(whole: Option<Cursor<'_>>, partial: Option<Cursor<'_>>, above: u16) -> bool {
    match (whole, partial) {
        (None, None) => true,
        (Some(_), None) => false,
        (None, Some(partial)) => partial.material_index() == above,
        (Some(whole), Some(partial)) => (0..8).all(|octant| {
            stands_for(whole.child(octant), partial.child(octant), partial.material_index())
        }),
    }
}

fn grow_all(pieces: &OctreePieces, order: impl Iterator<Item = usize>) -> PartialOctree {
    let mut partial = PartialOctree::new(&pieces.trunk).expect("just written");
    for branch in order {
        let grade = usize::from(partial.grades_of(branch));
        if let Some(piece) = pieces.branches[branch].get(grade) {
            partial.grow(branch, piece).expect("just written");
        }
    }
    partial
}

#[test]
fn all_pieces_make_the_whole_tree_again_in_any_order() {
    for depth in [1, 2, 3, 5, 7] {
        let whole = octree(depth, &[[300, 7, 90], [1, 1, 1], [250, 250, 250]]);
        let pieces = whole.to_pieces();
        let count = pieces.branches.len();
        let backwards = (0..3).flat_map(|_| (0..count).rev());
        for partial in [
            grow_all(&pieces, backwards),
            grow_all(&pieces, (0..count).flat_map(|branch| [branch; 3])),
        ] {
            assert!(partial.is_complete() && partial.is_complete_in(&whole.bounds()));
            let [a, b] = [&whole, partial.octree()].map(|tree| tree.root().expect("not empty"));
            assert!(is_same(a, b), "depth {depth}");
            assert_eq!(partial.octree().materials, whole.materials);
        }
    }
}

proptest! {
    #[test]
    fn what_is_missing_is_filled_with_the_colour_of_the_node_above(
        scattered in prop::collection::vec(prop::array::uniform3(any::<u16>()), 0..50),
        depth in 1u8..=7,
        order in prop::collection::vec(any::<prop::sample::Index>(), 0..40),
    ) {
        let whole = octree(depth, &scattered);
        let pieces = whole.to_pieces();
        let count = pieces.branches.len();
        let partial = grow_all(&pieces, order.iter().map(|at| at.index(count)));
        let tree = partial.octree();
        prop_assert!(stands_for(whole.root(), tree.root(), 0));
        for branch in 0..count {
            let bounds = partial.bounds_of(branch).expect("it is less than the count");
            let middle = inside(bounds);
            prop_assert_eq!(partial.branch_at(bounds.centre()), Some(branch));
            let complete = partial.grades_of(branch) == partial.grades();
            prop_assert_eq!(partial.is_complete_in(&middle), complete);
            prop_assert!(complete || tree.solid_in(&middle) || !whole.solid_in(&middle));
        }
    }

    #[test]
    fn damaged_pieces_are_refused_or_give_a_sound_tree(
        depth in 1u8..=5,
        which in any::<prop::sample::Index>(),
        at in any::<prop::sample::Index>(),
        flip in 1u8..,
    ) {
        let pieces = octree(depth, &[]).to_pieces();
        let mut trunk = pieces.trunk.clone();
        let place = at.index(trunk.len());
        trunk[place] ^= flip;
        if let Ok(partial) = PartialOctree::new(&trunk) {
            walk(partial.octree().root());
        }
        let branch = which.index(pieces.branches.len());
        let mut partial = PartialOctree::new(&pieces.trunk).expect("just written");
        for piece in &pieces.branches[branch] {
            let mut damaged = piece.clone();
            let place = at.index(damaged.len());
            damaged[place] ^= flip;
            let before = partial.grades_of(branch);
            let grown = partial.clone().grow(branch, &damaged);
            prop_assert_eq!(partial.grades_of(branch), before);
            let mut other = partial.clone();
            if other.grow(branch, &damaged).is_ok() {
                walk(other.octree().root());
            }
            prop_assert!(grown.is_ok() || partial.grow(branch, &piece[1..]).is_err());
            partial.grow(branch, piece).expect("just written");
        }
        prop_assert!(partial.grow(branch, &pieces.branches[branch][0]).is_err(), "complete");
        prop_assert!(partial.grow(pieces.branches.len(), &[]).is_err(), "no such branch");
    }

    #[test]
    fn noise_is_no_trunk(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(PartialOctree::new(&bytes).is_err());
    }
}

#[test]
fn a_tree_that_lets_branches_go_is_one_that_never_had_them() {
    for depth in [2, 5, 7] {
        let pieces = octree(depth, &[[300, 7, 90], [250, 250, 250]]).to_pieces();
        let count = pieces.branches.len();
        // Of some branches all grades are here, of others one or two.
        let order = || (0..3).flat_map(|round| (0..count).filter(move |at| at % 4 >= round));
        let mut tree = grow_all(&pieces, order());
        let all = tree.bytes();
        let keeps = |branch: usize| branch % 3 != 1;
        tree.keep(keeps);
        let mut expected = grow_all(&pieces, order().filter(|branch| keeps(*branch)));
        for _ in 0..2 {
            let [a, b] = [&tree, &expected].map(|tree| tree.octree().root().expect("not empty"));
            assert!(is_same(a, b), "depth {depth}");
            for branch in 0..count {
                assert_eq!(tree.grades_of(branch), expected.grades_of(branch));
                assert_eq!(tree.bytes_of(branch) == 0, tree.grades_of(branch) == 0);
            }
            // What was let go comes again.
            for branch in 0..count {
                let grade = usize::from(tree.grades_of(branch));
                if let Some(piece) = pieces.branches[branch].get(grade) {
                    tree.grow(branch, piece).expect("just written");
                    expected.grow(branch, piece).expect("just written");
                }
            }
        }
        assert!(depth < 7 || all > tree.bytes() / 2);
        let full = tree.bytes();
        tree.keep(|_| false);
        assert!(tree.bytes() < full && (0..count).all(|branch| tree.grades_of(branch) == 0));
    }
    let mut empty =
        PartialOctree::new(&Octree::empty(Vec3::ZERO, 8.0, 6).to_pieces().trunk).unwrap();
    empty.keep(|_| true);
    assert!(empty.is_complete());
}

/// A box with a little less than a cube.
fn inside(cube: Aabb) -> Aabb {
    let spare = cube.size() * 0.01;
    Aabb::new(cube.min + spare, cube.max - spare)
}

/// Looks at every node.
fn walk(node: Option<Cursor<'_>>) -> usize {
    node.map_or(0, |node| 1 + node.children().map(|(_, child)| walk(Some(child))).sum::<usize>())
}

#[test]
fn a_tree_without_voxels_is_complete_at_once() {
    let pieces = Octree::empty(Vec3::ZERO, 8.0, 6).to_pieces();
    let partial = PartialOctree::new(&pieces.trunk).expect("just written");
    assert!(partial.is_complete() && partial.octree().root().is_none());
}
