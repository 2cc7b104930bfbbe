//! The live page for operators, in a browser.

use std::path::Path;

use serde_json::json;
use sightline_server::{http::OwnerToken, net::Limits};
use tokio::task::spawn_blocking;

use super::{browser::Browser, config, is_quiet, join, operators::listen_with, serve, until};
use crate::building::{EAST, WEST};

/// How many pixels of the plans people and TBVs colour.
const COLOURED: &str = "storeys.reduce((sum, { canvas }) => sum + canvas.getContext('2d')
    .getImageData(0, 0, canvas.width, canvas.height).data.filter((v, i) => i % 4 === 3 && v).length,
    0)";
/// Clicks where the first person of the table stands.
const CLICK: &str = "(() => {
    const { eye } = now.people[0].place;
    const storey = storeys.find(storey => holds(storey, eye[1]));
    const [x, y] = place(storey, [eye[0], eye[2]]);
    const box = storey.canvas.getBoundingClientRect(), scale = box.width / storey.width;
    storey.canvas.dispatchEvent(new MouseEvent('click',
        { clientX: box.left + x * scale + 3, clientY: box.top + y * scale, bubbles: true }));
    return picked === now.people[0].avatar;
})()";

#[tokio::test(flavor = "multi_thread")]
async fn the_page_shows_people_on_plans_and_what_one_of_them_may_see() {
    let (server, _) = serve(config());
    let token = OwnerToken::new().unwrap();
    let http = listen_with(&server, &Limits::default(), token.clone()).await;
    let (ada, bo) = (join(&server, "Ada", WEST).await, join(&server, "<b>Bo</b>", EAST).await);
    until("both are quiet", || is_quiet(&ada) && is_quiet(&bo)).await;
    let url = format!("http://{}/#token={token}", http.local_addr());
    let looked = spawn_blocking(move || Browser::open(&url).map(look)).await.unwrap();
    match looked {
        Some(faults) => {
            assert!(faults.is_empty(), "{faults:?}");
            until("Ada is told", || ada.end().as_deref() == Some("a moderator removed you: loud"))
                .await;
        }
        None => println!("skipped: Chromium is not installed"),
    }
}

/// Looks at the page. What it did wrong.
fn look(mut page: Browser) -> Vec<String> {
    page.until("document.querySelectorAll('#sessions tr').length === 2 && storeys.length > 0");
    page.until("storeys.every(({ element }) => element.firstChild.naturalWidth > 100)");
    let names =
        "[...document.querySelectorAll('#sessions td:first-child')].map(c => c.textContent)";
    let shown = page.value(names);
    assert_eq!(shown, json!(["<b>Bo</b>", "Ada"]), "as text, by name");
    assert_eq!(page.value("document.querySelectorAll('#sessions b, #picked b').length"), json!(0));
    page.until("now.clients.quiet + now.clients.asked + now.clients.live === 2");
    page.until(&format!("{COLOURED} > 200"));
    page.value("document.querySelector('#sessions tr').click()");
    page.until("document.getElementById('picked').textContent.includes('holds 0 others')");
    page.until(
        "sight !== null && sight.cells.length > 0 && sight.cells.length === sight.cells_all",
    );
    page.until(&format!("picked = null, {CLICK}"));
    page.until("ticks.length > 1 && document.getElementById('take_s').textContent.endsWith('s')");
    page.until("location.hash === '' && token !== null");
    page.value("picked = null, window.prompt = () => 'loud'");
    let act = |name| format!("document.querySelector('[data-act={name}]').click()");
    page.value("document.querySelectorAll('#sessions tr')[1].click()");
    page.until("document.getElementById('subject').textContent === 'Ada (visitor):'");
    page.value(&act("mute"));
    page.until("document.getElementById('mute').textContent === 'unmute'");
    let picture = Path::new(env!("CARGO_TARGET_TMPDIR")).join("operator-page.png");
    page.picture(&picture);
    println!("the page: {}", picture.display());
    page.value(&act("kick"));
    page.until("document.getElementById('answer').textContent === 'kick Ada: done'");
    std::mem::take(&mut page.faults)
}
