//! From a document to a model: nodes, meshes and materials.

use std::time::Duration;

use glam::{DMat4, DVec3, Mat4, Vec2, Vec3};
use gltf::{
    Document, Node, Primitive, Semantic,
    material::{AlphaMode, Material as GltfMaterial},
    mesh::Mode,
};
use sightline_world::{Spawn, geometry::Aabb, motion::Body};

use super::{
    accessor,
    animation::{Animations, Chain},
    error::{DEPTH_MAX, GlbError, NODES_MAX, TRIANGLES_MAX, VERTICES_MAX},
    resources::Resources,
};
use crate::{
    import::{
        limits::{self, SPAWNS_MAX},
        movers::MoverList,
    },
    model::{Model, Surface, SurfaceMaterial},
    rooms,
};

/// The height of an eye above a spawn point, where feet stand, in metres.
const EYE_HEIGHT: f64 = Body::PERSON.below_eye as f64;

/// Walks the scene and fills the model.
pub(super) struct Reader<'a> {
    document: &'a Document,
    resources: Resources,
    model: Model,
    vertices: usize,
    triangles: usize,
    animations: Animations,
    /// Nodes that move.
    moving: Vec<MovingNode>,
    /// For each named node of the model, the nearest named ancestor.
    above: Vec<Option<usize>>,
}

/// A node that moves, and the surfaces below it that no other moving node carries.
struct MovingNode {
    name: String,
    chain: Chain,
    /// The surfaces, in the coordinates of the node.
    surfaces: Vec<Surface>,
}

