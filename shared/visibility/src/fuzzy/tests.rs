//! The reference model: dense eyes in the box, with lines to points of every patch, each compared
//! with all triangles.

use glam::{DVec3, Quat, Vec3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::SmallRng};

use sightline_world::geometry::{Aabb, Frustum};

use super::*;

/// Patches, each with the number of its surface.
#[derive(Default)]
struct Scene {
    corners: Vec<Vec3>,
    polygons: Vec<(u32, Vec<u32>)>,
    surfaces: u32,
}

impl Scene {
    /// Adds a surface over a grid of places.
    fn add(&mut self, across: u32, down: u32, triangles: bool, place: impl Fn(f32, f32) -> Vec3) {
        let start = self.corners.len() as u32;
        for j in 0..=down {
            for i in 0..=across {
                self.corners.push(place(i as f32 / across as f32, j as f32 / down as f32));
            }
        }
        for j in 0..down {
            for i in 0..across {
                let at = |i: u32, j: u32| start + j * (across + 1) + i;
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                let polygons: &[&[u32]] =
                    if triangles { &[&[a, b, c], &[a, c, d]] } else { &[&[a, b, c, d]] };
                for polygon in polygons {
                    self.polygons.push((self.surfaces, polygon.to_vec()));
                }
            }
        }
        self.surfaces += 1;
    }

    fn wall(&mut self, random: &mut SmallRng, middle: Vec3, half: f32) {
        let turn = turn(random);
        let (across, down) = (random.random_range(1..5), random.random_range(1..5));
        let shape =
            half * Vec3::new(random.random_range(0.2..1.0), random.random_range(0.2..1.0), 0.0);
        let place =
            |u: f32, v: f32| middle + turn * (Vec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0) * shape);
        self.add(across, down, true, place);
    }

    /// Adds all six sides of a turned box as one surface.
    fn slab(&mut self, middle: Vec3, turn: Quat, half: Vec3) {
        let start = self.corners.len() as u32;
        let corners = Aabb::new(-half, half).corners();
        self.corners.extend(corners.map(|corner| middle + turn * corner));
        for side in
            [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
        {
            let [a, b, c, d] = side.map(|corner: u32| start + corner);
            self.polygons.push((self.surfaces, vec![a, b, c]));
            self.polygons.push((self.surfaces, vec![a, c, d]));
        }
        self.surfaces += 1;
    }

    fn ball(&mut self, middle: Vec3, radius: Vec3, parts: u32) {
        self.add(parts, parts / 2, true, |u, v| {
            let (around, down) = (u.fract() * std::f32::consts::TAU, v * std::f32::consts::PI);
            middle
                + Vec3::new(around.cos() * down.sin(), down.cos(), around.sin() * down.sin())
                    * radius
        });
    }

    /// Adds waves, which hide themselves.
    fn waves(&mut self, random: &mut SmallRng, middle: Vec3, half: f32) {
        let (turn, high) = (turn(random), random.random_range(0.1..0.6) * half);
        self.add(8, 4, true, |u, v| {
            middle
                + turn
                    * Vec3::new(
                        half * (2.0 * u - 1.0),
                        high * (u * 12.0).sin(),
                        half * (2.0 * v - 1.0),
                    )
        });
    }

    fn random(random: &mut SmallRng) -> Self {
        let mut scene = Self::default();
        for _ in 0..random.random_range(3..9) {
            let middle = direction(random) * random.random_range(0.8..6.0);
            let size = random.random_range(0.3..4.0);
            match random.random_range(0..5) {
                0 | 1 => scene.wall(random, middle, size),
                2 => {
                    let half =
                        Vec3::from_array(std::array::from_fn(|_| random.random_range(0.01..size)));
                    scene.slab(middle, turn(random), half);
                }
                3 => scene.ball(middle, Vec3::splat(0.4 * size), 8),
                _ => scene.waves(random, middle, size),
            }
        }
        scene
    }

    fn surfaces(&self) -> Surfaces {
        Surfaces::new(&self.corners, &self.polygons).unwrap()
    }

    fn corners_of(&self, patch: usize) -> Vec<DVec3> {
        self.polygons[patch].1.iter().map(|i| self.corners[*i as usize].as_dvec3()).collect()
    }

    /// All triangles, each with its patch.
    fn triangles(&self) -> Vec<(usize, [DVec3; 3])> {
        let fan = |patch: usize| {
            let corners = self.corners_of(patch);
            (2..corners.len()).map(move |i| (patch, [corners[0], corners[i - 1], corners[i]]))
        };
        (0..self.polygons.len()).flat_map(fan).collect()
    }
}

