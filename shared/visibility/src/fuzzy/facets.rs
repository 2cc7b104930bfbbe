//! Facets: the parts of a surface that lie in one plane, with their outlines. To project a facet
//! takes time by its edges, so a wall of a thousand patches costs no more than its four edges.

use glam::DVec3;
use rustc_hash::FxHashMap;
use sightline_world::{geometry::Aabb, tolerance::ON_PLANE_F32_M};

use super::patches::PatchMesh;

/// Connected patches in one plane.
#[derive(Clone, Debug)]
pub(super) struct PlanarFacet {
    /// The unit normal.
    pub(super) normal: DVec3,
    /// The distance of the plane from the origin along the normal, in metres.
    pub(super) offset: f64,
    pub(super) bounds: Aabb,
    /// The edges of its outline, and of the outlines of its holes.
    pub(super) edges: Vec<FacetEdge>,
}

/// An edge of a facet's outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct FacetEdge {
    pub(super) ends: [DVec3; 2],
    /// The other facet of the same surface that the edge belongs to, if there is just one.
    pub(super) neighbour: Option<FacetNeighbour>,
}

/// A facet beyond an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FacetNeighbour {
    pub(super) facet: u32,
    /// Whether the normals of both facets point to the same side of the surface.
    pub(super) same_side: bool,
}

/// A patch beyond an edge.
#[derive(Clone, Copy)]
struct PatchNeighbour {
    patch: u32,
    /// Whether the corners of both patches turn the same way.
    same_turn: bool,
}

/// For each edge of a patch that belongs to just two patches, the other one.
type Neighbours = FxHashMap<(u32, usize), PatchNeighbour>;

/// The facet that a patch belongs to.
#[derive(Clone, Copy)]
struct FacetPlacement {
    facet: u32,
    /// Whether the corners of the patch turn the other way than those of the facet's first patch.
    is_turned: bool,
}

/// An edge of an outline, by the indices of its corners.
#[derive(Clone, Copy)]
struct OutlineEdge {
    from: u32,
    to: u32,
    neighbour: Option<FacetNeighbour>,
}

/// Finds the facets of one surface. `start` is the index of its first facet.
pub(super) fn find(mesh: &PatchMesh, patches: &[u32], start: usize) -> Vec<PlanarFacet> {
    let neighbours = neighbours(mesh, patches);
    let mut places: FxHashMap<u32, FacetPlacement> = FxHashMap::default();
    let mut found: Vec<Vec<u32>> = Vec::new();
    for &first in patches {
        if mesh.patch(first as usize).normal != DVec3::ZERO && !places.contains_key(&first) {
            let number = (start + found.len()) as u32;
            found.push(spread(mesh, &neighbours, first, number, &mut places));
        }
    }
    let facet = |(number, members): (usize, &Vec<u32>)| {
        let number = (start + number) as u32;
        let outline = outline(mesh, &neighbours, &places, members, number);
        let first = mesh.patch(members[0] as usize);
        let bounds = |all: Aabb, patch: &u32| all.union(&mesh.patch(*patch as usize).bounds);
        PlanarFacet {
            normal: first.normal,
            offset: first.offset,
            bounds: members.iter().fold(Aabb::EMPTY, bounds),
            edges: merged(mesh, outline),
        }
    };
    found.iter().enumerate().map(facet).collect()
}

fn neighbours(mesh: &PatchMesh, patches: &[u32]) -> Neighbours {
    let mut found: FxHashMap<[u32; 2], Vec<(u32, usize, bool)>> = FxHashMap::default();
    for &patch in patches {
        for edge in mesh.edges(patch as usize) {
            let [from, to] = mesh.ends(patch as usize, edge);
            let key = [from.min(to), from.max(to)];
            found.entry(key).or_default().push((patch, edge, from < to));
        }
    }
    let mut neighbours = Neighbours::default();
    for edges in found.values() {
        if let [(one, edge, up), (other, other_edge, other_up)] = edges[..]
            && one != other
        {
            // Patches that turn the same way run along a shared edge in opposite directions.
            let same_turn = up != other_up;
            neighbours.insert((one, edge), PatchNeighbour { patch: other, same_turn });
            neighbours.insert((other, other_edge), PatchNeighbour { patch: one, same_turn });
        }
    }
    neighbours
}