/// A node to visit.
#[derive(Clone)]
struct Visit<'a> {
    node: Node<'a>,
    /// The transform of its parent, relative to the world or to the moving node that carries it.
    parent: DMat4,
    depth: usize,
    carrier: Option<usize>,
    /// The nearest named ancestor, as an index into the named nodes of the model.
    within: Option<usize>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(document: &'a Document, resources: Resources, title: &str) -> Self {
        let model = Model::empty(limits::tidy_title(title));
        Self {
            document,
            resources,
            model,
            vertices: 0,
            triangles: 0,
            animations: Animations::default(),
            moving: Vec::new(),
            above: Vec::new(),
        }
    }

    /// Reads the default scene, or all scenes when there is none.
    pub(super) fn read(mut self) -> Result<Model, GlbError> {
        let scenes: Vec<_> = match self.document.default_scene() {
            Some(scene) => vec![scene],
            None => self.document.scenes().collect(),
        };
        if let [scene] = &scenes[..]
            && let Some(name) = scene.name().filter(|name| !matches!(*name, "" | "Scene"))
        {
            self.model.title = limits::tidy_title(name);
        }
        self.animations =
            Animations::read(self.document, &self.resources, &mut self.model.warnings)?;
        let visit =
            |node| Visit { node, parent: DMat4::IDENTITY, depth: 0, carrier: None, within: None };
        let mut stack: Vec<Visit<'a>> =
            scenes.iter().flat_map(|scene| scene.nodes()).map(visit).collect();
        stack.reverse();
        let mut visited = 0;
        while let Some(visit) = stack.pop() {
            visited += 1;
            if visited > NODES_MAX || stack.len() > NODES_MAX {
                return Err(GlbError::TooMany("nodes"));
            }
            if visit.depth > DEPTH_MAX {
                return Err(GlbError::Depth);
            }
            self.visit(&visit, &mut stack)?;
        }
        self.make_movers();
        self.model.nodes.retain(|(_, bounds)| !bounds.is_empty());
        rooms::nodes::in_order(&mut self.model.rooms);
        Ok(self.model)
    }

    fn visit(&mut self, visit: &Visit<'a>, stack: &mut Vec<Visit<'a>>) -> Result<(), GlbError> {
        let Visit { node, parent, depth, mut carrier, mut within } = visit.clone();
        let above = carrier.and_then(|index| self.moving.get(index)).map(|above| &above.chain);
        let mut place = parent * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        if let Some(chain) = self.animations.chain(&node, above, &parent)? {
            let name = node.name().map_or_else(|| format!("node {}", node.index()), str::to_owned);
            carrier = Some(self.moving.len());
            self.moving.push(MovingNode { name, chain, surfaces: Vec::new() });
            place = DMat4::IDENTITY;
        }
        if let Some(role) = node.name().and_then(rooms::nodes::role) {
            self.room(&node, &role, &tidied(place), carrier)?;
        } else {
            if let Some(name) = node.name().filter(|_| carrier.is_none()) {
                self.model.nodes.push((name.to_owned(), Aabb::EMPTY));
                self.above.push(within);
                within = Some(self.above.len() - 1);
            }
            self.node(&node, &tidied(place), carrier, within)?;
        }
        let child = |node| Visit { node, parent: place, depth: depth + 1, carrier, within };
        stack.extend(node.children().map(child));
        Ok(())
    }

    /// Makes movers of all nodes that move.
    fn make_movers(&mut self) {
        let mut movers = MoverList::default();
        for MovingNode { name, chain, surfaces } in self.moving.drain(..) {
            let (trajectory, faulty) = chain.trajectory();
            if faulty && !surfaces.is_empty() {
                let what = "has conflicting, too deep or invalid animations";
                self.model.warnings.push(format!("{}: {what}", limits::tidy_title(&name)));
            }
            movers.add(&name, &surfaces, trajectory);
        }
        self.model.movers = movers.finish(&mut self.model.warnings);
    }

    fn node(
        &mut self,
        node: &Node<'a>,
        place: &DMat4,
        carrier: Option<usize>,
        within: Option<usize>,
    ) -> Result<(), GlbError> {
        let is_marker = node.name().is_some_and(marks_spawn);
        if is_marker || node.extension_value("OMI_spawn_point").is_some() {
            let above = carrier.and_then(|index| self.moving.get(index));
            let start = above.map(|above| above.chain.trajectory().0.at(Duration::ZERO));
            self.spawn(&start.map_or(*place, |start| DMat4::from(start) * *place));
        }
        // What a marker looks like in an editor is not part of the building.
        let Some(mesh) = node.mesh().filter(|_| !is_marker) else { return Ok(()) };
        for primitive in mesh.primitives() {
            let Some(surface) = self.primitive(mesh.index(), &primitive, place)? else { continue };
            if let Some(carrier) = carrier.and_then(|index| self.moving.get_mut(index)) {
                carrier.surfaces.push(surface);
                continue;
            }
            if !surface.material.glass {
                self.model.opaque.extend(surface.corners());
            }
            let bounds = Aabb::from_points(surface.corners().flatten());
            let mut at = within;
            while let Some(around) = at {
                let (_, known) = &mut self.model.nodes[around];
                *known = known.union(&bounds);
                at = self.above[around];
            }
            self.model.surfaces.push(surface);
        }
        Ok(())
    }

    /// Reads a node that declares a part of a room, or a window.
    fn room(
        &mut self,
        node: &Node<'a>,
        role: &rooms::nodes::NodeRole<'_>,
        place: &DMat4,
        carrier: Option<usize>,
    ) -> Result<(), GlbError> {
        let name = node.name().unwrap_or_default();
        if carrier.is_some() {
            self.model.warnings.push(format!("{name}: rooms do not move; left out"));
            return Ok(());
        }
        let mut corners = Vec::new();
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
            let index = node.mesh().map_or(0, |mesh| mesh.index());
            if let Some(surface) = self.primitive(index, &primitive, place)? {
                corners.extend(surface.corners().flatten());
            }
        }
        let extras = node.extras().as_ref().map(|extras| extras.get());
        let added = rooms::nodes::add(&mut self.model.rooms, name, role, &corners, extras);
        Ok(added?)
    }

    /// Adds a spawn point.
    fn spawn(&mut self, to_world: &DMat4) {
        let feet = to_world.transform_point3(DVec3::ZERO);
        let forward = to_world.transform_vector3(DVec3::NEG_Z);
        let eye = (feet + DVec3::Y * EYE_HEIGHT).as_vec3();
        if self.model.spawns.len() >= SPAWNS_MAX || !limits::is_sane(eye) {
            self.model.warnings.push("a spawn point left out".into());
            return;
        }
        let yaw = (-forward.x).atan2(-forward.z) as f32;
        self.model.spawns.push(Spawn { eye, yaw: if yaw.is_finite() { yaw } else { 0.0 } });
    }

    /// The surface of a primitive, if it has triangles.
    fn primitive(
        &mut self,
        mesh: usize,
        primitive: &Primitive<'a>,
        to_world: &DMat4,
    ) -> Result<Option<Surface>, GlbError> {
        let mode = primitive.mode();
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            let warning = format!("mesh {mesh}: {mode:?} left out, not triangles");
            self.model.warnings.push(warning);
            return Ok(None);
        }
        let Some(positions) = primitive.get(&Semantic::Positions) else {
            self.model.warnings.push(format!("mesh {mesh}: a primitive without positions"));
            return Ok(None);
        };
        self.vertices += positions.count();
        if self.vertices > VERTICES_MAX {
            return Err(GlbError::TooMany("vertices"));
        }
        let local = accessor::vectors::<3>(&positions, &self.resources, 3)?;
        let positions = placed(mesh, &local, to_world)?;
        let triangles = self.triangles(mesh, primitive, mode, &positions)?;
        if triangles.is_empty() {
            return Ok(None);
        }
        let (material, uvs) = self.material(primitive, positions.len())?;
        let colours = self.colours(primitive, positions.len())?;
        Ok(Some(Surface { positions, uvs, colours, triangles, material }))
    }

    /// The triangles as indices into the positions, without degenerate ones.
    fn triangles(
        &mut self,
        mesh: usize,
        primitive: &Primitive<'a>,
        mode: Mode,
        positions: &[Vec3],
    ) -> Result<Vec<[u32; 3]>, GlbError> {
        let vertices = positions.len();
        let indices = match primitive.indices() {
            Some(accessor) => accessor::indices(&accessor, &self.resources)?,
            None => (0..vertices as u32).collect(),
        };
        if let Some(&index) = indices.iter().find(|&&i| i as usize >= vertices) {
            return Err(GlbError::Index { mesh, index, vertices });
        }
        let triples: Vec<[u32; 3]> = match mode {
            Mode::TriangleStrip => {
                let flip = |(i, w): (usize, &[u32])| [w[i % 2], w[1 - i % 2], w[2]];
                indices.windows(3).enumerate().map(flip).collect()
            }
            Mode::TriangleFan => match indices.split_first() {
                Some((&first, rest)) => rest.windows(2).map(|w| [first, w[0], w[1]]).collect(),
                None => Vec::new(),
            },
            _ => indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
        };
        self.triangles += triples.len();
        if self.triangles > TRIANGLES_MAX {
            return Err(GlbError::TooMany("triangles"));
        }
        let has_area = |t: &[u32; 3]| limits::has_area(t.map(|i| positions[i as usize]));
        Ok(triples.into_iter().filter(has_area).collect())
    }

    /// The material of a primitive, and its texture coordinates if it has a texture.
    fn material(
        &mut self,
        primitive: &Primitive<'a>,
        vertices: usize,
    ) -> Result<(SurfaceMaterial, Vec<Vec2>), GlbError> {
        let source = primitive.material();
        let [r, g, b, alpha] = source.pbr_metallic_roughness().base_color_factor();
        let glass = source.alpha_mode() != AlphaMode::Opaque || alpha < 1.0;
        let mut material =
            SurfaceMaterial { colour: [r, g, b].map(limits::srgb_byte), texture: None, glass };
        let Some(mapping) = Mapping::of(&source) else { return Ok((material, Vec::new())) };
        let Some(accessor) = primitive.get(&Semantic::TexCoords(mapping.set)) else {
            return Ok((material, Vec::new()));
        };
        let image = mapping.texture.source().index();
        let warnings = &mut self.model.warnings;
        material.texture = self.resources.image(self.document, image, warnings);
        if material.texture.is_none() {
            return Ok((material, Vec::new()));
        }
        let mut uvs: Vec<Vec2> = accessor::vectors::<2>(&accessor, &self.resources, 2)?
            .into_iter()
            .map(|uv| mapping.apply(Vec2::from(uv)))
            .collect();
        uvs.resize(vertices, Vec2::ZERO);
        Ok((material, uvs))
    }

    fn colours(
        &self,
        primitive: &Primitive<'a>,
        vertices: usize,
    ) -> Result<Vec<[u8; 3]>, GlbError> {
        let Some(accessor) = primitive.get(&Semantic::Colors(0)) else { return Ok(Vec::new()) };
        let linear = accessor::vectors::<3>(&accessor, &self.resources, 3)?;
        let mut colours: Vec<[u8; 3]> =
            linear.into_iter().map(|colour| colour.map(limits::srgb_byte)).collect();
        colours.resize(vertices, [255; 3]);
        Ok(colours)
    }
}

