//! Random rooms against sight lines: whatever a line shows by the author's rules, the index shows.

use glam::{DVec3, Vec2, Vec3};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_visibility::rooms::RoomIndex;
use sightline_world::{
    CellId, Cells, Node, World,
    geometry::Aabb,
    rooms::{Object, ObjectSet, Room, RoomId, RoomVisibility, Rooms, Shape, Window},
};

use crate::stage::{EVERYTHING, may_see, world};

/// A room of the reference model: a turned box, or an L of two, with openings in its walls.
struct Naive {
    boxes: Vec<Turned>,
    openings: Vec<Opening>,
    room: Room,
}

/// A box turned about the vertical through its centre.
#[derive(Clone, Copy)]
struct Turned {
    centre: Vec3,
    half: Vec3,
    turn: f32,
}

/// An opening: a parallelogram, and the opening behind which it is seen from outside, if it is.
struct Opening {
    corner: DVec3,
    sides: [DVec3; 2],
    outwards: DVec3,
    behind: Option<usize>,
}

impl Turned {
    fn out(&self, local: Vec3) -> Vec3 {
        let (s, c) = self.turn.sin_cos();
        self.centre + Vec3::new(c * local.x + s * local.z, local.y, c * local.z - s * local.x)
    }

    fn contains(&self, point: Vec3) -> bool {
        let (s, c) = self.turn.sin_cos();
        let p = point - self.centre;
        let local = Vec3::new(c * p.x - s * p.z, p.y, s * p.x + c * p.z);
        local.abs().cmple(self.half).all()
    }

    /// Whether a line between two points passes through the box.
    fn is_crossed(&self, from: Vec3, to: Vec3) -> bool {
        let (s, c) = self.turn.sin_cos();
        let local = |point: Vec3| {
            let p = point - self.centre;
            Vec3::new(c * p.x - s * p.z, p.y, s * p.x + c * p.z)
        };
        let (from, way) = (local(from), local(to) - local(from));
        let (mut enters, mut leaves) = (0.0_f32, 1.0_f32);
        for axis in 0..3 {
            let ends = [-1.0, 1.0].map(|side| (side * self.half[axis] - from[axis]) / way[axis]);
            enters = enters.max(ends[0].min(ends[1]));
            leaves = leaves.min(ends[0].max(ends[1]));
        }
        enters < leaves
    }

    fn corners(&self) -> Vec<Vec3> {
        Aabb::new(-self.half, self.half).corners().iter().map(|at| self.out(*at)).collect()
    }

    fn shape(&self, rng: &mut SmallRng) -> Shape {
        let corner = |x: f32, z: f32| {
            let at = self.out(Vec3::new(x * self.half.x, 0.0, z * self.half.z));
            Vec2::new(at.x, at.z)
        };
        let heights = [self.centre.y - self.half.y, self.centre.y + self.half.y];
        if rng.random_bool(0.5) {
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            let corners = corners.map(|(x, z)| corner(x, z)).to_vec();
            Shape::Plan { corners, heights: Some(heights) }
        } else {
            Shape::Hull(self.corners())
        }
    }
}

impl Opening {
    /// The share of a line's length at which it passes the opening, and whether it goes outwards.
    fn crossed(&self, from: DVec3, to: DVec3) -> Option<(f64, bool)> {
        let normal = self.sides[0].cross(self.sides[1]);
        let [a, b] = [from, to].map(|at| normal.dot(at - self.corner));
        if a == b || (a > 0.0) == (b > 0.0) {
            return None;
        }
        let share = a / (a - b);
        let at = from.lerp(to, share) - self.corner;
        let along = |side: DVec3| at.dot(side) / side.length_squared();
        let inside = self.sides.iter().all(|side| (0.0..=1.0).contains(&along(*side)));
        inside.then(|| (share, (to - from).dot(self.outwards) > 0.0))
    }
}

impl Naive {
    fn contains(&self, point: Vec3) -> bool {
        self.boxes.iter().any(|part| part.contains(point))
    }

    /// Whether a line shows its end by this room's windows, level by level.
    fn shows(&self, from: DVec3, to: DVec3) -> bool {
        let first = (0..self.openings.len()).filter(|at| self.openings[*at].behind.is_none());
        first.into_iter().any(|at| self.goes_out(at, from, to))
    }

    /// Whether the room is opaque, and a line between two points outside comes in through its wall.
    fn stops(&self, from: Vec3, to: Vec3) -> bool {
        let comes_in = |opening: &Opening| {
            let crossed = opening.crossed(from.as_dvec3(), to.as_dvec3());
            crossed.is_some_and(|(_, outwards)| !outwards)
        };
        self.room.opaque
            && !self.contains(from)
            && !self.contains(to)
            && self.boxes.iter().any(|part| part.is_crossed(from, to))
            && !self.openings.iter().any(comes_in)
    }