fn direction(random: &mut SmallRng) -> Vec3 {
    loop {
        let v = Vec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        if v.length() < 1.0 && v.length() > 0.1 {
            return v.normalize();
        }
    }
}

fn turn(random: &mut SmallRng) -> Quat {
    if random.random_bool(0.3) {
        let quarter = std::f32::consts::FRAC_PI_2;
        return Quat::from_rotation_y(quarter * random.random_range(0..4) as f32);
    }
    Quat::from_rotation_arc(Vec3::Z, direction(random))
}

/// The share of a line's length at which it meets a triangle.
fn meets([a, b, c]: &[DVec3; 3], from: DVec3, to: DVec3) -> Option<f64> {
    let (way, normal) = (to - from, (*b - *a).cross(*c - *a));
    let slope = normal.dot(way);
    if slope.abs() < 1e-12 {
        return None;
    }
    let share = normal.dot(*a - from) / slope;
    let at = from + way * share;
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|(p, q)| (**q - **p).cross(at - **p).dot(normal) >= -1e-12 * normal.length_squared());
    inside.then_some(share)
}

/// Whether an eye sees a point of a patch: the line meets nothing before it.
fn sees(triangles: &[(usize, [DVec3; 3])], eye: DVec3, point: DVec3) -> bool {
    !triangles.iter().any(|(_, triangle)| {
        meets(triangle, eye, point).is_some_and(|share| share > 1e-9 && share < 1.0 - 1e-6)
    })
}

/// Points of a patch: its corners, moved inwards a little, its middle and a few others.
fn points(corners: &[DVec3], random: &mut SmallRng) -> Vec<DVec3> {
    let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let mut points: Vec<DVec3> =
        corners.iter().map(|corner| corner.lerp(middle, 0.02)).chain([middle]).collect();
    for _ in 0..2 {
        let weights: Vec<f64> = corners.iter().map(|_| random.random_range(0.01..1.0)).collect();
        let sum: f64 = weights.iter().sum();
        points.push(corners.iter().zip(&weights).map(|(c, w)| *c * (w / sum)).sum());
    }
    points
}

fn eyes(bounds: &Aabb, random: &mut SmallRng, inner: usize) -> Vec<DVec3> {
    let mut eyes: Vec<DVec3> = bounds.corners().iter().map(|eye| eye.as_dvec3()).collect();
    eyes.extend((0..inner).map(|_| {
        let share = Vec3::from_array(std::array::from_fn(|_| random.random_range(0.0..=1.0)));
        (bounds.min + bounds.size() * share).as_dvec3()
    }));
    eyes
}

/// What dense eyes found about patches.
#[derive(Default)]
struct Tally {
    patches: usize,
    unseen: usize,
    invisible: usize,
    visible: usize,
}

/// Compares classes with what dense eyes see.
fn check(
    scene: &Scene,
    bounds: &Aabb,
    classes: &[PatchVisibility],
    random: &mut SmallRng,
    tally: &mut Tally,
) {
    let (triangles, eyes) = (scene.triangles(), eyes(bounds, random, 12));
    for (patch, class) in classes.iter().enumerate() {
        let points = points(&scene.corners_of(patch), random);
        let mut lines = eyes.iter().flat_map(|eye| points.iter().map(move |point| (*eye, *point)));
        let is_seen = match class {
            PatchVisibility::Visible => {
                let hidden = lines.find(|(eye, point)| !sees(&triangles, *eye, *point));
                assert!(hidden.is_none(), "patch {patch}, visible, is hidden: {hidden:?}");
                true
            }
            PatchVisibility::Invisible | PatchVisibility::Remaining => {
                let seen = lines.find(|(eye, point)| sees(&triangles, *eye, *point));
                let is_sound = *class != PatchVisibility::Invisible || seen.is_none();
                assert!(is_sound, "patch {patch}, invisible, is seen: {seen:?}");
                seen.is_some()
            }
        };
        tally.patches += 1;
        tally.unseen += usize::from(!is_seen);
        tally.invisible += usize::from(*class == PatchVisibility::Invisible);
        tally.visible += usize::from(*class == PatchVisibility::Visible);
    }
}

/// A thousand random scenes: walls at any angle, cut by each other, thin slabs, balls, waves.
#[test]
fn nothing_seen_is_invisible_and_nothing_hidden_is_visible() {
    println!("box, m   patches   unseen   found   of them   visible");
    for (round, half) in [0.025, 0.125, 0.5, 2.0].into_iter().enumerate() {
        let mut tally = Tally::default();
        for seed in 0..250 {
            let random = &mut SmallRng::seed_from_u64((round * 1_000 + seed) as u64);
            let scene = Scene::random(random);
            let middle = direction(random) * random.random_range(0.0..1.5);
            let bounds = Aabb::around(middle, half);
            let size = random.random_range(24..160);
            let classes = classify(&scene.surfaces(), &ViewpointBox::all_round(bounds), size, None);
            check(&scene, &bounds, &classes, random, &mut tally);
        }
        let Tally { patches, unseen, invisible, visible } = tally;
        let share = 100 * invisible / unseen.max(1);
        println!("{:6.2} {patches:9} {unseen:8} {invisible:7} {share:7} % {visible:9}", 2.0 * half);
        assert!(invisible > 0 || half > 1.0, "nothing hidden was found");
        assert!(visible > 0 || half > 1.0, "nothing visible was found");
    }
}

