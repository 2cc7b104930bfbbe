//! One row: both indices of the same volumes, the time of each operation, and what they find.

use std::{fmt::Write, hint::black_box, time::Instant};

use serde::Serialize;
use sightline_cli::percentile::percentile;
use sightline_world::{
    geometry::Aabb,
    octree::{
        DEPTH_MAX,
        occupants::{OccupantId, Occupants},
    },
};

use crate::{
    scene::{Building, Motion, Move, REGION_WIDTHS, Scene},
    spaces::{SpaceIndex, SpaceSet},
};

/// How often insertions and queries are measured.
const REPEATS: usize = 7;

/// The figures of a number of volumes.
#[derive(Serialize)]
pub struct VolumesRow {
    volumes: usize,
    motion: Motion,
    /// The mean number of spaces that a volume overlaps.
    spaces_each: f64,
    octree_nodes: usize,
    insert: InsertCost,
    /// `None` when all rest.
    moves: Option<MoveCost>,
    queries: Vec<QueryRow>,
}

/// Nanoseconds to insert a volume.
#[derive(Serialize)]
struct InsertCost {
    octree_ns: f64,
    spaces: SpacesCost,
}

/// Nanoseconds to move a volume.
#[derive(Serialize)]
struct MoveCost {
    octree_ns: f64,
    octree_grouped_ns: f64,
    spaces: SpacesCost,
}

/// Nanoseconds to find the spaces of a box, and to do the rest.
#[derive(Clone, Copy, Serialize)]
struct SpacesCost {
    find_ns: f64,
    lists_ns: f64,
}

impl SpacesCost {
    fn whole_ns(self) -> f64 {
        self.find_ns + self.lists_ns
    }
}

/// The two questions for regions of one width. Counts are means over the regions.
#[derive(Serialize)]
struct QueryRow {
    region_m: f32,
    meet_octree_ns: f64,
    meet_spaces: SpacesCost,
    /// Each volume in the lists is compared with the region.
    meet_spaces_boxed: SpacesCost,
    meet_octree: f64,
    meet_volumes_in_spaces: f64,
    /// The volumes that share a point of some cell with the region.
    meet_true: f64,
    see_octree_ns: f64,
    see_spaces: SpacesCost,
    see_octree: f64,
    /// The octree is asked once, for the box around all visible spaces.
    see_octree_once_ns: f64,
    see_octree_once: f64,
    see_volumes_in_spaces: f64,
    /// The volumes in cells that the PVS of cells shows from the region.
    see_by_cells: f64,
}

/// The present boxes, and both indices of them.
struct Indices<'a> {
    building: &'a Building,
    volumes: Vec<Aabb>,
    /// The spaces of each volume.
    spaces: Vec<Vec<u32>>,
    octree: Occupants,
    lists: SpaceIndex,
}

impl VolumesRow {
    pub fn measure(building: &Building, volumes: usize, motion: Motion, seed: u64) -> Self {
        let scene = Scene::new(building, volumes, motion, seed);
        let (mut indices, insert) = Indices::filled(building, &scene.volumes);
        let moves = indices.move_all(&scene.steps);
        let volume_cells = indices.volume_cells();
        let query =
            |(regions, width): (&Vec<Aabb>, f32)| indices.query(regions, &volume_cells, width);
        let queries = scene.regions.iter().zip(REGION_WIDTHS).map(query).collect();
        let entries: usize = indices.spaces.iter().map(Vec::len).sum();
        let spaces_each = entries as f64 / volumes as f64;
        let octree_nodes = indices.octree.node_count();
        Self { volumes, motion, spaces_each, octree_nodes, insert, moves, queries }
    }
}

