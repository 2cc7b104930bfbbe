//! Hand-made worlds, and clients without a network: an ask is answered before the next tick.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use glam::Vec3;
use roaring::RoaringBitmap;
use sightline_world::{
    Cell, CellId, Cells, Gate, Mesh, Node, Polygon, Portal, Space, Spawn, World,
    geometry::{Aabb, Axes},
    motion::{AvatarId, Body, Pose, Report, Tbv},
    octree::Octree,
};

use crate::{Config, Engine, Input, Margin, Output, TbvShape, Validity};

pub const TICK: Duration = Duration::from_millis(50);

/// A world of these cells, in which a pair of cells sees each other if `sees` says so.
pub fn world(tree: Vec<Node>, bounds: Vec<Aabb>, sees: impl Fn(u32, u32) -> bool) -> World {
    let count = bounds.len() as u32;
    let met = |a: u32, b: u32| a == b || sees(a, b) || sees(b, a);
    let portals = portals(&bounds, met);
    let all = bounds.iter().fold(Aabb::EMPTY, |all, b| all.union(b));
    World {
        title: "hand-made".to_owned(),
        octree: Octree::empty(all.min, 1.0, 1),
        cells: Cells {
            axes: Axes::WORLD,
            bounds: all,
            tree,
            spaces: spaces(&bounds, &portals),
            gates: portals.iter().map(gate).collect(),
            cells: cells(bounds, &portals),
            portals,
            pvs: (0..count)
                .map(|a| (0..count).filter(|b| met(a, *b)).collect::<RoaringBitmap>())
                .collect(),
        },
        mesh: Mesh::default(),
        spawns: vec![
            Spawn { eye: all.centre(), yaw: 1.0 },
            Spawn { eye: all.centre() + Vec3::X, yaw: 2.0 },
        ],
        body: Body::PERSON,
        speed_max: 2.0,
        movers: Vec::new(),
        rooms: Default::default(),
        light: None,
        origin: None,
    }
}

/// The portals: each rectangle that two cells share that see each other.
fn portals(bounds: &[Aabb], met: impl Fn(u32, u32) -> bool) -> Vec<Portal> {
    let mut found = Vec::new();
    for (a, lesser) in bounds.iter().enumerate() {
        for (b, greater) in bounds.iter().enumerate() {
            let shared = lesser.intersection(greater);
            let size = shared.size();
            let flat = (0..3).filter(|axis| size[*axis] == 0.0).collect::<Vec<_>>();
            let (lesser, greater) = (lesser.centre(), greater.centre());
            if let [axis] = flat[..]
                && size.min_element() == 0.0
                && lesser[axis] < greater[axis]
                && met(a as u32, b as u32)
            {
                let cells = [CellId(a as u32), CellId(b as u32)];
                let polygon = Polygon::Rectangle { axis: axis as u8, bounds: shared };
                found.push(Portal { cells, polygon });
            }
        }
    }
    found
}

fn of_cell(portals: &[Portal], cell: u32) -> Vec<u32> {
    (0..).zip(portals).filter(|(_, p)| p.cells.contains(&CellId(cell))).map(|(i, _)| i).collect()
}

fn cells(bounds: Vec<Aabb>, portals: &[Portal]) -> Vec<Cell> {
    let numbered = bounds.into_iter().zip(0..);
    numbered.map(|(bounds, i)| Cell { bounds, space: i, portals: of_cell(portals, i) }).collect()
}

/// Every cell is a space.
fn spaces(bounds: &[Aabb], portals: &[Portal]) -> Vec<Space> {
    let numbered = bounds.iter().zip(0..);
    numbered
        .map(|(&bounds, i)| Space { bounds, cells: i..i + 1, gates: of_cell(portals, i) })
        .collect()
}

fn gate(portal: &Portal) -> Gate {
    Gate { spaces: portal.cells.map(|cell| cell.0), polygon: portal.polygon.clone() }
}

/// Cells of 10 m in a row along x, 3 m high; each sees itself and its neighbours.
pub fn row(count: u32) -> World {
    let cell = |i: u32| {
        let x = i as f32 * 10.0;
        Aabb::new(Vec3::new(x, 0.0, 0.0), Vec3::new(x + 10.0, 3.0, 10.0))
    };
    let mut tree = Vec::new();
    for i in 0..count - 1 {
        let next = tree.len() as u32;
        let at = (i + 1) as f32 * 10.0;
        tree.push(Node::Axial { axis: 0, at, sides: [next + 1, next + 2] });
        tree.push(Node::Leaf(CellId(i)));
    }
    tree.push(Node::Leaf(CellId(count - 1)));
    world(tree, (0..count).map(cell).collect(), |a, b| a.abs_diff(b) <= 1)
}

/// Narrows the portal and the gate of two cells to a part of their extent along an axis.
pub fn narrow(world: &mut World, joint: usize, axis: usize, part: [f32; 2]) {
    let cells = &mut world.cells;
    for polygon in [&mut cells.portals[joint].polygon, &mut cells.gates[joint].polygon] {
        let Polygon::Rectangle { bounds, .. } = polygon else {
            unreachable!("hand-made worlds join in rectangles")
        };
        (bounds.min[axis], bounds.max[axis]) = (part[0], part[1]);
    }
}

