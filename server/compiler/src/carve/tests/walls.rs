//! Merging and classes against a reference model: random walls with openings, triangulated at
//! random.

use proptest::prelude::*;

use super::*;

/// A wall of squares, some of which are open.
#[derive(Debug, Clone)]
struct Wall {
    squares: [[bool; 6]; 5],
    /// Which diagonal each square has.
    fans: [[bool; 6]; 5],
    axis: usize,
    turn: f64,
}

fn wall() -> impl Strategy<Value = Wall> {
    (any::<[[bool; 6]; 5]>(), any::<[[bool; 6]; 5]>(), 0..3usize, 0.0..1.5f64)
        .prop_map(|(squares, fans, axis, turn)| Wall { squares, fans, axis, turn })
}

impl Wall {
    /// Two triangles a square, with the diagonal either way; in single precision, as models are.
    fn triangles(&self, turn: f64) -> Vec<Triangle> {
        let corner = |u: usize, v: usize| {
            let (u, v) = (u as f64 * 0.7 + 11.3, v as f64 * 0.45);
            let at = match self.axis {
                0 => DVec3::new(3.1, u, v),
                1 => DVec3::new(v, 3.1, u),
                _ => DVec3::new(u, v, 3.1),
            };
            Axes::turned(-turn).own_exact(at).as_vec3().as_dvec3()
        };
        let mut triangles = Vec::new();
        for (v, row) in self.squares.iter().enumerate() {
            for (u, _) in row.iter().enumerate().filter(|(_, there)| **there) {
                let mut ring = [(u, v), (u + 1, v), (u + 1, v + 1), (u, v + 1)];
                if self.fans[v][u] {
                    ring.rotate_left(1);
                }
                triangles.extend(fan(&ring.map(|(u, v)| corner(u, v))));
            }
        }
        triangles
    }

    fn count(&self) -> usize {
        self.squares.as_flattened().iter().filter(|there| **there).count()
    }
}

/// The number of polygons, by brute force: triangles that share a diagonal are in one polygon.
fn naive_polygons(triangles: &[Triangle]) -> usize {
    let mut of: Vec<usize> = (0..triangles.len()).collect();
    for i in 0..triangles.len() {
        for j in 0..i {
            let shared: Vec<DVec3> =
                triangles[i].iter().filter(|p| triangles[j].contains(p)).copied().collect();
            let is_diagonal = |a: DVec3, b: DVec3| {
                (a - b).abs().to_array().iter().filter(|d| **d > 0.1).count() == 2
            };
            if shared.len() == 2 && is_diagonal(shared[0], shared[1]) {
                let (from, to) = (of[i], of[j]);
                of.iter_mut().filter(|o| **o == from).for_each(|o| *o = to);
            }
        }
    }
    of.sort_unstable();
    of.dedup();
    of.len()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// However a wall is triangulated, its diagonals vanish and it is axial.
    #[test]
    fn diagonals_vanish(wall in wall()) {
        let triangles = wall.triangles(0.0);
        let polygons = Polygons::merge(&triangles, &[]);
        prop_assert_eq!(polygons.len(), naive_polygons(&triangles));
        prop_assert!(classes(&polygons).iter().all(|&c| c == Class::Axial));
        for polygon in 0..polygons.len() as u32 {
            let loops = polygons.loops(polygon);
            prop_assert_eq!((loops.len(), loops[0].len()), (1, 4));
        }
    }

    /// Walls turned about the vertical are semi-axial. In their own axes they are axial.
    #[test]
    fn turned_walls_are_semi_axial(wall in wall()) {
        prop_assume!(wall.count() > 0 && wall.turn > 0.01);
        let triangles = wall.triangles(wall.turn);
        // A diagonal along an axis would look like a side.
        let is_along_axis = |edge: DVec3| edge.x.abs().min(edge.z.abs()) < edge.length() * 1e-3;
        let edges = |t: &Triangle| [t[1] - t[0], t[2] - t[1], t[0] - t[2]];
        let level = triangles.iter().flat_map(edges).filter(|edge| edge.y.abs() < 1e-6);
        prop_assume!(!level.into_iter().any(is_along_axis));
        let carved = carve(&triangles, &[], &CarveOptions::default());
        prop_assert_eq!(carved.report.before, Class::SemiAxial);
        prop_assert_eq!(carved.report.clusters, 0);
        let own: Vec<Triangle> =
            triangles.iter().map(|t| t.map(|p| Axes::turned(wall.turn).own_exact(p))).collect();
        prop_assert_eq!(carve(&own, &[], &CarveOptions::default()).report.before, Class::Axial);
    }

    /// Triangles of different surfaces stay apart.
    #[test]
    fn triangles_of_two_surfaces_do_not_merge(wall in wall()) {
        let triangles = wall.triangles(0.0);
        let surfaces: Vec<u32> = (0..triangles.len() as u32).collect();
        prop_assert_eq!(Polygons::merge(&triangles, &surfaces).len(), triangles.len());
    }

    /// A polygon cut at random points of its diagonal merges again, though no two triangles share a
    /// whole edge.
    #[test]
    fn t_junctions_do_not_matter(cuts in prop::collection::vec(0.05..0.95f64, 1..6)) {
        let [a, b, c, d] = [[0., 0.], [5., 0.], [5., 3.], [0., 3.]]
            .map(|[x, y]| DVec3::new(x, y, 1.0));
        let mut cuts = cuts;
        cuts.sort_by(f64::total_cmp);
        cuts.dedup_by(|x, y| (*x - *y).abs() < 1e-3);
        let mut triangles = vec![[a, b, c]];
        let mut last = a;
        for &cut in cuts.iter().chain([&1.0]) {
            let next = a.lerp(c, cut);
            triangles.push([d, last, next]);
            last = next;
        }
        let polygons = Polygons::merge(&triangles, &[]);
        prop_assert_eq!(polygons.len(), 1);
        prop_assert_eq!(classes(&polygons)[0], Class::Axial);
    }
}

#[test]
fn a_ring_that_is_one_polygon_has_a_hole() {
    // Triangulated so that only slanted edges are within.
    let ring = level_ring(0.0, ([0.0, 0.0], [4.0, 4.0]), ([1.0, 1.0], [2.0, 3.0]), true);
    let polygons = Polygons::merge(&ring, &[]);
    assert_eq!(polygons.len(), 1);
    let mut sizes: Vec<usize> = polygons.loops(0).iter().map(Vec::len).collect();
    sizes.sort_unstable();
    assert_eq!(sizes, [4, 4]);
    assert_eq!(classes(&polygons)[0], Class::Axial);
}
