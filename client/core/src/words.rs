//! What people are told in words.

use std::collections::BTreeMap;

/// How many names are listed.
const NAMES_MAX: usize = 5;

/// Who is in sight, by their names.
pub fn in_sight<'a>(names: impl Iterator<Item = &'a str>) -> String {
    // People of the same name are counted.
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let mut count = 0;
    for name in names {
        *counts.entry(name).or_default() += 1;
        count += 1;
    }
    let named = |(name, count): (&&str, &usize)| match count {
        1 => (*name).to_owned(),
        count => format!("{name} ({count})"),
    };
    let mut listed: Vec<String> = counts.iter().take(NAMES_MAX).map(named).collect();
    if counts.len() > NAMES_MAX {
        listed.push("others".to_owned());
    }
    match count {
        0 => "nobody is in sight".to_owned(),
        1 => format!("one person is in sight: {}", listed.join(", ")),
        _ => format!("{count} people are in sight: {}", listed.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_in_sight_are_counted_and_some_are_named() {
        let words = |names: &[&str]| in_sight(names.iter().copied());
        assert_eq!(words(&[]), "nobody is in sight");
        assert_eq!(words(&["Ada"]), "one person is in sight: Ada");
        assert_eq!(words(&["Bob", "Ada", "Bob"]), "3 people are in sight: Ada, Bob (2)");
        let many = words(&["a", "b", "c", "d", "e", "f", "g"]);
        assert_eq!(many, "7 people are in sight: a, b, c, d, e, others");
    }
}
