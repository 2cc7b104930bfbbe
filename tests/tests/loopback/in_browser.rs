//! The client for browsers, in a browser: it joins, sees and is seen, walks through doors, chats,
//! and comes back after the server was lost.

use std::{net::SocketAddr, path::Path, time::Instant};

use base64::{Engine, prelude::BASE64_STANDARD};
use glam::Vec3;
use serde_json::Value;
use sightline_client::net::Session;
use sightline_renderer::{Camera, Frame, Renderer};
use sightline_server::{net::ServeConfig, web::WebServer};
use sightline_world::World;
use tokio::{runtime::Handle, task::spawn_blocking};

use super::{browser::Browser, building, config, hears, join, until};
use crate::building::WAY;

/// The size of the picture that is compared.
const SIZE: (usize, usize) = (960, 540);
/// The share of its pixels that may differ: both round alike but for the sines of the view.
const DIFFERENT_MAX: f64 = 0.002;
/// The colours of the picture at rest, as base64 of red, green, blue and 255 for each pixel.
const COLOURS: &str = "(() => {
    const { client, memory, view } = sightline;
    view.client = null;
    client.draw(performance.now(), 960, 540);
    const bytes = new Uint8Array(memory.buffer, client.pixels(), 960 * 540 * 4);
    let text = '';
    for (let at = 0; at < bytes.length; at += 8190) {
        text += String.fromCharCode(...bytes.subarray(at, at + 8190));
    }
    view.client = client;
    return btoa(text);
})()";
/// How long a picture of the page's size takes while one turns: the median, in milliseconds.
const DRAWN_MS: &str = "(() => {
    const { client, view } = sightline;
    view.client = null;
    const took = [];
    for (let i = 0; i < 40; i++) {
        client.turn(Math.PI / 20, 0);
        client.step(performance.now(), 0, 0, 0, false, false);
        const start = performance.now();
        client.draw(performance.now(), 960, 540);
        took.push(performance.now() - start);
    }
    view.client = client;
    return took.sort((a, b) => a - b)[20];
})()";

