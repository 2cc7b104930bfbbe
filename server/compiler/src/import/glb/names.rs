//! What the names of nodes tell of their meshes, and of those of their descendants.

/// What a mesh is there for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(super) enum Purpose {
    /// It is drawn, and hides people when it is opaque.
    #[default]
    Building,
    /// It hides people and is not drawn: `occluder:NAME`, or a name that ends with `-occ`.
    Occluder,
    /// It is drawn and hides nobody: `detail:NAME`, or a name that ends with `-noocc`.
    Detail,
    /// It stops bodies and does nothing else: `collider:NAME`, or a name that ends with `-col`.
    Collider,
    /// It is part of the building and gives light of its colour: `light:NAME`, or a name that ends
    /// with `-light`. Without a mesh it is a lamp.
    Light,
}

/// The purpose that a name tells, if it tells one.
pub(super) fn purpose(name: &str) -> Option<Purpose> {
    let name = without_number(name).to_ascii_lowercase();
    let says = |prefix: &str, suffix: &str| name.starts_with(prefix) || name.ends_with(suffix);
    if says("detail:", "-noocc") {
        Some(Purpose::Detail)
    } else if says("occluder:", "-occ") {
        Some(Purpose::Occluder)
    } else if says("collider:", "-col") {
        Some(Purpose::Collider)
    } else if says("light:", "-light") {
        Some(Purpose::Light)
    } else {
        None
    }
}

/// Whether a node of this name is a spawn point: `spawn`, `spawn:NAME`, or `spawn` with a number.
pub(super) fn marks_spawn(name: &str) -> bool {
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '_' | '-' | ' ');
    match name.get(..5) {
        Some(start) if start.eq_ignore_ascii_case("spawn") => {
            let rest = &name[5..];
            rest.starts_with(':') || rest.chars().all(is_number)
        }
        _ => false,
    }
}

/// A name without the number that modelling programs add to duplicates, such as `.001`.
fn without_number(name: &str) -> &str {
    let is_number = |text: &str| text.len() == 3 && text.bytes().all(|b| b.is_ascii_digit());
    name.rsplit_once('.').filter(|(_, number)| is_number(number)).map_or(name, |(stem, _)| stem)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_and_suffixes_tell_the_purpose() {
        for (name, told) in [
            ("wall", None),
            ("occluder:north", Some(Purpose::Occluder)),
            ("Wall-OCC", Some(Purpose::Occluder)),
            ("wall-occ.001", Some(Purpose::Occluder)),
            ("wall-noocc", Some(Purpose::Detail)),
            ("detail:plant", Some(Purpose::Detail)),
            ("fence-col", Some(Purpose::Collider)),
            ("collider:fence", Some(Purpose::Collider)),
            ("light:desk", Some(Purpose::Light)),
            ("Panel-light.002", Some(Purpose::Light)),
            ("lightwell", None),
            ("protocol", None),
            ("my occluder: no", None),
        ] {
            assert_eq!(purpose(name), told, "{name}");
        }
    }
}
