//! Extensions of glTF: which of them the reader understands, and which it may ignore.

/// Extensions that the reader understands.
const UNDERSTOOD: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
    "OMI_spawn_point",
];

/// Extensions that change nothing that a world has: shine, sound, notes, physics. A file
/// that requires textures of Basis Universal gets base colours instead, with a warning.
const HARMLESS: &[&str] = &[
    "ADOBE_materials_clearcoat_specular",
    "ADOBE_materials_clearcoat_tint",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_materials_bump",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "EXT_texture_avif",
    "EXT_texture_procedurals",
    "FB_geometry_metadata",
    "GODOT_single_root",
    "KHR_animation_pointer",
    "KHR_audio_emitter",
    "KHR_interactivity",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_physics_rigid_bodies",
    "KHR_implicit_shapes",
    "KHR_texture_basisu",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MOZ_hubs_components",
    "MPEG_audio_spatial",
    "MSFT_lod",
    "MSFT_packing_normalRoughnessMetallic",
    "MSFT_packing_occlusionRoughnessMetallic",
    "MSFT_texture_dds",
    "VRMC_materials_hdr_emissiveMultiplier",
    "VRMC_materials_mtoon",
];

/// Converts a file with compressed geometry. The tool decompresses what it reads.
const DECOMPRESS: &str = "npx @gltf-transform/cli copy IN.glb OUT.glb";

/// Extensions that a file requires and without which it cannot be read: the names, and how to
/// convert the file. `None` when there are none.
pub(super) fn unreadable<'a>(required: impl Iterator<Item = &'a str>) -> Option<(String, String)> {
    let unknown: Vec<&str> = required.filter(|name| !is_known(name)).collect();
    if unknown.is_empty() {
        return None;
    }
    let how = if unknown.contains(&"KHR_draco_mesh_compression") {
        format!("convert the file with `{DECOMPRESS}`")
    } else {
        "export the file without it".to_owned()
    };
    Some((unknown.join(", "), how))
}

fn is_known(name: &str) -> bool {
    UNDERSTOOD.contains(&name) || HARMLESS.contains(&name) || name.starts_with("OMI_")
}

/// Whether what an extension of a material does to light is known.
pub(super) fn is_known_of_material(name: &str) -> bool {
    is_known(name)
}
