//! Materials: their colour, and whether sight passes through.

use std::collections::BTreeMap;

use glam::Vec2;
use gltf::{
    Document, Primitive, Semantic,
    material::{AlphaMode, Material as GltfMaterial},
};
use serde_json::Value;

use super::{accessor, extensions, resources::Resources};
use crate::{import::limits, model::SurfaceMaterial};

/// Materials read so far, and what is to be told of them.
#[derive(Default)]
pub(super) struct Materials {
    /// How many primitives have an extension of materials that is not known, by its name.
    unknown: BTreeMap<String, usize>,
}

/// How a primitive looks.
pub(super) struct Look {
    pub(super) material: SurfaceMaterial,
    /// Texture coordinates, if there is a texture.
    pub(super) uvs: Vec<Vec2>,
    /// Whether sight is blocked.
    pub(super) hides: bool,
}

impl Materials {
    /// The look of a primitive with this many vertices.
    pub(super) fn look(
        &mut self,
        primitive: &Primitive<'_>,
        vertices: usize,
        document: &Document,
        resources: &mut Resources,
        warnings: &mut Vec<String>,
    ) -> Look {
        let source = primitive.material();
        let [r, g, b, alpha] = base_colour(&source);
        let glass = lets_light_through(&source, alpha);
        let hides = !glass && !self.has_unknown_extension(&source);
        let mut colour = [r, g, b].map(limits::srgb_byte);
        if glass && colour == [0; 3] {
            // Black glass would be taken for a collider.
            colour = [1; 3];
        }
        let emission = emission(&source, document, resources, warnings);
        let material = SurfaceMaterial { colour, texture: None, glass, emission };
        let mut look = Look { material, uvs: Vec::new(), hides };
        let Some(mapping) = Mapping::of(&source) else { return look };
        let Some(accessor) = primitive.get(&Semantic::TexCoords(mapping.set)) else { return look };
        // Texture coordinates that cannot be read leave the base colour.
        let Ok(uvs) = accessor::vectors::<2>(&accessor, resources, 2) else { return look };
        let Some(image) = document.textures().nth(mapping.texture).map(|t| t.source().index())
        else {
            return look;
        };
        look.material.texture = resources.image(document, image, warnings);
        if look.material.texture.is_some() {
            look.uvs = uvs.into_iter().map(|uv| mapping.apply(Vec2::from(uv))).collect();
            look.uvs.resize(vertices, Vec2::ZERO);
        }
        look
    }

    fn has_unknown_extension(&mut self, material: &GltfMaterial<'_>) -> bool {
        let names = material.extensions().into_iter().flat_map(|all| all.keys());
        let mut found = false;
        for name in names.filter(|name| !extensions::is_known_of_material(name)) {
            *self.unknown.entry(limits::tidy_title(name)).or_default() += 1;
            found = true;
        }
        found
    }

    /// A warning for each extension that is not known.
    pub(super) fn warn(&self, warnings: &mut Vec<String>) {
        warnings.extend(self.unknown.iter().map(|(name, count)| {
            format!(
                "{count} meshes have materials with {name}, which is not known: sight passes \
                 through them"
            )
        }));
    }
}

/// The linear base colour and its alpha.
fn base_colour(material: &GltfMaterial<'_>) -> [f32; 4] {
    let old = material.extension_value("KHR_materials_pbrSpecularGlossiness");
    let Some(old) = old else { return material.pbr_metallic_roughness().base_color_factor() };
    let diffuse = old.get("diffuseFactor");
    std::array::from_fn(|i| {
        diffuse.and_then(|factor| factor.get(i)?.as_f64()).map_or(1.0, |value| value as f32)
    })
}

/// The light that a material gives: its factor, times the mean of its texture, times its strength.
fn emission(
    material: &GltfMaterial<'_>,
    document: &Document,
    resources: &mut Resources,
    warnings: &mut Vec<String>,
) -> [f32; 3] {
    let factor = material.emissive_factor();
    let strength = material.extension_value("KHR_materials_emissive_strength");
    let strength = strength.and_then(|value| value.get("emissiveStrength")?.as_f64());
    let strength = strength.map_or(1.0, |strength| strength as f32);
    if factor == [0.0; 3] || !(strength > 0.0 && strength.is_finite()) {
        return [0.0; 3];
    }
    let mean = material.emissive_texture().and_then(|info| {
        let image = document.textures().nth(info.texture().index())?.source().index();
        resources.mean(document, image, warnings)
    });
    let mean = mean.unwrap_or([1.0; 3]);
    let brightest = limits::EMISSION_MAX;
    [0, 1, 2].map(|i| (factor[i].max(0.0) * mean[i] * strength).min(brightest))
}

/// Whether light, and so sight, passes through a material: by alpha, or by transmission. A
/// material that is `OPAQUE` ignores the alpha of its texture, but may transmit all the same.
fn lets_light_through(material: &GltfMaterial<'_>, alpha: f32) -> bool {
    let number = |extension: &str, key: &str, default: f64| {
        material
            .extension_value(extension)
            .map(|value| value.get(key).and_then(Value::as_f64).unwrap_or(default))
    };
    let transmits = [
        number("KHR_materials_transmission", "transmissionFactor", 0.0),
        number("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor", 0.0),
        number("KHR_materials_volume", "thicknessFactor", 0.0),
    ];
    material.alpha_mode() != AlphaMode::Opaque
        || alpha < 1.0
        || transmits.into_iter().flatten().any(|share| share > 0.0)
}

/// The mapping of the base-colour texture, with `KHR_texture_transform`.
struct Mapping {
    texture: usize,
    set: u32,
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl Mapping {
    fn of(material: &GltfMaterial<'_>) -> Option<Self> {
        if let Some(old) = material.extension_value("KHR_materials_pbrSpecularGlossiness") {
            let info = old.get("diffuseTexture")?;
            let index = |key: &str| info.get(key).and_then(Value::as_u64);
            let texture = usize::try_from(index("index")?).ok()?;
            let set = u32::try_from(index("texCoord").unwrap_or(0)).ok()?;
            let transform = info.get("extensions").and_then(|all| all.get("KHR_texture_transform"));
            return Some(Self::new(texture, set, transform));
        }
        let info = material.pbr_metallic_roughness().base_color_texture()?;
        let transform = info.extension_value("KHR_texture_transform");
        Some(Self::new(info.texture().index(), info.tex_coord(), transform))
    }

    fn new(texture: usize, set: u32, transform: Option<&Value>) -> Self {
        let mut mapping =
            Self { texture, set, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE };
        let Some(transform) = transform else { return mapping };
        let pair = |name: &str, otherwise: Vec2| {
            let number = |i: usize| Some(transform.get(name)?.get(i)?.as_f64()? as f32);
            Vec2::new(number(0).unwrap_or(otherwise.x), number(1).unwrap_or(otherwise.y))
        };
        mapping.offset = pair("offset", Vec2::ZERO);
        mapping.scale = pair("scale", Vec2::ONE);
        mapping.rotation = transform.get("rotation").and_then(|v| v.as_f64()).unwrap_or(0.0) as f32;
        if let Some(set) = transform.get("texCoord").and_then(|v| v.as_u64()) {
            mapping.set = u32::try_from(set).unwrap_or(u32::MAX);
        }
        mapping
    }

    fn apply(&self, uv: Vec2) -> Vec2 {
        // In texture space v points down, so the extension rotates the other way.
        let turned = Vec2::from_angle(-self.rotation).rotate(uv * self.scale) + self.offset;
        if turned.is_finite() { turned } else { Vec2::ZERO }
    }
}
