//! What fuzzy projection saves a z-buffer, in the manner of Lim's Examples 1 to 4.
//!
//! ```text
//! cargo bench -p sightline-tests --bench fuzzy
//! ```
//!
//! One to four furnished rooms stand in a row, made of coarse or fine patches, with doorways
//! between them. Five nearby eyes in the first room look towards the others. The normal way draws
//! every patch of each view into a z-buffer, except those that face away or are out of view. The
//! other way first finds the patches that are invisible from the box around the eyes, and draws the
//! rest. The last columns also find the visible patches, which are drawn without a depth test. All
//! ways must give the same pictures. Times are CPU time of one thread for five views, the least of
//! several runs.
//!
//! There are two ratios of the normal way's time. The first divides by the time of drawing the rest
//! alone, as Lim does. In all his rows of two rooms and more, his time decreases with the share of
//! patches left out, within a hundredth, and the time to find them stands in a column of its own.
//! The second ratio includes that time, in his figures too.

use std::{fmt, time::Duration};

use clap::Parser;
use cpu_time::ThreadTime;
use glam::{Mat3, Vec2, Vec3};
use serde::Serialize;
use sightline_tests::bench_flags::BenchFlags;
use sightline_visibility::fuzzy::{
    FuzzyBuffer, PackedVisibility, PatchVisibility, Surfaces, ViewpointBox, classify,
};
use sightline_world::geometry::{Aabb, Frustum};

/// Half the field of view, in degrees, along both axes of the picture.
const HALF_ANGLE: f32 = 40.0;
/// The number of elements along each side of a face of the fuzzy buffer.
const ELEMENTS: usize = 400;

/// Measures fuzzy projection on furnished rooms.
#[derive(Parser)]
struct Args {
    /// The number of runs. The least time of a figure counts.
    #[arg(long, value_name = "N", default_value_t = 5)]
    runs: u32,
    #[command(flatten)]
    flags: BenchFlags,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let (sizes, runs, rooms) =
        if args.flags.bench { ([400, 1_000], args.runs.max(1), 4) } else { ([64, 100], 1, 2) };
    let heads = [
        ("pixels", 6),
        ("rooms", 6),
        ("in all", 8),
        ("invisible", 10),
        ("normal ms", 10),
        ("rest ms", 8),
        ("ratio", 7),
        ("Lim's", 6),
        ("sorting ms", 11),
        ("ratio", 7),
        ("Lim's", 6),
        ("visible", 8),
        ("sorting ms", 11),
        ("ratio", 7),
        ("bytes", 6),
    ];
    let heads = heads.map(|(head, width)| format!("{head:>width$}"));
    println!("patches {}", heads.join(" "));
    let mut rows = Vec::new();
    for (example, (is_fine, size)) in
        [(false, sizes[0]), (false, sizes[1]), (true, sizes[0]), (true, sizes[1])]
            .into_iter()
            .enumerate()
    {
        for rooms in 1..=rooms {
            let row = row(example, is_fine, size, rooms, runs)?;
            println!("{row}");
            rows.push(row);
        }
    }
    args.flags.write(&rows)
}

/// The figures of one scene. Times are milliseconds of CPU time for all views.
#[derive(Serialize)]
struct FuzzyRow {
    patches: &'static str,
    /// Pixels along each side of a picture.
    pixels: usize,
    rooms: usize,
    patches_in_all: usize,
    invisible: usize,
    normal_ms: f64,
    rest_ms: f64,
    ratio: f64,
    lim_ratio: Option<f32>,
    sorting_ms: f64,
    ratio_with_sorting: f64,
    lim_ratio_with_sorting: Option<f32>,
    visible: usize,
    sorting_both_ms: f64,
    ratio_with_sorting_both: f64,
    /// The size of the packed classes.
    bytes: usize,
}