    fn goes_out(&self, at: usize, from: DVec3, to: DVec3) -> bool {
        let crossed = |at: usize| self.openings[at].crossed(from, to);
        let behind = |at: usize| {
            (0..self.openings.len()).filter(move |child| self.openings[*child].behind == Some(at))
        };
        let comes_in = |child: &usize| crossed(*child).is_some_and(|(_, outwards)| !outwards);
        crossed(at).is_some_and(|(_, outwards)| outwards)
            && !behind(at)
                .filter(comes_in)
                .any(|child| !behind(child).any(|out| self.goes_out(out, from, to)))
    }
}

/// A scene: rooms, objects, and a world of cells that all see each other.
struct Scene {
    rooms: Vec<Naive>,
    objects: Vec<Aabb>,
    world: World,
    index: RoomIndex,
    /// The same rooms, none of which is opaque.
    without_opaque: RoomIndex,
}

impl Scene {
    fn new(seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let count = rng.random_range(1..=5);
        let mut rooms: Vec<Naive> = (0..count).map(|i| naive(&mut rng, i)).collect();
        let objects: Vec<Aabb> = (0..3)
            .map(|_| Aabb::around(point(&mut rng, 12.0), rng.random_range(0.5..4.0)))
            .collect();
        for naive in &mut rooms {
            naive.room.sees = sees(&mut rng, count);
            naive.room.sealed = rng.random_bool(0.2);
            naive.room.opaque = rng.random_bool(0.3);
        }
        let list = rooms.iter().map(|naive| naive.room.clone()).collect();
        let named = objects.iter().zip(0..).map(|(bounds, i)| Object {
            name: format!("object {i}"),
            bounds: *bounds,
            mover: None,
        });
        let built = Rooms::new(list, named.collect()).unwrap();
        let turn = if rng.random_bool(0.5) { 0.0 } else { rng.random_range(-0.7..0.7) };
        let mut world = world(built, turn);
        if rng.random_bool(0.7) {
            world.cells = quartered(&world.cells, &mut rng);
        }
        let index = RoomIndex::new(&world);
        let clear = world.rooms.list().iter().map(|room| Room { opaque: false, ..room.clone() });
        let clear = Rooms::new(clear.collect(), world.rooms.objects().to_vec()).unwrap();
        let without_opaque = RoomIndex::of(&clear, &world.cells);
        Self { rooms, objects, world, index, without_opaque }
    }

    fn may_see_in_cells(&self, eyes: Aabb, body: Aabb) -> bool {
        let overlap = |region: Aabb| {
            let mut found = Vec::new();
            self.world.cells.overlapping(&region, &mut found);
            self.index.overlap_in_cells(&self.world.cells, &[region], &found)
        };
        self.index.may_see(&overlap(eyes), &overlap(body))
    }

    fn rooms_at(&self, point: Vec3) -> Vec<usize> {
        (0..self.rooms.len()).filter(|at| self.rooms[*at].contains(point)).collect()
    }

    /// Whether the author's rules let an eye see a point, both in own axes.
    fn shows(&self, eye: Vec3, body: Vec3) -> bool {
        let cell = self.world.cells.at_own(body);
        let [eye, body] = [eye, body].map(|at| self.world.cells.axes.world(at));
        let [at_eye, at_body] = [eye, body].map(|at| self.rooms_at(at));
        let sealed = |rooms: &[usize]| -> Vec<usize> {
            rooms.iter().copied().filter(|at| self.rooms[*at].room.sealed).collect()
        };
        if sealed(&at_eye) != sealed(&at_body) {
            return false;
        }
        if self.rooms.iter().any(|naive| naive.stops(eye, body)) {
            return false;
        }
        let mut said =
            at_eye.iter().map(|at| (*at, &self.rooms[*at])).filter(|(_, r)| r.room.restricts());
        let mut said = said.by_ref().peekable();
        said.peek().is_none()
            || said.any(|(id, naive)| {
                let in_set = |set: &ObjectSet| {
                    set.rooms.iter().any(|id| at_body.contains(&usize::from(id.0)))
                        || set.cells.iter().any(|named| cell == Some(*named))
                        || set.objects.iter().any(|at| self.holds(*at, body))
                };
                let by_set = match &naive.room.sees {
                    RoomVisibility::Unspecified => at_body.contains(&id),
                    RoomVisibility::Only(set) => at_body.contains(&id) || in_set(set),
                    RoomVisibility::AllBut(set) => !in_set(set),
                };
                by_set || naive.shows(eye.as_dvec3(), body.as_dvec3())
            })
    }

