//! Quake III BSP, version 46: drawn surfaces with textures and light, brushes that block sight.
//!
//! In these maps, what is drawn and what blocks sight are different. Faces and patches are drawn.
//! Solid, not translucent brushes and patches of the world model block sight. Doors and lifts block
//! nothing: they become movers.

mod archive;
mod brush;
mod draw;
mod entities;
mod error;
mod light;
mod lumps;
mod map;
mod movers;
mod origin;
mod shader_script;
mod tree;
mod units;

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use sightline_world::{Origin, Solid, motion::Body};

use super::{limits, movers::MoverList};
use crate::model::{ConvexFace, ConvexSolid, Model};
use archive::Archives;
use map::{Map, Shader};
use movers::Moving;
use units::{UNIT, placed};

pub use error::BspError;

/// The speed limit of players, in metres per second.
const SPEED_MAX: f32 = 15.0;
/// Contents that are solid.
const CONTENTS_SOLID: i32 = 1;
/// Contents that let sight through.
const CONTENTS_TRANSLUCENT: i32 = 0x2000_0000;
/// Surfaces that are not drawn: sky, nodraw, hint and skip.
const SURFACE_NOT_DRAWN: i32 = 0x4 | 0x80 | 0x100 | 0x200;

/// Reads a map, with textures from the archives of the game. When several archives hold a file, the
/// last one counts.
pub fn read(path: &Path, pk3s: &[PathBuf]) -> Result<Model, BspError> {
    let io = |source| BspError::Io { path: path.to_owned(), source };
    let bytes = limits::read_file(path).map_err(io)?;
    read_slice(&bytes, pk3s, &limits::title_of(path))
}

/// Reads a map from bytes.
pub fn read_slice(bytes: &[u8], pk3s: &[PathBuf], title: &str) -> Result<Model, BspError> {
    let map = Map::parse(bytes)?;
    let entities = entities::parse(&map.entities);
    let mut model = Model {
        is_lit: true,
        spawns: entities.spawns.clone(),
        places: entities.places.clone(),
        lamps: entities.lamps.clone(),
        body: Body::QUAKE,
        speed_max: SPEED_MAX,
        ..Model::empty(limits::tidy_title(entities.title.as_deref().unwrap_or(title)))
    };
    let mut archives = Archives::open(pk3s)?;
    let moving = movers::moving(&map, &entities, &mut model.warnings);
    draw::surfaces(&map, &moving, &mut archives, &mut model)?;
    let mut mover_list = MoverList::default();
    for Moving { name, faces, trajectory } in moving {
        mover_list.add(&name, &draw::apart(&map, faces, &mut archives)?, trajectory);
    }
    model.movers = mover_list.finish(&mut model.warnings);
    let mut origin = origin::origin(&map)?;
    brushes(&map, &mut model, &mut origin)?;
    model.origin = Some(origin);
    Ok(model)
}

impl Shader {
    fn is_drawn(&self) -> bool {
        self.surface_flags & SURFACE_NOT_DRAWN == 0
    }

    fn is_opaque(&self) -> bool {
        self.contents & CONTENTS_SOLID != 0 && self.contents & CONTENTS_TRANSLUCENT == 0
    }
}

/// Adds the brushes that block sight, and their faces.
fn brushes(map: &Map<'_>, model: &mut Model, origin: &mut Origin) -> Result<(), BspError> {
    let mut left_out = 0;
    for brush in map.world_brushes.iter().filter(|b| map.shaders[b.shader].is_opaque()) {
        let Some(faces) = brush::faces(brush) else {
            left_out += 1;
            continue;
        };
        if !faces.is_empty() {
            origin.solids.push(Solid {
                bounds: origin::bounds(faces.iter().flat_map(|(_, winding)| winding).copied()),
                sides: brush.sides.iter().map(|&side| side as u32).collect(),
            });
        }
        let mut solid = ConvexSolid { faces: Vec::with_capacity(faces.len()) };
        for (plane, winding) in &faces {
            let corners: Vec<Vec3> = winding.iter().map(|&p| placed(p)).collect();
            let fan = (2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]]);
            model.opaque.extend(fan.filter(|&triangle| limits::has_area(triangle)));
            let DVec3 { x, y, z } = plane.normal;
            let (normal, distance) = (DVec3::new(x, z, -y), plane.distance * UNIT);
            solid.faces.push(ConvexFace { normal, distance, corners });
        }
        if !solid.faces.is_empty() {
            model.solids.push(solid);
        }
        if model.opaque.len() > draw::TRIANGLES_MAX {
            return Err(BspError::TooMany("triangles"));
        }
    }
    if left_out > 0 {
        model.warnings.push(format!("{left_out} brushes without bounds left out"));
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests;
