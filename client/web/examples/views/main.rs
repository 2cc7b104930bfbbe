//! What a picture costs in a browser's program and on the machine itself: the same client draws the
//! same views in both.
//!
//! ```text
//! cargo run --release -p sightline-web --example views -- house.slw [client/web/dist]
//! ```
//!
//! It needs `node`, whose WebAssembly is Chrome's. Times are CPU time, so other programs disturb
//! them little.

use std::{
    env, fs,
    num::NonZeroU32,
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

use cpu_time::ThreadTime;
use sightline_protocol::{frame, message::ServerMessage};
use sightline_web::Client;
use sightline_world::{
    World, content_id,
    motion::{AvatarId, Pose},
};

/// The size of the pictures.
const SIZE: [usize; 2] = [960, 540];
/// The number of views: the eye turns once.
const VIEWS: usize = 24;
/// How often each is drawn. The least time counts.
const REPEATS: usize = 5;

fn main() -> ExitCode {
    let mut arguments = env::args().skip(1);
    let Some(path) = arguments.next() else {
        eprintln!("usage: views WORLD.slw [FOLDER OF THE COMPILED CLIENT]");
        return ExitCode::FAILURE;
    };
    let page = arguments.next().unwrap_or_else(|| "client/web/dist".to_owned());
    match measure(Path::new(&path), Path::new(&page)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn measure(path: &Path, page: &Path) -> Result<(), String> {
    let file =
        fs::read(path).map_err(|error| format!("cannot read {}: {error}", path.display()))?;
    let messages = messages(&file)?;
    let native = median(drawn(&file, &messages));
    let said = env::temp_dir().join(format!("views-{}.bin", std::process::id()));
    fs::write(&said, messages.concat()).map_err(|error| error.to_string())?;
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("examples/views/views.mjs");
    let output = Command::new("node")
        .arg(script)
        .args([page, path, &said])
        .args([SIZE[0], SIZE[1], VIEWS, REPEATS].map(|number| number.to_string()))
        .output();
    let _ = fs::remove_file(&said);
    let output = output.map_err(|error| format!("cannot run node: {error}"))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let numbers = printed.split_whitespace().filter_map(|word| word.parse().ok());
    let web = median(numbers.collect());
    let [columns, rows] = SIZE;
    println!("a picture of {columns} × {rows}, the median of {VIEWS} views:");
    println!("native {native:.2} ms, WebAssembly {web:.2} ms, ratio {:.2}", web / native);
    Ok(())
}

/// What a server says until a client is in the world, as two pieces: before and after the client
/// gets the world.
fn messages(file: &[u8]) -> Result<[Vec<u8>; 2], String> {
    let world = World::from_bytes(file).map_err(|error| error.to_string())?;
    let id = content_id(file).map_err(|error| error.to_string())?.0;
    let spawn = world.spawns[0];
    let pose = Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() };
    let tick_interval_us = NonZeroU32::new(50_000).ok_or("a tick takes time")?;
    let welcome = ServerMessage::Welcome { avatar: AvatarId(1), tick_interval_us };
    let offer = ServerMessage::World { number: 1, id, bytes: file.len() as u64, head: None };
    let entered = ServerMessage::Entered { pose: (&pose).into(), tick: 1 };
    let first = [frame::encode(&welcome), frame::encode(&offer)].concat();
    // The script must know where the first piece ends.
    let length = (first.len() as u32).to_le_bytes().to_vec();
    Ok([[length, first].concat(), frame::encode(&entered)])
}

/// The time for each view, in milliseconds.
fn drawn(file: &[u8], [first, second]: &[Vec<u8>; 2]) -> Vec<f64> {
    let Ok(mut client) = Client::new("Ada", 0, &[0; 32], "") else { return Vec::new() };
    client.opened(0.0);
    client.control(1.0, &first[4..]);
    client.give(file);
    client.control(2.0, second);
    let (turn, mut now) = (std::f32::consts::TAU / VIEWS as f32, 3.0);
    let view = |_| {
        client.turn(turn, 0.0);
        let repeat = |_| {
            // Another picture must come between, or nothing would be drawn anew.
            client.draw(now, 16, 9);
            now += 1.0;
            client.step(now, 0.0, 0.0, 0.0, false, false);
            let start = ThreadTime::now();
            client.draw(now, SIZE[0], SIZE[1]);
            start.elapsed().as_secs_f64() * 1e3
        };
        (0..REPEATS).map(repeat).fold(f64::INFINITY, f64::min)
    };
    (0..VIEWS).map(view).collect()
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}