    fn holds(&self, object: u32, body: Vec3) -> bool {
        // Sets consist of boxes in own axes: that of an object is the box around it there.
        let axes = &self.world.cells.axes;
        axes.own_box(&self.objects[object as usize]).contains(axes.own(body))
    }
}

fn point(rng: &mut SmallRng, far: f32) -> Vec3 {
    let mut side = || rng.random_range(-far..far);
    Vec3::new(side(), side() * 0.3, side())
}

fn naive(rng: &mut SmallRng, number: usize) -> Naive {
    let turn = if rng.random_bool(0.5) { 0.0 } else { rng.random_range(-0.8..0.8) };
    let half = |rng: &mut SmallRng| rng.random_range(1.0..5.0);
    let main = Turned {
        centre: point(rng, 8.0),
        half: Vec3::new(half(rng), rng.random_range(1.0..2.0), half(rng)),
        turn,
    };
    let mut boxes = vec![main];
    if rng.random_bool(0.4) {
        // The second box touches the first, so the room is not convex.
        let half = Vec3::new(half(rng), main.half.y, half(rng));
        let away = Vec3::new(main.half.x + half.x, 0.0, rng.random_range(-1.0..1.0) * main.half.z);
        boxes.push(Turned { centre: main.out(away), half, turn });
    }
    let shapes = boxes.iter().map(|part| part.shape(rng)).collect();
    let mut naive = Naive {
        boxes,
        openings: Vec::new(),
        room: Room { name: format!("room {number}"), shapes, ..Room::default() },
    };
    for _ in 0..rng.random_range(0..5) {
        open(rng, &mut naive);
    }
    naive
}