impl fmt::Display for FuzzyRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:<7} {:>6} {:>6} {:>8} {:>10} {:>10.1} {:>8.1} {:>7.2} {:>6.2} {:>11.1} {:>7.2} \
             {:>6.2} {:>8} {:>11.1} {:>7.2} {:>6}",
            self.patches,
            self.pixels,
            self.rooms,
            self.patches_in_all,
            self.invisible,
            self.normal_ms,
            self.rest_ms,
            self.ratio,
            self.lim_ratio.unwrap_or(f32::NAN),
            self.sorting_ms,
            self.ratio_with_sorting,
            self.lim_ratio_with_sorting.unwrap_or(f32::NAN),
            self.visible,
            self.sorting_both_ms,
            self.ratio_with_sorting_both,
            self.bytes,
        )
    }
}

/// Lim's seconds for five views: the normal way, his way, and finding the patches; by example and
/// number of rooms.
const LIM: [[[f32; 3]; 4]; 4] = [
    [[11.2, 11.1, 1.2], [21.8, 17.3, 2.1], [35.7, 23.9, 2.9], [46.3, 25.6, 3.6]],
    [[20.7, 20.7, 1.2], [40.8, 32.4, 2.1], [56.4, 37.8, 2.9], [f32::NAN; 3]],
    [[25.0, 24.1, 2.0], [41.1, 25.0, 2.5], [60.6, 29.1, 3.4], [80.7, 33.8, 4.6]],
    [[42.0, 40.5, 2.0], [75.9, 45.4, 2.5], [111.3, 53.8, 3.4], [148.3, 61.9, 4.6]],
];

fn row(
    example: usize,
    is_fine: bool,
    size: usize,
    rooms: usize,
    runs: u32,
) -> anyhow::Result<FuzzyRow> {
    let scene = RoomScene::rooms(rooms, is_fine);
    let surfaces = Surfaces::new(&scene.corners, &scene.polygons)?;
    let around = Aabb::around(Vec3::new(1.2, 1.6, 2.0), 0.1);
    let cameras: Vec<FixedCamera> =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [0.5, 1.0, -1.0]]
            .map(|at| FixedCamera { eye: around.centre() + Vec3::from(at) * 0.1, size })
            .into();
    // A yaw of -90 degrees looks along x.
    let angle = 2.0 * HALF_ANGLE.to_radians();
    let view = Frustum::new(-std::f32::consts::FRAC_PI_2, 0.0, angle, angle);
    let eyes = ViewpointBox::within(around, &view);
    let everything = vec![PatchVisibility::Remaining; surfaces.len()];
    let [mut sorting, mut normal, mut ours, mut sorting_both, mut with_both] = [Duration::MAX; 5];
    let (mut classes, mut both) = (everything.clone(), Vec::new());
    let mut ways = [(); 3].map(|()| cameras.iter().map(ZBuffer::new).collect::<Vec<_>>());
    for _ in 0..runs {
        let start = ThreadTime::now();
        classes.fill(PatchVisibility::Remaining);
        FuzzyBuffer::new(&surfaces, &eyes, ELEMENTS).find_hidden(&surfaces, &mut classes);
        sorting = sorting.min(start.elapsed());
        normal = normal.min(draw(&scene, &mut ways[0], &everything));
        ours = ours.min(draw(&scene, &mut ways[1], &classes));
        // Once more, with the visible patches found too.
        let start = ThreadTime::now();
        both = classify(&surfaces, &eyes, ELEMENTS, None);
        sorting_both = sorting_both.min(start.elapsed());
        with_both = with_both.min(draw(&scene, &mut ways[2], &both));
        let picture = |view: &ZBuffer| view.picture.clone();
        let [one, other, third] = [0, 1, 2].map(|way| ways[way].iter().map(picture));
        anyhow::ensure!(one.clone().eq(other) && one.eq(third), "the pictures differ");
    }
    let count = |classes: &[PatchVisibility], class: PatchVisibility| {
        classes.iter().filter(|of| **of == class).count()
    };
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    let ratio = |time: Duration| ms(normal) / ms(time);
    let [his_normal, his, his_sorting] = LIM[example][rooms - 1];
    // Lim has no figures for the last row of his second example.
    let known = |ratio: f32| ratio.is_finite().then_some(ratio);
    Ok(FuzzyRow {
        patches: if is_fine { "fine" } else { "coarse" },
        pixels: size,
        rooms,
        patches_in_all: surfaces.len(),
        invisible: count(&classes, PatchVisibility::Invisible),
        normal_ms: ms(normal),
        rest_ms: ms(ours),
        ratio: ratio(ours),
        lim_ratio: known(his_normal / his),
        sorting_ms: ms(sorting),
        ratio_with_sorting: ratio(sorting + ours),
        lim_ratio_with_sorting: known(his_normal / (his + his_sorting)),
        visible: count(&both, PatchVisibility::Visible),
        sorting_both_ms: ms(sorting_both),
        ratio_with_sorting_both: ratio(sorting_both + with_both),
        bytes: PackedVisibility::new(&both, None).len(),
    })
}

