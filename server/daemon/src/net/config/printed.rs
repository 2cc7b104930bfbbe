//! The configuration as a TOML file with comments, and what it may cost.

use std::fmt::Write;

use toml::{Table, Value};

use super::{
    COMMENTS, LIMIT_COMMENTS, ServeConfig,
    bounds::{self, Bound, bytes_all},
};

/// The server's share of a core for each visitor who walks, as measured with 100 of them in 2,000
/// rooms: see `tests/results/RESULTS.md`.
const CORES_PER_VISITOR: f64 = 0.0007;
/// The width of the file, in characters.
const WIDTH: usize = 100;

impl ServeConfig {
    /// All settings and limits as a TOML file: each with its comment, its range and the most memory
    /// that it lets peers occupy. A setting without a value is commented out.
    pub fn to_toml(&self) -> String {
        let values = Table::try_from(self).expect("settings are numbers, words and tables");
        let mut text = String::new();
        self.section(&mut text, COMMENTS, bounds::SETTINGS, &values);
        text += "[limits]\n\n";
        let limits = values.get("limits").and_then(Value::as_table).cloned().unwrap_or_default();
        self.section(&mut text, LIMIT_COMMENTS, bounds::LIMITS, &limits);
        text
    }

    fn section(
        &self,
        text: &mut String,
        comments: &[(&str, &[&str])],
        bounds: &[Bound],
        values: &Table,
    ) {
        for (name, lines) in comments.iter().filter(|(name, _)| *name != "limits") {
            let mut comment = lines.concat().trim().to_owned();
            if let Some(bound) = bounds.iter().find(|bound| bound.name == *name) {
                let _ = write!(comment, " From {} to {}.", bound.min, bound.max);
                if let Some(bytes) = bound.bytes {
                    let _ = write!(comment, " Memory: at most {}.", size(bytes(self)));
                }
            }
            wrap(text, &comment);
            let _ = match values.get(*name) {
                Some(value) => writeln!(text, "{name} = {value}\n"),
                None => writeln!(text, "# {name} = \"…\"\n"),
            };
        }
    }

    /// What its clients may cost, for people.
    pub fn cost(&self) -> String {
        let memory = size(bytes_all(self));
        let cores = self.clients_max as f64 * CORES_PER_VISITOR;
        format!(
            "clients_max = {}: at most {memory} of memory beside the world and the program, and \
             about {cores:.2} cores if all walk in a large building as measured; in one hall more",
            self.clients_max
        )
    }
}

/// Writes a comment in lines.
fn wrap(text: &mut String, comment: &str) {
    let mut line = "#".to_owned();
    for word in comment.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > WIDTH {
            let _ = writeln!(text, "{line}");
            line = "#".to_owned();
        }
        line = line + " " + word;
    }
    let _ = writeln!(text, "{line}");
}

/// A size for people.
fn size(bytes: u64) -> String {
    match bytes {
        0..1_048_576 => format!("{} KiB", bytes.div_ceil(1_024)),
        _ => format!("{} MiB", bytes.div_ceil(1_048_576)),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn what_is_printed_is_read_again() {
        let text = ServeConfig::default().to_toml();
        assert_eq!(ServeConfig::from_toml(&text).unwrap(), ServeConfig::default());
        let mut other = ServeConfig { clients_max: 3, free_entry: true, ..Default::default() };
        other.limits.chat_per_s = 2.5;
        other.data = Some("/srv/a \"b\"".into());
        assert_eq!(ServeConfig::from_toml(&other.to_toml()).unwrap(), other);
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH), "{text}");
        assert!(text.contains("# The most clients.") && text.contains("Memory: at most"), "{text}");
    }

    #[test]
    fn every_number_has_a_range_that_holds_its_default() {
        let values = Table::try_from(ServeConfig::default()).unwrap();
        let limits = values["limits"].as_table().unwrap();
        for (values, bounds) in [(&values, bounds::SETTINGS), (limits, bounds::LIMITS)] {
            let numbers = values.iter().filter(|(_, value)| number(value).is_some());
            let names: BTreeSet<_> = numbers.map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, bounds.iter().map(|bound| bound.name).collect());
            for bound in bounds {
                let value = number(&values[bound.name]).unwrap();
                assert!((bound.min..=bound.max).contains(&value), "{}", bound.name);
            }
        }
    }

    fn number(value: &Value) -> Option<f64> {
        super::super::number(value)
    }

    #[test]
    fn the_cost_grows_with_the_clients() {
        let of = |clients_max| {
            let config = ServeConfig { clients_max, ..Default::default() };
            (bytes_all(&config), config.cost())
        };
        let [(few, said), (many, _)] = [of(100), of(200)];
        assert!(said.starts_with("clients_max = 100: at most ") && said.contains("0.07 cores"));
        let each = (many - few) / 100;
        assert_eq!(
            each,
            1_204 * 1_024,
            "bytes for each client: buffers of 1,044 KiB, and what else is kept"
        );
    }
}
