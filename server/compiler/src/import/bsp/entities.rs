//! The entities of a map: text of key and value pairs in braces.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use sightline_world::Spawn;

use super::units::{UNIT, placed};
use crate::{
    import::limits::{LAMPS_MAX, SPAWNS_MAX, is_sane},
    model::{Lamp, LampSource},
};

/// The eye of a player above the origin of its box, in Quake units.
const EYE: f64 = 26.0;
/// An object on a floor is this far above it, in Quake units.
const FLOOR: f64 = 1.0;
/// The candela of one unit of a light's brightness. The map compiler gives a surface one unit away
/// 7,500 times its brightness, where 255 is white; white is about 800 lux here.
const CANDELA: f64 = 7_500.0 / 255.0 * 800.0 * UNIT * UNIT;
/// The most places. More are not needed to find the inside of a map.
const PLACES_MAX: usize = 1 << 14;
/// The classes of entities at which players begin.
const SPAWN_CLASSES: [&str; 6] = [
    "info_player_deathmatch",
    "info_player_start",
    "team_ctf_redplayer",
    "team_ctf_blueplayer",
    "team_ctf_redspawn",
    "team_ctf_bluespawn",
];

/// The entities that are used.
#[derive(Debug, Default)]
pub(super) struct Entities {
    pub title: Option<String>,
    pub spawns: Vec<Spawn>,
    /// Points of all entities. They tell the inside of a map, as for the map's own compiler.
    /// Players reach some of it by teleporters only.
    pub places: Vec<Vec3>,
    /// Lamps, which count when a map is lit anew.
    pub lamps: Vec<Lamp>,
    /// Entities with a brush model.
    pub brush_models: Vec<Keys>,
    /// Corners of the paths of trains, by name. When several have one name, the first counts.
    pub corners: HashMap<String, Keys>,
}

/// The keys of an entity, in lower case, and their values.
#[derive(Debug, Default)]
pub(super) struct Keys(HashMap<String, String>);

impl Keys {
    /// The value of a key; empty when it is absent.
    pub(super) fn text(&self, key: &str) -> &str {
        self.0.get(key).map_or("", String::as_str)
    }

    pub(super) fn number(&self, key: &str) -> Option<f64> {
        numbers::<1>(self.text(key)).map(|[number]| number)
    }

    /// A number, or the default when it is 0, as for most keys in the game.
    pub(super) fn number_not_0(&self, key: &str, default: f64) -> f64 {
        self.number(key).filter(|&number| number != 0.0).unwrap_or(default)
    }

    pub(super) fn vector(&self, key: &str) -> Option<DVec3> {
        numbers::<3>(self.text(key)).map(DVec3::from)
    }

    /// Pitch, yaw and roll, in degrees.
    pub(super) fn angles(&self) -> DVec3 {
        let yaw = self.number("angle").map(|yaw| DVec3::Y * yaw);
        yaw.or_else(|| self.vector("angles")).unwrap_or(DVec3::ZERO)
    }

    pub(super) fn flags(&self) -> u32 {
        self.number("spawnflags").map_or(0, |flags| flags as u32)
    }
}

/// Reads entities, and skips what is invalid.
pub(super) fn parse(text: &str) -> Entities {
    let mut entities = Entities::default();
    let mut pairs: HashMap<String, &str> = HashMap::new();
    let mut key = None;
    for token in tokens(text) {
        match token {
            Token::Open => pairs.clear(),
            Token::Close => entities.take(&pairs),
            Token::Word(word) => match key.take() {
                None => {
                    key = Some(word);
                    continue;
                }
                Some(key) => {
                    pairs.insert(str::to_ascii_lowercase(key), word);
                }
            },
        }
        key = None;
    }
    entities
}

impl Entities {
    fn take(&mut self, pairs: &HashMap<String, &str>) {
        let get = |key: &str| pairs.get(key).copied();
        let class = get("classname").unwrap_or_default().to_ascii_lowercase();
        let has_model = get("model").is_some_and(|model| model.starts_with('*'));
        if !has_model && self.places.len() < PLACES_MAX {
            self.places.extend(place(&get));
        }
        if class == "light" && self.lamps.len() < LAMPS_MAX {
            self.lamps.extend(lamp(&get));
        } else if class == "worldspawn" {
            self.title = get("message").filter(|m| !m.trim().is_empty()).map(str::to_owned);
        } else if SPAWN_CLASSES.contains(&class.as_str()) && self.spawns.len() < SPAWNS_MAX {
            self.spawns.extend(spawn(&get));
        } else if class == "path_corner" {
            let name = get("targetname").unwrap_or_default().to_owned();
            self.corners.entry(name).or_insert_with(|| keys(pairs));
        } else if has_model {
            self.brush_models.push(keys(pairs));
        }
    }
}

fn keys(pairs: &HashMap<String, &str>) -> Keys {
    Keys(pairs.iter().map(|(key, &text)| (key.clone(), text.to_owned())).collect())
}

