//! Reference models: lines that are known to exist, and a slow search for lines.

use glam::DVec3;
use rand::{Rng, SeedableRng, rngs::SmallRng};

use super::{
    directed_gate::{DirectedGate, edge_separators},
    separators::{HalfSpaces, separators},
    *,
};
use crate::HalfSpace;

fn vector(rng: &mut SmallRng, mut of: impl FnMut(&mut SmallRng) -> f64) -> DVec3 {
    DVec3::new(of(rng), of(rng), of(rng))
}

/// Multiples of 1/64: their products and sums are exact.
fn coarse(rng: &mut SmallRng, within: f64) -> f64 {
    (rng.random_range(-within..within) * 64.0).round() / 64.0
}

/// Whether a line meets a box that is enlarged by a margin.
fn meets(from: DVec3, along: DVec3, region: &DAabb, margin: f64) -> bool {
    let (mut first, mut last) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        let (low, high) = (region.min[axis] - margin, region.max[axis] + margin);
        if along[axis] == 0.0 {
            if from[axis] < low || from[axis] > high {
                return false;
            }
        } else {
            let (a, b) = ((low - from[axis]) / along[axis], (high - from[axis]) / along[axis]);
            (first, last) = (first.max(a.min(b)), last.min(a.max(b)));
        }
    }
    first <= last
}

/// A box around a point. It is often flat, and the point is often on its boundary.
fn around(rng: &mut SmallRng, point: DVec3, size: f64) -> DAabb {
    let below = vector(rng, |rng| if rng.random_bool(0.4) { 0.0 } else { coarse(rng, size).abs() });
    let above = vector(rng, |rng| if rng.random_bool(0.4) { 0.0 } else { coarse(rng, size).abs() });
    DAabb { min: point - below, max: point + above }
}

/// The signs of a direction, some of them left open. Where the direction is level, either sign will
/// do.
fn signs(rng: &mut SmallRng, along: DVec3) -> exact::DirectionSigns {
    std::array::from_fn(|axis| match rng.random_range(0..3) {
        0 => None,
        _ if along[axis] == 0.0 => Some(rng.random_bool(0.5)),
        _ => Some(along[axis] > 0.0),
    })
}

/// Lines of all kinds, each with boxes that it is known to meet.
#[test]
fn a_line_that_exists_is_found() {
    let mut rng = SmallRng::seed_from_u64(1);
    let mut spare = Vec::new();
    for case in 0..200_000 {
        let rng = &mut rng;
        let offset = [0.0, 0.0, 1_000.0, -1_000.0][rng.random_range(0..4)];
        let from = vector(rng, |rng| coarse(rng, 8.0) + offset);
        // Level along no axis, one or two, or nearly level.
        let kinds = [1.0, 1.0, 0.0, 1.0 / 4_096.0, 1.0 / 1_048_576.0];
        let mut along = vector(rng, |rng| coarse(rng, 1.0) * kinds[rng.random_range(0..5)]);
        if along == DVec3::ZERO {
            along = DVec3::AXES[rng.random_range(0..3)];
        }
        let reach = [4.0, 100.0, 1_000.0][rng.random_range(0..3)];
        let size = [0.1, 1.0, 10.0][rng.random_range(0..3)];
        let boxes: Vec<_> = (0..rng.random_range(1..9))
            .map(|_| {
                let point = from + along * coarse(rng, reach);
                around(rng, point, size)
            })
            .collect();
        let signs = signs(rng, along);
        // A poor guess of the direction must do no harm.
        let towards =
            if rng.random_bool(0.5) { along } else { vector(rng, |rng| coarse(rng, 2.0)) };
        assert!(
            exact::line_meets_all(&boxes, signs, towards, &mut spare),
            "case {case}: {from} + t {along}, {signs:?}, towards {towards}: {boxes:?}"
        );
    }
}