/// Makes an opening in a wall that has the room on one side only. It may be behind another opening.
fn open(rng: &mut SmallRng, naive: &mut Naive) {
    let part = naive.boxes[rng.random_range(0..naive.boxes.len())];
    let axis = rng.random_range(0..3usize);
    let sign: f32 = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let mut span = |side: usize| {
        let a = rng.random_range(-1.0..0.7f32);
        let b = rng.random_range(a + 0.1..1.0);
        [a * part.half[side], b * part.half[side]]
    };
    let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    let (spans_u, spans_v) = (span(u), span(v));
    let corner = |i: usize, j: usize| {
        let mut at = Vec3::ZERO;
        at[axis] = sign * part.half[axis];
        at[u] = spans_u[i];
        at[v] = spans_v[j];
        part.out(at)
    };
    let mut step = Vec3::ZERO;
    step[axis] = sign;
    let outwards = part.out(step) - part.centre;
    let corners = vec![corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
    // A window leads out: along all of it, the room is on one side only.
    let beside = |far: f32| corners.iter().any(|at| naive.contains(*at + outwards * far));
    let middle = corners.iter().sum::<Vec3>() / 4.0;
    if beside(0.05) || naive.contains(middle + outwards * 0.02) {
        return;
    }
    let count = naive.openings.len();
    let behind = (count > 0 && rng.random_bool(0.4)).then(|| rng.random_range(0..count));
    let exact = |i: usize| corners[i].as_dvec3();
    naive.openings.push(Opening {
        corner: exact(0),
        sides: [exact(1) - exact(0), exact(3) - exact(0)],
        outwards: outwards.as_dvec3(),
        behind,
    });
    let name = format!("window {count}");
    naive.room.windows.push(Window { name, corners, behind: behind.map(|at| at as u32) });
}

fn sees(rng: &mut SmallRng, rooms: usize) -> RoomVisibility {
    let mut some =
        |count: usize| -> Vec<u32> { (0..count as u32).filter(|_| rng.random_bool(0.3)).collect() };
    let set = ObjectSet {
        rooms: some(rooms).into_iter().map(|at| RoomId(at as u16)).collect(),
        cells: some(1).into_iter().map(CellId).collect(),
        objects: some(3),
    };
    match rng.random_range(0..3) {
        0 => RoomVisibility::Unspecified,
        1 => RoomVisibility::Only(set),
        _ => RoomVisibility::AllBut(set),
    }
}

/// Divides the one cell into four.
fn quartered(cells: &Cells, rng: &mut SmallRng) -> Cells {
    let [x, z] = [0, 1].map(|_| rng.random_range(-6.0..6.0f32));
    let tree = vec![
        Node::Axial { axis: 0, at: x, sides: [1, 2] },
        Node::Axial { axis: 2, at: z, sides: [3, 4] },
        Node::Axial { axis: 2, at: z, sides: [5, 6] },
        Node::Leaf(CellId(0)),
        Node::Leaf(CellId(1)),
        Node::Leaf(CellId(2)),
        Node::Leaf(CellId(3)),
    ];
    let bounds = |i: usize| {
        let mut part = EVERYTHING;
        if i < 2 {
            part.max.x = x
        } else {
            part.min.x = x
        }
        if i.is_multiple_of(2) {
            part.max.z = z
        } else {
            part.min.z = z
        }
        part
    };
    let mut cells = cells.clone();
    let whole = cells.cells[0].clone();
    cells.cells =
        (0..4).map(|i| sightline_world::Cell { bounds: bounds(i), ..whole.clone() }).collect();
    cells.spaces[0].cells = 0..4;
    cells.pvs = vec![(0..4).collect(); 4];
    cells.tree = tree;
    cells
}

fn region(rng: &mut SmallRng, around: Option<Vec3>) -> Aabb {
    let centre = around.unwrap_or_else(|| point(rng, 14.0));
    let half = if rng.random_bool(0.3) { 0.01 } else { rng.random_range(0.05..1.5) };
    let mut side = || rng.random_range(0.2..1.0f32) * half;
    let half = Vec3::new(side(), side(), side());
    Aabb::new(centre - half, centre + half)
}

fn inside(rng: &mut SmallRng, region: &Aabb) -> Vec3 {
    let mut share = || rng.random_range(0.0..=1.0f32);
    region.min + region.size() * Vec3::new(share(), share(), share())
}

#[test]
fn nobody_is_ruled_out_whom_a_line_shows() {
    let (mut denied, mut found, mut loose, mut opaque) = (0, 0, 0, 0);
    for seed in 0..400 {
        let scene = Scene::new(seed);
        let mut rng = SmallRng::seed_from_u64(seed ^ 0x5eed);
        for _ in 0..60 {
            // Most viewers stand in a room.
            let stands = &scene.rooms[rng.random_range(0..scene.rooms.len())].boxes[0];
            let axes = &scene.world.cells.axes;
            let near = rng.random_bool(0.8).then(|| axes.own(stands.centre + point(&mut rng, 2.0)));
            let (eyes, body) = (region(&mut rng, near), region(&mut rng, None));
            let asked = may_see(&scene.world, &scene.index, eyes, body);
            let mut lines = 0..if asked { 30 } else { 300 };
            let shown = lines.any(|_| {
                let (eye, point) = (inside(&mut rng, &eyes), inside(&mut rng, &body));
                scene.shows(eye, point)
            });
            assert!(asked || !shown, "seed {seed}: {eyes:?} sees {body:?}");
            let in_cells = scene.may_see_in_cells(eyes, body);
            assert!(in_cells || !shown, "seed {seed}: {eyes:?} sees {body:?}, by cells");
            denied += u32::from(!asked);
            found += u32::from(shown);
            loose += u32::from(asked && !shown);
            let asked_without = may_see(&scene.world, &scene.without_opaque, eyes, body);
            opaque += u32::from(asked_without && !asked);
        }
    }
    println!("{denied} pairs ruled out, {opaque} of them by opaque rooms alone");
    println!("{found} shown by a line, {loose} kept without one");
    assert!(denied > 4_000 && found > 4_000 && opaque > 300, "{denied} {found} {opaque}");
    assert!(loose < 24_000 / 5, "{loose} pairs kept that no line shows");
}

/// C-shaped rooms, as in FIG. 9 of Menon and Rossignac 1999. Through a window of the upper arm, the
/// lower arm is seen from outside.
fn folded(rng: &mut SmallRng) -> Naive {
    let part = |[x, z]: [f32; 2], [to_x, to_z]: [f32; 2]| Turned {
        centre: Vec3::new((x + to_x) * 0.5, 1.5, (z + to_z) * 0.5),
        half: Vec3::new((to_x - x) * 0.5, 1.5, (to_z - z) * 0.5),
        turn: 0.0,
    };
    let boxes = vec![
        part([-8.0, -8.0], [8.0, -4.0]),
        part([-8.0, -4.0], [-4.0, 2.0]),
        part([-8.0, 2.0], [8.0, 6.0]),
    ];
    let shapes = boxes.iter().map(|part| part.shape(rng)).collect();
    let room = Room { name: "C".into(), shapes, ..Room::default() };
    let mut naive = Naive { boxes, openings: Vec::new(), room };
    for (number, z, outwards) in [(0, -4.0, 1.0), (1, 2.0, -1.0), (2, 6.0, 1.0)] {
        let low = rng.random_range(-3.9..3.0f32);
        let [from, to] = [low, rng.random_range(low + 0.5..7.9)];
        let [bottom, top] = [rng.random_range(0.1..1.3f32), rng.random_range(1.5..2.9)];
        let at = |x: f32, y: f32| Vec3::new(x, y, z);
        let corners = vec![at(from, bottom), at(to, bottom), at(to, top), at(from, top)];
        let behind = (number > 0).then(|| number - 1);
        naive.openings.push(Opening {
            corner: corners[0].as_dvec3(),
            sides: [corners[1], corners[3]].map(|end| (end - corners[0]).as_dvec3()),
            outwards: DVec3::Z * outwards,
            behind,
        });
        let behind = behind.map(|at| at as u32);
        naive.room.windows.push(Window { name: format!("{number}"), corners, behind });
    }
    naive
}

#[test]
fn rooms_that_fold_back_show_what_lines_show() {
    let (mut denied, mut beyond) = (0, 0);
    for seed in 0..300 {
        let mut rng = SmallRng::seed_from_u64(seed);
        let naive = folded(&mut rng);
        let built = Rooms::new(vec![naive.room.clone()], Vec::new()).unwrap();
        let world = world(built, 0.0);
        let index = RoomIndex::new(&world);
        for _ in 0..60 {
            let mut within = |[x, y, z]: [[f32; 2]; 3], half: f32| {
                let mut at = |[a, b]: [f32; 2]| rng.random_range(a + half..b - half);
                Aabb::around(Vec3::new(at(x), at(y), at(z)), half)
            };
            let eyes = within([[-8.0, 8.0], [0.0, 3.0], [-8.0, -4.0]], 0.6);
            let body = within([[-9.0, 9.0], [0.0, 3.0], [5.5, 12.0]], 0.2);
            let asked = may_see(&world, &index, eyes, body);
            let shown = (0..150).any(|_| {
                let (eye, body) = (inside(&mut rng, &eyes), inside(&mut rng, &body));
                naive.contains(body) || naive.shows(eye.as_dvec3(), body.as_dvec3())
            });
            assert!(asked || !shown, "seed {seed}: {eyes:?} sees {body:?}");
            denied += u32::from(!asked);
            beyond += u32::from(shown && body.min.z > 6.0);
        }
    }
    println!("{denied} ruled out, {beyond} seen beyond the lower arm");
    assert!(denied > 3_000 && beyond > 500, "{denied} {beyond}");
}

/// If rooms hide a region, they hide every part of it.
#[test]
fn what_holds_for_a_region_holds_for_its_parts() {
    for seed in 0..200 {
        let scene = Scene::new(seed);
        let mut rng = SmallRng::seed_from_u64(seed ^ 0xfeed);
        for _ in 0..40 {
            let [eyes, body] = [0, 1].map(|_| region(&mut rng, None));
            if may_see(&scene.world, &scene.index, eyes, body) {
                continue;
            }
            let mut part = |of: &Aabb| {
                let [a, b] = [0, 1].map(|_| inside(&mut rng, of));
                Aabb::new(a.min(b), a.max(b))
            };
            let (eyes, body) = (part(&eyes), part(&body));
            assert!(!may_see(&scene.world, &scene.index, eyes, body), "seed {seed}");
        }
    }
}

/// Points in different sealed rooms never agree, and points in the same ones do unless there are
/// too many.
#[test]
fn points_agree_if_they_are_in_the_same_sealed_rooms() {
    let mut apart = 0;
    for seed in 0..300 {
        let scene = Scene::new(seed);
        let mut rng = SmallRng::seed_from_u64(seed ^ 0xea1);
        let sealed = |at: Vec3| -> Vec<usize> {
            let rooms = scene.rooms_at(at).into_iter();
            rooms.filter(|id| scene.rooms[*id].room.sealed).collect()
        };
        for _ in 0..200 {
            let [a, b] = [0, 1].map(|_| point(&mut rng, 9.0));
            let agrees = scene.index.sealed_rooms_at(a).agrees(&scene.index.sealed_rooms_at(b));
            assert!(!agrees || sealed(a) == sealed(b), "seed {seed}: {a} {b}");
            assert!(
                agrees || sealed(a) != sealed(b) || sealed(a).len() >= 4,
                "seed {seed}: {a} {b}"
            );
            apart += u32::from(!agrees);
        }
    }
    assert!(apart > 1_000, "{apart}");
}
