mod flood;

use std::collections::HashMap;

use super::{plan::WALL, *};

const SIZES: [usize; 12] = [1, 2, 3, 5, 6, 7, 12, 20, 21, 60, 150, 700];

#[test]
fn a_plan_has_the_rooms_that_were_asked_for() {
    for rooms in SIZES {
        for seed in 0..8 {
            assert_eq!(plan(rooms, seed).room_count(), rooms, "seed {seed}");
        }
    }
    assert_eq!(plan(0, 1).room_count(), 1);
}

#[test]
fn every_space_can_be_reached_from_every_other() {
    for rooms in SIZES {
        for seed in 0..8 {
            let plan = plan(rooms, seed);
            let doors = plan.doors.iter().filter_map(|d| Some((d.spaces.0, d.spaces.1?)));
            let stairs = plan.stairs.iter().map(|stair| (stair.spaces[0], stair.spaces[1]));
            let joins: Vec<_> = doors.chain(stairs).collect();
            let mut reached = vec![false; plan.spaces.len()];
            reached[0] = true;
            while let Some(&(a, b)) = joins.iter().find(|(a, b)| reached[*a] != reached[*b]) {
                (reached[a], reached[b]) = (true, true);
            }
            assert!(reached.iter().all(|&r| r), "{rooms} rooms, seed {seed}");
        }
    }
}

/// Rooms and corridors are apart by at least a wall, wide enough to use, and doors lie in the wall
/// between the two spaces that they name.
#[test]
fn spaces_and_doors_fit_together() {
    for (rooms, seed) in SIZES.into_iter().flat_map(|rooms| [(rooms, 3), (rooms, 4)]) {
        let plan = plan(rooms, seed);
        let divided =
            |space: &&PlanSpace| matches!(space.kind, SpaceKind::Room | SpaceKind::Corridor);
        let spaces: Vec<&PlanSpace> = plan.spaces.iter().filter(divided).collect();
        for (i, a) in spaces.iter().enumerate() {
            assert!(a.rect.size(0).min(a.rect.size(1)) >= 116, "{rooms} rooms, seed {seed}: {a:?}");
            for b in spaces[..i].iter().filter(|b| b.storey == a.storey) {
                assert!(!a.rect.grown(WALL).overlaps(&b.rect), "{a:?} {b:?}");
            }
        }
        for door in &plan.doors {
            let ends = [Some(door.spaces.0), door.spaces.1];
            for space in ends.into_iter().flatten().map(|i| &plan.spaces[i]) {
                assert_eq!(space.storey, door.storey);
                assert!(door.rect.grown(1).overlaps(&space.rect), "{door:?} {space:?}");
            }
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_building_and_another_seed_another() {
    assert_eq!(glb(14, 5), glb(14, 5));
    assert_ne!(glb(14, 5), glb(14, 6));
}

/// Along every upright edge as many faces run up as down: walls have no cracks and no open ends.
/// (Above and below they end exactly on whole slabs.)
#[test]
fn walls_close() {
    let plan = plan(12, 2);
    let mut scene = mesh::Scene::new(&plan);
    shell::build(&plan, &mut scene);
    let gltf = gltf::Gltf::from_slice(&scene.to_glb()).unwrap();
    let blob = gltf.blob.clone().unwrap();
    // On each upright line, where edges end and in which sense: all must cancel out.
    let mut ends: HashMap<[i32; 3], i32> = HashMap::new();
    for primitive in gltf.meshes().flat_map(|mesh| mesh.primitives()) {
        let reader = primitive.reader(|_| Some(&blob));
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        for corners in indices.chunks(3) {
            for i in 0..3 {
                let from = positions[corners[i] as usize].map(|v| v * 64.0);
                let to = positions[corners[(i + 1) % 3] as usize].map(|v| v * 64.0);
                assert!(from.iter().all(|v| v.fract() == 0.0), "off the lattice: {from:?}");
                let [from, to] = [from, to].map(|p| p.map(|v| v as i32));
                if from[0] == to[0] && from[2] == to[2] {
                    *ends.entry(from).or_default() += 1;
                    *ends.entry(to).or_default() -= 1;
                }
            }
        }
    }
    let open: Vec<_> = ends.iter().filter(|(_, count)| **count != 0).take(5).collect();
    assert!(open.is_empty(), "{open:?}");
}

/// The lift serves every storey, and doors leave their openings free. None of them blocks sight.
#[test]
fn movers_stay_inside_and_the_lift_serves_every_storey() {
    let (rooms, seed) = (60, 2);
    let plan = plan(rooms, seed);
    let model =
        sightline_compiler::import::glb::read_slice(&glb(rooms, seed), None, "office").unwrap();
    assert!(model.warnings.is_empty(), "{:?}", model.warnings);
    let building = model.bounds().unwrap();
    let (lifts, doors): (Vec<_>, Vec<_>) =
        model.movers.iter().partition(|mover| mover.name == "lift");
    assert_eq!(lifts.len(), 1);
    assert!(doors.len() >= plan.storeys, "{}", doors.len());
    for mover in &model.movers {
        assert!(building.contains_box(&mover.everywhere()), "{}", mover.name);
    }
    let climb = lifts[0].everywhere().size().y - lifts[0].bounds().size().y;
    assert!((climb - mesh::metres(plan.floor(plan.storeys - 1))).abs() < 1e-3, "{climb}");
    for door in doors {
        let way = door.everywhere().size() - door.bounds().size();
        let width = door.bounds().size().x.max(door.bounds().size().z);
        assert!((way.max_element() - width).abs() < 1e-3, "{}: {way}", door.name);
        let corner = door.mesh().positions[0];
        assert!(!model.opaque.as_flattened().contains(&corner), "{} hides", door.name);
    }
}
