//! What form factors cost, by hemicubes with lists of candidates and by rays (Lim 1999, "Use of the
//! Visibility and Invisibility Methods for the Radiosity Methods").
//!
//! ```text
//! cargo bench -p sightline-tests --bench form_factors -- --rooms 1,4,60,400
//! ```
//!
//! Receivers lie 0.3 m apart on the surfaces of generated buildings. Those of one space that lie in
//! a cube of 4 m make a group, and those in one of its eight parts a group below it. A hemicube of
//! each receiver is drawn with all triangles as candidates; with those that fuzzy projection does
//! not find invisible from the two groups; with those in the spaces that box visibility does not
//! find hidden from the group; and with those in the cells that the PVS holds. Lists are made once
//! for a group, and their time counts. Rays find the same form factors from the same directions,
//! and the last column has as many rays as the compiler casts. Times are CPU time of one thread.
//!
//! A second line for each building is for the parts of the patent that the compiler does without. A
//! hemicube pyramid saves pixels where little accuracy is asked for, so it takes at least as long
//! as a hemicube of few pixels with the same list, whose making does not count here. Rays whose
//! candidates are a group's list go down a tree of these triangles alone. A list takes four bytes
//! for each entry, or packed as the smallest two by differences.

use std::{collections::BTreeMap, f32::consts::PI, ops::ControlFlow, time::Duration};

use clap::Parser;
use cpu_time::ThreadTime;
use glam::{Vec2, Vec3};
use serde::Serialize;
use sightline_compiler::{CompileOptions, LightMethod, compile, import::glb, model::Surface};
use sightline_oracle::Oracle;
use sightline_tests::bench_flags::BenchFlags;
use sightline_visibility::{
    box_visibility::{BoxScratch, BoxVisibility, Occluders},
    fuzzy::{FuzzyBuffer, PackedVisibility, PatchVisibility, Surfaces, ViewpointBox},
};
use sightline_world::{CellId, Mesh, World, geometry::Aabb};

/// Pixels along an edge of a hemicube, and of a coarse and a fine one.
const PIXELS: usize = 32;
const COARSE: usize = 8;
const FINE: usize = 128;
/// The rays that the compiler casts from a node.
const RAYS: usize = 512;
/// Elements along an edge of a face of the fuzzy buffer.
const ELEMENTS: usize = 128;
/// The distance between receivers, in metres, and how far they are lifted off their surface.
const STEP: f32 = 0.3;
const LIFT: f32 = 1.0e-3;
/// The widths of a group and of the groups below it, in metres.
const WIDTHS: [f32; 2] = [4.0, 2.0];
/// The budget of one test of two boxes, in units of work.
const BUDGET: u32 = 5_000;

/// Measures the cost of form factors.
#[derive(Parser)]
struct Args {
    /// The numbers of rooms of the buildings.
    #[arg(long, value_delimiter = ',', value_name = "N,N,...", default_value = "1,4,60,400")]
    rooms: Vec<usize>,
    /// How many groups are measured in each building.
    #[arg(long, value_name = "N", default_value_t = 6)]
    groups: usize,
    /// At most how many receivers are measured in each group below a group.
    #[arg(long, value_name = "N", default_value_t = 24)]
    receivers: usize,
    #[command(flatten)]
    flags: BenchFlags,
}

fn main() -> anyhow::Result<()> {
    let mut args = Args::parse();
    if !args.flags.bench {
        (args.rooms, args.groups, args.receivers) = (vec![1], 1, 2);
    }
    println!(
        "rooms triangles receivers | ms a receiver: all   fuzzy     box     PVS    rays  {RAYS} rays \
         | ratio: fuzzy box PVS rays | left: fuzzy box PVS | differs"
    );
    println!(
        "      | ms a receiver with fuzzy lists: {COARSE} pixels {PIXELS} pixels {FINE} pixels | with \
         lists of box visibility: the same | rays with its lists: rays, trees | bytes of a fuzzy list: \
         plain packed"
    );
    let mut rows = Vec::new();
    for rooms in &args.rooms {
        let row = measure(*rooms, &args)?;
        println!("{row}");
        rows.push(row);
    }
    args.flags.write(&rows)
}