/// An eye that looks along x.
struct FixedCamera {
    eye: Vec3,
    size: usize,
}

/// Draws the patches of a scene in each view.
fn draw(scene: &RoomScene, views: &mut [ZBuffer], classes: &[PatchVisibility]) -> Duration {
    let start = ThreadTime::now();
    views.iter_mut().for_each(|view| view.draw(scene, classes));
    start.elapsed()
}

struct ZBuffer<'a> {
    camera: &'a FixedCamera,
    /// The inverse depth of each pixel: it is linear in the picture.
    depths: Vec<f32>,
    /// The nearest patch of each pixel; `u32::MAX` where there is none.
    picture: Vec<u32>,
    polygon: Vec<Vec3>,
    spare: Vec<Vec3>,
    places: Vec<Vec2>,
}

impl<'a> ZBuffer<'a> {
    fn new(camera: &'a FixedCamera) -> Self {
        let pixels = camera.size * camera.size;
        Self {
            camera,
            depths: vec![0.0; pixels],
            picture: vec![u32::MAX; pixels],
            polygon: Vec::new(),
            spare: Vec::new(),
            places: Vec::new(),
        }
    }

    fn draw(&mut self, scene: &RoomScene, classes: &[PatchVisibility]) {
        self.depths.fill(0.0);
        self.picture.fill(u32::MAX);
        for (patch, class) in classes.iter().enumerate() {
            match class {
                PatchVisibility::Invisible => {}
                PatchVisibility::Visible => self.fill::<false>(scene, patch),
                PatchVisibility::Remaining => self.fill::<true>(scene, patch),
            }
        }
    }

