//! Nodes that an author leaves out of the building, by name.

use wildmatch::WildMatch;

/// Patterns of names of nodes that are left out, with all below them. `*` stands for any letters
/// and `?` for one; upper and lower case are the same.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeftOut {
    /// Nodes that are not wanted.
    pub dropped: Vec<String>,
    /// Doors that stand open: neither drawn nor in anybody's way.
    pub open_doors: Vec<String>,
}

/// Counts how many nodes each pattern leaves out.
pub(super) struct PatternCounts {
    patterns: Vec<(&'static str, WildMatch, usize)>,
}

impl PatternCounts {
    pub(super) fn new(left_out: &LeftOut) -> Self {
        let of = |flag: &'static str, patterns: &[String]| {
            let matcher = |text: &String| WildMatch::new_case_insensitive(text);
            patterns.iter().map(|text| (flag, matcher(text), 0)).collect::<Vec<_>>()
        };
        let mut patterns = of("--drop", &left_out.dropped);
        patterns.extend(of("--open-doors", &left_out.open_doors));
        Self { patterns }
    }

    /// Whether a node of this name is left out.
    pub(super) fn take(&mut self, name: &str) -> bool {
        let found = self.patterns.iter_mut().find(|(_, pattern, _)| pattern.matches(name));
        found.map(|(_, _, count)| *count += 1).is_some()
    }

    /// Warns of patterns that fit no node.
    pub(super) fn warn(&self, warnings: &mut Vec<String>) {
        let unused = self.patterns.iter().filter(|(_, _, count)| *count == 0);
        warnings.extend(unused.map(|(flag, pattern, _)| {
            format!("{flag} {pattern}: no node of the model has such a name")
        }));
    }
}