/// The figures of one building. Times are milliseconds for each receiver.
#[derive(Serialize)]
struct FormFactorRow {
    rooms: usize,
    triangles: usize,
    receivers: usize,
    all_ms: f64,
    fuzzy_ms: f64,
    box_ms: f64,
    pvs_ms: f64,
    rays_ms: f64,
    compiler_rays_ms: f64,
    /// Hemicubes of [`COARSE`], [`PIXELS`] and [`FINE`] pixels, with lists by fuzzy projection and
    /// by box visibility. The making of lists does not count.
    fuzzy_by_pixels_ms: [f64; 3],
    box_by_pixels_ms: [f64; 3],
    /// As many rays as in `rays_ms`, among the triangles that box visibility leaves, and the making
    /// of trees of these.
    listed_rays_ms: f64,
    listed_trees_ms: f64,
    /// The bytes of a part's list by fuzzy projection, in the mean.
    list_bytes: f64,
    packed_bytes: f64,
    /// The shares of all triangles that lists leave.
    fuzzy_left: f64,
    box_left: f64,
    pvs_left: f64,
    /// The greatest difference of a form factor from that with all candidates, of any list.
    differs: f32,
    /// The same of rays.
    rays_differ: f32,
}

impl std::fmt::Display for FormFactorRow {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { all_ms, fuzzy_ms, box_ms, pvs_ms, rays_ms, .. } = self;
        let ratio = |ms: &f64| all_ms / ms;
        write!(
            f,
            "{:>5} {:>9} {:>9} | {all_ms:>18.3} {fuzzy_ms:>7.3} {box_ms:>7.3} {pvs_ms:>7.3} \
             {rays_ms:>7.3} {:>9.3} | {:>12.2} {:.2} {:.2} {:.2} | {:>8.3} {:.3} {:.3} | {:.1e} {:.1e}",
            self.rooms,
            self.triangles,
            self.receivers,
            self.compiler_rays_ms,
            ratio(fuzzy_ms),
            ratio(box_ms),
            ratio(pvs_ms),
            ratio(rays_ms),
            self.fuzzy_left,
            self.box_left,
            self.pvs_left,
            self.differs,
            self.rays_differ
        )?;
        let three = |[a, b, c]: &[f64; 3]| format!("{a:.3} {b:.3} {c:.3}");
        write!(
            f,
            "\n      | {} | {} | {:.3} {:.3} | {:.0} {:.0}",
            three(&self.fuzzy_by_pixels_ms),
            three(&self.box_by_pixels_ms),
            self.listed_rays_ms,
            self.listed_trees_ms,
            self.list_bytes,
            self.packed_bytes
        )
    }
}

/// A point that receives light.
#[derive(Clone, Copy)]
struct Receiver {
    at: Vec3,
    normal: Vec3,
}

/// Receivers of one space in one cube, by its parts.
type Group = BTreeMap<[i32; 3], Vec<Receiver>>;

