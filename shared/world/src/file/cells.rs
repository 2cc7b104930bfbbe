//! The sections of the cells and of the PVS.

use glam::DVec3;
use roaring::RoaringBitmap;

use super::{
    ReadError, list,
    reader::SectionReader,
    writer::{put_aabb, put_count, put_f32, put_f64, put_u32, put_vec3},
};
use crate::{
    cells::{Cell, CellId, Cells, Gate, Node, Polygon, Portal, Pvs, Space},
    geometry::Axes,
};

/// The greatest depth of the tree, which is walked by recursion.
const TREE_DEPTH_MAX: u16 = 512;
/// The greatest number of cells. A row of the PVS then has at most sixteen containers. Sixteen in
/// each row take about a gigabyte.
const CELLS_MAX: usize = 1 << 20;
/// The greatest number of pairs of cells that see each other, each counted once. A pair takes at
/// most four bytes in memory, so all pairs take at most a gigabyte. A hall of 23,000 cells without
/// a wall has fewer pairs.
const PAIRS_MAX: u64 = 1 << 28;

pub(super) fn cells_bytes(cells: &Cells) -> Vec<u8> {
    let mut out = Vec::new();
    put_f64(&mut out, cells.axes.turn());
    put_aabb(&mut out, &cells.bounds);
    put_count(&mut out, cells.spaces.len());
    for space in &cells.spaces {
        put_count(&mut out, space.cells.len());
        put_aabb(&mut out, &space.bounds);
    }
    put_count(&mut out, cells.cells.len());
    for cell in &cells.cells {
        put_aabb(&mut out, &cell.bounds);
    }
    put_tree(&mut out, &cells.tree);
    put_count(&mut out, cells.portals.len());
    for portal in &cells.portals {
        portal.cells.iter().for_each(|cell| put_u32(&mut out, cell.0));
        put_polygon(&mut out, &portal.polygon);
    }
    put_count(&mut out, cells.gates.len());
    for gate in &cells.gates {
        gate.spaces.iter().for_each(|&space| put_u32(&mut out, space));
        put_polygon(&mut out, &gate.polygon);
    }
    out
}

/// Appends the tree: thirteen bytes for each node, so that the reader can check the count at once,
/// then the planes that are not axial, in the order of their nodes.
pub(super) fn put_tree(out: &mut Vec<u8>, tree: &[Node]) {
    put_count(out, tree.len());
    let mut planes = Vec::new();
    for node in tree {
        let (tag, at, [a, b]) = match *node {
            Node::Axial { axis, at, sides } => (axis, at, sides),
            Node::Leaf(cell) => (NODE_LEAF, 0.0, [cell.0, 0]),
            Node::Solid => (NODE_SOLID, 0.0, [0, 0]),
            Node::Plane { normal, distance, sides } => {
                normal.to_array().into_iter().for_each(|c| put_f64(&mut planes, c));
                put_f64(&mut planes, distance);
                (NODE_PLANE, 0.0, sides)
            }
        };
        out.push(tag);
        put_f32(out, at);
        put_u32(out, a);
        put_u32(out, b);
    }
    out.append(&mut planes);
}

/// The tags of nodes that are not axial planes. The tag of an axial plane is its axis.
const NODE_LEAF: u8 = 3;
const NODE_SOLID: u8 = 4;
const NODE_PLANE: u8 = 5;
/// The tag of a polygon that is not an axial rectangle.
const POLYGON_OTHER: u8 = 3;

fn put_polygon(out: &mut Vec<u8>, polygon: &Polygon) {
    match polygon {
        Polygon::Rectangle { axis, bounds } => {
            out.push(*axis);
            put_aabb(out, bounds);
        }
        Polygon::Other { normal, corners } => {
            out.push(POLYGON_OTHER);
            normal.to_array().into_iter().for_each(|c| put_f64(out, c));
            put_count(out, corners.len());
            corners.iter().for_each(|&corner| put_vec3(out, corner));
        }
    }
}

pub(super) fn read_cells(input: &mut SectionReader) -> Result<Cells, ReadError> {
    let turn = input.f64()?;
    if turn.abs() > std::f64::consts::TAU {
        return Err(ReadError::Malformed("the axes"));
    }
    let bounds = input.aabb()?;
    let (mut spaces, mut cells) = read_spaces_and_cells(input)?;
    let tree = read_tree(input, cells.len())?;
    let portals = read_joins(input, cells.len(), |portal, [a, b]| {
        cells[a as usize].portals.push(portal);
        cells[b as usize].portals.push(portal);
    })?;
    let gates = read_joins(input, spaces.len(), |gate, [a, b]| {
        spaces[a as usize].gates.push(gate);
        spaces[b as usize].gates.push(gate);
    })?;
    let portals = portals
        .into_iter()
        .map(|(cells, polygon)| Portal { cells: cells.map(CellId), polygon })
        .collect();
    let gates = gates.into_iter().map(|(spaces, polygon)| Gate { spaces, polygon }).collect();
    let axes = Axes::turned(turn);
    Ok(Cells { axes, bounds, tree, cells, portals, spaces, gates, pvs: Vec::new() })
}