fn spawn<'a>(get: &impl Fn(&str) -> Option<&'a str>) -> Option<Spawn> {
    let [x, y, z] = numbers::<3>(get("origin")?)?;
    let eye = placed(DVec3::new(x, y, z + EYE));
    let turn = get("angle")
        .and_then(numbers::<1>)
        .map(|[angle]| angle)
        .or_else(|| get("angles").and_then(numbers::<3>).map(|[_, yaw, _]| yaw))
        .unwrap_or(0.0)
        .to_radians();
    // Quake measures angles from +x towards +y, which is -z here.
    let yaw = (-turn.cos()).atan2(turn.sin()) as f32;
    is_sane(eye).then_some(Spawn { eye, yaw })
}

/// A lamp, all around.
fn lamp<'a>(get: &impl Fn(&str) -> Option<&'a str>) -> Option<Lamp> {
    let at = placed(DVec3::from(numbers::<3>(get("origin")?)?));
    let brightness = get("light").and_then(numbers::<1>).map_or(300.0, |[light]| light).max(0.0);
    let colour = get("_color").and_then(numbers::<3>).unwrap_or([1.0; 3]);
    let intensity =
        colour.map(|part| (part.clamp(0.0, 1.0) * brightness.min(1.0e5) * CANDELA) as f32);
    is_sane(at).then_some(Lamp { source: LampSource::Point(at), intensity })
}

/// The place of an entity. None when it is not set.
fn place<'a>(get: &impl Fn(&str) -> Option<&'a str>) -> Option<Vec3> {
    let origin = DVec3::from(numbers::<3>(get("origin")?)?);
    let place = placed(origin + DVec3::Z * FLOOR);
    (origin != DVec3::ZERO && is_sane(place)).then_some(place)
}

/// The first numbers of a text, when all are finite.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let mut words = text.split_ascii_whitespace();
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = words.next()?.parse().ok().filter(|n: &f64| n.is_finite())?;
    }
    Some(numbers)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'a> {
    Open,
    Close,
    Word(&'a str),
}

/// Braces and words. Words in quotes may contain anything but quotes.
fn tokens(text: &str) -> impl Iterator<Item = Token<'_>> {
    let mut rest = text;
    std::iter::from_fn(move || {
        rest = rest.trim_start_matches(|c: char| c.is_whitespace() || c == '\0');
        let first = rest.chars().next()?;
        let (token, after) = match first {
            '{' => (Token::Open, &rest[1..]),
            '}' => (Token::Close, &rest[1..]),
            '"' => match rest[1..].split_once('"') {
                Some((word, after)) => (Token::Word(word), after),
                None => (Token::Word(&rest[1..]), ""),
            },
            _ => {
                let ends = |c: char| c.is_whitespace() || matches!(c, '{' | '}' | '"' | '\0');
                let (word, after) = rest.split_at(rest.find(ends).unwrap_or(rest.len()));
                (Token::Word(word), after)
            }
        };
        rest = after;
        Some(token)
    })
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn titles_and_spawns_are_found() {
        let entities = parse(
            r#"{ "classname" "worldspawn" "message" "The Keep" }
            { "origin" "100 -200 24" "classname" "info_player_deathmatch" "angle" "90" }
            { "classname" "team_CTF_redspawn" "origin" "0 0 0" "angles" "0 180 0" }
            { "classname" "item_quad" "origin" "100 0 99" }
            { "classname" "func_rotating" "origin" "1 2 3" "model" "*1" }
            { "classname" "light" }"#,
        );
        assert_eq!(entities.title.as_deref(), Some("The Keep"));
        let [first, second] = entities.spawns[..] else { panic!("{entities:?}") };
        let expected = Vec3::new(2.54, 1.27, 5.08);
        assert!((first.eye - expected).length() < 1e-5, "{first:?}");
        let [at_first, at_item] = entities.places[..] else { panic!("{entities:?}") };
        assert!((first.eye - at_first - Vec3::Y * 0.635).length() < 1e-5, "{at_first}");
        assert!((at_item - Vec3::new(2.54, 2.54, 0.0)).length() < 1e-5, "{at_item}");
        // 90° looks along +y, our -z; 180° along -x, a quarter turn to the left of that.
        assert!(first.yaw.abs() < 1e-6);
        assert!((second.yaw - FRAC_PI_2).abs() < 1e-6, "{second:?}");
    }

    #[test]
    fn invalid_text_is_skipped() {
        for text in [
            "",
            "{",
            "}",
            "}}}{{{",
            "\"",
            "{ \"classname\" \"info_player_start\" }",
            "{ \"classname\" \"info_player_start\" \"origin\" \"1 nan 2\" }",
            "{ \"classname\" \"info_player_start\" \"origin\" \"1e300 0 0\" }",
            "{ classname info_player_start origin }",
            "\u{fffd}{\u{fffd}\"\u{fffd}\0{ é }",
        ] {
            assert!(parse(text).spawns.is_empty(), "{text:?}");
        }
    }
}
