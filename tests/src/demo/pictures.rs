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
use glam::Vec3;
use sightline_cli::progress::Progress;
use sightline_client::net::Session;
use sightline_client_core::replica::ShownAvatar;
use sightline_compiler::plan::{self, Mark, Overlay};
use sightline_oracle::Oracle;
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
/// The number of directions to look in.
const DIRECTIONS: usize = 16;
/// A direction with less than this share of the greatest mean depth is not looked in: a wall is
/// near.
const OPEN_SHARE: f64 = 0.6;
/// The cosine of the angle from the middle within which somebody is in the picture.
const IN_PICTURE: f32 = 0.75;
/// People nearer than this hide the picture, and people beyond cannot be recognised. In metres.
const DISTANCE: std::ops::Range<f32> = 2.5..25.0;
/// What somebody too near takes from a view.
const TOO_NEAR: f32 = -1.0;
/// People nearer than this count as if they were here: two of them are better than one close by.
const NEAR_M: f32 = 8.0;

/// The moment of a walk that is worth a picture.
pub(super) struct PictureWatch {
    /// Where you stand.
    you: Pose,
    best: Option<PictureMoment>,
}

impl PictureWatch {
    /// Waits until the visitors are done, and keeps the moment and the direction in which they
    /// filled most of the view.
    pub(super) fn new(
        you: &Session,
        visitors: &Visitors,
        world: &World,
        duration: Duration,
    ) -> Self {
        let progress = Progress::new();
        let start = Instant::now();
        let (oracle, views) = (Oracle::new(&world.mesh), open_views(you.pose(), world));
        let mut best: Option<(f32, PictureMoment)> = None;
        while !visitors.is_over().load(Relaxed) {
            thread::sleep(MOMENT_INTERVAL);
            let share = start.elapsed().as_secs_f32() / duration.as_secs_f32();
            progress.show("walking", share);
            if share < SETTLED && best.is_some() {
                continue;
            }
            let moment = PictureMoment::now(you, visitors);
            let (filled, pose) = moment.best_view(&views, &oracle);
            if best.as_ref().is_none_or(|(most, _)| filled >= *most) {
                best = Some((filled, PictureMoment { pose, ..moment }));
            }
        }
        progress.finish();
        Self { you: you.pose(), best: best.map(|(_, moment)| moment) }
    }

    /// Writes the pictures into a folder, and measures the frame rate.
    ///
    /// # Errors
    /// When a picture cannot be written.
    pub(super) fn finish(self, world: &World, folder: &Path) -> anyhow::Result<FrameRate> {
        let frames = time_frames(world, &self.you);
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

/// The directions in which no wall is near: from the greatest mean depth to the least. Sky has a
/// depth of zero here.
fn open_views(here: Pose, world: &World) -> Vec<Pose> {
    let mut renderer = Renderer::default();
    let mut frame = Frame::new(96, 54);
    let turn = |step: usize| step as f32 * std::f32::consts::TAU / DIRECTIONS as f32;
    let mut views: Vec<(f64, Pose)> = (0..DIRECTIONS)
        .map(|step| Pose { yaw: turn(step), ..here })
        .map(|pose| {
            renderer.draw(&world.octree, &Camera::at(&pose), &mut frame);
            let far =
                |&depth: &f32| if depth.is_finite() { f64::from(depth.min(30.0)) } else { 0.0 };
            (frame.depth.iter().map(far).sum(), pose)
        })
        .collect();
    views.sort_by(|a, b| b.0.total_cmp(&a.0));
    let least = views.first().map_or(0.0, |(most, _)| OPEN_SHARE * most);
    views.into_iter().filter(|(depth, _)| *depth >= least).map(|(_, pose)| pose).collect()
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
    /// Where you look from, and in which direction.
    pose: Pose,
    /// On the server's clock.
    time: Duration,
    visible: Vec<ShownAvatar>,
    /// The avatar number and the true pose of each visitor.
    everybody: Vec<(u32, Pose)>,
}

impl PictureMoment {
    fn now(you: &Session, visitors: &Visitors) -> Self {
        let snapshots = visitors.snapshots();
        let visitors = snapshots.last().map_or(&[][..], |snapshot| &snapshot.visitors);
        let everybody = visitors.iter().map(|v| (v.avatar.0, v.pose)).collect();
        let (pose, time, visible) = (you.pose(), you.server_time(), you.shown_avatars());
        Self { pose, time, visible, everybody }
    }

    /// The view in which people in sight fill most, and how much that is: a person fills less by
    /// the square of the distance.
    fn best_view(&self, views: &[Pose], oracle: &Oracle) -> (f32, Pose) {
        let here = self.pose.eye;
        let eyes = self.visible.iter().map(|avatar| avatar.pose.eye);
        let seen: Vec<Vec3> = eyes.filter(|eye| oracle.between(here, *eye)).collect();
        let filled = |view: &Pose| {
            let people = seen.iter().map(|eye| eye - here).map(|way| {
                let is_ahead = way.normalize_or_zero().dot(view.forward()) > IN_PICTURE;
                match way.length() {
                    distance if !is_ahead || distance > DISTANCE.end => 0.0,
                    distance if distance < DISTANCE.start => TOO_NEAR,
                    distance => distance.max(NEAR_M).powi(-2),
                }
            });
            people.sum::<f32>()
        };
        // Of equals the last one counts: the most open view.
        let rated = views.iter().rev().map(|view| (filled(view), *view));
        rated.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, self.pose))
    }

    fn view(&self, world: &World) -> Picture {
        let camera = Camera::at(&self.pose);
        let mut frame = Frame::new(SIZE.0, SIZE.1);
        Renderer::default().draw(&world.octree, &camera, &mut frame);
        movers::draw(&mut frame, &camera, world, self.time);
        let figures: Vec<AvatarFigure> = self
            .visible
            .iter()
            .map(|avatar| AvatarFigure {
                pose: avatar.pose,
                body: world.body,
                colour: avatar.colour,
                name: &avatar.name,
                stride: 0.0,
                light: world.light_at(world.body.middle(avatar.pose.eye)),
            })
            .collect();
        avatars::draw(&mut frame, &camera, &world.octree, &figures);
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
                number: None,
            })
            .collect();
        marks.push(Mark {
            eye: self.pose.eye,
            forward: Some(self.pose.forward()),
            colour: [230, 30, 30],
            filled: true,
            number: None,
        });
        let visible = Some(world.cells.visible_from_point(self.pose.eye));
        plan::draw(world, &Overlay { marks, visible, ..Overlay::default() })
    }
}