/// Two slits whose heights hardly differ and that are far apart: the line between them is nearly
/// level.
#[test]
fn nearly_level_lines_through_thin_gaps_are_found() {
    let mut spare = Vec::new();
    for gap in [1e-5, 2e-4, 1e-3, 0.01] {
        for length in [1.0, 10.0, 100.0, 400.0, 1_000.0, 4_000.0] {
            for at in [0.0, 1_000.0, -1_000.0] {
                for level in 0..3 {
                    let (u, v) = ((level + 1) % 3, (level + 2) % 3);
                    let slit = |height: f64, along: f64| {
                        let mut region = DAabb { min: DVec3::splat(at), max: DVec3::splat(at) };
                        region.min[level] += height;
                        region.max[level] += height;
                        region.min[u] += along;
                        region.max[u] += along + 0.5;
                        region.min[v] += along * 0.5;
                        region.max[v] += along * 0.5 + 0.5;
                        region
                    };
                    let boxes = [slit(0.0, 0.0), slit(gap, length)];
                    for signs in [[Some(true); 3], [None; 3]] {
                        assert!(
                            exact::line_meets_all(&boxes, signs, DVec3::ONE, &mut spare),
                            "{gap} in {length}, axis {level}, at {at}"
                        );
                    }
                }
            }
        }
    }
}

/// The bounds that boxes put on the moments of lines, for an inverse direction.
fn moments(boxes: &[DAabb], w: DVec3) -> (DVec3, DVec3) {
    let (mut low, mut high) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
    for DAabb { min, max } in boxes {
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            low[axis] = low[axis].max(min[u] * w[u] - max[v] * w[v]);
            high[axis] = high[axis].min(max[u] * w[u] - min[v] * w[v]);
        }
    }
    (low, high)
}

/// By how much the best rising direction fails; not positive if some line meets all boxes. The
/// failure is the maximum of functions that are linear in the inverse direction, so it is convex.
/// Two nested ternary searches find its minimum.
fn best_rising(boxes: &[DAabb]) -> (f64, DVec3) {
    let fails = |w: DVec3| {
        let (low, high) = moments(boxes, w);
        (low - high).max_element().max(low.element_sum()).max(-high.element_sum())
    };
    let by_thirds = |of: &dyn Fn(f64) -> f64| {
        let (mut from, mut to) = (0.0, 1.0);
        for _ in 0..70 {
            let (a, b) = (from + (to - from) / 3.0, to - (to - from) / 3.0);
            if of(a) <= of(b) { to = b } else { from = a }
        }
        (from + to) * 0.5
    };
    let weights = |s: f64, t: f64| DVec3::new(s, (1.0 - s) * t, (1.0 - s) * (1.0 - t));
    let best_t = |s: f64| by_thirds(&|t| fails(weights(s, t)));
    let s = by_thirds(&|s| fails(weights(s, best_t(s))));
    let w = weights(s, best_t(s));
    (fails(w), w)
}

/// The line that meets all boxes, for an inverse direction well inside the allowed ones.
fn line(boxes: &[DAabb], w: DVec3) -> (DVec3, DVec3) {
    let (low, high) = moments(boxes, w);
    // Moments between the bounds whose sum is zero.
    let share = -low.element_sum() / (high.element_sum() - low.element_sum()).max(1e-300);
    let m = low + (high - low) * share;
    let d = w.recip();
    let moment = DVec3::new(m.x * d.y * d.z, m.y * d.z * d.x, m.z * d.x * d.y);
    (d.cross(moment) / d.length_squared(), d / d.length())
}

