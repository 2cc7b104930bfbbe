//! What moving things cost a picture: Fig. 6 (a) to (c) of Sudarsky and Gotsman, with real pictures.
//!
//! ```text
//! cargo bench -p sightline-tests --bench moving
//! ```
//!
//! Chairs go to and fro at the tables of a generated building, and an eye turns round in one of its
//! rooms. (a) The building grows, and the chairs are as many; (b) four chairs for each room; (c) one building, and
//! ever more chairs, all of them in other rooms. Each row draws the same pictures in three ways: every
//! mover drawn (Z), by the Z pyramid (HZ), and by the pyramid and temporal bounding volumes (TBV), which must be
//! equal. Times are CPU milliseconds of all threads for a picture, the building included: of several rounds the
//! one with the least in the mean, without its first picture, in which everything is looked at. Ratios are to the
//! building alone. Last come the movers that the third way draws in a picture, and those it places.

use std::{ops::ControlFlow, time::Duration};

use clap::Parser;
use cpu_time::ProcessTime;
use glam::{DAffine3, DVec3, Quat, Vec3};
use rand::{Rng, SeedableRng, rngs::SmallRng};
use sightline_client::render::{
    Camera, Frame, Renderer,
    moving::{Culling, Moving},
};
use sightline_server::compile::{
    self,
    demo_building::{self, Plan, SpaceKind, UNITS_PER_METRE},
    glb,
};
use sightline_shared::{
    geometry::Aabb,
    motion::trajectory::{Course, Joint, Track, Trajectory},
    world::{Mesh, Mover, World},
};

/// Between two pictures.
const STEP: Duration = Duration::from_millis(33);
const WAYS: [Culling; 3] = [Culling::Plain, Culling::Hierarchical, Culling::Temporal];

/// Measures pictures of buildings with moving chairs.
#[derive(Parser)]
struct Args {
    /// Pictures of a round.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..))]
    pictures: u32,
    /// Rounds, of which the least counts.
    #[arg(long, value_name = "N", default_value_t = 3)]
    rounds: u32,
    /// What `cargo bench` passes. Without it the buildings and pictures are small, to show that this works.
    #[arg(long, hide = true)]
    bench: bool,
}

impl Args {
    fn size(&self) -> [usize; 2] {
        if self.bench { [1_280, 720] } else { [160, 90] }
    }
}

fn main() -> anyhow::Result<()> {
    let mut args = Args::parse();
    let (rooms, chairs): (&[usize], &[usize]) = if args.bench {
        (&[8, 30, 60, 125], &[125, 500, 1_000, 2_000])
    } else {
        (args.pictures, args.rounds) = (6, 1);
        (&[6], &[20])
    };
    println!(
        "{:<4} {:>6} {:>7} {:>9} {:>8} {:>8} {:>8} {:>7} {:>7} {:>7} {:>8} {:>8}",
        "",
        "rooms",
        "chairs",
        "alone ms",
        "Z ms",
        "HZ ms",
        "TBV ms",
        "Z",
        "HZ",
        "TBV",
        "drawn",
        "placed"
    );
    let mut building = None;
    for &rooms in rooms {
        let mut next = Building::new(rooms, if args.bench { 0.06 } else { 0.25 })?;
        next.row("(a)", next.chairs(16, false), &args)?;
        next.row("(b)", next.chairs(4 * rooms, false), &args)?;
        building = Some(next);
    }
    for &count in chairs {
        if let Some(building) = &mut building {
            building.row("(c)", building.chairs(count, true), &args)?;
        }
    }
    Ok(())
}

struct Building {
    plan: Plan,
    world: World,
    /// Of the rooms, in metres, floors and all.
    rooms: Vec<Aabb>,
}

/// What was measured of one way.
struct Cost {
    ms: f64,
    /// Movers that were drawn, and whose place was worked out, in a picture.
    drawn: f64,
    placed: f64,
    pictures: Vec<Vec<u32>>,
}

impl Building {
    fn new(rooms: usize, voxel: f32) -> anyhow::Result<Self> {
        let plan = demo_building::plan(rooms, 1);
        let model = glb::read_slice(&demo_building::glb(rooms, 1), None, "generated")?;
        // Nobody asks who sees whom.
        let options =
            compile::Options { voxel: Some(voxel), cell: Some(8.0), ..Default::default() };
        let (world, _) = compile::compile(&model, &options, &|_, _| ControlFlow::Continue(()))?;
        let scale = 1.0 / UNITS_PER_METRE as f32;
        let spaces = plan.spaces.iter().filter(|space| space.kind == SpaceKind::Room);
        let rooms = spaces.map(|space| {
            let floor = plan.floor(space.storey) as f32 * scale;
            let [min, max] = [space.rect.min, space.rect.max]
                .map(|[x, z]| Vec3::new(x as f32 * scale, floor, z as f32 * scale));
            Aabb::new(min, max + Vec3::Y * 2.5)
        });
        let rooms = rooms.collect();
        Ok(Self { plan, world, rooms })
    }

