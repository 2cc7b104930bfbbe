//! Triangles by node and colour, and the GLB file.

use std::{borrow::Cow, collections::BTreeMap};

use glam::Vec3;
use gltf::binary::{Glb, Header};
use serde_json::{Value, json};

use super::{UNITS_PER_METRE, plan::Plan};

/// An sRGB colour and an opacity. Glass has less than 255.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Paint(pub [u8; 3], pub u8);

impl Paint {
    pub const GLASS: Self = Self([150, 200, 215], 60);

    pub const fn opaque(colour: [u8; 3]) -> Self {
        Self(colour, 255)
    }
}

/// The triangles of a building, by node.
pub(super) struct Scene {
    names: Vec<String>,
    shell: usize,
    soups: BTreeMap<(usize, Paint), Soup>,
    spawns: Vec<(Vec3, f32)>,
    /// The nodes that move: seconds, and the offset from where they are drawn, in metres.
    ways: BTreeMap<usize, Vec<(f32, Vec3)>>,
}

/// Triangles of one node and colour.
#[derive(Default)]
struct Soup {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Scene {
    /// An empty scene with a node for each space, and one for everything else.
    pub fn new(plan: &Plan) -> Self {
        let names = plan.spaces.iter().map(|space| space.name.clone());
        Self::with_nodes(names.chain(["shell".to_owned()]).collect())
    }

    /// An empty scene with nodes of these names.
    pub fn with_nodes(names: Vec<String>) -> Self {
        let shell = names.len() - 1;
        let (soups, ways) = (BTreeMap::new(), BTreeMap::new());
        Self { names, shell, soups, spawns: Vec::new(), ways }
    }

    /// The node of everything that belongs to no space.
    pub fn shell(&self) -> usize {
        self.shell
    }

    /// Adds a node that moves for ever: seconds, and the offset from where it is drawn.
    pub fn mover(&mut self, name: String, way: Vec<(f32, Vec3)>) -> usize {
        self.names.push(name);
        self.ways.insert(self.names.len() - 1, way);
        self.names.len() - 1
    }

    /// Adds a convex polygon, counter-clockwise seen from its front, in metres.
    pub fn polygon(&mut self, node: usize, paint: Paint, corners: &[Vec3]) {
        let soup = self.soups.entry((node, paint)).or_default();
        let first = soup.positions.len() as u32;
        soup.positions.extend_from_slice(corners);
        let fan = 1..corners.len().saturating_sub(1) as u32;
        soup.triangles.extend(fan.map(|i| [first, first + i, first + i + 1]));
    }

    /// Adds a rectangle at `at` on `axis`, between lattice points of the other two axes in cyclic
    /// order (x, y, z, x ...), facing along the axis or against it.
    pub fn face(&mut self, node: usize, paint: Paint, face: Face) {
        let Face { axis, at, min, max, positive } = face;
        let corner = |u: i32, v: i32| {
            let mut point = Vec3::ZERO;
            point[axis] = metres(at);
            point[(axis + 1) % 3] = metres(u);
            point[(axis + 2) % 3] = metres(v);
            point
        };
        debug_assert!(axis < 3, "a face lies across x, y or z");
        let mut corners = [
            corner(min[0], min[1]),
            corner(max[0], min[1]),
            corner(max[0], max[1]),
            corner(min[0], max[1]),
        ];
        if !positive {
            corners.reverse();
        }
        self.polygon(node, paint, &corners);
    }

    /// Adds the six faces of a box between two lattice points.
    pub fn block(&mut self, node: usize, paint: Paint, min: [i32; 3], max: [i32; 3]) {
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for positive in [false, true] {
                let at = if positive { max[axis] } else { min[axis] };
                let (min, max) = ([min[u], min[v]], [max[u], max[v]]);
                self.face(node, paint, Face { axis, at, min, max, positive });
            }
        }
    }

    /// Adds a spawn point: where the feet stand, in metres, and the yaw.
    pub fn spawn(&mut self, feet: Vec3, yaw: f32) {
        self.spawns.push((feet, yaw));
    }

    pub fn spawn_count(&self) -> usize {
        self.spawns.len()
    }

    pub fn triangle_count(&self) -> usize {
        self.soups.values().map(|soup| soup.triangles.len()).sum()
    }

