//! The building as one sees it.

use std::{collections::VecDeque, sync::Arc, time::Duration};

use glam::Vec3;
use serde::Serialize;
use sightline_client_core::{
    arriving::ArrivingWorld,
    fetching::{Outlook, PieceError, ShownBranch},
    replica::{AvatarSource, Replica, ShownAvatar},
};
use sightline_renderer::{
    Camera, Frame, Renderer,
    moving::{Culling, InView, MovingRenderer},
    streaming::shown_branches,
};
use sightline_visibility::rooms::{BuildingSight, RoomIndex};
use sightline_world::{
    PieceId, World,
    motion::Pose,
    plan::{Plan, PlanSketch},
    rooms::{Room, RoomId},
};

use crate::walk::Walk;

/// A view that has not changed for this long is drawn with more pixels.
const RESTS: Duration = Duration::from_millis(400);
/// The least horizontal field of view, in radians: on an upright screen the vertical one grows.
const FOV_X_MIN: f32 = 0.95;

/// The most bytes of pieces that are taken in at a time, or one piece: taking them in holds
/// pictures up.
const TAKEN_BYTES: usize = 24 * 1_024;
/// The most pieces of a request.
const REQUEST_MAX: usize = 256;
/// While the eye moves, one pixel of this number, in one row of this number, tells what a picture
/// shows.
const LOOK_STEP: usize = 4;
/// The picture where too little of the building is here.
const NOTHING: u32 = 0x0038_4450;

/// What came of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// The body moved, or stands.
    Moved,
    /// It is stuck.
    Stuck,
    /// No way leads to where it was to go.
    NoWay,
}

/// The building as one sees it.
pub(crate) struct Scene {
    pub(crate) walk: Walk,
    building: ArrivingWorld,
    /// The content id of its head, where it comes in pieces.
    pub(crate) head: Option<PieceId>,
    rooms: RoomIndex,
    moving: MovingRenderer,
    renderer: Renderer,
    /// The building alone.
    bare: Frame,
    /// The building, and what moves in it.
    inhabited: Frame,
    /// Red, green, blue and 255 for each pixel.
    pixels: Vec<[u8; 4]>,
    /// Whether what rooms hide from the eye is drawn, too.
    with_hidden: bool,
    shown: Option<ShownView>,
    /// What the picture shows that moves.
    in_view: Option<InView>,
    /// The camera and how many pieces were taken in, and since when it has been those.
    view: ((Camera, u64), Duration),
    seen: Vec<ShownAvatar>,
    plan: Option<Arc<Plan>>,
    sketch: Option<PlanSketch>,
    /// Pieces that have come and are not taken in yet.
    arrived: VecDeque<(usize, Vec<u8>)>,
    /// The branches that the last picture shows, and how closely it was looked at.
    branches: (Vec<ShownBranch>, usize),
    /// The columns and rows of a picture at rest.
    full_size: (usize, usize),
    /// Whether the plan of the storey is wanted.
    wants_plan: bool,
    /// Whether all of the building is wanted, and not only what is seen.
    wants_all: bool,
    /// Where the body is to go once all of the building is here.
    goal: Option<Vec3>,
}

/// What the picture of the building shows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ShownView {
    camera: Camera,
    /// Columns and rows.
    size: (usize, usize),
    /// Whether with what rooms hide.
    with_hidden: bool,
    /// How many pieces of the building were taken in; `None` when too few for a picture.
    pieces: Option<u64>,
}

/// A room, as a page lists it.
#[derive(Debug, Serialize)]
pub(crate) struct ListedRoom {
    title: String,
    /// The middle of its floor, in metres.
    at: [f32; 3],
}

/// Where a plan is.
#[derive(Debug, Serialize)]
pub(crate) struct PlanPlace {
    columns: usize,
    rows: usize,
    /// The world's x and z at the upper left corner, in metres.
    x: f32,
    z: f32,
    /// The length that a pixel spans, in metres.
    metres: f32,
}

impl Scene {
    pub(crate) fn new(building: ArrivingWorld, head: Option<PieceId>, pose: Pose) -> Self {
        let world = building.world();
        Self {
            head,
            walk: Walk::new(world, pose),
            rooms: RoomIndex::new(world),
            moving: MovingRenderer::new(world, Culling::default()),
            renderer: Renderer::default(),
            bare: Frame::default(),
            inhabited: Frame::default(),
            pixels: Vec::new(),
            with_hidden: false,
            shown: None,
            in_view: None,
            view: ((Camera::at(&pose), 0), Duration::ZERO),
            seen: Vec::new(),
            plan: None,
            sketch: None,
            arrived: VecDeque::new(),
            branches: (Vec::new(), usize::MAX),
            full_size: (0, 0),
            wants_plan: false,
            wants_all: false,
            goal: None,
            building,
        }
    }

    /// Whether this is the scene of a world.
    pub(crate) fn is_in(&self, world: &Arc<World>) -> bool {
        self.building.is(world)
    }

    /// The share of the building that is here, from 0 to 1.
    pub(crate) fn share(&self) -> f32 {
        self.building.share()
    }

