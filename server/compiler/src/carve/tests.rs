mod rays;
mod walls;

use sightline_world::geometry::Axes;

use super::*;
use volume::area;

type Triangle = [DVec3; 3];

fn fan(corners: &[DVec3]) -> Vec<Triangle> {
    (2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]]).collect()
}

/// A solid: an anticlockwise outline, extruded from z = 0 to a depth. `faces` are the polygons of
/// its front, which fill the outline.
fn extruded(outline: &[[f64; 2]], faces: &[Vec<[f64; 2]>], depth: f64) -> Vec<Triangle> {
    let at = |[x, y]: [f64; 2], z: f64| DVec3::new(x, y, z);
    let mut triangles = Vec::new();
    for face in faces {
        let front: Vec<DVec3> = face.iter().map(|&p| at(p, depth)).collect();
        let back: Vec<DVec3> = face.iter().rev().map(|&p| at(p, 0.0)).collect();
        triangles.extend(fan(&front));
        triangles.extend(fan(&back));
    }
    for (i, &p) in outline.iter().enumerate() {
        let q = outline[(i + 1) % outline.len()];
        triangles.extend(fan(&[at(p, depth), at(p, 0.0), at(q, 0.0), at(q, depth)]));
    }
    triangles
}

/// The arch of Lei and Ouhyoung 1999, Fig. 4, with its front divided as in Fig. 5: a wall 4 m wide,
/// 3 m high and half a metre thick, with a passage from x = 1 to 3 that is round above 1.5 m.
fn arch(segments: usize, rise: f64) -> Vec<Triangle> {
    let curve: Vec<[f64; 2]> = (0..=segments)
        .map(|i| {
            let turn = std::f64::consts::PI * i as f64 / segments as f64;
            [2.0 - turn.cos(), 1.5 + rise * turn.sin()]
        })
        .collect();
    let mut outline = vec![[0.0, 0.0], [1.0, 0.0]];
    outline.extend(&curve);
    outline.extend([[3.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]);
    let mut faces: Vec<Vec<[f64; 2]>> =
        [0.0, 3.0].map(|x| vec![[x, 0.0], [x + 1.0, 0.0], [x + 1.0, 3.0], [x, 3.0]]).into();
    faces.extend(curve.windows(2).map(|w| vec![w[0], w[1], [w[1][0], 3.0], [w[0][0], 3.0]]));
    extruded(&outline, &faces, 0.5)
}

/// A block with an octagonal passage (Lei and Ouhyoung 1999, Fig. 9), with or without a shaft
/// through its roof.
fn passage(shaft: bool) -> Vec<Triangle> {
    let octagon: Vec<[f64; 2]> = [
        [1.5, 1.0],
        [2.5, 1.0],
        [3.0, 1.5],
        [3.0, 2.5],
        [2.5, 3.0],
        [1.5, 3.0],
        [1.0, 2.5],
        [1.0, 1.5],
    ]
    .into();
    let around = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
    // Polygons from each corner of the block to the near corners of the passage, and polygons
    // above, below and beside the passage.
    let mut faces = Vec::new();
    for i in 0..4 {
        let (corner, next) = (around[i], around[(i + 1) % 4]);
        let near = |j: usize| octagon[j % 8];
        faces.push(vec![corner, next, near(2 * i + 1), near(2 * i)]);
        faces.push(vec![next, near(2 * i + 2), near(2 * i + 1)]);
    }
    let mut triangles = extruded(&around, &faces, 2.0);
    let inner: Vec<[f64; 2]> = octagon.into_iter().rev().collect();
    triangles.extend(extruded(&inner, &[], 2.0));
    if shaft {
        let is_level = |t: &Triangle, y: f64| t.iter().all(|p| p.y == y);
        triangles.retain(|t| !is_level(t, 3.0) && !is_level(t, 4.0));
        let hole = ([1.8, 0.8], [2.2, 1.2]);
        triangles.extend(level_ring(3.0, ([1.5, 0.0], [2.5, 2.0]), hole, false));
        triangles.extend(level_ring(4.0, ([0.0, 0.0], [4.0, 2.0]), hole, true));
        let ([x0, z0], [x1, z1]) = hole;
        let ring = [[x0, z0], [x1, z0], [x1, z1], [x0, z1]];
        for i in 0..4 {
            let ([x, z], [u, w]) = (ring[i], ring[(i + 1) % 4]);
            let wall = [(x, 3.0, z), (u, 3.0, w), (u, 4.0, w), (x, 4.0, z)];
            triangles.extend(fan(&wall.map(|(x, y, z)| DVec3::new(x, y, z))));
        }
    }
    triangles
}

/// A level rectangle with a rectangular hole, its front up or down.
fn level_ring(
    y: f64,
    outer: ([f64; 2], [f64; 2]),
    hole: ([f64; 2], [f64; 2]),
    up: bool,
) -> Vec<Triangle> {
    let ring = |([x0, z0], [x1, z1]): ([f64; 2], [f64; 2])| {
        [[x0, z0], [x1, z0], [x1, z1], [x0, z1]].map(|[x, z]| DVec3::new(x, y, z))
    };
    let (outer, hole) = (ring(outer), ring(hole));
    (0..4)
        .flat_map(|i| {
            let j = (i + 1) % 4;
            let mut quad = [outer[i], outer[j], hole[j], hole[i]];
            if up {
                quad.reverse();
            }
            fan(&quad)
        })
        .collect()
}

fn cuboid(min: DVec3, max: DVec3) -> Vec<Triangle> {
    let rect = [[min.x, min.y], [max.x, min.y], [max.x, max.y], [min.x, max.y]];
    let mut triangles = extruded(&rect, &[rect.into()], max.z - min.z);
    triangles.as_flattened_mut().iter_mut().for_each(|p| p.z += min.z);
    triangles
}

fn covered(polygons: &[Polygon]) -> f64 {
    polygons.iter().map(|polygon| area(&polygon.triangles)).sum()
}

/// The carved model: what is left of the polygons, and the caps.
fn carved_model(carved: &CarvedModel) -> Vec<Triangle> {
    let kept = carved.polygons.iter().flat_map(|p| &p.triangles);
    kept.chain(carved.caps.iter().flat_map(|a| &a.triangles)).copied().collect()
}

/// Whether every edge is used as often in one direction as in the other.
fn is_closed(triangles: &[Triangle]) -> bool {
    let polygons = Polygons::merge(triangles, &[]);
    polygons.edges().all(|edge| edge.iter().map(|border| border.sense).sum::<i32>() == 0)
}

/// Whether a point lies in a triangle, to a hundredth of a millimetre.
fn contains(&[a, b, c]: &Triangle, point: DVec3) -> bool {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    normal.dot(point - a).abs() < 1e-5
        && [(a, b), (b, c), (c, a)]
            .iter()
            .all(|&(p, q)| normal.cross((q - p).normalize_or_zero()).dot(point - p) > -1e-5)
}

/// Checks what holds for every carving.
fn check_sound(model: &[Triangle], carved: &CarvedModel) {
    let (before, after) = (area(model), covered(&carved.polygons) + covered(&carved.cuttings));
    assert!((before - after).abs() < 1e-6 * before.max(1.0), "{before} {after}");
    assert!(carved.report.after < Class::NonAxial, "{:?}", carved.report);
    let normals = |t: &Triangle| (t[1] - t[0]).cross(t[2] - t[0]).normalize_or_zero();
    for polygon in carved.polygons.iter().chain(&carved.cuttings) {
        for triangle in polygon.triangles.iter().filter(|t| area(&[**t]) > 1e-6) {
            assert!(normals(triangle).dot(polygon.plane.normal) > 0.999);
        }
    }
    for triangle in carved.polygons.iter().flat_map(|p| &p.triangles) {
        let centre = triangle.iter().sum::<DVec3>() / 3.0;
        assert!(model.iter().any(|original| contains(original, centre)), "{centre} is not of it");
    }
    for added in &carved.caps {
        assert!(added.triangles.iter().all(|t| normals(t).dot(added.plane.normal) > 0.999));
    }
}

#[test]
fn the_arch_of_figure_4() {
    let model = arch(6, 1.0);
    assert!(is_closed(&model));
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    let CarveReport { polygons, axial, semi_axial, non_axial, elements, clusters, .. } =
        carved.report;
    // Six pieces of the front, the back and the soffit each.
    assert_eq!((polygons, axial, semi_axial, non_axial), (29, 11, 0, 18));
    // As in Fig. 5.
    assert_eq!((elements, clusters), (6, 1));
    let CarveReport { units, confined, cuttings, added, sealed, removed, before, after, .. } =
        carved.report;
    assert_eq!((units, confined, cuttings, removed), (1, 0, 18, 6));
    assert_eq!((before, after), (Class::NonAxial, Class::Axial));
    // The three dark polygons of Fig. 4b: above and on both sides.
    assert_eq!((added, sealed), (3, 3));
    let sizes: Vec<f64> = carved.caps.iter().map(|a| area(&a.triangles)).collect();
    let normals: Vec<DVec3> = carved.caps.iter().map(|a| a.plane.normal).collect();
    assert_eq!(normals, [DVec3::X, DVec3::NEG_X, DVec3::NEG_Y]);
    assert!(sizes.iter().zip([0.5, 0.5, 1.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{sizes:?}");
    assert!(is_closed(&carved_model(&carved)));
}

/// Smaller units leave more of the wall, and stairs instead of one opening (Lei and Ouhyoung 1999,
/// Fig. 6d).
#[test]
fn elements_as_units_cut_less() {
    let model = arch(6, 1.0);
    let clusters = carve(&model, &[], &CarveOptions::default());
    let elements = carve(&model, &[], &CarveOptions { units: CarvingUnits::Elements });
    check_sound(&model, &elements);
    assert_eq!((elements.report.units, elements.report.added, elements.report.sealed), (6, 12, 12));
    assert!(covered(&elements.polygons) > covered(&clusters.polygons) + 0.3);
    assert!(is_closed(&carved_model(&elements)));
}

/// The sides of the passage lie on the sides of the volume, which become caps as a whole (Lei and
/// Ouhyoung 1999, Fig. 9).
#[test]
fn an_octagonal_passage_becomes_square() {
    let model = passage(false);
    assert!(is_closed(&model));
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    assert_eq!((carved.report.clusters, carved.report.added, carved.report.sealed), (1, 4, 4));
    assert!(carved.caps.iter().all(|a| (area(&a.triangles) - 4.0).abs() < 1e-9));
    assert!(is_closed(&carved_model(&carved)));
}

/// External edges in the interior of a side bound a hole in its cap.
#[test]
fn a_shaft_in_the_roof_of_a_passage_stays_open() {
    let model = passage(true);
    assert!(is_closed(&model));
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    let roof = carved.caps.iter().find(|a| a.plane.normal == DVec3::NEG_Y).unwrap();
    assert!((area(&roof.triangles) - (4.0 - 0.16)).abs() < 1e-6, "{}", area(&roof.triangles));
    assert_eq!(carved.report.added, 4);
    assert!(is_closed(&carved_model(&carved)));
}

/// Polygons in the box that are not connected to the unit there stay whole (Lei and Ouhyoung 1999,
/// Fig. 8).
#[test]
fn unconnected_polygons_in_the_box_are_not_split() {
    let mut model = arch(6, 1.0);
    let beam = cuboid(DVec3::new(-1.0, 1.8, 0.2), DVec3::new(5.0, 2.0, 0.3));
    model.extend(&beam);
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    assert_eq!((carved.report.cuttings, carved.report.added), (18, 3));
    let is_of_beam = |p: &&Polygon| p.triangles.iter().flatten().any(|c| c.x < -0.5 || c.x > 4.5);
    let left: f64 = carved.polygons.iter().filter(is_of_beam).map(|p| area(&p.triangles)).sum();
    assert!((left - area(&beam)).abs() < 1e-9, "{left}");
}

/// A wall without thickness has no inside, so its caps are not sealed.
#[test]
fn nothing_is_sealed_in_an_open_surface() {
    let mut model = arch(6, 1.0);
    model.retain(|t| !t.iter().all(|p| p.z == 0.0));
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    assert_eq!(carved.report.sealed, 0);
    // An inside-out surface seals nothing either.
    let turned: Vec<Triangle> = arch(6, 1.0).into_iter().map(|[a, b, c]| [a, c, b]).collect();
    assert_eq!(carve(&turned, &[], &CarveOptions::default()).report.sealed, 0);
}

/// A cavity in the block reaches through one of the caps.
#[test]
fn nothing_is_sealed_across_a_cavity() {
    let mut model = passage(false);
    let hole = cuboid(DVec3::new(1.05, 2.85, 0.5), DVec3::new(1.2, 3.2, 1.0));
    model.extend(hole.iter().map(|&[a, b, c]| [a, c, b]));
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    let open: Vec<DVec3> =
        carved.caps.iter().filter(|a| !a.sealed).map(|a| a.plane.normal).collect();
    assert_eq!(open, [DVec3::NEG_Y]);
    assert_eq!(carved.report.sealed, 3);
    // A block inside a room that was hewn from something larger has no sealed cap either.
    let mut hewn = passage(false);
    let room = cuboid(DVec3::splat(-5.0), DVec3::splat(9.0));
    hewn.extend(room.iter().map(|&[a, b, c]| [a, c, b]));
    assert_eq!(carve(&hewn, &[], &CarveOptions::default()).report.sealed, 0);
}

/// In a corridor with chamfered edges, the box of all chamfers is the corridor: carving it would
/// leave nothing.
#[test]
fn a_cluster_does_not_take_all_that_is_joined_to_it() {
    let chamfered = [
        [0.1, 0.0],
        [2.9, 0.0],
        [3.0, 0.1],
        [3.0, 2.9],
        [2.9, 3.0],
        [0.1, 3.0],
        [0.0, 2.9],
        [0.0, 0.1],
    ];
    let model: Vec<Triangle> = extruded(&chamfered, &[chamfered.into()], 30.0);
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    assert_eq!(carved.report.clusters, 1);
    assert!(
        covered(&carved.polygons) > 0.85 * area(&model),
        "{}",
        covered(&carved.polygons) / area(&model)
    );
}

/// A terrain of squares one metre wide, and a house on a level place in its middle. The walls rise
/// from edges of the terrain, and are lower than the hills.
fn house_on_terrain() -> (Vec<Triangle>, Vec<Triangle>) {
    let height = |x: i32, z: i32| {
        let away = f64::from((x - 10).abs().max((z - 10).abs()) - 3).max(0.0);
        away * 0.8 + 0.1 * away * f64::from((x * 7 + z * 5) % 3)
    };
    let at = |x: i32, z: i32| DVec3::new(x.into(), height(x, z), z.into());
    let mut terrain = Vec::new();
    for (x, z) in (0..20).flat_map(|x| (0..20).map(move |z| (x, z))) {
        let is_house = (8..12).contains(&x) && (8..12).contains(&z);
        let [a, b, c, d] = [at(x, z), at(x, z + 1), at(x + 1, z + 1), at(x + 1, z)];
        if !is_house {
            terrain.extend([[a, b, c], [a, c, d]]);
        }
    }
    let house = cuboid(DVec3::new(8.0, 0.0, 8.0), DVec3::new(12.0, 3.0, 12.0));
    let is_floor = |t: &Triangle| t.iter().all(|p| p.y == 0.0);
    (terrain, house.into_iter().filter(|t| !is_floor(t)).collect())
}

/// The box of the terrain contains the house, and the walls are connected to the terrain.
#[test]
fn a_terrain_does_not_take_the_house_that_stands_on_it() {
    let (terrain, house) = house_on_terrain();
    let model = [&terrain[..], &house].concat();
    let carved = carve(&model, &[], &CarveOptions::default());
    check_sound(&model, &carved);
    let is_wall = |p: &&Polygon| p.plane.normal.y.abs() < 0.5;
    let left: f64 = carved.polygons.iter().filter(is_wall).map(|p| area(&p.triangles)).sum();
    assert!((left - 48.0).abs() < 1e-9, "{left}");
    assert!(carved.report.clusters >= 1 && carved.report.cuttings > 100);
}

/// In its own axes, a building turned by any angle is the building it was, in single precision.
#[test]
fn a_turned_building_is_carved_like_one_that_is_not() {
    let glb = sightline_demo_building::glb(6, 3);
    let model = crate::import::glb::read_slice(&glb, None, "demo").unwrap();
    let carved_at = |degrees: f64| {
        let axes = Axes::turned(degrees.to_radians());
        let turned = |p: &glam::Vec3| axes.world(*p);
        let opaque: Vec<[glam::Vec3; 3]> =
            model.opaque.iter().map(|corners| corners.each_ref().map(turned)).collect();
        let turn = dominant_orientation(&opaque);
        assert!((turn - degrees.to_radians()).abs() < 1e-6, "{degrees} {turn}");
        let axes = Axes::turned(turn);
        let own = |p: glam::Vec3| axes.own_exact(p.as_dvec3());
        let triangles: Vec<Triangle> = opaque.iter().map(|corners| corners.map(own)).collect();
        let carved = carve(&triangles, &[], &CarveOptions::default());
        (carved.report.clone(), covered(&carved.polygons))
    };
    let (straight, left) = carved_at(0.0);
    assert!(straight.clusters > 5 && straight.axial > 1000, "{straight:?}");
    for degrees in [30.0, 17.3, 44.9, 89.2] {
        let (report, still_left) = carved_at(degrees);
        assert_eq!(format!("{report:?}"), format!("{straight:?}"), "{degrees}");
        assert!((left - still_left).abs() < 1e-3 * left, "{left} {still_left}");
    }
}

#[test]
fn odd_input_is_carved_too() {
    assert_eq!(carve(&[], &[], &CarveOptions::default()).report.after, Class::Axial);
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let model = [
        [p(0., 0.), p(0., 0.), p(0., 0.)],
        [p(0., 0.), p(1., 0.), p(2., 0.)],
        [p(0., 0.), p(4., 0.), p(4., 3.)],
        [p(0., 0.), p(4., 0.), p(4., 3.)],
        [p(0., 0.), p(4., 3.), p(4., 0.)],
        [p(0., 0.), p(1e-5, 2.), p(4., 3.)],
    ];
    let carved = carve(&model, &[], &CarveOptions::default());
    assert_eq!(carved.report.degenerate, 2);
    check_sound(&model, &carved);
}