fn read_spaces_and_cells(input: &mut SectionReader) -> Result<(Vec<Space>, Vec<Cell>), ReadError> {
    let bad = || ReadError::Malformed("the spaces");
    let count = input.count(28)?;
    let mut spaces = list(count)?;
    let mut end = 0u32;
    for _ in 0..count {
        let (start, length) = (end, input.u32()?);
        end = start.checked_add(length).filter(|_| length > 0).ok_or_else(bad)?;
        spaces.push(Space { bounds: input.aabb()?, cells: start..end, gates: Vec::new() });
        if end as usize > input.len() / 24 {
            return Err(bad());
        }
    }
    if input.count(24)? != end as usize {
        return Err(bad());
    }
    let mut cells = list(end as usize)?;
    for (index, space) in (0..).zip(&spaces) {
        for _ in space.cells.clone() {
            cells.push(Cell { bounds: input.aabb()?, space: index, portals: Vec::new() });
        }
    }
    Ok((spaces, cells))
}

/// Reads polygons between two of `count` cells or spaces, and calls `found` with the number of each
/// polygon and what it joins.
fn read_joins(
    input: &mut SectionReader,
    count: usize,
    mut found: impl FnMut(u32, [u32; 2]),
) -> Result<Vec<([u32; 2], Polygon)>, ReadError> {
    let joins = input.count(33)?;
    let mut read = list(joins)?;
    for index in 0..joins as u32 {
        let ids = [input.u32()?, input.u32()?];
        let polygon = read_polygon(input)?;
        if ids[0] == ids[1] || ids.iter().any(|&id| id as usize >= count) {
            return Err(ReadError::Malformed("a portal"));
        }
        found(index, ids);
        read.push((ids, polygon));
    }
    Ok(read)
}

fn read_polygon(input: &mut SectionReader) -> Result<Polygon, ReadError> {
    let axis = input.u8()?;
    if axis < POLYGON_OTHER {
        return Ok(Polygon::Rectangle { axis, bounds: input.aabb()? });
    }
    let normal = input.direction()?;
    let count = input.count(12)?;
    if axis > POLYGON_OTHER || !(3..=CORNERS_MAX).contains(&count) {
        return Err(ReadError::Malformed("a polygon"));
    }
    let corners = (0..count).map(|_| input.vec3()).collect::<Result<_, _>>()?;
    Ok(Polygon::Other { normal, corners })
}

/// The greatest number of corners of a polygon.
const CORNERS_MAX: usize = 64;

/// Reads a tree in which every node but the root has exactly one parent, and every cell is exactly
/// one leaf. A walk down such a tree ends and visits nothing twice.
pub(super) fn read_tree(input: &mut SectionReader, cells: usize) -> Result<Vec<Node>, ReadError> {
    let bad = ReadError::Malformed("the tree");
    let count = input.count(13)?;
    let mut tree = list(count)?;
    let mut depths: Vec<Option<u16>> = vec![None; count];
    let mut leaf_seen = vec![false; cells];
    if let Some(root) = depths.first_mut() {
        *root = Some(0);
    }
    for index in 0..count {
        let (tag, at, [a, b]) = (input.u8()?, input.f32()?, [input.u32()?, input.u32()?]);
        let Some(depth) = depths[index].filter(|&depth| depth < TREE_DEPTH_MAX) else {
            return Err(bad);
        };
        let sides = [a, b];
        match tag {
            NODE_LEAF => match leaf_seen.get_mut(a as usize) {
                Some(seen) if !*seen => *seen = true,
                _ => return Err(bad),
            },
            NODE_SOLID => {}
            0..NODE_LEAF | NODE_PLANE => {
                for side in sides.map(|side| side as usize) {
                    match depths.get_mut(side) {
                        Some(below) if side > index && below.is_none() => *below = Some(depth + 1),
                        _ => return Err(bad),
                    }
                }
            }
            _ => return Err(bad),
        }
        tree.push(match tag {
            NODE_LEAF => Node::Leaf(CellId(a)),
            NODE_SOLID => Node::Solid,
            NODE_PLANE => Node::Plane { normal: DVec3::ZERO, distance: 0.0, sides },
            axis => Node::Axial { axis, at, sides },
        });
    }
    if tree.is_empty() || !leaf_seen.iter().all(|&seen| seen) {
        return Err(bad);
    }
    for node in &mut tree {
        if let Node::Plane { normal, distance, .. } = node {
            *normal = input.direction()?;
            *distance = input.f64()?;
        }
    }
    Ok(tree)
}

