//! A measurement: which command is run, and what its table shows.

use std::path::Path;

use serde_json::Value;

/// Figures of the product under one heading.
pub struct Measurement {
    /// The name of its file.
    pub name: &'static str,
    /// The heading of its table.
    pub title: &'static str,
    /// What the figures are, in a sentence or two.
    pub note: &'static str,
    /// What is run.
    pub program: Program,
    /// One command each.
    pub runs: &'static [Run],
    /// A JSON pointer to the list that has an object for each row of the table, or to one such
    /// object.
    pub rows: &'static str,
    /// Heads of columns, with JSON pointers from a row to the figure.
    pub columns: &'static [(&'static str, &'static str)],
}

/// One command of a measurement.
pub struct Run {
    /// The first cell of its rows.
    pub label: &'static str,
    /// Arguments that every run has.
    pub args: &'static [&'static str],
    /// Arguments that follow in a whole run.
    pub full: &'static [&'static str],
    /// Arguments that follow with `--quick`.
    pub quick: &'static [&'static str],
}

/// What is run.
#[derive(Clone, Copy)]
pub enum Program {
    /// `sightline-server`.
    Server,
    /// `sightline-client`.
    Client,
    /// A bench of the package `sightline-tests`.
    Bench(&'static str),
}

impl Program {
    /// What cargo is told, up to `--`.
    pub fn cargo_words(self) -> Vec<&'static str> {
        match self {
            Self::Server => vec!["run", "-q", "--release", "-p", "sightline-server"],
            Self::Client => vec!["run", "-q", "--release", "-p", "sightline-client"],
            Self::Bench(name) => vec!["bench", "-q", "-p", "sightline-tests", "--bench", name],
        }
    }

    /// A command as a person would type it, files without their folders.
    pub fn shown(self, words: &[String]) -> String {
        let program = match self {
            Self::Server => "sightline-server".into(),
            Self::Client => "sightline-client".into(),
            Self::Bench(name) => format!("cargo bench -p sightline-tests --bench {name} --"),
        };
        let bare = |word: &String| match Path::new(word).file_name() {
            Some(name) if word.contains('/') => name.to_string_lossy().into_owned(),
            _ => word.clone(),
        };
        let words: Vec<String> = words.iter().map(bare).collect();
        format!("{program} {}", words.join(" ")).trim_end().to_owned()
    }
}

impl Measurement {
    /// The heads of the table's columns. The first is empty: it is for the runs' labels.
    pub fn heads(&self) -> Vec<&'static str> {
        [""].into_iter().chain(self.columns.iter().map(|column| column.0)).collect()
    }

    /// The table's rows of a run, from what it wrote.
    pub fn rows_of(&self, run: &Run, figures: &Value) -> Vec<Vec<Value>> {
        let rows = match figures.pointer(self.rows) {
            Some(Value::Array(rows)) => rows.iter().collect(),
            Some(row) => vec![row],
            None => Vec::new(),
        };
        let cell = |row: &Value, pointer| row.pointer(pointer).cloned().unwrap_or_default();
        let cells = |row| {
            let label = Value::from(run.label);
            [label].into_iter().chain(self.columns.iter().map(|c| cell(row, c.1))).collect()
        };
        rows.into_iter().map(cells).collect()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn rows_are_read_from_a_list_or_from_one_object() {
        let run = Run { label: "a", args: &[], full: &[], quick: &[] };
        let of = |rows| Measurement {
            name: "",
            title: "",
            note: "",
            program: Program::Server,
            runs: &[],
            rows,
            columns: &[("x", "/x"), ("y", "/deep/y")],
        };
        let row = json!({ "x": 1, "deep": { "y": "two" } });
        let expected = vec![vec![json!("a"), json!(1), json!("two")]];
        assert_eq!(of("").rows_of(&run, &row), expected);
        assert_eq!(of("/list").rows_of(&run, &json!({ "list": [row] })), expected);
        assert!(of("/absent").rows_of(&run, &json!({})).is_empty());
    }

    #[test]
    fn commands_are_shown_without_folders() {
        let words = ["replay", "/tmp/a.slw", "--rtt", "0"].map(String::from);
        assert_eq!(Program::Server.shown(&words), "sightline-server replay a.slw --rtt 0");
    }
}