    /// Whether there is enough of the building for a picture from where the eye is.
    pub(crate) fn is_open(&self) -> bool {
        self.building.is_open_at(self.walk.pose().eye)
    }

    /// Takes in how large a picture at rest is.
    pub(crate) fn set_full_size(&mut self, size: (usize, usize)) {
        self.full_size = size;
    }

    /// Moves the body on to a moment. It waits where the building is not here.
    pub(crate) fn step(
        &mut self,
        now: Duration,
        ways: [f32; 3],
        jump: bool,
        fly: bool,
        stands: bool,
    ) -> Step {
        if let Some(goal) = self.goal
            && let Some(world) = self.building.complete()
        {
            self.goal = None;
            if !self.walk.go_to(world, goal) {
                return Step::NoWay;
            }
        }
        match self.walk.step(&self.building, now, ways, jump, fly, stands) {
            true => Step::Stuck,
            false => Step::Moved,
        }
    }

    /// Begins to walk to the floor at a point, or near it, as soon as all of the building is here.
    /// Returns whether a way leads there, as far as that is known.
    pub(crate) fn go_to(&mut self, floor: Vec3) -> bool {
        match self.building.complete() {
            Some(world) => self.walk.go_to(world, floor),
            None => {
                (self.goal, self.wants_all) = (Some(floor), true);
                true
            }
        }
    }

    /// Stops walking to a place.
    pub(crate) fn stop(&mut self) {
        self.goal = None;
        self.walk.stop();
    }

    /// The numbers of the pieces to fetch now. With those that are under way they take at most
    /// `bytes_max` bytes, or are one.
    pub(crate) fn next_pieces(&mut self, bytes_max: usize) -> Vec<usize> {
        let pose = self.walk.pose();
        let size = if self.full_size.1 > 0 { self.full_size } else { return Vec::new() };
        let outlook = Outlook {
            eye: pose.eye,
            velocity: pose.velocity,
            focal: camera(&pose, size).focal(size.1),
            shown: &self.branches.0,
            plan: self.wants_plan,
            all: self.wants_all,
        };
        let mut next = self.building.next(&outlook, bytes_max);
        if next.len() > REQUEST_MAX {
            let rest = next.split_off(REQUEST_MAX);
            self.building.forget(&rest);
        }
        next
    }

    /// Gives pieces, one after the other, but for those that the server refused; nothing when they
    /// could not be had.
    ///
    /// # Errors
    /// When they are not the pieces of these numbers.
    pub(crate) fn give_pieces(
        &mut self,
        numbers: &[usize],
        bytes: Option<&[u8]>,
        refused: &[usize],
    ) -> Result<(), PieceError> {
        self.building.refuse(refused);
        let (Some(mut rest), Some(fetcher)) = (bytes, self.building.fetcher()) else {
            self.building.forget(numbers);
            return Ok(());
        };
        for &number in numbers.iter().filter(|number| !refused.contains(number)) {
            let (_, length) = fetcher.piece(number).ok_or(PieceError::Unknown)?;
            let piece = rest.split_off(..length as usize).ok_or(PieceError::Damaged)?;
            self.arrived.push_back((number, piece.to_vec()));
        }
        if rest.is_empty() { Ok(()) } else { Err(PieceError::Damaged) }
    }

    /// Takes in some of the pieces that have come.
    ///
    /// # Errors
    /// When one is malformed.
    pub(crate) fn take_pieces(&mut self) -> Result<(), PieceError> {
        let mut bytes = 0;
        while bytes < TAKEN_BYTES
            && let Some((number, piece)) = self.arrived.pop_front()
        {
            bytes += piece.len();
            self.building.take(number, piece)?;
        }
        Ok(())
    }

    /// The avatars of which at least one pixel is shown.
    pub(crate) fn seen(&self) -> &[ShownAvatar] {
        &self.seen
    }

    /// The title of the building, and of the room that one is in, if any.
    pub(crate) fn place(&self) -> (&str, Option<&str>) {
        let room = self.rooms.room_at(self.walk.pose().eye);
        let world = self.building.world();
        let room = room.and_then(|room| world.rooms.get(room));
        (&world.title, room.map(|room| room.title()))
    }

    pub(crate) fn rooms(&self) -> Vec<ListedRoom> {
        let listed = |(id, room): (u16, &Room)| {
            let bounds = self.rooms.bounds(RoomId(id));
            let at = bounds.centre().with_y(bounds.min.y).to_array();
            ListedRoom { title: room.title().to_owned(), at }
        };
        (0..).zip(self.building.world().rooms.list()).map(listed).collect()
    }

    /// Draws what rooms hide from the eye from now on, or leaves it out again. Returns false where
    /// there are no rooms.
    pub(crate) fn toggle_hidden(&mut self) -> bool {
        self.with_hidden ^= true;
        !self.rooms.is_empty()
    }

    /// The height of the soles, in metres.
    pub(crate) fn soles(&self) -> f32 {
        self.walk.pose().eye.y - self.building.world().body.below_eye
    }

    /// Whether the view has been the same for a while.
    pub(crate) fn rests(&self, now: Duration) -> bool {
        now.saturating_sub(self.view.1) >= RESTS
    }