/// The upper half of the PVS, diagonal included. The lower half follows by symmetry.
pub(super) fn pvs_bytes(cells: &Cells) -> Vec<u8> {
    let mut out = Vec::new();
    for (cell, row) in (0..).zip(&cells.pvs) {
        let mut row = row.clone();
        row.remove_range(..cell);
        row.optimize();
        row.serialize_into(&mut out).expect("writing to memory does not fail");
    }
    out
}

pub(super) fn read_pvs(input: &mut SectionReader, cells: usize) -> Result<Pvs, ReadError> {
    let bad = |what| Err(ReadError::Malformed(what));
    if cells > CELLS_MAX {
        return bad("more cells than any world may have");
    }
    let mut upper = list(cells)?;
    let mut pairs = 0;
    for cell in 0..cells as u32 {
        let Ok(row) = RoaringBitmap::deserialize_from(input.as_read()) else {
            return bad("the PVS");
        };
        if row.min() != Some(cell) || row.max().is_none_or(|last| last as usize >= cells) {
            return bad("the PVS");
        }
        pairs += row.len();
        // A run of a few bytes can stand for very many pairs.
        if pairs > PAIRS_MAX {
            return bad("more pairs in the PVS than any world may have");
        }
        upper.push(row);
    }
    if input.is_empty() { Ok(both_ways(upper)) } else { bad("the PVS") }
}

/// Adds the lower half of a symmetric PVS to its upper half. Successive cells see nearly the same,
/// so each column consists of few runs, and only where a row differs from the one before is there
/// work.
fn both_ways(mut rows: Pvs) -> Pvs {
    let mut lesser = vec![RoaringBitmap::new(); rows.len()];
    // For each cell, the first of the run of cells before it that see it.
    let mut begun: Vec<Option<u32>> = vec![None; rows.len()];
    let mut before = &RoaringBitmap::new();
    for (cell, row) in (0..).zip(&rows) {
        if let Some(from) = begun[cell as usize].take() {
            lesser[cell as usize].insert_range(from..cell);
        }
        let mut differs = before ^ row;
        differs.remove_range(..=cell);
        for other in differs {
            match begun[other as usize].take() {
                Some(from) => {
                    lesser[other as usize].insert_range(from..cell);
                }
                None => begun[other as usize] = Some(cell),
            }
        }
        before = row;
    }
    for (row, mut lesser) in rows.iter_mut().zip(lesser) {
        lesser.optimize();
        *row |= lesser;
        row.optimize();
    }
    rows
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::Aabb;

    fn read(rows: &[RoaringBitmap], cells: usize) -> Result<Pvs, ReadError> {
        let mut bytes = Vec::new();
        rows.iter().for_each(|row| row.serialize_into(&mut bytes).unwrap());
        read_pvs(&mut SectionReader::new(&bytes), cells)
    }

    fn run(from: u32, to: u32) -> RoaringBitmap {
        let mut row = RoaringBitmap::new();
        row.insert_range(from..to);
        row.optimize();
        row
    }

    #[test]
    fn half_of_the_pvs_gives_the_other_half() {
        let mut pvs = vec![RoaringBitmap::new(); 300];
        for cell in 0..300u32 {
            for other in
                (cell..300).filter(|other| (cell * 7 + other * 13) % 5 < 2 || *other == cell)
            {
                pvs[cell as usize].insert(other);
                pvs[other as usize].insert(cell);
            }
        }
        let cells = Cells { pvs: pvs.clone(), ..Cells::whole(Aabb::around(Vec3::ZERO, 1.0)) };
        let bytes = pvs_bytes(&cells);
        assert_eq!(read_pvs(&mut SectionReader::new(&bytes), 300).unwrap(), pvs);
    }

    #[test]
    fn rows_that_are_not_an_upper_half_are_refused() {
        assert_eq!(read(&[run(0, 2), run(1, 2)], 2).unwrap(), [run(0, 2), run(0, 2)]);
        for rows in [[run(0, 2), run(0, 2)], [run(0, 3), run(1, 2)], [run(0, 1), run(2, 2)]] {
            assert!(read(&rows, 2).is_err());
        }
    }

    /// Half a megabyte can stand for 450 million pairs.
    #[test]
    fn runs_that_unpack_to_too_many_pairs_are_refused() {
        let cells = 30_000;
        let rows: Vec<_> = (0..cells).map(|cell| run(cell, cells)).collect();
        let error = read(&rows, cells as usize).unwrap_err().to_string();
        assert!(error.ends_with("more pairs in the PVS than any world may have"), "{error}");
    }
}
