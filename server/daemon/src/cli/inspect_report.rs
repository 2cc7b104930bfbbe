//! The page of `inspect --report`: what is known of a world in one HTML file.

use std::{fmt::Write, time::Duration};

use base64::{Engine, prelude::BASE64_STANDARD};
use sightline_picture::Picture;
use sightline_renderer::{Camera, Frame, Renderer, movers};
use sightline_world::{Spawn, World, motion::Pose};

/// A row of a table: a name, which is indented when it belongs to the one above, and a value.
pub type TableRow = (String, String);

/// The size of a view, in pixels.
const VIEW: (usize, usize) = (960, 540);
/// The most spawn points whose views are shown.
const VIEWS_MAX: usize = 12;

const STYLE: &str = "body{font:15px/1.4 system-ui,sans-serif;max-width:62rem;margin:2rem auto;\
    padding:0 1rem;color:#222;background:#fff}img{max-width:100%;border:1px solid #ccc}\
    figure{margin:1rem 0}table{border-collapse:collapse}td{padding:.15rem 1rem .15rem 0;\
    vertical-align:top}td.part{padding-left:1.2rem}tr:nth-child(even){background:#f4f4f4}\
    pre{overflow-x:auto;background:#f4f4f4;padding:.7rem}";

/// A page with a plan, views from spawn points, a table, and what a verification has found.
///
/// # Errors
/// When a picture cannot be encoded.
pub fn page(
    world: &World,
    plan: &Picture,
    rows: &[TableRow],
    verified: Option<&str>,
) -> anyhow::Result<String> {
    let title = match world.title.trim() {
        "" => "A world without a title".to_owned(),
        title => escaped(title),
    };
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>{title}</title>\n\
         <style>{STYLE}</style>\n<h1>{title}</h1>\n<h2>Plan</h2>\n"
    );
    figure(&mut page, plan, "Each storey from above, with cells, rooms and spawn points.")?;
    let spawns = world.spawns.iter().enumerate();
    page += "<h2>Where visitors begin</h2>\n";
    for (number, spawn) in spawns.take(VIEWS_MAX) {
        let [x, y, z] = spawn.eye.to_array();
        let caption = format!("Spawn point {number}, at {x:.2},{y:.2},{z:.2}.");
        figure(&mut page, &view(world, spawn), &caption)?;
    }
    page += "<h2>Figures</h2>\n<table>\n";
    for (name, value) in rows {
        let class = if name.starts_with(' ') { " class=\"part\"" } else { "" };
        let [name, value] = [name.trim(), value].map(escaped);
        let _ = writeln!(page, "<tr><td{class}>{name}</td><td>{value}</td></tr>");
    }
    page += "</table>\n";
    if let Some(verified) = verified {
        let _ = writeln!(page, "<h2>Verification</h2>\n<pre>{}</pre>", escaped(verified.trim()));
    }
    Ok(page + "</html>\n")
}

/// What a visitor sees at first.
fn view(world: &World, spawn: &Spawn) -> Picture {
    let camera = Camera::at(&Pose { eye: spawn.eye, yaw: spawn.yaw, ..Pose::default() });
    let mut frame = Frame::new(VIEW.0, VIEW.1);
    Renderer::default().draw(&world.octree, &camera, &mut frame);
    movers::draw(&mut frame, &camera, world, Duration::ZERO);
    Picture::from_fn(VIEW.0 as u32, VIEW.1 as u32, |x, y| {
        let [_, red, green, blue] = frame.colour[y as usize * VIEW.0 + x as usize].to_be_bytes();
        [red, green, blue]
    })
}

fn figure(page: &mut String, picture: &Picture, caption: &str) -> anyhow::Result<()> {
    let data = BASE64_STANDARD.encode(picture.to_png()?);
    let _ = writeln!(
        page,
        "<figure><img src=\"data:image/png;base64,{data}\" alt=\"{caption}\">\
         <figcaption>{caption}</figcaption></figure>"
    );
    Ok(())
}

/// Text of a file as HTML shows it.
fn escaped(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => shown += "&amp;",
            '<' => shown += "&lt;",
            '>' => shown += "&gt;",
            '"' => shown += "&quot;",
            '\n' => shown.push('\n'),
            letter if letter.is_control() => {}
            letter => shown.push(letter),
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sightline_fixtures::two_rooms;

    use super::*;

    #[test]
    fn a_page_has_its_pictures_and_nothing_of_a_file_becomes_markup() {
        let mut world = two_rooms::world();
        world.title = "<script>\u{7}\"&".to_owned();
        world.spawns = vec![Spawn { eye: Vec3::new(3.0, 1.6, 3.0), yaw: 0.0 }];
        let rows =
            [("rooms".to_owned(), "2".to_owned()), ("  <b>".to_owned(), "1 window".to_owned())];
        let plan = Picture::from_fn(4, 4, |x, y| [x as u8, y as u8, 0]);
        let page = page(&world, &plan, &rows, Some("misses < 1")).unwrap();
        assert_eq!(page.matches("data:image/png;base64,").count(), 2, "the plan and a view");
        assert!(page.contains("<title>&lt;script&gt;&quot;&amp;</title>"));
        assert!(page.contains("<td class=\"part\">&lt;b&gt;</td><td>1 window</td>"));
        assert!(page.contains("<pre>misses &lt; 1</pre>"));
        assert!(!page.contains("<script>") && !page.contains("<b>"));
    }
}