fn measure(rooms: usize, args: &Args) -> anyhow::Result<FormFactorRow> {
    let model = glb::read_slice(&sightline_demo_building::glb(rooms, 1), None, "demo")?;
    let options =
        CompileOptions { voxel: Some(0.5), light: LightMethod::None, ..CompileOptions::default() };
    let (world, _) = compile(&model, &options, &|_, _| ControlFlow::Continue(()))?;
    let triangles = &model.opaque;
    let mut polygons = Vec::new();
    for (number, surface) in model.surfaces.iter().enumerate().filter(|(_, s)| !s.material.glass) {
        for _ in surface.corners() {
            let first = 3 * polygons.len() as u32;
            polygons.push((number as u32, vec![first, first + 1, first + 2]));
        }
    }
    anyhow::ensure!(polygons.len() == triangles.len(), "all opaque triangles are drawn");
    let surfaces = Surfaces::new(triangles.as_flattened(), &polygons)?;
    let lists = Lists::new(&world, triangles);
    let occluders = Occluders::new(&world);
    let oracle = Oracle::new(&world.mesh);
    let groups = groups(&world, &oracle, &model.surfaces);
    let chosen = groups.len().div_ceil(args.groups.max(1)).max(1);
    let mut sums = Sums::default();
    let all: Vec<u32> = (0..triangles.len() as u32).collect();
    for group in groups.values().step_by(chosen) {
        let whole = bounds(group.values().flatten());
        let (above, time) =
            timed(|| find_hidden(&surfaces, &whole, vec![PatchVisibility::Remaining; all.len()]));
        sums.fuzzy += time;
        for part in group.values() {
            let around = bounds(part.iter());
            let (classes, time) = timed(|| find_hidden(&surfaces, &around, above.clone()));
            sums.fuzzy += time;
            let (fuzzy, time) = timed(|| remaining(&classes));
            sums.fuzzy += time;
            sums.list_bytes += 4 * fuzzy.len();
            sums.packed_bytes += PackedVisibility::new(&classes, None).len();
            let own = world.cells.axes.own_box(&around);
            let (boxes, time) = timed(|| lists.by_box_visibility(&world, &occluders, &own));
            sums.boxes += time;
            let (pvs, time) = timed(|| lists.by_pvs(&world, &own));
            sums.pvs += time;
            let (listed, time) = timed(|| Oracle::new(&mesh_of(triangles, &boxes)));
            sums.listed_trees += time;
            let some = part.len().div_ceil(args.receivers).max(1);
            // A group's lists serve all of its receivers, of which some are measured.
            let scale = |list: &mut Duration, time: Duration| *list += time * some as u32;
            for receiver in part.iter().step_by(some) {
                let (truth, time) = timed(|| hemicube::<PIXELS>(triangles, &all, receiver));
                scale(&mut sums.all, time);
                for (list, sum) in
                    [(&fuzzy, &mut sums.fuzzy), (&boxes, &mut sums.boxes), (&pvs, &mut sums.pvs)]
                {
                    let (factors, time) = timed(|| hemicube::<PIXELS>(triangles, list, receiver));
                    scale(sum, time);
                    sums.differs = sums.differs.max(difference(&truth, &factors));
                }
                for (list, sums) in
                    [(&fuzzy, &mut sums.fuzzy_by_pixels), (&boxes, &mut sums.box_by_pixels)]
                {
                    let hemicubes = [hemicube::<COARSE>, hemicube::<PIXELS>, hemicube::<FINE>];
                    for (draw, sum) in hemicubes.into_iter().zip(sums) {
                        scale(sum, timed(|| draw(triangles, list, receiver)).1);
                    }
                }
                scale(&mut sums.listed_rays, timed(|| by_rays(&listed, receiver)).1);
                let (factors, time) = timed(|| by_rays(&oracle, receiver));
                scale(&mut sums.rays, time);
                sums.rays_differ = sums.rays_differ.max(difference(&truth, &factors));
                sums.receivers += some;
            }
            sums.lists += 1;
            for (left, list) in sums.left.iter_mut().zip([&fuzzy, &boxes, &pvs]) {
                *left += list.len() as f64 / all.len() as f64;
            }
        }
    }
    let ms = |time: Duration| time.as_secs_f64() * 1.0e3 / sums.receivers.max(1) as f64;
    let [fuzzy_left, box_left, pvs_left] = sums.left.map(|left| left / f64::from(sums.lists));
    let directions = (PIXELS * PIXELS * 3) as f64;
    Ok(FormFactorRow {
        rooms,
        triangles: triangles.len(),
        receivers: sums.receivers,
        all_ms: ms(sums.all),
        fuzzy_ms: ms(sums.fuzzy),
        box_ms: ms(sums.boxes),
        pvs_ms: ms(sums.pvs),
        rays_ms: ms(sums.rays),
        compiler_rays_ms: ms(sums.rays) * RAYS as f64 / directions,
        fuzzy_by_pixels_ms: sums.fuzzy_by_pixels.map(ms),
        box_by_pixels_ms: sums.box_by_pixels.map(ms),
        listed_rays_ms: ms(sums.listed_rays),
        listed_trees_ms: ms(sums.listed_trees),
        list_bytes: sums.list_bytes as f64 / f64::from(sums.lists),
        packed_bytes: sums.packed_bytes as f64 / f64::from(sums.lists),
        fuzzy_left,
        box_left,
        pvs_left,
        differs: sums.differs,
        rays_differ: sums.rays_differ,
    })
}

#[derive(Default)]
struct Sums {
    all: Duration,
    fuzzy: Duration,
    boxes: Duration,
    pvs: Duration,
    rays: Duration,
    fuzzy_by_pixels: [Duration; 3],
    box_by_pixels: [Duration; 3],
    listed_rays: Duration,
    listed_trees: Duration,
    list_bytes: usize,
    packed_bytes: usize,
    receivers: usize,
    lists: u32,
    left: [f64; 3],
    differs: f32,
    rays_differ: f32,
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = ThreadTime::now();
    let done = work();
    (done, start.elapsed())
}

