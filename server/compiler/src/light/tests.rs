use glam::Vec3;

use super::*;
use crate::model::{Surface, SurfaceMaterial};

impl Shade {
    fn factor(self) -> f32 {
        match self {
            Self::Factor(factor) => factor,
            Self::Linear(light) => panic!("{light} is not ambient light"),
        }
    }
}

fn quad(a: Vec3, u: Vec3, v: Vec3) -> [[Vec3; 3]; 2] {
    [[a, a + u, a + u + v], [a, a + u + v, a + v]]
}

/// A room of 6 × 3 × 6 m whose sides face inwards: the floor, the ceiling, and four walls.
fn room() -> Vec<[Vec3; 3]> {
    let (x, y, z) = (Vec3::X * 6.0, Vec3::Y * 3.0, Vec3::Z * 6.0);
    [
        quad(Vec3::ZERO, z, x),
        quad(y, x, z),
        quad(Vec3::ZERO, x, y),
        quad(z, y, x),
        quad(Vec3::ZERO, y, z),
        quad(x, z, y),
    ]
    .concat()
}

fn surface(triangles: &[[Vec3; 3]]) -> Surface {
    Surface::of_triangles(triangles, SurfaceMaterial::opaque([255; 3]))
}

/// Lit triangles, all opaque.
struct Scene {
    triangles: Vec<[Vec3; 3]>,
    light: Light,
}

impl Scene {
    fn new(triangles: Vec<[Vec3; 3]>) -> Self {
        let go_on = |_| ControlFlow::Continue(());
        let light = Light::new(&[surface(&triangles)], &triangles, Vec3::X, 0.03, &go_on);
        Self { light: light.expect("not broken off"), triangles }
    }

    fn room_with(more: &[[Vec3; 3]]) -> Self {
        Self::new([room(), more.to_vec()].concat())
    }

    /// The factor at a point on the first of some triangles that contains it.
    fn at(&self, point: Vec3) -> f32 {
        let contains = |corners: &[Vec3; 3]| {
            let [a, b, c] = *corners;
            let normal = (b - a).cross(c - a);
            let inside = |a: Vec3, b: Vec3| (b - a).cross(point - a).dot(normal) >= -1.0e-4;
            (point - a).dot(normal.normalize()).abs() < 1.0e-4
                && inside(a, b)
                && inside(b, c)
                && inside(c, a)
        };
        let triangle = self.triangles.iter().position(contains).expect("the point is on one");
        self.light.of(0, triangle).expect("it has an area").at(point).factor()
    }
}

#[test]
fn corners_are_darker_than_open_floor() {
    let scene = Scene::room_with(&[]);
    let [open, edge, corner] =
        [Vec3::new(3.0, 0.0, 3.0), Vec3::new(3.0, 0.0, 0.01), Vec3::new(0.01, 0.0, 0.01)]
            .map(|point| scene.at(point));
    assert!(open > edge + 0.12 && edge > corner, "{open} {edge} {corner}");
    let ceiling = scene.at(Vec3::new(3.0, 3.0, 3.0));
    assert!(open > ceiling + 0.04, "the lamp is above: {open} {ceiling}");
}

