//! From the bytes of a file to a validated document.
//!
//! The `gltf` crate validates documents, but takes some things for granted and refuses extensions
//! that it does not know. Both are seen to here, on the JSON.

use std::collections::BTreeSet;

use gltf::{
    Document, Semantic,
    json::{Index, Root, validation::Checked},
};
use serde_json::{Value, json};

use super::{error::GlbError, extensions};

/// Extensions that give a texture another image, those first that can be read.
const OTHER_IMAGES: [&str; 3] = ["EXT_texture_webp", "KHR_texture_basisu", "EXT_texture_avif"];

/// The document of a .glb or .gltf, and the binary chunk of a .glb.
pub(super) fn read(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), GlbError> {
    let (json, blob) = split(bytes)?;
    let invalid = |error: serde_json::Error| GlbError::Json(error.to_string());
    let mut json: Value = serde_json::from_slice(&json).map_err(invalid)?;
    check_extensions(&mut json)?;
    give_images(&mut json);
    let root: Root = serde_json::from_value(json).map_err(invalid)?;
    check_positions(&root)?;
    Ok((Document::from_json(root)?, blob))
}

/// The URIs of buffers and images that are not within the file, each once. Of a faulty file, those
/// that can be told.
pub(super) fn uris(bytes: &[u8]) -> BTreeSet<String> {
    let json = split(bytes).ok().and_then(|(json, _)| serde_json::from_slice::<Value>(&json).ok());
    let lists = ["buffers", "images"].map(|list| json.as_ref()?.get(list)?.as_array());
    let named = |item: &Value| Some(item.get("uri")?.as_str()?.to_owned());
    let all = lists.into_iter().flatten().flatten().filter_map(named);
    all.filter(|uri| !uri.starts_with("data:")).collect()
}

/// The JSON and the binary chunk.
fn split(bytes: &[u8]) -> Result<(Vec<u8>, Option<Vec<u8>>), GlbError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.to_vec(), None));
    }
    // The `gltf` crate trusts that the length in the header covers the header.
    let file = bytes.len() as u64;
    let header = match bytes.get(8..12) {
        Some(&[a, b, c, d]) => u64::from(u32::from_le_bytes([a, b, c, d])),
        _ => 20,
    };
    if header < 20 || header > file {
        return Err(GlbError::Truncated { header, file });
    }
    let glb = gltf::Glb::from_slice(bytes)?;
    Ok((glb.json.into_owned(), glb.bin.map(|bin| bin.into_owned())))
}

/// Refuses a file that requires what cannot be read. The list is emptied, because the `gltf` crate
/// knows fewer extensions.
fn check_extensions(json: &mut Value) -> Result<(), GlbError> {
    let required = json.get("extensionsRequired").and_then(Value::as_array);
    let names = required.into_iter().flatten().filter_map(Value::as_str);
    if let Some((names, how)) = extensions::unreadable(names) {
        return Err(GlbError::Extensions { names, how });
    }
    if let Some(root) = json.as_object_mut() {
        root.remove("extensionsRequired");
    }
    Ok(())
}

/// Gives each texture an image: the one of an extension that can be read, its own, or one that
/// cannot be read and is left out with a warning.
fn give_images(json: &mut Value) {
    let images = json.get("images").and_then(Value::as_array).map_or(0, Vec::len);
    let mut lacks_image = false;
    for texture in json.get_mut("textures").and_then(Value::as_array_mut).into_iter().flatten() {
        let other = |name: &str| texture.get("extensions")?.get(name)?.get("source").cloned();
        let own = texture.get("source").cloned();
        let [webp, basis, avif] = OTHER_IMAGES.map(other);
        let source = webp.or(own).or(basis).or(avif);
        lacks_image |= source.is_none();
        if let Some(texture) = texture.as_object_mut() {
            texture.insert("source".to_owned(), source.unwrap_or_else(|| json!(images)));
        }
    }
    if lacks_image && let Some(root) = json.as_object_mut() {
        let list = root.entry("images").or_insert_with(|| json!([]));
        if let Some(list) = list.as_array_mut() {
            list.push(json!({}));
        }
    }
}

/// Checks that the accessors of positions exist. The validation of the `gltf` crate takes that for
/// granted.
fn check_positions(root: &Root) -> Result<(), GlbError> {
    let positions = Checked::Valid(Semantic::Positions);
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let mut indices = primitives.filter_map(|p| p.attributes.get(&positions)).map(Index::value);
    match indices.find(|&index| index >= root.accessors.len()) {
        Some(index) => Err(GlbError::Accessor { index, reason: "is not there" }),
        None => Ok(()),
    }
}