/// Receivers on the surfaces that are not inside something solid, in groups by space and place.
fn groups(
    world: &World,
    oracle: &Oracle,
    surfaces: &[Surface],
) -> BTreeMap<(u32, [i32; 3]), Group> {
    let mut groups: BTreeMap<(u32, [i32; 3]), Group> = BTreeMap::new();
    let corners = surfaces.iter().filter(|s| !s.material.glass).flat_map(Surface::corners);
    for [a, b, c] in corners {
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let [across, down] = [b - a, c - a].map(|edge| (edge.length() / STEP).ceil() as usize);
        for (i, j) in (0..across).flat_map(|i| (0..down).map(move |j| (i, j))) {
            let (u, v) = ((i as f32 + 0.5) / across as f32, (j as f32 + 0.5) / down as f32);
            let at = a + (b - a) * u + (c - a) * v + normal * LIFT;
            if u + v >= 1.0 {
                continue;
            }
            // Inside something solid, the nearest surface shows its back.
            let is_buried = oracle.first_hit(at, normal).is_some_and(|hit| !hit.is_front);
            let Some(CellId(cell)) = world.cells.at(at).filter(|_| !is_buried) else { continue };
            let space = world.cells.cells[cell as usize].space;
            let [whole, part] = WIDTHS.map(|width| (at / width).floor().as_ivec3().to_array());
            let group = groups.entry((space, whole)).or_default();
            group.entry(part).or_default().push(Receiver { at, normal });
        }
    }
    groups
}

fn bounds<'a>(receivers: impl Iterator<Item = &'a Receiver>) -> Aabb {
    Aabb::from_points(receivers.map(|receiver| receiver.at))
}

/// What no eye in a box sees, besides what is settled.
fn find_hidden(
    surfaces: &Surfaces,
    eyes: &Aabb,
    mut settled: Vec<PatchVisibility>,
) -> Vec<PatchVisibility> {
    let eyes = ViewpointBox::all_round(*eyes);
    FuzzyBuffer::new(surfaces, &eyes, ELEMENTS).find_hidden(surfaces, &mut settled);
    settled
}

fn remaining(classes: &[PatchVisibility]) -> Vec<u32> {
    (0..).zip(classes).filter(|(_, c)| **c != PatchVisibility::Invisible).map(|(i, _)| i).collect()
}

/// Some triangles as a mesh.
fn mesh_of(triangles: &[[Vec3; 3]], some: &[u32]) -> Mesh {
    let positions: Vec<Vec3> = some.iter().flat_map(|&number| triangles[number as usize]).collect();
    let corners = (0..some.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    Mesh { triangles: corners.collect(), positions }
}

/// The triangles of each cell and of each space.
struct Lists {
    of_cell: Vec<Vec<u32>>,
    of_space: Vec<Vec<u32>>,
    triangles: usize,
}

impl Lists {
    fn new(world: &World, triangles: &[[Vec3; 3]]) -> Self {
        let cells = &world.cells;
        let mut of_cell = vec![Vec::new(); cells.cells.len()];
        let mut of_space: Vec<Vec<u32>> = vec![Vec::new(); cells.spaces.len()];
        let mut touched = Vec::new();
        for (number, corners) in (0..).zip(triangles) {
            let own = Aabb::from_points(corners.map(|corner| cells.axes.own(corner))).grown(LIFT);
            touched.clear();
            cells.overlapping(&own, &mut touched);
            for CellId(cell) in &touched {
                of_cell[*cell as usize].push(number);
                let space = &mut of_space[cells.cells[*cell as usize].space as usize];
                if space.last() != Some(&number) {
                    space.push(number);
                }
            }
        }
        Self { of_cell, of_space, triangles: triangles.len() }
    }

    /// The triangles in the cells that can be seen from a box along own axes.
    fn by_pvs(&self, world: &World, own: &Aabb) -> Vec<u32> {
        let seen = world.cells.visible_from(own);
        self.united(seen.iter().map(|cell| &self.of_cell[cell as usize]))
    }

    /// The triangles in the spaces that a box may see, of those that the PVS holds.
    fn by_box_visibility(&self, world: &World, occluders: &Occluders, own: &Aabb) -> Vec<u32> {
        let mut spaces: Vec<u32> = (world.cells.visible_from(own).iter())
            .map(|cell| world.cells.cells[cell as usize].space)
            .collect();
        spaces.sort_unstable();
        spaces.dedup();
        let mut scratch = BoxScratch::default();
        spaces.retain(|space| {
            let bounds = &world.cells.spaces[*space as usize].bounds;
            let mut budget = BUDGET;
            let between = occluders.between(&mut scratch, own, bounds, &mut budget);
            between != BoxVisibility::Hidden
        });
        self.united(spaces.iter().map(|space| &self.of_space[*space as usize]))
    }

    fn united<'a>(&self, lists: impl Iterator<Item = &'a Vec<u32>>) -> Vec<u32> {
        let mut is_in = vec![false; self.triangles];
        lists.flatten().for_each(|triangle| is_in[*triangle as usize] = true);
        (0..).zip(is_in).filter(|(_, is_in)| *is_in).map(|(triangle, _)| triangle).collect()
    }
}