/// The mapping of the base-colour texture, with `KHR_texture_transform`.
struct Mapping<'a> {
    texture: gltf::Texture<'a>,
    set: u32,
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl<'a> Mapping<'a> {
    fn of(material: &GltfMaterial<'a>) -> Option<Self> {
        let info = material.pbr_metallic_roughness().base_color_texture()?;
        let (texture, set) = (info.texture(), info.tex_coord());
        let mut mapping =
            Self { texture, set, offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE };
        let Some(transform) = info.extension_value("KHR_texture_transform") else {
            return Some(mapping);
        };
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
        Some(mapping)
    }

    fn apply(&self, uv: Vec2) -> Vec2 {
        // In texture space v points down, so the extension rotates the other way.
        let turned = Vec2::from_angle(-self.rotation).rotate(uv * self.scale) + self.offset;
        if turned.is_finite() { turned } else { Vec2::ZERO }
    }
}

/// Whether a node of this name is a spawn point: `spawn`, `spawn:NAME`, or `spawn` with a number.
fn marks_spawn(name: &str) -> bool {
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '_' | '-' | ' ');
    match name.get(..5) {
        Some(start) if start.eq_ignore_ascii_case("spawn") => {
            let rest = &name[5..];
            rest.starts_with(':') || rest.chars().all(is_number)
        }
        _ => false,
    }
}

/// Makes nearly exact quarter turns exact, so that axial faces stay axial.
fn tidied(mut transform: DMat4) -> DMat4 {
    const TOLERANCE: f64 = 1e-6;
    for column in [&mut transform.x_axis, &mut transform.y_axis, &mut transform.z_axis] {
        let length = column.truncate().length();
        for axis in 0..3 {
            if column[axis].abs() < TOLERANCE * length {
                column[axis] = 0.0;
            } else if (column[axis].abs() - 1.0).abs() < TOLERANCE {
                column[axis] = column[axis].signum();
            }
        }
    }
    transform
}

/// Positions in the world's axes.
fn placed(mesh: usize, local: &[[f32; 3]], to_world: &DMat4) -> Result<Vec<Vec3>, GlbError> {
    let place = |(vertex, &position): (usize, &[f32; 3])| {
        let placed = to_world.transform_point3(Vec3::from(position).as_dvec3()).as_vec3();
        if limits::is_sane(placed) {
            Ok(placed)
        } else {
            Err(GlbError::Coordinate { mesh, vertex })
        }
    };
    local.iter().enumerate().map(place).collect()
}