/// All patches that are connected to one within its plane.
fn spread(
    mesh: &PatchMesh,
    neighbours: &Neighbours,
    first: u32,
    number: u32,
    places: &mut FxHashMap<u32, FacetPlacement>,
) -> Vec<u32> {
    let (mut members, mut next) = (vec![first], 0);
    let plane = mesh.patch(first as usize);
    places.insert(first, FacetPlacement { facet: number, is_turned: false });
    while let Some(&patch) = members.get(next) {
        next += 1;
        let is_turned = places[&patch].is_turned;
        for edge in mesh.edges(patch as usize) {
            let Some(neighbour) = neighbours.get(&(patch, edge)) else { continue };
            let other = neighbour.patch;
            let is_turned = is_turned == neighbour.same_turn;
            let turn = if is_turned { -1.0 } else { 1.0 };
            let on_plane =
                |corner: DVec3| (plane.normal.dot(corner) - plane.offset).abs() <= ON_PLANE_F32_M;
            // A patch that is folded back faces the other way.
            if !places.contains_key(&other)
                && mesh.patch(other as usize).normal.dot(plane.normal) * turn > 0.5
                && mesh.corners(other as usize).all(on_plane)
            {
                places.insert(other, FacetPlacement { facet: number, is_turned });
                members.push(other);
            }
        }
    }
    members
}

/// The edges that a facet's patches do not share with each other.
fn outline(
    mesh: &PatchMesh,
    neighbours: &Neighbours,
    places: &FxHashMap<u32, FacetPlacement>,
    members: &[u32],
    number: u32,
) -> Vec<OutlineEdge> {
    let mut edges = Vec::new();
    for &patch in members {
        let is_turned = places[&patch].is_turned;
        for edge in mesh.edges(patch as usize) {
            let [from, to] = mesh.ends(patch as usize, edge);
            let neighbour = neighbours.get(&(patch, edge)).and_then(|neighbour| {
                let place = *places.get(&neighbour.patch)?;
                let same_side = neighbour.same_turn == (is_turned == place.is_turned);
                Some(FacetNeighbour { facet: place.facet, same_side })
            });
            if from == to || neighbour == Some(FacetNeighbour { facet: number, same_side: true }) {
                continue;
            }
            // An edge that joins the facet to itself in another way is a fold.
            let neighbour = neighbour.filter(|neighbour| neighbour.facet != number);
            let (from, to) = if is_turned { (to, from) } else { (from, to) };
            edges.push(OutlineEdge { from, to, neighbour });
        }
    }
    edges
}

/// Merges edges that follow each other on a line and have the same neighbour.
fn merged(mesh: &PatchMesh, outline: Vec<OutlineEdge>) -> Vec<FacetEdge> {
    let mut leaving: FxHashMap<u32, Vec<usize>> = FxHashMap::default();
    let mut arriving: FxHashMap<u32, usize> = FxHashMap::default();
    for (i, edge) in outline.iter().enumerate() {
        leaving.entry(edge.from).or_default().push(i);
        *arriving.entry(edge.to).or_default() += 1;
    }
    // The edge that begins where another ends, if no third edge begins or ends there.
    let next = |edge: &OutlineEdge| {
        let follows = match leaving.get(&edge.to).map(Vec::as_slice) {
            Some([only]) if arriving.get(&edge.to) == Some(&1) => *only,
            _ => return None,
        };
        let other = outline[follows];
        let [a, b, c] = [edge.from, edge.to, other.to].map(|corner| mesh.corner(corner));
        let is_straight = (b - a).cross(c - b) == DVec3::ZERO && (b - a).dot(c - b) > 0.0;
        (is_straight && other.neighbour == edge.neighbour).then_some(follows)
    };
    let follows: Vec<Option<usize>> = outline.iter().map(next).collect();
    let mut is_first = vec![true; outline.len()];
    follows.iter().flatten().for_each(|next| is_first[*next] = false);
    let starts = (0..outline.len()).filter(|start| is_first[*start]);
    starts
        .map(|start| {
            let mut last = start;
            while let Some(next) = follows[last] {
                last = next;
            }
            let ends = [outline[start].from, outline[last].to].map(|at| mesh.corner(at));
            FacetEdge { ends, neighbour: outline[start].neighbour }
        })
        .collect()
}
