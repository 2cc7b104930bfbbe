//! From a document to a model: nodes and what they carry.

mod lamps;
mod primitive;

use std::time::Duration;

use glam::{DMat4, DVec3, Mat4};
use gltf::{Document, Node};
use sightline_world::{Spawn, geometry::Aabb, motion::Body};

use super::{
    animation::{Animations, Chain},
    error::{DEPTH_MAX, GlbError, NODES_MAX, PLACED_MAX},
    instances,
    material::Materials,
    names::{self, Purpose},
    resources::Resources,
};
use crate::{
    import::{
        left_out::PatternCounts,
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
    /// The transform of the whole scene.
    root: DMat4,
    model: Model,
    materials: Materials,
    /// How many parts are left out because they are faulty, and what is wrong with the first.
    faulty: usize,
    first_fault: Option<GlbError>,
    left_out: PatternCounts,
    /// How many meshes are mirrored by their nodes.
    mirrored: usize,
    /// How many primitives are left out because they are points or lines.
    lines: usize,
    /// How many primitives have been placed, each copy for itself.
    placed: usize,
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
    purpose: Purpose,
    /// Whether the node and all below it are switched off (`KHR_node_visibility`).
    is_hidden: bool,
}

/// Where a node stands, and what its meshes are there for.
#[derive(Clone, Copy)]
struct Setting<'b> {
    place: &'b DMat4,
    carrier: Option<usize>,
    within: Option<usize>,
    purpose: Purpose,
}

/// A surface, and whether it blocks sight.
struct Part {
    surface: Surface,
    hides: bool,
}

impl<'a> Reader<'a> {
    pub(super) fn new(
        document: &'a Document,
        resources: Resources,
        title: &str,
        root: DMat4,
        left_out: PatternCounts,
    ) -> Self {
        let model = Model::empty(limits::tidy_title(title));
        Self {
            document,
            resources,
            root,
            model,
            materials: Materials::default(),
            faulty: 0,
            first_fault: None,
            left_out,
            mirrored: 0,
            lines: 0,
            placed: 0,
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
        let root = self.root;
        let visit = |node| Visit {
            node,
            parent: root,
            depth: 0,
            carrier: None,
            within: None,
            purpose: Purpose::Building,
            is_hidden: false,
        };
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
        self.tell_of_parts()?;
        self.model.nodes.retain(|(_, bounds)| !bounds.is_empty());
        rooms::nodes::in_order(&mut self.model.rooms);
        Ok(self.model)
    }

    /// Warns of what is left out or changed.
    ///
    /// # Errors
    /// When nothing is left because all parts are faulty.
    fn tell_of_parts(&mut self) -> Result<(), GlbError> {
        let warnings = &mut self.model.warnings;
        self.materials.warn(warnings);
        self.left_out.warn(warnings);
        let counts = [
            (self.mirrored, "meshes are mirrored by their nodes; writing is too"),
            (self.lines, "primitives are left out: they are points or lines, not triangles"),
        ];
        let told = counts.iter().filter(|(count, _)| *count > 0);
        warnings.extend(told.map(|(count, what)| format!("{count} {what}")));
        let Some(first) = self.first_fault.take() else { return Ok(()) };
        let is_empty = self.model.surfaces.is_empty() && self.model.opaque.is_empty();
        if is_empty && self.model.movers.is_empty() {
            return Err(first);
        }
        warnings.push(format!("{} parts left out, because they are faulty: {first}", self.faulty));
        Ok(())
    }

    /// What was read of a part. A faulty part is left out.
    fn tolerate<T>(&mut self, part: Result<T, GlbError>) -> Result<Option<T>, GlbError> {
        match part {
            Ok(part) => Ok(Some(part)),
            Err(error) if error.is_of_a_part() => {
                self.faulty += 1;
                self.first_fault.get_or_insert(error);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    fn visit(&mut self, visit: &Visit<'a>, stack: &mut Vec<Visit<'a>>) -> Result<(), GlbError> {
        let Visit { node, parent, depth, mut carrier, mut within, purpose, is_hidden } =
            visit.clone();
        if node.name().is_some_and(|name| self.left_out.take(name)) {
            return Ok(());
        }
        let purpose = node.name().and_then(names::purpose).unwrap_or(purpose);
        let visibility = node.extension_value("KHR_node_visibility");
        let is_shown = visibility.and_then(|value| value.get("visible")?.as_bool());
        let is_hidden = is_hidden || is_shown == Some(false);
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
            let place = &tidied(place);
            self.node(&node, &Setting { place, carrier, within, purpose }, is_hidden)?;
        }
        let child = |node| Visit {
            node,
            parent: place,
            depth: depth + 1,
            carrier,
            within,
            purpose,
            is_hidden,
        };
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
        setting: &Setting<'_>,
        is_hidden: bool,
    ) -> Result<(), GlbError> {
        let is_marker = node.name().is_some_and(names::marks_spawn);
        if is_marker || node.extension_value("OMI_spawn_point").is_some() {
            let above = setting.carrier.and_then(|index| self.moving.get(index));
            let start = above.map(|above| above.chain.trajectory().0.at(Duration::ZERO));
            let place = *setting.place;
            self.spawn(&start.map_or(place, |start| DMat4::from(start) * place));
        }
        if !is_hidden {
            self.lamp(node, setting);
        }
        // What a marker looks like in an editor is not part of the building.
        let Some(mesh) = node.mesh().filter(|_| !is_marker && !is_hidden) else { return Ok(()) };
        let places = instances::places(node, self.document, &self.resources);
        for instance in self.tolerate(places)?.into_iter().flatten() {
            let place = *setting.place * instance;
            self.mirrored += usize::from(place.determinant() < 0.0);
            for primitive in mesh.primitives() {
                self.placed += 1;
                if self.placed > PLACED_MAX {
                    return Err(GlbError::TooMany("copies of meshes"));
                }
                let part = self.primitive(mesh.index(), &primitive, &place);
                if let Some(Some(part)) = self.tolerate(part)? {
                    self.add(part, setting);
                }
            }
        }
        Ok(())
    }

    /// Adds a part of the building, or of what moves.
    fn add(&mut self, Part { mut surface, hides }: Part, setting: &Setting<'_>) {
        if setting.purpose == Purpose::Collider {
            surface.material = SurfaceMaterial::unseen();
        }
        if setting.purpose == Purpose::Light {
            lamps::make_emissive(&mut surface);
        }
        if let Some(carrier) = setting.carrier.and_then(|index| self.moving.get_mut(index)) {
            if !matches!(setting.purpose, Purpose::Occluder | Purpose::Collider) {
                carrier.surfaces.push(surface);
            }
            return;
        }
        let blocks_sight = match setting.purpose {
            Purpose::Building | Purpose::Light => hides,
            Purpose::Occluder => true,
            Purpose::Detail | Purpose::Collider => false,
        };
        if blocks_sight {
            self.model.opaque.extend(surface.corners());
        }
        let bounds = Aabb::from_points(surface.corners().flatten());
        let mut at = setting.within;
        while let Some(around) = at {
            let (_, known) = &mut self.model.nodes[around];
            *known = known.union(&bounds);
            at = self.above[around];
        }
        if setting.purpose != Purpose::Occluder {
            self.model.surfaces.push(surface);
        }
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
            if let Some(part) = self.primitive(index, &primitive, place)? {
                corners.extend(part.surface.corners().flatten());
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
