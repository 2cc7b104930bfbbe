//! A carved model blocks no line of sight that the original model lets through.

use proptest::prelude::*;
use sightline_oracle::Oracle;
use sightline_world::Mesh;

use super::*;

fn sight(triangles: &[Triangle]) -> Oracle {
    let positions = triangles.as_flattened().iter().map(|p| p.as_vec3()).collect();
    let triangles = (0..triangles.len() as u32).map(|i| [i * 3, i * 3 + 1, i * 3 + 2]).collect();
    Oracle::new(&Mesh { positions, triangles })
}

/// A random closed wall with an arch, somewhere, across x or z.
fn moved_arch() -> impl Strategy<Value = Vec<Triangle>> {
    (2..12usize, 0.3..1.4f64, any::<bool>(), -9..9i32, -9..9i32).prop_map(
        |(segments, rise, across, x, z)| {
            let mut model = arch(segments, rise);
            for p in model.as_flattened_mut() {
                let at = if across { DVec3::new(p.z, p.y, 4.0 - p.x) } else { *p };
                *p = (at + DVec3::new(f64::from(x), 0.0, f64::from(z))).as_vec3().as_dvec3();
            }
            model
        },
    )
}

const WAYS: [glam::Vec3; 5] = [
    glam::Vec3::new(0.31, 0.87, 0.41),
    glam::Vec3::new(-0.7, 0.21, 0.3),
    glam::Vec3::new(0.53, -0.37, 0.71),
    glam::Vec3::new(-0.17, 0.61, -0.83),
    glam::Vec3::new(-0.29, -0.43, 0.19),
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn the_carved_model_hides_nothing_that_is_visible(
        arches in prop::collection::vec(moved_arch(), 1..5),
        smallest in any::<bool>(),
        rays in prop::collection::vec((any::<[u16; 3]>(), any::<[u16; 3]>()), 200),
    ) {
        let model: Vec<Triangle> = arches.concat();
        let units = if smallest { CarvingUnits::Elements } else { CarvingUnits::Clusters };
        let carved = carve(&model, &[], &CarveOptions { units });
        check_sound(&model, &carved);
        let kept: Vec<Triangle> =
            carved.polygons.iter().flat_map(|p| p.triangles.clone()).collect();
        let cut = carved.cuttings.iter().flat_map(|p| p.triangles.clone());
        let all: Vec<Triangle> = kept.iter().copied().chain(cut).collect();
        let (original, kept, all) = (sight(&model), sight(&kept), sight(&all));
        for (from, to) in rays {
            let point = |[x, y, z]: [u16; 3]| {
                let at = DVec3::new(x.into(), y.into(), z.into()) / f64::from(u16::MAX);
                (at * DVec3::new(26.0, 4.0, 26.0) - DVec3::new(11.0, 0.5, 11.0)).as_vec3()
            };
            let (from, to) = (point(from), point(to));
            if original.between(from, to) {
                prop_assert!(kept.between(from, to), "{from} {to}");
            }
            // With its cuttings, the carved model is the original.
            let direction = (to - from).normalize_or(glam::Vec3::X);
            match (original.distance(from, direction), all.distance(from, direction)) {
                (Some(a), Some(b)) => prop_assert!((a - b).abs() < 1e-3, "{a} {b}"),
                (a, b) => prop_assert_eq!(a, b),
            }
        }
    }

    /// One arch is a closed solid and stays one. Its caps lie inside it.
    #[test]
    fn sealed_caps_lie_in_the_solid(model in moved_arch(), smallest in any::<bool>()) {
        let units = if smallest { CarvingUnits::Elements } else { CarvingUnits::Clusters };
        let carved = carve(&model, &[], &CarveOptions { units });
        prop_assert!(carved.report.added > 0 && carved.report.sealed == carved.report.added);
        prop_assert!(is_closed(&carved_model(&carved)));
        let solid = sight(&model);
        for triangle in carved.caps.iter().flat_map(|a| &a.triangles) {
            let centre = (triangle.iter().sum::<DVec3>() / 3.0).as_vec3();
            // Wherever one goes from there, one meets the surface first from behind: an odd number
            // of times. Past an edge that is nearer than a step a crossing may be lost, so most
            // ways count.
            let is_odd = |direction: &glam::Vec3| {
                let direction = direction.normalize();
                let (mut at, mut crossings) = (centre, 0);
                while let Some(distance) = solid.distance(at, direction).filter(|_| crossings < 100) {
                    crossings += 1;
                    at += direction * (distance + 1e-4);
                }
                crossings % 2 == 1
            };
            let odd = WAYS.iter().filter(|way| is_odd(way)).count();
            prop_assert!(odd > WAYS.len() / 2, "{}", centre);
        }
    }
}