#[test]
fn the_exact_test_agrees_with_a_slow_search() {
    let mut rng = SmallRng::seed_from_u64(2);
    let mut spare = Vec::new();
    let (mut met, mut not_met, mut wrong) = (0, 0, 0);
    for case in 0..3_000 {
        let rng = &mut rng;
        let count = rng.random_range(2..9);
        let flip = vector(rng, |rng| [1.0, -1.0][rng.random_range(0..2)]);
        // Boxes and rectangles near a diagonal. About half of the cases have no line.
        let rising: Vec<_> =
            (0..count)
                .map(|i| {
                    let place = vector(rng, |rng| coarse(rng, 2.0)) + f64::from(i) * 2.0;
                    let size = vector(rng, |rng| {
                        if rng.random_bool(0.3) { 0.0 } else { coarse(rng, 3.0).abs() }
                    });
                    DAabb { min: place, max: place + size }
                })
                .collect();
        let boxes: Vec<_> = rising
            .iter()
            .map(|b| {
                let (a, b) = (b.min * flip, b.max * flip);
                DAabb { min: a.min(b), max: a.max(b) }
            })
            .collect();
        let (fails, w) = best_rising(&rising);
        let signs = [0, 1, 2].map(|axis| Some(flip[axis] > 0.0));
        let towards = if rng.random_bool(0.5) { flip } else { vector(rng, |rng| coarse(rng, 2.0)) };
        let found = exact::line_meets_all(&boxes, signs, towards, &mut spare);
        if fails < -1e-6 && w.min_element() > 1e-4 {
            let (from, along) = line(&rising, w);
            assert!(
                rising.iter().all(|b| meets(from, along, b, 1e-6)),
                "the reference model, in case {case}"
            );
        }
        if fails <= 0.0 {
            met += 1;
            assert!(found, "case {case}: {boxes:?}, {signs:?}: fails by {fails} at {w}");
        } else if fails > 1e-6 {
            not_met += 1;
            wrong += usize::from(found);
        }
    }
    assert!(met > 500 && not_met > 500, "{met} cases have a line, {not_met} do not");
    assert!(wrong * 200 < not_met, "{wrong} of {not_met} are said to have a line");
    println!("{met} cases have a line; of {not_met} that do not, {wrong} are said to have one");
}

/// A point of a box, often on its boundary.
fn point_in(rng: &mut SmallRng, region: &DAabb) -> DVec3 {
    let mut place = vector(rng, |rng| rng.random_range(-0.3..1.3f64).clamp(0.0, 1.0));
    place = region.min + (region.max - region.min) * place;
    place
}

fn random_box(rng: &mut SmallRng, offset: f64) -> DAabb {
    let min = vector(rng, |rng| rng.random_range(-5.0..5.0) + offset);
    let size =
        vector(rng, |rng| if rng.random_bool(0.3) { 0.0 } else { rng.random_range(0.0..4.0) });
    DAabb { min, max: min + size }
}

#[test]
fn lines_stay_between_the_separating_planes() {
    let mut rng = SmallRng::seed_from_u64(3);
    let mut halves = HalfSpaces::none();
    let mut planes = 0;
    for case in 0..4_000 {
        let rng = &mut rng;
        let offset = [0.0, 1_000.0, -1_000.0][case % 3];
        let (source, pass) = (random_box(rng, offset), random_box(rng, offset));
        separators(&source, &pass, &mut halves);
        planes += halves.count;
        for half in halves.as_slice() {
            assert!((half.normal.length() - 1.0).abs() < 1e-9);
            // It touches both boxes, one on each side: it cannot be moved or turned inwards.
            let heights =
                |region: &DAabb| region.corners().map(|c| half.normal.dot(c) - half.distance);
            let nearest = heights(&source).into_iter().fold(f64::INFINITY, f64::min);
            let farthest = heights(&pass).into_iter().fold(f64::NEG_INFINITY, f64::max);
            assert!(nearest.abs() < 1e-8 && farthest.abs() < 1e-8, "case {case}: {half:?}");
        }
        for _ in 0..50 {
            let (from, through) = (point_in(rng, &source), point_in(rng, &pass));
            let beyond = through + (through - from) * rng.random_range(0.0..10.0f64);
            let around = DAabb { min: beyond, max: beyond };
            assert!(halves.meet(&around), "case {case}: from {from} through {through}");
            assert!(halves.cut(&mut around.clone()), "case {case}");
        }
    }
    assert!(planes > 8_000, "{planes}");
}