/// The walls of a room are thin and stand outdoors, and reach above the ceiling. Their triangles
/// are of all shapes.
#[test]
fn light_is_even_along_the_edge_of_a_wall_and_a_ceiling() {
    let fan = |hub: Vec3, rim: &[Vec3]| -> Vec<[Vec3; 3]> {
        rim.windows(2).map(|ends| [hub, ends[0], ends[1]]).collect()
    };
    let along = |z: f32, y: f32| -> Vec<Vec3> {
        [0.0, 0.4, 0.7, 1.9, 2.3, 3.1, 4.6, 4.7, 6.0].map(|x| Vec3::new(x, y, z)).to_vec()
    };
    // The ceiling, as triangles from a hub to its edge on either wall, and the rest.
    let hub = Vec3::new(3.3, 3.0, 2.9);
    let (near, far) = (along(0.0, 3.0), along(6.0, 3.0));
    let mut triangles = fan(hub, &near);
    triangles.extend(far.windows(2).map(|ends| [hub, ends[1], ends[0]]));
    triangles.push([hub, near[8], far[8]]);
    triangles.push([hub, far[0], near[0]]);
    // The wall at z = 0, half a metre higher than the ceiling.
    let foot = Vec3::new(2.2, 0.0, 0.0);
    triangles.extend(along(0.0, 3.5).windows(2).map(|ends| [foot, ends[1], ends[0]]));
    triangles.push([foot, Vec3::new(6.0, 0.0, 0.0), Vec3::new(6.0, 3.5, 0.0)]);
    triangles.push([foot, Vec3::new(0.0, 3.5, 0.0), Vec3::ZERO]);
    let others = room().into_iter().enumerate().filter(|(i, _)| !(2..6).contains(i));
    triangles.extend(others.map(|(_, triangle)| triangle));
    let scene = Scene::new(triangles);
    for name in ["ceiling", "wall"] {
        let at = |x: f32, away: f32| match name {
            "ceiling" => Vec3::new(x, 3.0, away),
            _ => Vec3::new(x, 3.0 - away, 0.0),
        };
        for away in [0.02, 0.1, 0.3] {
            let light: Vec<f32> =
                (0..80).map(|i| scene.at(at(1.0 + 0.05 * i as f32, away))).collect();
            let ends = (
                light.iter().copied().fold(f32::MAX, f32::min),
                light.iter().copied().fold(f32::MIN, f32::max),
            );
            assert!(ends.1 - ends.0 < 0.06, "{name}, {away} m from the edge: {ends:?}");
        }
        assert!(
            scene.at(at(3.0, 0.05)) < scene.at(at(3.0, 1.4)) - 0.05,
            "{name}: the edge is darker than what is far from it"
        );
    }
}

#[test]
fn light_does_not_pass_under_a_wall() {
    // A floor runs under a wall, on whose other side there is a low dark duct.
    let wall = quad(Vec3::new(2.9, 0.0, 0.0), Vec3::Y * 3.0, Vec3::Z * 6.0);
    let back = quad(Vec3::new(3.0, 0.0, 0.0), Vec3::Z * 6.0, Vec3::Y * 3.0);
    let lid = quad(Vec3::new(3.0, 0.2, 0.0), Vec3::X * 3.0, Vec3::Z * 6.0);
    let reversed = wall.map(|[a, b, c]| [a, c, b]);
    let scene = Scene::room_with(&[reversed, back.map(|[a, b, c]| [a, c, b]), lid].concat());
    let [here, there] = [2.89, 3.01].map(|x| scene.at(Vec3::new(x, 0.0, 3.0)));
    let far = scene.at(Vec3::new(2.5, 0.0, 3.0));
    assert!(here > there + 0.1, "{here} {there}");
    assert!((here - far).abs() < 0.12, "no shade from the duct: {here} {far}");
}

#[test]
fn buried_corners_darken_nothing() {
    // A wall that continues below the floor, where its foot is not visible.
    let scene = Scene::room_with(&quad(Vec3::new(2.0, -0.2, 3.0), Vec3::X * 2.0, Vec3::Y * 2.2));
    let foot = scene.at(Vec3::new(3.0, 0.01, 3.0));
    assert!(foot > 0.6, "{foot}");
}

#[test]
fn a_surface_inside_out_is_lit_on_its_back() {
    let cube = |inwards: bool| {
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|edge| edge * 0.4);
        let at = Vec3::new(2.0, 0.5, 2.0);
        let sides = [
            quad(at, x, z),
            quad(at + y, z, x),
            quad(at, y, x),
            quad(at + z, x, y),
            quad(at, z, y),
            quad(at + x, y, z),
        ];
        let turned = |[a, b, c]: [Vec3; 3]| if inwards { [a, c, b] } else { [a, b, c] };
        sides.concat().into_iter().map(turned).collect::<Vec<_>>()
    };
    let top = Vec3::new(2.3, 0.9, 2.15);
    let [outwards, inwards] = [false, true].map(|inwards| Scene::room_with(&cube(inwards)).at(top));
    assert!(outwards > 0.9 && (outwards - inwards).abs() < 0.01, "{outwards} {inwards}");
}

#[test]
fn threads_do_not_matter() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let scene = pool.install(|| Scene::room_with(&[]));
        (0..60).map(|i| scene.at(Vec3::new(i as f32 * 0.1, 0.0, 0.1)).to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(with(1), with(3));
}
