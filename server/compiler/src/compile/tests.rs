use super::*;
use crate::model::{Surface, SurfaceMaterial};

/// A hollow box with a table in it.
fn house() -> Model {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for (min, max) in [
        (Vec3::ZERO, Vec3::new(6.0, 3.0, 5.0)),
        (Vec3::new(2.0, 0.0, 2.0), Vec3::new(3.0, 0.8, 3.0)),
    ] {
        let first = positions.len() as u32;
        positions.extend((0..8).map(|i| {
            Vec3::new(
                if i & 1 == 0 { min.x } else { max.x },
                if i & 2 == 0 { min.y } else { max.y },
                if i & 4 == 0 { min.z } else { max.z },
            )
        }));
        for [a, b, c, d] in
            [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
        {
            triangles.push([a, b, c].map(|i: u32| i + first));
            triangles.push([a, c, d].map(|i: u32| i + first));
        }
    }
    let opaque = triangles.iter().map(|t| t.map(|i| positions[i as usize])).collect();
    let material = SurfaceMaterial::opaque([180, 90, 60]);
    let surface = Surface { positions, uvs: Vec::new(), colours: Vec::new(), triangles, material };
    Model { surfaces: vec![surface], is_lit: true, opaque, speed_max: 5.0, ..Model::empty("house") }
}

#[test]
fn a_house_compiles_and_what_is_outside_does_not_see_inside() {
    let options = CompileOptions { voxel: Some(0.25), ..CompileOptions::default() };
    let (world, report) = compile(&house(), &options, &|_, _| ControlFlow::Continue(())).unwrap();
    let (inside, outside) = (Vec3::new(1.0, 1.5, 1.0), Vec3::new(-1.0, 1.5, 1.0));
    let [inside, outside] = [inside, outside].map(|eye| world.cells.at(eye).unwrap());
    assert!(!world.cells.sees(inside, outside));
    assert_eq!(world.mesh.positions.len(), 16);
    assert_eq!(report.triangles, 24);
    assert!(report.octree.voxels > 1_000, "{}", report.octree.voxels);
    assert_eq!(World::from_bytes(&world.to_bytes()).unwrap(), world);
}

#[test]
fn a_quick_compilation_has_wide_voxels_and_cells_and_misses_nobody() {
    let of = |quality| {
        let options = CompileOptions { quality, ..CompileOptions::default() };
        compile(&house(), &options, &|_, _| ControlFlow::Continue(())).unwrap().0
    };
    let (fine, quick) = (of(Quality::Fine), of(Quality::Quick));
    assert_eq!(quick.octree.voxel(), fine.octree.voxel() * 2.0);
    assert_eq!(quick.cells.cells.len(), quick.cells.spaces.len());
    assert!(fine.cells.cells.len() > quick.cells.cells.len());
    let at = |world: &World, eye| world.cells.at(eye).unwrap();
    let inside = Vec3::new(1.0, 1.5, 1.0);
    for eye in [Vec3::new(-1.0, 1.5, 1.0), Vec3::new(5.0, 1.5, 4.0)] {
        let sees = |world: &World| world.cells.sees(at(world, inside), at(world, eye));
        assert!(sees(&quick) || !sees(&fine), "{eye}");
    }
}

#[test]
fn radiosity_is_for_models_that_bring_no_light() {
    let options = CompileOptions {
        voxel: Some(0.25),
        light: LightMethod::Radiosity,
        light_quality: LightQuality::Fast,
        ..CompileOptions::default()
    };
    let go_on = |_, _| ControlFlow::Continue(());
    let mut model = house();
    let (lit, report) = compile(&model, &options, &go_on).unwrap();
    assert!(report.light.is_none(), "the model brings light");
    model.remove_light();
    let (found, report) = compile(&model, &options, &go_on).unwrap();
    assert!(report.light.is_some_and(|light| light.points > 50 && light.exposure > 0.0));
    assert!(found.octree != lit.octree, "the colours have light");
}

#[test]
fn a_place_to_stand_is_found_inside() {
    let (world, _) = compile(
        &house(),
        &CompileOptions { voxel: Some(0.25), ..CompileOptions::default() },
        &|_, _| ControlFlow::Continue(()),
    )
    .unwrap();
    let eye = world.spawns[0].eye;
    assert!(Aabb::new(Vec3::ZERO, Vec3::new(6.0, 3.0, 5.0)).contains(eye), "{eye}");
    // On the floor, of which the voxels reach up to a quarter of a metre higher.
    assert!((1.6..1.86).contains(&eye.y), "{eye}");
}

#[test]
fn a_break_at_any_stage_ends_the_compilation() {
    let options = CompileOptions { voxel: Some(0.25), ..CompileOptions::default() };
    for broken in [Stage::Carving, Stage::Cells, Stage::Pvs, Stage::Voxels] {
        // At once, and in the middle of the work.
        for from in [0.0, 0.3] {
            let progress = |stage, share| match stage == broken && share >= from {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            };
            let outcome = compile(&house(), &options, &progress);
            // This one tells only that it begins.
            let may_end = broken == Stage::Cells && from > 0.0;
            match outcome {
                Err(CompileError::Cancelled) => {}
                Ok(_) if may_end => {}
                other => panic!("{broken:?} from {from}: {other:?}"),
            }
        }
    }
}

#[test]
fn an_empty_model_is_refused() {
    let mut model = house();
    model.surfaces.clear();
    model.opaque.clear();
    assert!(matches!(
        compile(&model, &CompileOptions::default(), &|_, _| ControlFlow::Continue(())),
        Err(CompileError::Empty)
    ));
}
