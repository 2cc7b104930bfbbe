//! How far walls enclose the places of a plan. Outdoors, most directions lead off the plan without
//! meeting a wall.

/// The directions in which each place looks, in steps along x and z.
const DIRECTIONS: [[i32; 2]; 8] =
    [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];

/// For each place of a plan, the share of directions in which there is a wall.
pub(super) fn enclosure(walls: &[bool], columns: usize, rows: usize) -> Vec<f32> {
    assert_eq!(walls.len(), columns * rows, "a plan of this size");
    let mut shares = vec![0.0; walls.len()];
    for direction in DIRECTIONS {
        for (share, meets) in shares.iter_mut().zip(meets_wall(walls, columns, rows, direction)) {
            *share += f32::from(u8::from(meets)) / DIRECTIONS.len() as f32;
        }
    }
    shares
}

/// Whether there is a wall in a direction from each place.
fn meets_wall(walls: &[bool], columns: usize, rows: usize, [dx, dz]: [i32; 2]) -> Vec<bool> {
    let mut meets = vec![false; walls.len()];
    // Each place comes after the one that it looks at.
    let ordered = |at: usize, count: usize, step: i32| if step > 0 { count - 1 - at } else { at };
    let next = |at: usize, count: usize, step: i32| {
        at.checked_add_signed(step as isize).filter(|at| *at < count)
    };
    for z in (0..rows).map(|z| ordered(z, rows, dz)) {
        for x in (0..columns).map(|x| ordered(x, columns, dx)) {
            let Some((x1, z1)) = next(x, columns, dx).zip(next(z, rows, dz)) else { continue };
            let beyond = z1 * columns + x1;
            meets[z * columns + x] = walls[beyond] || meets[beyond];
        }
    }
    meets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_enclose_what_is_between_them() {
        let plan = [
            "..........",
            "..######..",
            "..#....#..",
            "..#....#..",
            "..#.......",
            "..######..",
            "..........",
        ];
        let walls: Vec<bool> = plan.iter().flat_map(|row| row.bytes().map(|b| b == b'#')).collect();
        let shares = enclosure(&walls, 10, plan.len());
        let at = |x: usize, z: usize| shares[z * 10 + x];
        assert_eq!(at(4, 2), 1.0);
        assert_eq!(at(4, 4), 7.0 / 8.0, "one direction leads out of the door");
        assert_eq!(at(0, 0), 1.0 / 8.0);
        assert_eq!(at(4, 0), 3.0 / 8.0);
    }
}