/// A server with a listener for browsers.
fn open(listen: [SocketAddr; 2]) -> Option<(sightline_server::net::Server, WebServer)> {
    let config = ServeConfig { listen: listen[0], pieces_from_bytes: 0, ..config() };
    let identity = sightline_server::net::Identity::generate().unwrap();
    let server = sightline_server::net::Server::bind(building::world(), config, &identity).ok()?;
    let web = WebServer::listen(listen[1], server.web_door().unwrap()).ok()?;
    Some((server, web))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_browser_joins_sees_is_seen_walks_chats_and_comes_back() {
    let any: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let (server, web) = open([any; 2]).unwrap();
    let is_cut = || server.world().is_some_and(|world| world.pieces_bytes().is_some());
    until("the world is cut", is_cut).await;
    let addresses = [server.local_addr().unwrap(), web.local_addr()];
    let bo = join(&server, "Bo", WAY[2]).await;
    let url = format!("http://{}/", addresses[1]);
    let began = Instant::now();
    let opened = spawn_blocking(move || {
        Browser::open(&url).map(|mut page| {
            page.until("globalThis.sightline?.view.hasDrawn === true");
            page
        })
    });
    let Some(mut page) = opened.await.unwrap() else {
        println!("skipped: Chromium is not installed");
        return;
    };
    println!("the first picture after {:.1} s", began.elapsed().as_secs_f64());
    let handle = Handle::current();
    let (bo, page) = spawn_blocking(move || {
        rename(&mut page, "Ada");
        see_the_plan(&mut page);
        walk_and_see(&mut page, &handle, &bo);
        chat(&mut page, &handle, &bo);
        assert!(page.faults.is_empty(), "{:?}", page.faults);
        (bo, page)
    })
    .await
    .unwrap();
    bo.leave().await;
    let world = building::world();
    let mut page = spawn_blocking(move || {
        let mut page = page;
        page.until("sightline.state().people.length === 0");
        page.until("sightline.link.join.head !== null && sightline.client.share() === 1");
        compare(&mut page, world.world());
        page
    })
    .await
    .unwrap();

    drop(web);
    server.shutdown().await;
    let mut page = spawn_blocking(move || {
        page.until("!document.getElementById('notice').hidden");
        page.until("document.getElementById('notice-note').textContent.includes('closing')");
        page
    })
    .await
    .unwrap();
    // The system frees the sockets shortly after the server has gone.
    let mut again = None;
    until("the addresses are free", || {
        again = open(addresses);
        again.is_some()
    })
    .await;
    spawn_blocking(move || {
        page.until("sightline.client.is_in() && sightline.state().returns === 1");
        page.until("document.getElementById('notice').hidden");
    })
    .await
    .unwrap();
}

/// Takes another name in the settings.
fn rename(page: &mut Browser, name: &str) {
    page.until("sightline.client.is_in()");
    page.key("KeyO", "o");
    page.value(&format!("document.getElementById('name').value = {name:?}"));
    page.value("document.querySelector('#panel-settings [type=submit]').click()");
    page.until("sightline.client.is_in() && document.getElementById('panel').hidden");
}

/// The small plan is there before the building is.
fn see_the_plan(page: &mut Browser) {
    page.until("!document.getElementById('plan').hidden && sightline.client.plan() !== ''");
    let share = page.value("sightline.client.share()").as_f64().unwrap();
    println!("the plan is there with {:.1} % of the building", share * 100.0);
    assert!(share < 1.0, "all was fetched for the plan");
}

/// Walks through a door to where Bo stands.
fn walk_and_see(page: &mut Browser, handle: &Handle, bo: &Session) {
    let [_, door, lobby, ..] = WAY;
    let start = eye(page);
    assert!(start.distance(lobby) > 3.0, "{start} is in the lobby");
    let Vec3 { x, z, .. } = lobby;
    assert_eq!(page.value(&format!("sightline.client.go_to({x}, 0, {z})")), Value::Bool(true));
    page.until("sightline.state().people.some(({ name, inSight }) => name === 'Bo' && inSight)");
    page.until("document.getElementById('sight').textContent.includes('Bo')");
    page.until("document.getElementById('around').textContent.includes('Bo')");
    let seen = || bo.shown_avatars().iter().any(|other| other.name == "Ada");
    handle.block_on(until("Bo sees Ada", seen));
    page.until("!sightline.state().onRoute");
    // The keys walk, too.
    let before = eye(page);
    page.hold("KeyS", "s", true);
    page.until("sightline.state().pose[4] === 0");
    std::thread::sleep(std::time::Duration::from_millis(400));
    page.hold("KeyS", "s", false);
    let after = eye(page);
    assert!(before.distance(after) > 0.1, "from {before} to {after}, by the door {door}");
}

/// Each says something to the other.
fn chat(page: &mut Browser, handle: &Handle, bo: &Session) {
    page.key("Enter", "Enter");
    page.text("hello Bo");
    page.key("Enter", "Enter");
    handle.block_on(hears(bo, "Ada", "hello Bo"));
    bo.chat("hello <b>Ada</b>").unwrap();
    page.until("document.getElementById('log').textContent.includes('Bo: hello <b>Ada</b>')");
    page.until("document.getElementById('log').textContent.includes('Ada: hello Bo')");
    page.until("document.getElementById('plan').width > 50");
    page.picture(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("in-browser.png"));
}

/// Compares what the page shows with what the renderer draws here.
fn compare(page: &mut Browser, world: &World) {
    let pose = page.value("sightline.state().pose");
    let colours = page.value(COLOURS);
    let shown = BASE64_STANDARD.decode(colours.as_str().unwrap()).unwrap();
    let number = |i: usize| pose[i].as_f64().unwrap() as f32;
    let eye = Vec3::new(number(0), number(1), number(2));
    let camera = Camera { eye, yaw: number(3), pitch: number(4), fov_y: Camera::FOV_Y };
    let (mut frame, mut renderer) = (Frame::new(SIZE.0, SIZE.1), Renderer::default());
    renderer.draw(&world.octree, &camera, &mut frame);
    let differ = |(own, theirs): (&u32, &[u8])| {
        let [_, red, green, blue] = own.to_be_bytes();
        theirs != [red, green, blue, 255]
    };
    let different = frame.colour.iter().zip(shown.chunks(4)).filter(|&pair| differ(pair)).count();
    let share = different as f64 / frame.colour.len() as f64;
    assert_eq!(shown.len(), 4 * frame.colour.len());
    assert!(share <= DIFFERENT_MAX, "{different} pixels differ");
    let took = page.value(DRAWN_MS);
    println!("{different} pixels of 960 × 540 differ; a picture takes {took} ms in the browser");
}

/// Where the visitor of the page is.
fn eye(page: &mut Browser) -> Vec3 {
    let pose = page.value("sightline.state().pose");
    Vec3::from_array([0, 1, 2].map(|i| pose[i].as_f64().unwrap() as f32))
}
