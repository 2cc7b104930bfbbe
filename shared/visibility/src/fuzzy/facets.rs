//! Facets: what of a surface lies in one plane, with its outline. Walls of a thousand patches have four
//! edges, and these are what projecting them costs.

use glam::DVec3;
use rustc_hash::FxHashMap;

use super::surfaces::Surfaces;
use sightline_world::{geometry::Aabb, tolerance::ON_PLANE_F32_M};

/// Interconnected patches in one plane.
#[derive(Clone, Debug)]
pub(super) struct PlanarFacet {
    /// Of unit length.
    pub(super) normal: DVec3,
    pub(super) offset: f64,
    pub(super) bounds: Aabb,
    /// Its outline, and those of its holes.
    pub(super) edges: Vec<FacetEdge>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct FacetEdge {
    pub(super) ends: [DVec3; 2],
    /// The facet of the same surface that it shares the edge with, if it is one; and whether both
    /// normals are on the same side of the surface.
    pub(super) join: Option<(u32, bool)>,
}

/// The other patch that an edge belongs to, and whether their corners go round the same way.
type PatchJoin = Option<(u32, bool)>;

/// A patch's place: its facet, and whether it goes round the other way.
type FacetPlacement = (u32, bool);

/// An edge of an outline, by the numbers of its corners.
#[derive(Clone, Copy)]
struct OutlineEdge {
    from: u32,
    to: u32,
    join: Option<(u32, bool)>,
}

/// Finds the facets of one surface's patches.
pub(super) fn find(surfaces: &mut Surfaces, patches: &[u32]) {
    let joins = joins(surfaces, patches);
    let mut places: FxHashMap<u32, FacetPlacement> = FxHashMap::default();
    let (start, mut found) = (surfaces.facets(), Vec::new());
    for &first in patches {
        if surfaces.patch(first as usize).normal != DVec3::ZERO && !places.contains_key(&first) {
            let number = (start + found.len()) as u32;
            found.push(spread(surfaces, &joins, first, number, &mut places));
        }
    }
    for (number, members) in found.iter().enumerate() {
        let number = (start + number) as u32;
        let pieces = outline(surfaces, &joins, &places, members, number);
        let first = surfaces.patch(members[0] as usize);
        let bounds = |all: Aabb, patch: &u32| all.union(&surfaces.patch(*patch as usize).bounds);
        let facet = PlanarFacet {
            normal: first.normal,
            offset: first.offset,
            bounds: members.iter().fold(Aabb::EMPTY, bounds),
            edges: merged(surfaces, pieces),
        };
        surfaces.push(facet);
    }
}

/// For each edge that belongs to just two patches, the other one.
fn joins(surfaces: &Surfaces, patches: &[u32]) -> FxHashMap<(u32, usize), PatchJoin> {
    let mut found: FxHashMap<[u32; 2], Vec<(u32, usize, bool)>> = FxHashMap::default();
    for &patch in patches {
        for edge in surfaces.edges(patch as usize) {
            let [from, to] = surfaces.ends(patch as usize, edge);
            let key = [from.min(to), from.max(to)];
            found.entry(key).or_default().push((patch, edge, from < to));
        }
    }
    let mut joins = FxHashMap::default();
    for edges in found.values() {
        if let [(one, edge, up), (other, other_edge, other_up)] = edges[..]
            && one != other
        {
            // Round the same way, a shared edge is gone along once in each direction.
            joins.insert((one, edge), Some((other, up != other_up)));
            joins.insert((other, other_edge), Some((one, up != other_up)));
        }
    }
    joins
}

/// All patches that are joined to one within its plane.
fn spread(
    surfaces: &Surfaces,
    joins: &FxHashMap<(u32, usize), PatchJoin>,
    first: u32,
    number: u32,
    places: &mut FxHashMap<u32, FacetPlacement>,
) -> Vec<u32> {
    let (mut members, mut next) = (vec![first], 0);
    let plane = surfaces.patch(first as usize);
    places.insert(first, (number, false));
    while let Some(&patch) = members.get(next) {
        next += 1;
        let (_, is_turned) = places[&patch];
        for edge in surfaces.edges(patch as usize) {
            let Some(Some((other, same_way))) = joins.get(&(patch, edge)) else { continue };
            let is_turned = is_turned == *same_way;
            let turn = if is_turned { -1.0 } else { 1.0 };
            let on_plane =
                |corner: DVec3| (plane.normal.dot(corner) - plane.offset).abs() <= ON_PLANE_F32_M;
            // What is folded back faces the other way.
            if !places.contains_key(other)
                && surfaces.patch(*other as usize).normal.dot(plane.normal) * turn > 0.5
                && surfaces.corners(*other as usize).all(on_plane)
            {
                places.insert(*other, (number, is_turned));
                members.push(*other);
            }
        }
    }
    members
}

/// The edges that a facet's patches do not share with each other.
fn outline(
    surfaces: &Surfaces,
    joins: &FxHashMap<(u32, usize), PatchJoin>,
    places: &FxHashMap<u32, FacetPlacement>,
    members: &[u32],
    number: u32,
) -> Vec<OutlineEdge> {
    let mut pieces = Vec::new();
    for &patch in members {
        let (_, is_turned) = places[&patch];
        for edge in surfaces.edges(patch as usize) {
            let [from, to] = surfaces.ends(patch as usize, edge);
            let join =
                joins.get(&(patch, edge)).copied().flatten().and_then(|(other, same_way)| {
                    let (facet, other_is_turned) = *places.get(&other)?;
                    Some((facet, same_way == (is_turned == other_is_turned)))
                });
            if from == to || join == Some((number, true)) {
                continue;
            }
            // Joined to itself some other way: a fold.
            let join = join.filter(|(facet, _)| *facet != number);
            let (from, to) = if is_turned { (to, from) } else { (from, to) };
            pieces.push(OutlineEdge { from, to, join });
        }
    }
    pieces
}

/// Makes one edge of those that follow each other on a line and lead to the same facet.
fn merged(surfaces: &Surfaces, pieces: Vec<OutlineEdge>) -> Vec<FacetEdge> {
    let mut leaving: FxHashMap<u32, Vec<usize>> = FxHashMap::default();
    let mut arriving: FxHashMap<u32, usize> = FxHashMap::default();
    for (i, piece) in pieces.iter().enumerate() {
        leaving.entry(piece.from).or_default().push(i);
        *arriving.entry(piece.to).or_default() += 1;
    }
    // The one that goes on where a piece ends, if nothing else does.
    let next = |piece: &OutlineEdge| {
        let follows = match leaving.get(&piece.to).map(Vec::as_slice) {
            Some([only]) if arriving.get(&piece.to) == Some(&1) => *only,
            _ => return None,
        };
        let other = pieces[follows];
        let [a, b, c] = [piece.from, piece.to, other.to].map(|corner| surfaces.corner(corner));
        let is_straight = (b - a).cross(c - b) == DVec3::ZERO && (b - a).dot(c - b) > 0.0;
        (is_straight && other.join == piece.join).then_some(follows)
    };
    let follows: Vec<Option<usize>> = pieces.iter().map(next).collect();
    let mut is_first = vec![true; pieces.len()];
    follows.iter().flatten().for_each(|next| is_first[*next] = false);
    let starts = (0..pieces.len()).filter(|start| is_first[*start]);
    starts
        .map(|start| {
            let mut last = start;
            while let Some(next) = follows[last] {
                last = next;
            }
            let ends = [pieces[start].from, pieces[last].to].map(|at| surfaces.corner(at));
            FacetEdge { ends, join: pieces[start].join }
        })
        .collect()
}