    /// Draws a patch, with or without a depth test.
    fn fill<const TEST: bool>(&mut self, scene: &RoomScene, patch: usize) {
        let eye = self.camera.eye;
        let corner = |i: &u32| scene.corners[*i as usize] - eye;
        let indices = &scene.polygons[patch].1;
        let normal = scene.normals[patch];
        let offset = normal.dot(corner(&indices[0]));
        if offset >= 0.0 {
            return;
        }
        // Axes: to the right, down, ahead.
        let to_camera = Mat3::from_cols(Vec3::Z, Vec3::NEG_Y, Vec3::X).transpose();
        self.polygon.clear();
        self.polygon.extend(indices.iter().map(|i| to_camera * corner(i)));
        let slope = HALF_ANGLE.to_radians().tan();
        for side in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            self.clip(Vec2::from(side).extend(slope));
        }
        self.clip(Vec3::Z);
        if self.polygon.len() < 3 {
            return;
        }
        let scale = 0.5 * self.camera.size as f32;
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        places.extend(self.polygon.iter().map(|p| (p.truncate() / (p.z * slope) + 1.0) * scale));
        let plane = to_camera * normal / offset;
        let at = |x: f32, y: f32| {
            let way = (Vec2::new(x, y) / scale - 1.0) * slope;
            plane.dot(way.extend(1.0))
        };
        let step = at(1.0, 0.0) - at(0.0, 0.0);
        let low = places.iter().map(|p| p.y).fold(f32::INFINITY, f32::min);
        let high = places.iter().map(|p| p.y).fold(f32::NEG_INFINITY, f32::max);
        let size = self.camera.size;
        for row in
            (low - 0.5).ceil().max(0.0) as usize..(high + 0.5).floor().min(size as f32) as usize
        {
            let y = row as f32 + 0.5;
            let (mut left, mut right) = (f32::INFINITY, f32::NEG_INFINITY);
            for (i, to) in places.iter().enumerate() {
                let from = places[(i + places.len() - 1) % places.len()];
                if (from.y <= y) != (to.y <= y) {
                    // Both patches that share the edge get the same result, so they share no pixel.
                    let (from, to) = if from.y < to.y { (from, *to) } else { (*to, from) };
                    let x = from.x + (to.x - from.x) * (y - from.y) / (to.y - from.y);
                    (left, right) = (left.min(x), right.max(x));
                }
            }
            if left > right {
                continue;
            }
            let (first, last) =
                ((left - 0.5).ceil().max(0.0) as usize, (right - 0.5).ceil().max(0.0) as usize);
            let last = last.min(size);
            if first >= last {
                continue;
            }
            let (start, of) = (at(first as f32 + 0.5, y), patch as u32);
            let depths = &mut self.depths[row * size + first..row * size + last];
            let picture = &mut self.picture[row * size + first..row * size + last];
            for (i, (depth, pixel)) in depths.iter_mut().zip(picture).enumerate() {
                let inverse = start + step * i as f32;
                let is_nearer = !TEST || inverse > *depth;
                (*depth, *pixel) = if is_nearer { (inverse, of) } else { (*depth, *pixel) };
            }
        }
        self.places = places;
    }

    /// Keeps the part of the polygon on the positive side of a plane through the eye.
    fn clip(&mut self, plane: Vec3) {
        self.spare.clear();
        for (i, &to) in self.polygon.iter().enumerate() {
            let from = self.polygon[(i + self.polygon.len() - 1) % self.polygon.len()];
            let (low, high) = (plane.dot(from), plane.dot(to));
            if (low < 0.0) != (high < 0.0) {
                // Both patches that share the edge get the same point.
                self.spare.push(if low < high {
                    from.lerp(to, low / (low - high))
                } else {
                    to.lerp(from, high / (high - low))
                });
            }
            if high >= 0.0 {
                self.spare.push(to);
            }
        }
        std::mem::swap(&mut self.polygon, &mut self.spare);
    }
}

/// Patches whose corners go anticlockwise as seen from the front.
#[derive(Default)]
struct RoomScene {
    corners: Vec<Vec3>,
    normals: Vec<Vec3>,
    polygons: Vec<(u32, Vec<u32>)>,
    surfaces: u32,
}

/// The length, height and width of a room, in metres; and the height and width of its doorway.
const ROOM: Vec3 = Vec3::new(6.0, 3.0, 5.0);
const DOORWAY: [f32; 2] = [2.0, 1.0];

impl RoomScene {
    /// Furnished rooms in a row along x.
    fn rooms(count: usize, is_fine: bool) -> Self {
        let mut scene = Self::default();
        for room in 0..count {
            let from = Vec3::X * (room as f32 * (ROOM.x + 0.2));
            scene.shell(from, [room > 0, room + 1 < count], if is_fine { 0.125 } else { 0.25 });
            scene.furnish(from, if is_fine { 3 } else { 2 });
        }
        scene
    }