/// Two rooms with a doorway between them, and a ball in each.
fn rooms() -> Scene {
    let mut scene = Scene::default();
    let mut slab = |min: [f32; 3], max: [f32; 3]| {
        let bounds = Aabb::new(Vec3::from(min), Vec3::from(max));
        scene.slab(bounds.centre(), Quat::IDENTITY, bounds.size() * 0.5);
    };
    slab([-3.0, -0.2, -3.0], [13.0, 0.0, 3.0]);
    slab([-3.0, 3.0, -3.0], [13.0, 3.2, 3.0]);
    slab([-3.0, 0.0, -3.2], [13.0, 3.0, -3.0]);
    slab([-3.0, 0.0, 3.0], [13.0, 3.0, 3.2]);
    slab([-3.2, 0.0, -3.0], [-3.0, 3.0, 3.0]);
    // The wall between the rooms, with a doorway 1 m wide.
    slab([3.0, 0.0, -3.0], [3.2, 3.0, 1.5]);
    slab([3.0, 0.0, 2.5], [3.2, 3.0, 3.0]);
    scene.ball(Vec3::new(6.0, 1.0, -1.0), Vec3::splat(0.5), 12);
    scene.ball(Vec3::new(1.5, 1.0, 0.5), Vec3::splat(0.3), 12);
    scene
}

#[test]
fn a_wall_hides_what_stands_behind_it_from_a_box_and_not_what_a_doorway_shows() {
    let scene = rooms();
    let surfaces = scene.surfaces();
    let bounds = Aabb::around(Vec3::new(-1.0, 1.5, -1.5), 0.25);
    let eyes = ViewpointBox::all_round(bounds);
    let buffer = FuzzyBuffer::new(&surfaces, &eyes, 256);
    assert!(buffer.hides(&Aabb::around(Vec3::new(6.0, 1.0, -1.0), 0.5)), "the ball next door");
    assert!(!buffer.hides(&Aabb::around(Vec3::new(1.5, 1.0, 0.5), 0.3)), "the ball in the room");
    assert!(!buffer.hides(&Aabb::around(Vec3::new(4.5, 1.5, 2.2), 0.2)), "through the doorway");
    assert!(!buffer.hides(&bounds.grown(0.1)), "where the eyes are");
    let classes = classify(&surfaces, &eyes, 256, None);
    let random = &mut SmallRng::seed_from_u64(1);
    let mut tally = Tally::default();
    check(&scene, &bounds, &classes, random, &mut tally);
    assert!(tally.invisible * 2 > tally.unseen, "{} of {}", tally.invisible, tally.unseen);
}

#[test]
fn a_box_inside_inherits_what_was_settled_around_it() {
    let (scene, random) = (rooms(), &mut SmallRng::seed_from_u64(2));
    let surfaces = scene.surfaces();
    let outer = Aabb::around(Vec3::new(-1.0, 1.5, -1.5), 0.5);
    let settled = classify(&surfaces, &ViewpointBox::all_round(outer), 200, None);
    for _ in 0..8 {
        let share = Vec3::from_array(std::array::from_fn(|_| random.random_range(0.2..0.8)));
        let inner = Aabb::around(outer.min + outer.size() * share, 0.1);
        let eyes = ViewpointBox::all_round(inner);
        let classes = classify(&surfaces, &eyes, 200, Some(&settled));
        for (now, then) in classes.iter().zip(&settled) {
            assert!(*then == PatchVisibility::Remaining || now == then);
        }
        check(&scene, &inner, &classes, random, &mut Tally::default());
        let count = |classes: &[PatchVisibility]| {
            classes.iter().filter(|class| **class != PatchVisibility::Remaining).count()
        };
        assert!(count(&classes) >= count(&settled));
    }
}

