//! Lamps: `KHR_lights_punctual`, and nodes that are named as lights.

use glam::{DVec3, Vec3};
use gltf::Node;
use serde_json::Value;

use super::{Reader, Setting};
use crate::{
    import::{glb::names::Purpose, limits},
    model::{Lamp, LampSource, Surface},
};

/// The light of a surface that is named as a light, as a multiple of its colour.
const NAMED_EMISSION: f32 = 8.0;
/// The light of a node that is named as a light and has no mesh, in candela: a bulb of 800 lumens.
const NAMED_CANDELA: f32 = 64.0;
/// The greatest intensity that is read, in candela or lux.
const INTENSITY_MAX: f64 = 1.0e8;

impl<'a> Reader<'a> {
    /// Adds the lamp of a node, if it has one. Lamps that move are left out, as movers give no
    /// light.
    pub(super) fn lamp(&mut self, node: &Node<'a>, setting: &Setting<'_>) {
        let by_extension = node
            .extension_value("KHR_lights_punctual")
            .and_then(|value| value.get("light")?.as_u64())
            .and_then(|index| {
                let all = self.document.extension_value("KHR_lights_punctual")?;
                all.get("lights")?.get(usize::try_from(index).ok()?)
            });
        let is_named = setting.purpose == Purpose::Light
            && node.mesh().is_none()
            && node.children().len() == 0;
        let at = setting.place.transform_point3(DVec3::ZERO).as_vec3();
        let along = setting.place.transform_vector3(DVec3::NEG_Z).as_vec3();
        let lamp = match by_extension {
            Some(light) => lamp_of(light, at, along.normalize_or(Vec3::NEG_Y)),
            None if is_named => {
                Some(Lamp { source: LampSource::Point(at), intensity: [NAMED_CANDELA; 3] })
            }
            None => return,
        };
        let name = limits::tidy_title(node.name().unwrap_or("a lamp"));
        let Some(lamp) = lamp.filter(|_| limits::is_sane(at)) else {
            self.model.warnings.push(format!("{name}: a lamp of an unknown kind is left out"));
            return;
        };
        if setting.carrier.is_some() {
            self.model.warnings.push(format!("{name}: a lamp that moves is left out"));
        } else if self.model.lamps.len() < limits::LAMPS_MAX {
            self.model.lamps.push(lamp);
        } else if self.model.lamps.len() == limits::LAMPS_MAX {
            let most = limits::LAMPS_MAX;
            self.model.warnings.push(format!("lamps after the first {most} are left out"));
        }
    }
}

/// Makes a surface give light of its colour, unless it gives light anyway.
pub(super) fn make_emissive(surface: &mut Surface) {
    let material = &mut surface.material;
    if material.emission == [0.0; 3] {
        material.emission = material.colour.map(|byte| limits::linear(byte) * NAMED_EMISSION);
    }
}

/// A lamp, as `KHR_lights_punctual` describes it. None for an unknown type.
fn lamp_of(light: &Value, at: Vec3, along: Vec3) -> Option<Lamp> {
    let number = |of: &Value, key: &str, default: f64| {
        of.get(key).and_then(Value::as_f64).unwrap_or(default)
    };
    let colour: [f64; 3] = std::array::from_fn(|i| {
        light.get("color").and_then(|colour| colour.get(i)?.as_f64()).unwrap_or(1.0)
    });
    let strength = number(light, "intensity", 1.0);
    let intensity = colour.map(|channel| (channel * strength).clamp(0.0, INTENSITY_MAX) as f32);
    let source = match light.get("type")?.as_str()? {
        "point" => LampSource::Point(at),
        "directional" => LampSource::Parallel(along),
        "spot" => {
            let cone = light.get("spot").unwrap_or(&Value::Null);
            let outer = number(cone, "outerConeAngle", std::f64::consts::FRAC_PI_4);
            let inner = number(cone, "innerConeAngle", 0.0).min(outer);
            LampSource::Spot { at, along, cosines: [inner, outer].map(|angle| angle.cos() as f32) }
        }
        _ => return None,
    };
    Some(Lamp { source, intensity })
}
