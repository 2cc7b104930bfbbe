//! From animated surfaces to movers.

use glam::Vec3;
use sightline_world::{
    MOVER_TRIANGLES_MAX, MOVERS_MAX, Mesh, Mover, motion::trajectory::Trajectory,
};

use super::limits::tidy_title;
use crate::{
    model::Surface,
    palette::{Palette, Shade},
};

/// The movers of a model, within the limits of a world.
#[derive(Default)]
pub(super) struct MoverList {
    movers: Vec<Mover>,
    triangles: usize,
    left_out: usize,
}

impl MoverList {
    /// Adds a mover, whose surfaces are in its own coordinates. It is left out when it has no
    /// triangle, or exceeds the limits of a world.
    pub(super) fn add(&mut self, name: &str, surfaces: &[Surface], trajectory: Trajectory) {
        let triangles: usize = surfaces.iter().map(|surface| surface.triangles.len()).sum();
        if self.movers.len() == MOVERS_MAX || self.triangles + triangles > MOVER_TRIANGLES_MAX {
            self.left_out += 1;
            return;
        }
        let (mesh, colours) = coloured(surfaces);
        if let Some(mover) = Mover::new(tidy_title(name), mesh, colours, trajectory) {
            self.triangles += mover.colours().len();
            self.movers.push(mover);
        }
    }

    /// All movers. A warning counts those left out.
    pub(super) fn finish(self, warnings: &mut Vec<String>) -> Vec<Mover> {
        if self.left_out > 0 {
            warnings.push(format!("{} movers left out: more than a world takes", self.left_out));
        }
        self.movers
    }
}

/// The mesh of all triangles, and the colour about the middle of each.
fn coloured(surfaces: &[Surface]) -> (Mesh, Vec<[u8; 3]>) {
    let palette = Palette::new(surfaces);
    let (mut mesh, mut colours) = (Mesh::default(), Vec::new());
    for surface in surfaces {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend_from_slice(&surface.positions);
        for (index, (indices, corners)) in
            surface.triangles.iter().zip(surface.corners()).enumerate()
        {
            let [a, b, c] = corners;
            let width = ((b - a).cross(c - a).length() / 2.0).sqrt();
            let material = palette.material_of(surface, index, width);
            let colour = material
                .map_or(Vec3::ONE, |material| material.colour([1.0 / 3.0; 3], Shade::Factor(1.0)));
            let colour = colour.clamp(Vec3::ZERO, Vec3::ONE) * 255.0;
            mesh.triangles.push(indices.map(|i| first + i));
            colours.push(colour.to_array().map(|channel| channel.round() as u8));
        }
    }
    assert_eq!(mesh.triangles.len(), colours.len(), "a colour for each triangle");
    (mesh, colours)
}