    /// So many chairs, all over the rooms, or over all but the one with the eye.
    fn chairs(&self, count: usize, elsewhere: bool) -> Vec<Mover> {
        let mut random = SmallRng::seed_from_u64(2);
        let first = usize::from(elsewhere && self.rooms.len() > 1);
        (0..count)
            .map(|i| chair(&self.rooms[first + i % (self.rooms.len() - first)], &mut random))
            .collect()
    }

    fn row(&mut self, part: &str, chairs: Vec<Mover>, args: &Args) -> anyhow::Result<()> {
        let count = chairs.len();
        self.world.movers = chairs;
        let alone = self.measure(None, args);
        let costs = WAYS.map(|way| self.measure(Some(way), args));
        for cost in &costs[1..] {
            anyhow::ensure!(cost.pictures == costs[0].pictures, "the pictures are not the same");
        }
        let ratio = |cost: &Cost| cost.ms / alone.ms;
        println!(
            "{part:<4} {:>6} {:>7} {:>9.2} {:>8.2} {:>8.2} {:>8.2} {:>7.2} {:>7.2} {:>7.2} {:>8.1} {:>8.1}",
            self.plan.room_count(),
            count,
            alone.ms,
            costs[0].ms,
            costs[1].ms,
            costs[2].ms,
            ratio(&costs[0]),
            ratio(&costs[1]),
            ratio(&costs[2]),
            costs[2].drawn,
            costs[2].placed,
        );
        Ok(())
    }

    /// Draws from the middle of the first room, all round.
    fn measure(&self, way: Option<Culling>, args: &Args) -> Cost {
        let [width, height] = args.size();
        let mut cost = Cost { ms: f64::INFINITY, drawn: 0.0, placed: 0.0, pictures: Vec::new() };
        let room = &self.rooms[0];
        let mut renderer = Renderer::default();
        for round in 0..args.rounds.max(1) {
            let mut moving = way.map(|way| Moving::new(&self.world, way));
            let (mut frame, mut ms) = (Frame::new(width, height), 0.0);
            for picture in 0..args.pictures {
                let yaw = picture as f32 / args.pictures as f32 * std::f32::consts::TAU;
                let eye = room.centre().with_y(room.min.y + 1.6);
                let camera = Camera { eye, yaw, pitch: -0.1, fov_y: Camera::FOV_Y };
                let start = ProcessTime::now();
                renderer.draw(&self.world.octree, &camera, &mut frame);
                if let Some(moving) = &mut moving {
                    let now = STEP * (picture + 30);
                    moving.draw(&mut frame, &camera, &self.world, None, now);
                }
                // In the first everything is looked at for once.
                if picture > 0 {
                    ms += start.elapsed().as_secs_f64() * 1e3;
                }
                if round == 0 {
                    cost.pictures.push(frame.colour.clone());
                }
                if round == 0 && picture > 0 {
                    let effort = moving.as_ref().map(Moving::effort).unwrap_or_default();
                    cost.drawn += effort.drawn as f64 / f64::from(args.pictures - 1);
                    cost.placed += effort.placed as f64 / f64::from(args.pictures - 1);
                }
            }
            cost.ms = cost.ms.min(ms / f64::from(args.pictures - 1));
        }
        cost
    }
}

/// A chair of six boards that goes to a table in the middle of its room and back.
fn chair(room: &Aabb, random: &mut SmallRng) -> Mover {
    let mut mesh = Mesh::default();
    let legs = [[0.0, 0.0], [0.36, 0.0], [0.0, 0.36], [0.36, 0.36]];
    for [x, z] in legs {
        board(&mut mesh, Vec3::new(x, 0.0, z), Vec3::new(0.04, 0.42, 0.04));
    }
    board(&mut mesh, Vec3::new(0.0, 0.42, 0.0), Vec3::new(0.4, 0.03, 0.4));
    board(&mut mesh, Vec3::new(0.0, 0.45, 0.0), Vec3::new(0.4, 0.45, 0.03));
    let colours = vec![[150, 100, random.random_range(40..90)]; mesh.triangles.len()];
    let (middle, half) = (room.centre().with_y(room.min.y), room.size() * 0.5);
    let angle = random.random_range(0.0..std::f32::consts::TAU);
    let way = Vec3::new(angle.cos(), 0.0, angle.sin());
    let [near, far] = [0.5, 0.75].map(|share| middle + way * half.with_y(0.0) * share);
    let length_s = random.random_range(4.0..9.0);
    let mut joint = Joint::still(DAffine3::from_translation(DVec3::ZERO));
    joint.translation = Track::linear(vec![(0.0, far), (length_s * 0.5, near), (length_s, far)]);
    joint.rotation = Track::constant(Quat::from_rotation_y(-angle));
    let trajectory =
        Trajectory::new(vec![joint], length_s, Course::Loop).expect("a trajectory of sane keys");
    Mover::new("chair".to_owned(), mesh, colours, trajectory).expect("a mover with triangles")
}

fn board(mesh: &mut Mesh, from: Vec3, size: Vec3) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(Aabb::new(from, from + size).corners());
    for side in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    {
        let [a, b, c, d] = side.map(|corner: u32| first + corner);
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
}