    /// The GLB 2.0 file.
    pub fn to_glb(&self) -> Vec<u8> {
        let mut writer = Writer::default();
        for (&(node, paint), soup) in &self.soups {
            writer.primitive(node, paint, soup);
        }
        let nodes = self.nodes(&writer.primitives);
        let animations = self.animations(&mut writer);
        assert!(writer.bytes.len().is_multiple_of(4), "views are aligned");
        let bytes = writer.bytes.len();
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "sightline-server demo-building" },
            "extensionsUsed": ["OMI_spawn_point"],
            "scene": 0,
            "scenes": [{ "name": "Demo building", "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
            "meshes": writer.primitives.values().map(|p| json!({ "primitives": p })).collect::<Vec<_>>(),
            "nodes": nodes,
            "materials": writer.materials,
            "accessors": writer.accessors,
            "bufferViews": writer.views,
            "buffers": [{ "byteLength": bytes }],
        });
        if !animations.is_empty() {
            root["animations"] = json!(animations);
        }
        let glb = Glb {
            header: Header { magic: *b"glTF", version: 2, length: 0 },
            json: Cow::Owned(root.to_string().into_bytes()),
            bin: Some(Cow::Owned(writer.bytes)),
        };
        // Writing to memory does not fail; the largest building takes 190 MB.
        glb.to_vec().unwrap_or_default()
    }

    /// One animation for each node that moves.
    fn animations(&self, writer: &mut Writer) -> Vec<Value> {
        let places: Vec<usize> = writer.primitives.keys().copied().collect();
        let drawn = |node: &usize| places.iter().position(|place| place == node);
        let of = self.ways.iter().filter_map(|(node, way)| Some((*node, drawn(node)?, way)));
        of.map(|(node, index, way)| {
            let (times, places) = (writer.times(way), writer.places(way));
            json!({
                "name": self.names[node],
                "samplers": [{ "input": times, "output": places, "interpolation": "LINEAR" }],
                "channels": [{ "sampler": 0, "target": { "node": index, "path": "translation" } }],
            })
        })
        .collect()
    }

    fn nodes(&self, primitives: &BTreeMap<usize, Vec<Value>>) -> Vec<Value> {
        let spaces = primitives
            .keys()
            .enumerate()
            .map(|(mesh, &node)| json!({ "name": self.names[node], "mesh": mesh }));
        let spawns = self.spawns.iter().map(|(feet, yaw)| {
            json!({
                "name": "spawn",
                "translation": feet.to_array(),
                "rotation": glam::Quat::from_rotation_y(*yaw).to_array(),
                "extensions": { "OMI_spawn_point": {} },
            })
        });
        spaces.chain(spawns).collect()
    }
}

/// An axial rectangle; see [`Scene::face`].
#[derive(Clone, Copy)]
pub(super) struct Face {
    pub axis: usize,
    pub at: i32,
    pub min: [i32; 2],
    pub max: [i32; 2],
    pub positive: bool,
}

/// From lattice units to metres; exact.
pub(super) fn metres(units: i32) -> f32 {
    units as f32 / UNITS_PER_METRE as f32
}

/// The parts of a GLB file that is being written.
#[derive(Default)]
struct Writer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    material_of: BTreeMap<Paint, usize>,
    /// Primitives by node.
    primitives: BTreeMap<usize, Vec<Value>>,
}

impl Writer {
    fn primitive(&mut self, node: usize, paint: Paint, soup: &Soup) {
        let material = self.material(paint);
        let positions = self.positions(&soup.positions);
        let indices = self.indices(&soup.triangles, soup.positions.len());
        self.primitives.entry(node).or_default().push(json!({
            "attributes": { "POSITION": positions },
            "indices": indices,
            "material": material,
        }));
    }

    fn material(&mut self, paint: Paint) -> usize {
        let materials = &mut self.materials;
        *self.material_of.entry(paint).or_insert_with(|| {
            let Paint(colour, alpha) = paint;
            let [r, g, b] = colour.map(linear);
            let mut material = json!({
                "pbrMetallicRoughness": {
                    "baseColorFactor": [r, g, b, f32::from(alpha) / 255.0],
                    "metallicFactor": 0.0,
                },
                "doubleSided": true,
            });
            if alpha < 255 {
                material["alphaMode"] = json!("BLEND");
            }
            materials.push(material);
            materials.len() - 1
        })
    }

    fn positions(&mut self, positions: &[Vec3]) -> usize {
        let min = positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let max = positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
        let bytes = positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes);
        let view = self.view(bytes, Some(34_962));
        self.accessor(json!({
            "bufferView": view, "componentType": 5126, "type": "VEC3", "count": positions.len(),
            "min": min.to_array(), "max": max.to_array(),
        }))
    }

    fn times(&mut self, way: &[(f32, Vec3)]) -> usize {
        let (count, times) = (way.len(), || way.iter().map(|&(at_s, _)| at_s));
        let view = self.view(times().flat_map(f32::to_le_bytes), None);
        let last = times().fold(0.0, f32::max);
        self.accessor(json!({
            "bufferView": view, "componentType": 5126, "type": "SCALAR", "count": count,
            "min": [0.0], "max": [last],
        }))
    }

    fn places(&mut self, way: &[(f32, Vec3)]) -> usize {
        let places = way.iter().flat_map(|(_, place)| place.to_array());
        let view = self.view(places.flat_map(f32::to_le_bytes), None);
        self.accessor(json!({
            "bufferView": view, "componentType": 5126, "type": "VEC3", "count": way.len(),
        }))
    }

    fn indices(&mut self, triangles: &[[u32; 3]], vertices: usize) -> usize {
        let indices = triangles.iter().flatten();
        // Index 65535 is reserved for restarts.
        let (view, component) = if vertices < 65_535 {
            (self.view(indices.flat_map(|&i| (i as u16).to_le_bytes()), Some(34_963)), 5123)
        } else {
            (self.view(indices.flat_map(|&i| i.to_le_bytes()), Some(34_963)), 5125)
        };
        let count = triangles.len() * 3;
        self.accessor(json!({
            "bufferView": view, "componentType": component, "type": "SCALAR", "count": count,
        }))
    }

    fn view(&mut self, bytes: impl Iterator<Item = u8>, target: Option<u32>) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - offset;
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": length });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// From an sRGB byte to a linear factor.
fn linear(byte: u8) -> f32 {
    let value = f32::from(byte) / 255.0;
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}