#[test]
fn a_field_of_view_leaves_faces_out_and_says_nothing_of_what_is_beyond() {
    let surfaces = rooms().surfaces();
    let bounds = Aabb::around(Vec3::new(-1.0, 1.5, -1.5), 0.25);
    // A yaw of -90 degrees looks along x.
    let ahead = Frustum::new(-std::f32::consts::FRAC_PI_2, 0.0, 0.8, 0.6);
    let eyes = ViewpointBox::within(bounds, &ahead);
    assert_eq!(eyes.faces().count(), 1);
    let (some, all) = (
        classify(&surfaces, &eyes, 200, None),
        classify(&surfaces, &ViewpointBox::all_round(bounds), 200, None),
    );
    assert!(
        some.contains(&PatchVisibility::Invisible) && some.contains(&PatchVisibility::Remaining)
    );
    for (some, all) in some.iter().zip(&all) {
        assert!(*some == PatchVisibility::Remaining || some == all);
    }
    let nobody = ViewpointBox::all_round(Aabb::EMPTY);
    assert!(FuzzyBuffer::new(&surfaces, &nobody, 16).hides(&bounds));
}

#[test]
fn what_is_no_patch_is_refused() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.3), Vec3::Y, Vec3::NAN];
    let of = |indices: &[u32]| Surfaces::new(&corners, &[(0, indices.to_vec())]).map(|_| ());
    assert_eq!(of(&[0, 1, 3]), Ok(()));
    assert_eq!(of(&[0, 1]), Err(SurfaceError::Few { patch: 0 }));
    assert_eq!(of(&[0, 1, 2, 3]), Err(SurfaceError::Shape { patch: 0 }));
    assert_eq!(of(&[0, 1, 9]), Err(SurfaceError::Corner { patch: 0 }));
    assert_eq!(of(&[0, 1, 4]), Err(SurfaceError::Corner { patch: 0 }));
    // A polygon without an area hides nothing.
    let thin = Surfaces::new(&corners, &[(0, vec![0, 1, 1])]).unwrap();
    let buffer = FuzzyBuffer::new(&thin, &ViewpointBox::all_round(Aabb::around(-Vec3::Z, 0.0)), 64);
    assert!(!buffer.hides(&Aabb::around(Vec3::new(0.5, 0.0, 3.0), 0.01)));
}

fn class() -> impl Strategy<Value = PatchVisibility> {
    prop_oneof![3 => Just(PatchVisibility::Invisible), 1 => Just(PatchVisibility::Visible), 2 => Just(PatchVisibility::Remaining)]
}

proptest! {
    #[test]
    fn lists_give_back_what_was_put_in(
        classes in prop::collection::vec(class(), 0..400),
        flips in prop::collection::vec((any::<prop::sample::Index>(), class()), 0..20),
    ) {
        let alone = PackedVisibility::new(&classes, None);
        prop_assert_eq!(alone.classes(None), Ok(classes.clone()));
        let mut next = classes.clone();
        for (place, class) in flips {
            if !next.is_empty() {
                let place = place.index(next.len());
                next[place] = class;
            }
        }
        let change = PackedVisibility::new(&next, Some(&classes));
        prop_assert!(change.len() <= PackedVisibility::new(&next, None).len());
        prop_assert_eq!(change.classes(Some(&classes)), Ok(next));
        if change.is_change() {
            prop_assert_eq!(change.classes(None), Err(UnpackError::Neighbour));
        }
    }

    /// The rectangle of equations (1) and (2) holds every projection from every eye.
    #[test]
    fn an_extent_holds_all_projections(
        eyes in prop::array::uniform6(-1.0f32..1.0),
        bounds in prop::array::uniform6(-4.0f32..4.0),
        shares in prop::collection::vec(prop::array::uniform6(0.0f32..1.0), 20),
    ) {
        let of = |v: [f32; 6]| {
            let (a, b) = (Vec3::new(v[0], v[1], v[2]), Vec3::new(v[3], v[4], v[5]));
            Aabb::new(a.min(b), a.max(b))
        };
        let (eyes, bounds) = (of(eyes), of(bounds));
        for share in shares {
            let eye = eyes.min + eyes.size() * Vec3::new(share[0], share[1], share[2]);
            let point = bounds.min + bounds.size() * Vec3::new(share[3], share[4], share[5]);
            let way = (point - eye).as_dvec3();
            for axis in 0..3 {
                for backwards in [false, true] {
                    let depth = if backwards { -way[axis] } else { way[axis] };
                    let at = [way[(axis + 1) % 3] / depth, way[(axis + 2) % 3] / depth];
                    if depth <= 1e-3 || at.iter().any(|at| at.abs() > 1.0) {
                        continue;
                    }
                    let found = fuzzy_extent(&bounds, &eyes, axis, backwards);
                    prop_assert!(found.is_some(), "{way} on {axis}");
                    for (at, [least, most]) in at.into_iter().zip(found.unwrap_or_default()) {
                        prop_assert!(least - 1e-5 <= at && at <= most + 1e-5);
                    }
                }
            }
        }
    }
}
