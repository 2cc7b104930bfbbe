//! Where a model is put in the world: its unit, which way is up, and where its origin is.

use glam::{DMat4, DVec3};

use super::{error::GlbError, survey::Survey};

/// A building is hardly smaller than this, in metres.
const SMALL_M: f64 = 2.0;
/// A building is hardly larger than this, in metres.
const LARGE_M: f64 = 5_000.0;
/// Farther from the origin than this, in metres, single precision is coarser than a millimetre.
const FAR_M: f64 = 8_192.0;
/// A model probably lies on its side when it is this many times as high as it is wide.
const TALL: f64 = 8.0;

/// The axis of a model that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// y, as glTF has it.
    #[default]
    Y,
    /// z, as many modelling programs and CAD have it.
    Z,
}

/// How a model is placed in the world.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Placing {
    /// How many metres one unit of the model is: 0.001 for millimetres. When absent it is 1, and a
    /// model larger than 5 km is refused.
    pub scale: Option<f64>,
    /// The axis of the model that points up.
    pub up: UpAxis,
    /// Whether the middle of its ground becomes the origin. What is far from the origin is moved
    /// there anyway.
    pub recentre: bool,
}

/// The transform of the whole scene, and what the author should know.
pub(super) struct Root {
    pub(super) transform: DMat4,
    pub(super) notes: Vec<String>,
}

impl Placing {
    /// The transform of a scene that was surveyed.
    ///
    /// # Errors
    /// When the scene is larger than buildings are, and no scale is given.
    pub(super) fn root(&self, survey: Option<&Survey>) -> Result<Root, GlbError> {
        let turned = match self.up {
            UpAxis::Y => DMat4::IDENTITY,
            UpAxis::Z => DMat4::from_cols_array_2d(&[
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, -1.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ]),
        };
        let placed = DMat4::from_scale(DVec3::splat(self.scale.unwrap_or(1.0))) * turned;
        let Some(survey) = survey.map(|survey| survey.transformed(&placed)) else {
            return Ok(Root { transform: placed, notes: Vec::new() });
        };
        let size = survey.size();
        if self.scale.is_none() && size.max_element() > LARGE_M {
            return Err(GlbError::Large(size));
        }
        let mut notes = self.doubts(size);
        let foot = survey.foot();
        let is_far = foot.length() > FAR_M && foot.length() > size.max_element();
        if is_far || self.recentre {
            notes.push(format!(
                "the model is moved by {:.3},{:.3},{:.3}, so that its ground is at the origin",
                -foot.x, -foot.y, -foot.z
            ));
            return Ok(Root { transform: DMat4::from_translation(-foot) * placed, notes });
        }
        Ok(Root { transform: placed, notes })
    }

    /// What is hardly meant, by the size of a building in metres.
    fn doubts(&self, size: DVec3) -> Vec<String> {
        let DVec3 { x, y, z } = size;
        let shown = format!("the building is {x:.2} x {y:.2} x {z:.2} m");
        let mut doubts = Vec::new();
        if size.max_element() < SMALL_M {
            doubts.push(format!(
                "{shown}, which is small: is its unit the metre? If not, give --scale, such as 10 or \
                 100"
            ));
        }
        let is_upright = self.up == UpAxis::Y && y > TALL * x.min(z) && y > 4.0;
        if is_upright && x.max(z) > 4.0 {
            doubts.push(format!("{shown}, y upwards: if it lies on its side, give --up z"));
        }
        doubts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn survey(min: [f64; 3], max: [f64; 3]) -> Survey {
        Survey { min: min.into(), max: max.into() }
    }

    #[test]
    fn a_usual_building_stays_where_it_is() {
        let root =
            Placing::default().root(Some(&survey([-5.0, 0.0, 3.0], [15.0, 6.0, 20.0]))).unwrap();
        assert_eq!((root.transform, root.notes.len()), (DMat4::IDENTITY, 0));
    }

    #[test]
    fn units_up_and_origin_are_put_right() {
        let placing = Placing { scale: Some(0.001), up: UpAxis::Z, recentre: true };
        let root = placing.root(Some(&survey([1e4, 2e4, 0.0], [2e4, 4e4, 3e3]))).unwrap();
        for (from, to) in
            [([1e4, 2e4, 0.0], [-5.0, 0.0, 10.0]), ([2e4, 4e4, 3e3], [5.0, 3.0, -10.0])]
        {
            let placed = root.transform.transform_point3(DVec3::from(from));
            assert!(placed.distance(DVec3::from(to)) < 1e-9, "{placed}");
        }
        assert_eq!(root.notes.len(), 1, "{:?}", root.notes);
    }

    #[test]
    fn sizes_and_places_that_are_hardly_meant_are_told() {
        for (min, max, told) in [
            ([0.0; 3], [0.5, 0.2, 0.4], "small"),
            ([4e6, 0.0, 0.0], [4e6 + 20.0, 3.0, 20.0], "moved by -4000010.000,-0.000,-10.000"),
            ([0.0; 3], [20.0, 60.0, 3.0], "--up z"),
        ] {
            let root = Placing::default().root(Some(&survey(min, max))).unwrap();
            let [note] = &root.notes[..] else { panic!("{:?}", root.notes) };
            assert!(note.contains(told), "{note}");
        }
    }

    #[test]
    fn what_is_too_large_needs_a_scale() {
        let large = survey([0.0; 3], [6_500.0, 2_700.0, 10_000.0]);
        let error = Placing::default().root(Some(&large)).err().unwrap().to_string();
        assert!(error.contains("6500 x 2700 x 10000 m") && error.contains("--scale 0.001"));
        for scale in [1.0, 0.001] {
            assert!(
                Placing { scale: Some(scale), ..Placing::default() }.root(Some(&large)).is_ok()
            );
        }
    }
}