    /// Draws what one sees, if it looks otherwise than before. Returns whether it does.
    pub(crate) fn draw(
        &mut self,
        replica: Option<&mut Replica>,
        now: Duration,
        size: (usize, usize),
    ) -> bool {
        let camera = camera(&self.walk.pose(), size);
        let taken = self.building.taken();
        if (camera, taken) != self.view.0 {
            self.view = ((camera, taken), now);
        }
        let pieces = self.building.is_open_at(camera.eye).then_some(taken);
        let view = ShownView { camera, size, with_hidden: self.with_hidden, pieces };
        let is_changed = self.shown != Some(view);
        self.shown = Some(view);
        if pieces.is_none() {
            return self.show_nothing(size, is_changed);
        }
        let world = self.building.world();
        if is_changed {
            let sight = || BuildingSight::of(world, &self.rooms, camera.eye);
            self.renderer.building_sight = if self.with_hidden { None } else { sight() };
            self.bare.resize(size.0, size.1);
            self.renderer.draw(self.building.octree(), &camera, &mut self.bare);
        }
        let step = if self.rests(now) { 1 } else { LOOK_STEP };
        if let Some(fetcher) = self.building.fetcher()
            && (is_changed || step < self.branches.1)
        {
            let shown = shown_branches(&self.bare, &camera, fetcher.octree(), step);
            self.branches = (shown, step);
        }
        let time = replica.as_ref().map_or(now, |replica| replica.server_time(now));
        let source = replica.map(|replica| replica as &mut dyn AvatarSource);
        let mut in_view = self.moving.find(&self.bare, &camera, world, source, time);
        if let Some(sight) = &self.renderer.building_sight {
            in_view.leave_out_hidden(sight, world);
        }
        let is_same = self.in_view.as_ref().is_some_and(|shown| shown.looks_like(&in_view));
        if is_same && !is_changed {
            return false;
        }
        self.inhabited.copy_from(&self.bare);
        self.seen = in_view.draw(&mut self.inhabited, &camera, world, self.building.octree());
        self.in_view = Some(in_view);
        self.show();
        true
    }

    /// Makes the pixels of the picture.
    fn show(&mut self) {
        self.pixels.clear();
        self.pixels.extend(self.inhabited.colour.iter().map(|colour| {
            let [_, red, green, blue] = colour.to_be_bytes();
            [red, green, blue, 255]
        }));
    }

    /// Shows an empty picture, if it is another one than before. Returns whether it is.
    fn show_nothing(&mut self, size: (usize, usize), is_changed: bool) -> bool {
        self.branches.0.clear();
        self.seen.clear();
        self.in_view = None;
        if is_changed {
            self.inhabited = Frame::new(size.0, size.1);
            self.inhabited.colour.fill(NOTHING);
            self.show();
        }
        is_changed
    }

    /// The picture: red, green, blue and 255 for each pixel.
    pub(crate) fn pixels(&self) -> &[[u8; 4]] {
        &self.pixels
    }

    /// Takes the plan of the storey that one is on, if it has come as a piece, or goes on making it
    /// from a whole building. Returns whether there is another one now.
    pub(crate) fn make_plan(&mut self, rows: usize) -> bool {
        self.wants_plan = true;
        let soles = self.soles();
        let is_served = self.plan.as_ref().is_some_and(|plan| plan.serves(soles));
        if !is_served && let Some(plan) = self.building.plan_at(soles) {
            self.plan = Some(plan.clone());
            return true;
        }
        let Some(world) = self.building.complete() else { return false };
        if self.sketch.is_none() && !is_served {
            self.sketch = Some(PlanSketch::new(world, soles));
        }
        let Some(sketch) = &mut self.sketch else { return false };
        let Some(plan) = sketch.go_on(world, rows) else { return false };
        (self.plan, self.sketch) = (Some(Arc::new(plan)), None);
        true
    }

    pub(crate) fn makes_plan(&self) -> bool {
        self.sketch.is_some()
    }

    pub(crate) fn plan_place(&self) -> Option<PlanPlace> {
        let plan = self.plan.as_ref()?;
        let ([columns, rows], corner) = (plan.size(), plan.corner());
        Some(PlanPlace { columns, rows, x: corner.x, z: corner.y, metres: plan.metres() })
    }

    pub(crate) fn plan_pixels(&self) -> Vec<u8> {
        let pixels = self.plan.iter().flat_map(|plan| plan.pixels());
        let bytes = |pixel: &Option<u32>| match pixel.map(u32::to_be_bytes) {
            Some([_, red, green, blue]) => [red, green, blue, 255],
            None => [0; 4],
        };
        pixels.flat_map(bytes).collect()
    }
}

/// The camera of an eye for a picture of some columns and rows.
fn camera(pose: &Pose, (columns, rows): (usize, usize)) -> Camera {
    let upright = rows as f32 / columns.max(1) as f32;
    let least = 2.0 * ((FOV_X_MIN * 0.5).tan() * upright).atan();
    Camera { fov_y: Camera::FOV_Y.max(least), ..Camera::at(pose) }
}

#[cfg(test)]
mod tests;