/// A client, and what it was told.
#[derive(Clone, Debug, Default)]
pub struct Client {
    pub eye: Vec3,
    /// Its eye at the last tick.
    pub before: Option<Vec3>,
    /// When it reported last.
    pub made: Option<Duration>,
    /// How many orders it has heard.
    pub orders: u32,
    pub quiet: Option<Tbv>,
    pub asked: bool,
    pub sees: BTreeMap<AvatarId, Pose>,
    pub heard: Vec<String>,
    pub corrections: usize,
    pub dropped: Option<String>,
}

impl Client {
    /// Its pose, with the velocity since the last tick.
    fn step(&mut self) -> Pose {
        let velocity = self.velocity();
        self.before = Some(self.eye);
        Pose { eye: self.eye, velocity, ..Pose::default() }
    }

    /// The report that it makes now.
    pub fn report(&mut self, avatar: AvatarId, now: Duration, pose: Pose) -> Input {
        let next = self.made.map(|made| made + Duration::from_micros(1));
        let made = next.map_or(now, |next| next.max(now));
        self.made = Some(made);
        Input::Report { avatar, report: Report { made, orders: self.orders, pose } }
    }

    pub fn velocity(&self) -> Vec3 {
        (self.eye - self.before.unwrap_or(self.eye)) / TICK.as_secs_f32()
    }
}

/// An engine and its clients.
pub struct Stage {
    pub engine: Engine,
    pub now: Duration,
    pub clients: BTreeMap<AvatarId, Client>,
    /// All outputs, for comparing runs.
    pub log: Vec<Output>,
    pub reports: usize,
}

impl Stage {
    pub fn new(world: World, config: Config) -> Self {
        Self {
            engine: Engine::new(Arc::new(world), config),
            now: Duration::ZERO,
            clients: BTreeMap::new(),
            log: Vec::new(),
            reports: 0,
        }
    }

    /// A stage without delays, with the simplest TBVs and where every move is told, so that figures
    /// in a test are simple.
    pub fn prompt(world: World) -> Self {
        let config = Config {
            validity: Validity::Constant(Duration::from_secs(1)),
            shape: TbvShape::Sphere,
            margin: Margin::Fixed(Duration::ZERO),
            round_trip_initial: Duration::ZERO,
            by_exception: false,
            ..Config::default()
        };
        Self::new(world, config)
    }

    pub fn join(&mut self, id: u32, x: f32) -> AvatarId {
        self.join_at(id, Vec3::new(x, 1.6, 5.0))
    }

    pub fn join_at(&mut self, id: u32, eye: Vec3) -> AvatarId {
        let avatar = AvatarId(id);
        let name = format!("visitor {id}");
        let join = Input::Join { avatar, name, colour: [id as u8, 0, 0], place: Some(eye) };
        self.engine.handle(self.now, join);
        self.clients.insert(avatar, Client { eye, ..Client::default() });
        avatar
    }

    pub fn leave(&mut self, avatar: AvatarId) {
        self.engine.handle(self.now, Input::Leave { avatar });
        self.clients.remove(&avatar);
    }

    pub fn client(&self, avatar: AvatarId) -> &Client {
        &self.clients[&avatar]
    }

    /// Live clients report, though they need not, and asked ones once. Then the engine decides.
    pub fn tick(&mut self) {
        for (id, client) in &mut self.clients {
            let pose = client.step();
            let stays = |tbv: &Tbv| tbv.holds(&pose, TICK, &self.engine.agility());
            let is_silent = client.quiet.as_ref().is_some_and(stays);
            if !is_silent || std::mem::take(&mut client.asked) {
                self.reports += 1;
                self.engine.handle(self.now, client.report(*id, self.now, pose));
            }
        }
        let mut outputs = Vec::new();
        self.engine.tick(self.now, &mut outputs);
        outputs.iter().for_each(|output| self.deliver(output));
        self.log.append(&mut outputs);
        self.now += TICK;
    }

    pub fn ticks(&mut self, count: usize) {
        (0..count).for_each(|_| self.tick());
    }

    /// Walks along x at 1.9 m/s until the avatar is there.
    pub fn walk(&mut self, avatar: AvatarId, to_x: f32) {
        while (self.client(avatar).eye.x - to_x).abs() > 1e-3 {
            let eye = &mut self.clients.get_mut(&avatar).unwrap().eye;
            eye.x += (to_x - eye.x).clamp(-0.095, 0.095);
            self.tick();
        }
    }

    fn deliver(&mut self, output: &Output) {
        let Some(client) = self.clients.get_mut(&output.to()) else { return };
        client.orders += u32::from(matches!(output, Output::Live { .. } | Output::Quiet { .. }));
        match output {
            Output::Entered { pose, .. } => client.eye = pose.eye,
            Output::Appear { avatar, pose, .. } => {
                assert_eq!(client.sees.insert(*avatar, *pose), None, "appears once");
            }
            Output::Vanish { avatar, .. } => {
                client.sees.remove(avatar).expect("only what appeared vanishes");
            }
            Output::Poses { poses, .. } => {
                assert!(poses.is_sorted_by_key(|(id, _)| *id));
                for (avatar, pose) in poses {
                    *client.sees.get_mut(avatar).expect("a pose of what appeared") = *pose;
                }
            }
            Output::Live { .. } => client.quiet = None,
            Output::Quiet { tbv, .. } => client.quiet = Some(*tbv),
            Output::Ask { .. } => client.asked = true,
            Output::Correct { .. } => client.corrections += 1,
            Output::Chat { text, .. } => client.heard.push(text.clone()),
            Output::Drop { reason, .. } => client.dropped = Some(reason.clone()),
        }
    }
}
