//! What a page is told, as JSON.

use std::time::Duration;

use serde::Serialize;
use sightline_client_core::{replica::ShownAvatar, words};

use crate::{
    connection::{Connection, Ending, Stage},
    scene::Scene,
};

/// The greatest number of people that are listed.
const PEOPLE_MAX: usize = 64;

/// Something that was said, or has happened.
#[derive(Debug, Serialize)]
pub(crate) struct Said {
    /// Who said it; absent where nobody did.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    text: String,
}

impl Said {
    pub(crate) fn chat(name: String, text: String) -> Self {
        Self { name: Some(name), text }
    }

    pub(crate) fn notice(text: &str) -> Self {
        Self { name: None, text: text.to_owned() }
    }
}

/// How the client stands, where it is, and who is near.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Report<'a> {
    stage: &'static str,
    /// What the server does, or why there is no connection.
    reason: &'a str,
    /// Whether another attempt may succeed, and after how many milliseconds.
    may_pass: bool,
    retry_ms: u64,
    /// Whether the server needs another page.
    is_version: bool,
    building: &'a str,
    room: Option<&'a str>,
    /// Who is in sight, in words.
    sight: String,
    /// x, y and z of the eye in metres, yaw and pitch in radians.
    pose: Option<[f32; 5]>,
    /// The height of the soles, in metres.
    soles: f32,
    on_route: bool,
    returns: u32,
    people: Vec<Person>,
}

/// Somebody of whom the server tells this client.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Person {
    name: String,
    colour: String,
    metres: u32,
    in_sight: bool,
    at: [f32; 3],
}

/// The report of a moment.
pub(crate) fn reported(connection: &Connection, scene: Option<&Scene>, now: Duration) -> String {
    let passes =
        Ending { reason: String::new(), may_pass: true, retry: Duration::ZERO, is_version: false };
    let (stage, ending) = match connection.stage() {
        Stage::Closed(reason) => ("closed", Ending { reason: reason.clone(), ..passes }),
        Stage::Greeted => ("greeted", passes),
        Stage::Waiting(what) => ("waiting", Ending { reason: what.clone(), ..passes }),
        Stage::Fetching => ("fetching", passes),
        Stage::Entering => ("entering", passes),
        Stage::In => ("in", passes),
        Stage::Over(ending) => ("over", ending.clone()),
    };
    let (building, room) = scene.map(Scene::place).unwrap_or_default();
    let pose = scene.map(|scene| scene.walk.pose());
    let people = people(connection, scene, now);
    let report = Report {
        stage,
        reason: &ending.reason,
        may_pass: ending.may_pass,
        retry_ms: ending.retry.as_millis() as u64,
        is_version: ending.is_version,
        building,
        room,
        sight: words::in_sight(
            people.iter().filter(|person| person.in_sight).map(|person| person.name.as_str()),
        ),
        pose: pose.map(|pose| [pose.eye.x, pose.eye.y, pose.eye.z, pose.yaw, pose.pitch]),
        soles: scene.map_or(0.0, Scene::soles),
        on_route: scene.is_some_and(|scene| scene.walk.is_on_route()),
        returns: connection.presence().map_or(0, |presence| presence.returns()),
        people,
    };
    serde_json::to_string(&report).unwrap_or_default()
}

/// The people of whom the server tells this client, the nearest first.
fn people(connection: &Connection, scene: Option<&Scene>, now: Duration) -> Vec<Person> {
    let (Some(presence), Some(scene)) = (connection.presence(), scene) else { return Vec::new() };
    if !connection.is_in() {
        return Vec::new();
    }
    let eye = scene.walk.pose().eye;
    let mut told = presence.replica.shown_avatars(now);
    told.sort_by(|a, b| {
        let metres = |of: &ShownAvatar| of.pose.eye.distance(eye);
        metres(a).total_cmp(&metres(b))
    });
    told.truncate(PEOPLE_MAX);
    let person = |of: ShownAvatar| Person {
        in_sight: scene.seen().iter().any(|seen| seen.id == of.id),
        metres: of.pose.eye.distance(eye).round() as u32,
        colour: format!("#{:02x}{:02x}{:02x}", of.colour[0], of.colour[1], of.colour[2]),
        at: of.pose.eye.to_array(),
        name: of.name,
    };
    told.into_iter().map(person).collect()
}