/// Form factors by triangle, ascending.
type Factors = Vec<(u32, f32)>;

/// The greatest difference of a form factor.
fn difference(one: &Factors, other: &Factors) -> f32 {
    let mut all: BTreeMap<u32, f32> = one.iter().copied().collect();
    other.iter().for_each(|(triangle, factor)| *all.entry(*triangle).or_default() -= factor);
    all.values().fold(0.0, |most, away| away.abs().max(most))
}

/// The five faces of a hemicube: across, up and ahead. Sides have their lower half cut off.
fn faces(normal: Vec3) -> [[Vec3; 3]; 5] {
    let (u, v) = normal.any_orthonormal_pair();
    [[u, v, normal], [v, normal, u], [-v, normal, -u], [-u, normal, v], [u, normal, -v]]
}

/// The place of a pixel on a face, from -1 to 1, and its form factor.
fn pixel<const PIXELS: usize>(is_top: bool, column: usize, row: usize) -> (Vec2, f32) {
    let place = (Vec2::new(column as f32, row as f32) + 0.5) * (2.0 / PIXELS as f32) - 1.0;
    let area = (2.0 / PIXELS as f32).powi(2);
    let height = if is_top { 1.0 } else { place.y };
    (place, height * area / (PI * (place.length_squared() + 1.0).powi(2)))
}

fn is_above<const PIXELS: usize>(is_top: bool, row: usize) -> bool {
    is_top || row >= PIXELS / 2
}

/// Form factors by one ray for each pixel of a hemicube.
fn by_rays(oracle: &Oracle, receiver: &Receiver) -> Factors {
    let mut items = vec![u32::MAX; 5 * PIXELS * PIXELS];
    for (number, [across, up, ahead]) in faces(receiver.normal).into_iter().enumerate() {
        for (i, item) in items[number * PIXELS * PIXELS..][..PIXELS * PIXELS].iter_mut().enumerate()
        {
            let (column, row) = (i % PIXELS, i / PIXELS);
            if is_above::<PIXELS>(number == 0, row) {
                let (place, _) = pixel::<PIXELS>(number == 0, column, row);
                let along = (across * place.x + up * place.y + ahead).normalize();
                *item = oracle.first_hit(receiver.at, along).map_or(u32::MAX, |hit| hit.triangle);
            }
        }
    }
    factors_of::<PIXELS>(&items)
}

/// Form factors by drawing triangles on a hemicube.
fn hemicube<const PIXELS: usize>(
    triangles: &[[Vec3; 3]],
    candidates: &[u32],
    receiver: &Receiver,
) -> Factors {
    let mut items = vec![u32::MAX; 5 * PIXELS * PIXELS];
    let mut depths = vec![0.0f32; 5 * PIXELS * PIXELS];
    let faces = faces(receiver.normal);
    let mut corners: Vec<Vec3> = Vec::new();
    let mut spare: Vec<Vec3> = Vec::new();
    for &candidate in candidates {
        let relative = triangles[candidate as usize].map(|corner| corner - receiver.at);
        if relative.iter().all(|corner| corner.dot(receiver.normal) <= 0.0) {
            continue;
        }
        for (number, axes) in faces.iter().enumerate() {
            corners.clear();
            corners
                .extend(relative.map(|corner| Vec3::from_array(axes.map(|axis| axis.dot(corner)))));
            if !clip_to_face(&mut corners, &mut spare, number == 0) {
                continue;
            }
            let face = number * PIXELS * PIXELS;
            draw::<PIXELS>(&corners, candidate, &mut items[face..], &mut depths[face..]);
        }
    }
    factors_of::<PIXELS>(&items)
}