impl<'a> Indices<'a> {
    fn filled(building: &'a Building, volumes: &[Aabb]) -> (Self, InsertCost) {
        let count = volumes.len();
        let mut times = [const { Vec::new() }; 3];
        let mut fill = || {
            let (corner, edge) = building.cube();
            let mut octree = Occupants::new(corner, edge, DEPTH_MAX);
            let mut lists = SpaceIndex::new(building.spaces().len());
            times[0].push(time_each(count, || {
                for (volume, bounds) in (0..).zip(volumes) {
                    assert_eq!(octree.insert(&[*bounds]), Ok(OccupantId(volume)));
                }
            }));
            let mut spaces = Vec::with_capacity(count);
            times[1].push(time_each(count, || {
                spaces.extend(volumes.iter().map(|bounds| building.spaces_of(bounds)));
            }));
            times[2].push(time_each(count, || {
                (0..).zip(&spaces).for_each(|(volume, spaces)| lists.insert(volume, spaces));
            }));
            Self { building, volumes: volumes.to_vec(), spaces, octree, lists }
        };
        (1..REPEATS).for_each(|_| drop(black_box(fill())));
        let indices = fill();
        let [octree_ns, find_ns, lists_ns] = times.map(median);
        (indices, InsertCost { octree_ns, spaces: SpacesCost { find_ns, lists_ns } })
    }

    /// Moves all volumes step by step. A second octree moves them in groups.
    fn move_all(&mut self, steps: &[Vec<Move>]) -> Option<MoveCost> {
        let mut grouped = self.octree.clone();
        let mut times = [const { Vec::new() }; 4];
        for moves in steps.iter().filter(|moves| !moves.is_empty()) {
            let count = moves.len();
            times[0].push(time_each(count, || {
                for Move { volume, bounds } in moves {
                    assert_eq!(self.octree.move_to(OccupantId(*volume), &[*bounds]), Ok(()));
                }
            }));
            let group: Vec<(OccupantId, &[Aabb])> = moves
                .iter()
                .map(|it| (OccupantId(it.volume), std::slice::from_ref(&it.bounds)))
                .collect();
            times[1].push(time_each(count, || assert_eq!(grouped.move_all(&group), Ok(()))));
            let mut spaces = Vec::with_capacity(count);
            times[2].push(time_each(count, || {
                spaces.extend(moves.iter().map(|it| self.building.spaces_of(&it.bounds)));
            }));
            times[3].push(time_each(count, || {
                for (Move { volume, .. }, new) in moves.iter().zip(&spaces) {
                    self.lists.replace(*volume, &self.spaces[*volume as usize], new);
                }
            }));
            for (Move { volume, bounds }, new) in moves.iter().zip(spaces) {
                self.volumes[*volume as usize] = *bounds;
                self.spaces[*volume as usize] = new;
            }
        }
        assert_eq!(self.octree.node_count(), grouped.node_count(), "both ways give one tree");
        let moved = !times[0].is_empty();
        let [octree_ns, octree_grouped_ns, find_ns, lists_ns] = times.map(median);
        let spaces = SpacesCost { find_ns, lists_ns };
        moved.then_some(MoveCost { octree_ns, octree_grouped_ns, spaces })
    }

    /// For each volume, the cells whose boxes it meets.
    fn volume_cells(&self) -> Vec<Vec<u32>> {
        let cells = &self.building.world.cells.cells;
        let meets = |cell: &u32, volume: &Aabb| cells[*cell as usize].bounds.intersects(volume);
        let of = |volume: &Aabb| {
            let found = self.building.cells_of(volume).into_iter().map(|cell| cell.0);
            found.filter(|cell| meets(cell, volume)).collect()
        };
        self.volumes.iter().map(of).collect()
    }