    /// Floor, ceiling and walls of a room as one surface. Each wall across x may have a doorway;
    /// the second one has jambs.
    fn shell(&mut self, from: Vec3, doorways: [bool; 2], step: f32) {
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * ROOM);
        let whole = |_: Vec3| true;
        let open = |is_open: bool| {
            move |at: Vec3| {
                let aside = (at.z - from.z - 0.5 * ROOM.z).abs();
                !is_open || at.y > DOORWAY[0] || aside > 0.5 * DOORWAY[1]
            }
        };
        self.grid(from, z, x, step, whole);
        self.grid(from + y, x, z, step, whole);
        self.grid(from, x, y, step, whole);
        self.grid(from + z, y, x, step, whole);
        self.grid(from, y, z, step, open(doorways[0]));
        self.grid(from + x, z, y, step, open(doorways[1]));
        self.surfaces += 1;
        if doorways[1] {
            let [deep, high, wide] = [Vec3::X * 0.2, Vec3::Y * DOORWAY[0], Vec3::Z * DOORWAY[1]];
            let at = from + x + (z - wide) * 0.5;
            self.grid(at, wide, deep, step, whole);
            self.grid(at + high, deep, wide, step, whole);
            self.grid(at, deep, high, step, whole);
            self.grid(at + wide, high, deep, step, whole);
            self.surfaces += 1;
        }
    }

    /// Tables with balls on them, chairs and cupboards. The balls have many patches.
    fn furnish(&mut self, from: Vec3, detail: u32) {
        let step = 0.3 / detail as f32;
        for (i, at) in [[1.6, 1.0], [4.4, 1.0], [1.6, 4.0], [4.4, 4.0]].into_iter().enumerate() {
            let at = from + Vec3::new(at[0], 0.0, at[1]);
            self.slab(at + Vec3::new(-0.6, 0.7, -0.4), Vec3::new(1.2, 0.05, 0.8), step);
            for (x, z) in [(-0.55, -0.35), (0.5, -0.35), (-0.55, 0.3), (0.5, 0.3)] {
                self.slab(at + Vec3::new(x, 0.0, z), Vec3::new(0.05, 0.7, 0.05), step);
            }
            let parts = 10 * detail + 4 * (i as u32 % 2);
            self.ball(at + Vec3::new(0.2, 0.95, 0.0), 0.2, parts);
            self.ball(at + Vec3::new(-0.3, 0.87, 0.1), 0.12, parts);
        }
        for x in [0.3, 5.1] {
            self.slab(
                from + Vec3::new(x, 0.0, 2.0 - 1.6 * (x - 0.3) / 4.8),
                Vec3::new(0.5, 1.9, 1.0),
                step,
            );
        }
        for at in [[2.9, 0.5, 2.0], [3.1, 2.2, 3.9], [0.6, 0.4, 4.4]] {
            self.ball(from + Vec3::from(at), 0.4, 16 * detail);
        }
    }

    /// A flat grid of squares from a corner, facing `across` × `down`. Squares with an unwanted
    /// centre are left out.
    fn grid(
        &mut self,
        from: Vec3,
        across: Vec3,
        down: Vec3,
        step: f32,
        wants: impl Fn(Vec3) -> bool,
    ) {
        let [columns, rows] =
            [across, down].map(|way| (way.length() / step).round().max(1.0) as u32);
        let at = |i: u32, j: u32| {
            from + across * (i as f32 / columns as f32) + down * (j as f32 / rows as f32)
        };
        let normal = across.cross(down).normalize();
        for j in 0..rows {
            for i in 0..columns {
                let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                if wants((corners[0] + corners[2]) * 0.5) {
                    self.patch(&corners, normal);
                }
            }
        }
    }

    fn patch(&mut self, corners: &[Vec3], normal: Vec3) {
        let first = self.corners.len() as u32;
        self.corners.extend(corners);
        self.normals.push(normal);
        self.polygons.push((self.surfaces, (first..first + corners.len() as u32).collect()));
    }

    fn slab(&mut self, from: Vec3, size: Vec3, step: f32) {
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * size);
        let whole = |_: Vec3| true;
        self.grid(from, x, z, step, whole);
        self.grid(from + y, z, x, step, whole);
        self.grid(from, y, x, step, whole);
        self.grid(from + z, x, y, step, whole);
        self.grid(from, z, y, step, whole);
        self.grid(from + x, y, z, step, whole);
        self.surfaces += 1;
    }

    fn ball(&mut self, middle: Vec3, radius: f32, parts: u32) {
        let at = |i: u32, j: u32| {
            let around = (i % parts) as f32 / parts as f32 * std::f32::consts::TAU;
            let down = j as f32 / (parts / 2) as f32 * std::f32::consts::PI;
            let level = if j == 0 || j == parts / 2 { 0.0 } else { down.sin() };
            middle + radius * Vec3::new(around.cos() * level, down.cos(), around.sin() * level)
        };
        for j in 0..parts / 2 {
            for i in 0..parts {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                for corners in [[a, b, c], [a, c, d]] {
                    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                    if normal.length() > 1e-9 {
                        self.patch(&corners, normal.normalize());
                    }
                }
            }
        }
        self.surfaces += 1;
    }
}