/// Clips a polygon to what a face shows. Tells whether something is left.
fn clip_to_face(corners: &mut Vec<Vec3>, spare: &mut Vec<Vec3>, is_top: bool) -> bool {
    let low = if is_top { Vec3::new(0.0, 1.0, 1.0) } else { Vec3::Y };
    let sides = [
        Vec3::Z,
        Vec3::new(1.0, 0.0, 1.0),
        Vec3::new(-1.0, 0.0, 1.0),
        Vec3::new(0.0, -1.0, 1.0),
        low,
    ];
    if sides.iter().any(|side| corners.iter().all(|corner| side.dot(*corner) <= 0.0)) {
        return false;
    }
    for side in sides {
        let nearest = if side == Vec3::Z { 1.0e-4 } else { 0.0 };
        spare.clear();
        for (i, &to) in corners.iter().enumerate() {
            let from = corners[(i + corners.len() - 1) % corners.len()];
            let (before, after) = (side.dot(from) - nearest, side.dot(to) - nearest);
            if (before < 0.0) != (after < 0.0) {
                spare.push(from + (to - from) * (before / (before - after)));
            }
            if after >= 0.0 {
                spare.push(to);
            }
        }
        std::mem::swap(corners, spare);
    }
    corners.len() >= 3
}

/// Draws a clipped polygon on a face where it is nearest.
fn draw<const PIXELS: usize>(corners: &[Vec3], item: u32, items: &mut [u32], depths: &mut [f32]) {
    let normal = (1..corners.len() - 1)
        .map(|i| (corners[i] - corners[0]).cross(corners[i + 1] - corners[0]))
        .fold(
            Vec3::ZERO,
            |most, next| if next.length_squared() > most.length_squared() { next } else { most },
        );
    let offset = normal.dot(corners[0]);
    if offset == 0.0 {
        return;
    }
    let inverse = normal / offset;
    let half = 0.5 * PIXELS as f32;
    let place = |corner: &Vec3| (corner.truncate() / corner.z + 1.0) * half;
    let ends = |pick: fn(f32, f32) -> f32, from: f32| {
        corners.iter().map(|corner| place(corner).y).fold(from, pick)
    };
    let (low, high) = (ends(f32::min, f32::MAX), ends(f32::max, f32::MIN));
    for row in (low - 0.5).ceil().max(0.0) as usize..(high + 0.5).floor().min(2.0 * half) as usize {
        let y = row as f32 + 0.5;
        let (mut left, mut right) = (f32::INFINITY, f32::NEG_INFINITY);
        for (i, to) in corners.iter().enumerate() {
            let from = place(&corners[(i + corners.len() - 1) % corners.len()]);
            let to = place(to);
            if (from.y <= y) != (to.y <= y) {
                let x = from.x + (to.x - from.x) * (y - from.y) / (to.y - from.y);
                (left, right) = (left.min(x), right.max(x));
            }
        }
        if left > right {
            continue;
        }
        let columns = (left - 0.5).ceil().max(0.0) as usize
            ..((right - 0.5).ceil().max(0.0) as usize).min(PIXELS);
        for column in columns {
            let at = Vec2::new(column as f32 + 0.5, y) / half - 1.0;
            let nearness = inverse.dot(at.extend(1.0));
            let pixel = row * PIXELS + column;
            if nearness > depths[pixel] {
                (depths[pixel], items[pixel]) = (nearness, item);
            }
        }
    }
}

fn factors_of<const PIXELS: usize>(items: &[u32]) -> Factors {
    let mut sums: BTreeMap<u32, f32> = BTreeMap::new();
    for (i, item) in items.iter().enumerate().filter(|(_, item)| **item != u32::MAX) {
        let (face, place) = (i / (PIXELS * PIXELS), i % (PIXELS * PIXELS));
        *sums.entry(*item).or_default() +=
            pixel::<PIXELS>(face == 0, place % PIXELS, place / PIXELS).1;
    }
    sums.into_iter().collect()
}
