//! Plans of storeys: what they show, and their bytes.

use std::sync::LazyLock;

use proptest::prelude::*;
use sightline_fixtures::voxel_floor;
use sightline_world::{
    World,
    octree::Material,
    plan::{GLASS, Plan, WALL},
};

/// A floor with a wall, a pane and a table.
fn world() -> World {
    let wall = ([32, 0, 0], [33, 24, 64], 0);
    let pane = ([0, 0, 48], [32, 24, 49], Material::GLASS);
    let table = ([8, 0, 8], [16, 6, 16], 0);
    voxel_floor::world(&[wall, pane, table])
}

/// The plan of the floor.
static PLAN: LazyLock<Plan> = LazyLock::new(|| Plan::new(&world(), 0.125));
/// The plan where no storey is.
static VOID: LazyLock<Plan> = LazyLock::new(|| Plan::new(&world(), 5.0));

/// What a plan shows at a place, in metres.
fn shown(plan: &Plan, x: f32, z: f32) -> Option<u32> {
    let [column, row] = [x - plan.corner().x, z - plan.corner().y].map(|of| of / plan.metres());
    plan.pixels()[row as usize * plan.size()[0] + column as usize]
}

#[test]
fn a_plan_shows_walls_glass_floors_and_voids() {
    let plan = &*PLAN;
    assert_eq!(shown(plan, 4.06, 2.0), Some(WALL));
    assert_eq!(shown(plan, 2.0, 6.06), Some(GLASS));
    for [x, z] in [[2.0, 4.0], [6.0, 6.0], [1.5, 1.5]] {
        let floor = shown(plan, x, z).expect("a floor");
        assert!(![WALL, GLASS].contains(&floor), "{x}, {z}");
    }
    assert!(VOID.pixels().iter().all(Option::is_none), "no storey is there");
}

#[test]
fn a_packed_plan_is_the_same_and_small() {
    for plan in [&*PLAN, &*VOID] {
        let bytes = plan.to_bytes();
        assert_eq!(&Plan::from_bytes(&bytes).unwrap(), plan);
        let pixels = plan.size()[0] * plan.size()[1];
        assert!(bytes.len() < pixels / 20, "{} bytes for {pixels} pixels", bytes.len());
    }
}

proptest! {
    #[test]
    fn a_damaged_plan_is_refused_or_sound(at in any::<prop::sample::Index>(), flip in 1u8..) {
        let mut bytes = PLAN.to_bytes();
        prop_assert!(Plan::from_bytes(&bytes[..at.index(bytes.len())]).is_err());
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        if let Ok(plan) = Plan::from_bytes(&bytes) {
            prop_assert_eq!(plan.pixels().len(), plan.size()[0] * plan.size()[1]);
        }
    }
}