    fn query(&self, regions: &[Aabb], volume_cells: &[Vec<u32>], region_m: f32) -> QueryRow {
        let any = |_: u32| true;
        let (find_ns, spaces) = repeat(regions, |region| self.building.spaces_of(region));
        let known: Vec<(Aabb, Vec<u32>)> = regions.iter().copied().zip(spaces).collect();
        let with_find = |lists_ns| SpacesCost { find_ns, lists_ns };
        let (meet_octree_ns, meet_octree) =
            repeat(regions, |region| numbers(self.octree.meeting(region)));
        let (meet_ns, meet_spaces) =
            repeat(&known, |(_, spaces)| self.lists.among(spaces.iter().copied(), any));
        let (boxed_ns, meet_boxed) = repeat(&known, |(region, spaces)| {
            let meets = |volume: u32| self.volumes[volume as usize].intersects(region);
            self.lists.among(spaces.iter().copied(), meets)
        });
        let (see_octree_ns, see_octree) =
            repeat(&known, |(_, spaces)| self.octree_among(&self.building.visible_from(spaces)));
        let (see_once_ns, see_once) = repeat(&known, |(_, spaces)| {
            let bounds = self.building.bounds_of(&self.building.visible_from(spaces));
            numbers(self.octree.meeting(&bounds))
        });
        let (see_ns, see_spaces) = repeat(&known, |(_, spaces)| {
            self.lists.among(self.building.visible_from(spaces).shared(&self.lists.occupied), any)
        });
        let meet_true: Vec<Vec<u32>> = regions.iter().map(|it| self.truly_meeting(it)).collect();
        let see_by_cells: Vec<Vec<u32>> =
            regions.iter().map(|it| self.seen_by_cells(it, volume_cells)).collect();
        for found in [&meet_octree, &meet_spaces, &meet_boxed] {
            assert_holds(found, &meet_true);
        }
        for found in [&see_octree, &see_once, &see_spaces] {
            assert_holds(found, &see_by_cells);
        }
        QueryRow {
            region_m,
            meet_octree_ns,
            meet_spaces: with_find(meet_ns),
            meet_spaces_boxed: with_find(boxed_ns),
            meet_octree: mean_count(&meet_octree),
            meet_volumes_in_spaces: mean_count(&meet_spaces),
            meet_true: mean_count(&meet_true),
            // The region's own spaces tell which spaces to ask the octree for.
            see_octree_ns: find_ns + see_octree_ns,
            see_octree_once_ns: find_ns + see_once_ns,
            see_octree_once: mean_count(&see_once),
            see_spaces: with_find(see_ns),
            see_octree: mean_count(&see_octree),
            see_volumes_in_spaces: mean_count(&see_spaces),
            see_by_cells: mean_count(&see_by_cells),
        }
    }

    /// The volumes that meet the box around some of these spaces.
    fn octree_among(&self, spaces: &SpaceSet) -> Vec<u32> {
        let mut found = Vec::new();
        for space in spaces.shared(spaces) {
            found.extend(self.octree.meeting(&self.building.spaces()[space as usize].bounds));
        }
        found.sort_unstable();
        found.dedup();
        numbers(found)
    }

    /// The volumes that share a point of some cell with a region, by looking at each.
    fn truly_meeting(&self, region: &Aabb) -> Vec<u32> {
        let meets = |(_, volume): &(u32, &Aabb)| {
            volume.intersects(region)
                && !self.building.cells_of(&volume.intersection(region)).is_empty()
        };
        (0..).zip(&self.volumes).filter(meets).map(|(volume, _)| volume).collect()
    }

    /// The volumes in some cell that is visible from a region, by looking at each.
    fn seen_by_cells(&self, region: &Aabb, volume_cells: &[Vec<u32>]) -> Vec<u32> {
        let visible = self.building.world.cells.visible_from(region);
        let seen = |(_, cells): &(u32, &Vec<u32>)| cells.iter().any(|it| visible.contains(*it));
        (0..).zip(volume_cells).filter(seen).map(|(volume, _)| volume).collect()
    }
}

fn numbers(found: Vec<OccupantId>) -> Vec<u32> {
    found.into_iter().map(|id| id.0).collect()
}

/// Asks a question of each region several times. Returns the median of nanoseconds a question, and
/// the answers.
fn repeat<R>(regions: &[R], ask: impl Fn(&R) -> Vec<u32>) -> (f64, Vec<Vec<u32>>) {
    let mut answers = Vec::new();
    let mut times = Vec::new();
    for _ in 0..REPEATS {
        answers.clear();
        times.push(time_each(regions.len(), || answers.extend(regions.iter().map(&ask))));
    }
    (median(times), answers)
}

