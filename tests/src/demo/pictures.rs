//! What a person without a display gets to see: a view through the eyes of their own client, and a
//! plan that shows all visitors, and which of them the client was told of.

use std::{
    fs,
    path::Path,
    sync::atomic::Ordering::Relaxed,
    thread,
    time::{Duration, Instant},
};

use anyhow::Context;
use sightline_cli::progress::Progress;
use sightline_client::net::Session;
use sightline_client_core::replica::VisibleAvatar;
use sightline_compiler::plan::{self, Mark, Overlay};
use sightline_picture::Picture;
use sightline_renderer::{
    Camera, Frame, Renderer,
    avatars::{self, AvatarFigure},
    movers,
};
use sightline_world::{World, motion::Pose};

use super::{summary::FrameRate, visitors::Visitors};

/// Columns and rows of the view.
const SIZE: (usize, usize) = (960, 540);
/// Frames drawn to measure the frame rate.
const TIMED_FRAMES: usize = 60;
/// The time between two moments that are compared.
const MOMENT_INTERVAL: Duration = Duration::from_millis(200);
/// The share of the walk before which visitors still stand where they came in.
const SETTLED: f32 = 0.3;

/// The moment of a walk that is worth a picture.
pub(super) struct PictureWatch {
    /// Your pose in the pictures.
    pose: Pose,
    best: Option<PictureMoment>,
}

impl PictureWatch {
    /// Waits until the visitors are done, and keeps the moment at which most of them were in view.
    pub(super) fn new(
        you: &Session,
        visitors: &Visitors,
        world: &World,
        duration: Duration,
    ) -> Self {
        let progress = Progress::new();
        let start = Instant::now();
        let pose = best_view(you, world);
        let mut best: Option<PictureMoment> = None;
        while !visitors.is_over().load(Relaxed) {
            thread::sleep(MOMENT_INTERVAL);
            let share = start.elapsed().as_secs_f32() / duration.as_secs_f32();
            progress.show("walking", share);
            let moment = PictureMoment::now(you, visitors, pose);
            let is_settled = share > SETTLED || best.is_none();
            if is_settled && best.as_ref().is_none_or(|b| moment.in_front() >= b.in_front()) {
                best = Some(moment);
            }
        }
        progress.finish();
        Self { pose, best }
    }

    /// Writes the pictures into a folder, and measures the frame rate.
    ///
    /// # Errors
    /// When a picture cannot be written.
    pub(super) fn finish(self, world: &World, folder: &Path) -> anyhow::Result<FrameRate> {
        let frames = time_frames(world, &self.pose);
        if let Some(moment) = self.best {
            fs::create_dir_all(folder)
                .with_context(|| format!("cannot create {}", folder.display()))?;
            let (view, plan) = rayon::join(|| moment.view(world), || moment.plan(world));
            save(&view, folder, "view.png")?;
            save(&plan, folder, "plan.png")?;
        }
        Ok(frames)
    }
}

fn save(picture: &Picture, folder: &Path, name: &str) -> anyhow::Result<()> {
    let path = folder.join(name);
    picture.save(&path).with_context(|| format!("cannot write {}", path.display()))?;
    println!("picture: {}", path.display());
    Ok(())
}

/// Your place, facing the direction with the greatest mean depth. Sky has a depth of zero here.
fn best_view(you: &Session, world: &World) -> Pose {
    let mut renderer = Renderer::default();
    let mut frame = Frame::new(96, 54);
    let openness = |pose: &Pose, renderer: &mut Renderer, frame: &mut Frame| {
        renderer.draw(&world.octree, &Camera::at(pose), frame);
        let far = |&depth: &f32| if depth.is_finite() { f64::from(depth.min(30.0)) } else { 0.0 };
        frame.depth.iter().map(far).sum::<f64>()
    };
    let here = you.pose();
    (0..16)
        .map(|step| Pose { yaw: step as f32 * std::f32::consts::TAU / 16.0, ..here })
        .map(|pose| (openness(&pose, &mut renderer, &mut frame), pose))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(here, |(_, pose)| pose)
}

