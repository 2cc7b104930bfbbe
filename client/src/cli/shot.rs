//! `sightline-client shot`.

use std::{
    path::PathBuf,
    time::{Duration, Instant},
};

use anyhow::{Context, bail, ensure};
use glam::Vec3;
use sightline_client::render::{Camera, Frame, Renderer, SIDE_MAX, movers};
use sightline_shared::{motion::Pose, world::World};

/// Draws a view of a world as a PNG.
#[derive(clap::Args)]
pub struct Args {
    /// The world (.slw).
    world: PathBuf,
    /// Where the eye is, in metres; a spawn point when absent.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    eye: Option<Vec3>,
    /// A point to look at, in metres; straight ahead when absent.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    look: Option<Vec3>,
    /// Which spawn point to stand at, from 0.
    #[arg(long, value_name = "N", default_value_t = 0, conflicts_with = "eye")]
    spawn: usize,
    /// The picture's size in pixels.
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "960x540")]
    size: (usize, usize),
    /// The angle between the lowest and the highest line of sight, in degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = Camera::FOV_Y.to_degrees())]
    fov: f32,
    /// When: seconds on the server's clock, by which doors and lifts move.
    #[arg(long, value_name = "S", value_parser = parse_time, default_value = "0")]
    time: Duration,
    /// The picture to write.
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<()> {
    ensure!((1.0..=170.0).contains(&args.fov), "--fov must be between 1 and 170 degrees");
    let world = World::read(&args.world)?;
    let camera = Camera { fov_y: args.fov.to_radians(), ..camera(args, &world)? };
    let (width, height) = args.size;
    let mut frame = Frame::new(width, height);
    let start = Instant::now();
    Renderer::default().draw(&world.octree, &camera, &mut frame);
    movers::draw(&mut frame, &camera, &world.movers, args.time);
    let milliseconds = start.elapsed().as_secs_f64() * 1.0e3;
    let bytes = frame.colour.iter().flat_map(|pixel| pixel.to_be_bytes().into_iter().skip(1));
    let image = image::RgbImage::from_raw(width as u32, height as u32, bytes.collect())
        .context("the picture has no size")?;
    image.save(&args.output).with_context(|| format!("cannot write {}", args.output.display()))?;
    let output = args.output.display();
    super::print(&format!("{output}: {width} × {height}, drawn in {milliseconds:.1} ms\n"))
}

fn camera(args: &Args, world: &World) -> anyhow::Result<Camera> {
    let (eye, yaw) = match args.eye {
        Some(eye) => (eye, 0.0),
        None => {
            let Some(spawn) = world.spawns.get(args.spawn) else {
                let last = world.spawns.len().saturating_sub(1);
                bail!("there is no spawn point {}: they go from 0 to {last}", args.spawn);
            };
            (spawn.eye, spawn.yaw)
        }
    };
    Ok(match args.look {
        Some(target) => Camera::looking_at(eye, target),
        None => Camera::at(&Pose { eye, yaw, ..Pose::default() }),
    })
}

fn parse_point(text: &str) -> Result<Vec3, String> {
    let numbers: Option<Vec<f32>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|x: &f32| x.is_finite()))
        .collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Vec3::new(x, y, z)),
        _ => Err("a point is three numbers, as in 1.5,1.6,-2".into()),
    }
}

fn parse_time(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    seconds.ok_or_else(|| "a time is a number of seconds, as in 12.5".into())
}

fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let fits = |&(w, h): &(usize, usize)| [w, h].iter().all(|s| (1..=SIDE_MAX).contains(s));
    sides.filter(fits).ok_or_else(|| format!("a size is like 960x540, at most {SIDE_MAX} each"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_sizes_are_read() {
        assert_eq!(parse_point("1,-2.5, 3"), Ok(Vec3::new(1.0, -2.5, 3.0)));
        for wrong in ["", "1,2", "1,2,3,4", "a,b,c", "1,2,nan", "1,2,inf"] {
            assert!(parse_point(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_time("1.5"), Ok(Duration::from_millis(1_500)));
        for wrong in ["", "a", "-1", "nan", "inf", "1e300"] {
            assert!(parse_time(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_size("640x360"), Ok((640, 360)));
        for wrong in ["", "640", "0x9", "9x0", "-1x5", "99999x2", "2x99999"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
    }
}