/// The nanoseconds that each of some operations takes.
fn time_each(operations: usize, work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64() * 1e9 / operations as f64
}

/// The median; 0 when there are no values.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    percentile(&values, 50).unwrap_or(0.0)
}

fn mean_count(answers: &[Vec<u32>]) -> f64 {
    answers.iter().map(Vec::len).sum::<usize>() as f64 / answers.len() as f64
}

/// Checks that no volume is left out of an answer. Answers are ascending.
fn assert_holds(answers: &[Vec<u32>], expected: &[Vec<u32>]) {
    for (answer, expected) in answers.iter().zip(expected) {
        let missing = expected.iter().find(|volume| answer.binary_search(volume).is_err());
        assert_eq!(missing, None, "an index leaves out a volume");
    }
}

/// The cost of insertions and moves, in nanoseconds a volume.
pub fn update_table(rows: &[VolumesRow]) -> String {
    let heading = "octree | spaces | lists alone | octree / spaces | octree / lists";
    let mut text = format!(
        "| volumes | motion | spaces each | insert: {heading} | move: octree, one by one \
         | grouped | spaces | lists alone | grouped / spaces | grouped / lists |\n\
         | ---: | --- {}|\n",
        "| ---: ".repeat(12),
    );
    for row in rows {
        let costs = |octree_ns: f64, spaces: &SpacesCost| {
            let (whole_ns, lists_ns) = (spaces.whole_ns(), spaces.lists_ns);
            format!(
                "{octree_ns:.0} | {whole_ns:.0} | {lists_ns:.0} | {:.2} | {:.2}",
                octree_ns / whole_ns,
                octree_ns / lists_ns,
            )
        };
        let insert = costs(row.insert.octree_ns, &row.insert.spaces);
        let moves = row.moves.as_ref().map_or("| | | | |".into(), |moves| {
            let grouped = costs(moves.octree_grouped_ns, &moves.spaces);
            format!("{:.0} | {grouped}", moves.octree_ns)
        });
        let VolumesRow { volumes, motion, spaces_each, .. } = row;
        let _ = writeln!(text, "| {volumes} | {motion} | {spaces_each:.1} | {insert} | {moves} |");
    }
    text
}

/// The cost of queries, in nanoseconds, and the number of volumes that they find.
pub fn query_table(rows: &[VolumesRow]) -> String {
    let mut text = String::from(
        "| volumes | motion | region | meet: octree | spaces | spaces, then boxes \
         | octree / spaces, then boxes | found: octree | spaces | true \
         | see: octree | octree, one box | spaces | octree / spaces | one box / spaces \
         | found: octree | one box | spaces | by cells |\n",
    );
    let _ = writeln!(text, "| ---: | --- {}|", "| ---: ".repeat(17));
    for (row, query) in rows.iter().flat_map(|row| row.queries.iter().map(move |it| (row, it))) {
        let [meet, boxed, see] = [query.meet_spaces, query.meet_spaces_boxed, query.see_spaces]
            .map(SpacesCost::whole_ns);
        let _ = writeln!(
            text,
            "| {} | {} | {} m | {:.0} | {meet:.0} | {boxed:.0} | {:.2} | {:.1} | {:.1} | {:.1} \
             | {:.0} | {:.0} | {see:.0} | {:.1} | {:.1} | {:.0} | {:.0} | {:.0} | {:.0} |",
            row.volumes,
            row.motion,
            query.region_m,
            query.meet_octree_ns,
            query.meet_octree_ns / boxed,
            query.meet_octree,
            query.meet_volumes_in_spaces,
            query.meet_true,
            query.see_octree_ns,
            query.see_octree_once_ns,
            query.see_octree_ns / see,
            query.see_octree_once_ns / see,
            query.see_octree,
            query.see_octree_once,
            query.see_volumes_in_spaces,
            query.see_by_cells,
        );
    }
    text
}