/// Draws one turn on the spot, and measures it by the clock.
fn time_frames(world: &World, pose: &Pose) -> FrameRate {
    let mut renderer = Renderer::default();
    let mut frame = Frame::new(SIZE.0, SIZE.1);
    let start = Instant::now();
    for step in 0..TIMED_FRAMES {
        let turn = step as f32 * std::f32::consts::TAU / TIMED_FRAMES as f32;
        let camera = Camera::at(&Pose { yaw: pose.yaw + turn, ..*pose });
        renderer.draw(&world.octree, &camera, &mut frame);
    }
    let seconds = start.elapsed().as_secs_f64();
    FrameRate {
        per_s: TIMED_FRAMES as f64 / seconds,
        draw_ms: seconds * 1e3 / TIMED_FRAMES as f64,
        size: SIZE,
        note: "without a window, in a turn on the spot",
    }
}

/// What you saw at one moment, and where all visitors truly were.
struct PictureMoment {
    pose: Pose,
    /// On the server's clock.
    time: Duration,
    visible: Vec<VisibleAvatar>,
    /// The avatar number and the true pose of each visitor.
    everybody: Vec<(u32, Pose)>,
}

impl PictureMoment {
    fn now(you: &Session, visitors: &Visitors, pose: Pose) -> Self {
        let snapshots = visitors.snapshots();
        let visitors = snapshots.last().map_or(&[][..], |snapshot| &snapshot.visitors);
        let everybody = visitors.iter().map(|v| (v.avatar.0, v.pose)).collect();
        Self { pose, time: you.server_time(), visible: you.visible(), everybody }
    }

    /// The number of avatars within the view's angle, near enough to be recognised.
    fn in_front(&self) -> usize {
        let is_near = |to: glam::Vec3| {
            let along = to.dot(self.pose.forward());
            along > 1.5 && along < 20.0 && along > 0.75 * to.length()
        };
        self.visible.iter().filter(|avatar| is_near(avatar.pose.eye - self.pose.eye)).count()
    }

    fn view(&self, world: &World) -> Picture {
        let camera = Camera::at(&self.pose);
        let mut frame = Frame::new(SIZE.0, SIZE.1);
        Renderer::default().draw(&world.octree, &camera, &mut frame);
        movers::draw(&mut frame, &camera, &world.movers, self.time);
        let figures: Vec<AvatarFigure> = self
            .visible
            .iter()
            .map(|avatar| AvatarFigure {
                pose: avatar.pose,
                body: world.body,
                colour: avatar.colour,
                name: &avatar.name,
            })
            .collect();
        avatars::draw(&mut frame, &camera, &figures);
        Picture::from_fn(SIZE.0 as u32, SIZE.1 as u32, |x, y| {
            let [_, r, g, b] = frame.colour[y as usize * SIZE.0 + x as usize].to_be_bytes();
            [r, g, b]
        })
    }

    /// The plan. Avatars that you were told of are discs, all others are rings. Cells that you may
    /// see are bright.
    fn plan(&self, world: &World) -> Picture {
        let told = |id: u32| self.visible.iter().find(|avatar| avatar.id.0 == id);
        let mut marks: Vec<Mark> = self
            .everybody
            .iter()
            .map(|&(id, pose)| Mark {
                eye: pose.eye,
                forward: None,
                colour: told(id).map_or([245, 245, 245], |avatar| avatar.colour),
                filled: told(id).is_some(),
            })
            .collect();
        marks.push(Mark {
            eye: self.pose.eye,
            forward: Some(self.pose.forward()),
            colour: [230, 30, 30],
            filled: true,
        });
        let visible = Some(world.cells.visible_from_point(self.pose.eye));
        plan::draw(world, &Overlay { marks, visible, ..Overlay::default() })
    }
}