/// A point beyond both boxes that is outside a separating plane is on no line through the boxes.
#[test]
fn points_outside_a_separating_plane_are_on_no_line() {
    let mut rng = SmallRng::seed_from_u64(4);
    let mut halves = HalfSpaces::none();
    let (mut spare, mut inside, mut kept) = (Vec::new(), 0, 0);
    for _ in 0..4_000 {
        let rng = &mut rng;
        let wide = |rng: &mut SmallRng| {
            let region = random_box(rng, 0.0);
            DAabb { max: region.max + 0.1, ..region }
        };
        let (source, mut pass) = (wide(rng), wide(rng));
        // The second box is ahead along one axis, as the next gate always is.
        let axis = rng.random_range(0..3);
        let shift = source.max[axis] - pass.min[axis] + rng.random_range(0.01..4.0);
        (pass.min[axis], pass.max[axis]) = (pass.min[axis] + shift, pass.min[axis] + shift);
        separators(&source, &pass, &mut halves);
        for _ in 0..20 {
            let mut point = vector(rng, |rng| rng.random_range(-20.0..20.0));
            point[axis] = pass.max[axis] + rng.random_range(0.01..10.0);
            let target = DAabb { min: point, max: point };
            let is_on_line = exact::line_meets_all(
                &[source, pass, target],
                [None; 3],
                point - source.min,
                &mut spare,
            );
            let meets = halves.meet(&target);
            let outside = |half: &HalfSpace| half.normal.dot(point) > half.distance + 1e-3;
            let is_outside = halves.as_slice().iter().any(outside);
            assert!(!is_outside || !is_on_line, "{source:?}, {pass:?}, {point}");
            kept += usize::from(meets);
            inside += usize::from(is_on_line);
        }
    }
    // The planes are tangents of projections, so they keep a few points that are on no line.
    assert!(inside > 1_000 && kept * 10 < inside * 11, "{kept} kept, {inside} seen");
    println!("of {kept} points kept, {inside} are on a line");
}

/// Includes sources that reach through the gate's plane, as boxes around cells with slanted sides
/// do.
#[test]
fn lines_stay_between_the_planes_through_slanted_edges() {
    let mut rng = SmallRng::seed_from_u64(5);
    let mut planes = 0;
    for case in 0..4_000 {
        let rng = &mut rng;
        let normal = vector(rng, |rng| rng.random_range(-1.0..1.0)).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let corners: Vec<glam::Vec3> = (0..rng.random_range(3..7))
            .scan(0.0, |angle, _| {
                *angle += rng.random_range(0.4..1.0f64);
                let (sine, cosine) = angle.sin_cos();
                Some(((u * cosine + v * sine) * 2.0).as_vec3())
            })
            .collect();
        let gate = DirectedGate::slanted(normal, &corners, 0);
        let source = random_box(rng, 0.0);
        let mut halves = HalfSpaces::none();
        edge_separators(&source, &gate, normal, &mut halves);
        planes += halves.count;
        for _ in 0..50 {
            let from = point_in(rng, &source);
            let weights: Vec<f64> = corners.iter().map(|_| rng.random_range(0.0..1.0)).collect();
            let sum: f64 = weights.iter().sum();
            let through: DVec3 =
                corners.iter().zip(&weights).map(|(c, w)| c.as_dvec3() * (w / sum)).sum();
            if normal.dot(from) > gate.distance - 1e-3 {
                continue;
            }
            let beyond = through + (through - from) * rng.random_range(0.0..10.0f64);
            let around = DAabb { min: beyond, max: beyond };
            assert!(halves.meet(&around), "case {case}: from {from} through {through}: {source:?}");
        }
    }
    assert!(planes > 4_000, "{planes}");
}
