//! The page of tables, made from the files of all runs.

use std::{
    fmt::Write,
    fs,
    path::{Path, PathBuf},
};

use anyhow::Context;
use serde_json::Value;

const HEAD: &str = "# Results

Measured figures of Sightline, newest run first. Each run has a folder with the same figures as JSON.
This page is written by `cargo xtask results`: edit the files, not the page. CPU times are those of
all threads together unless a table says otherwise.
";

/// The page of the folder of results, newest run first.
pub fn page(results: &Path) -> anyhow::Result<String> {
    let mut runs: Vec<PathBuf> = entries(results)?;
    runs.retain(|path| path.join("machine.json").is_file());
    let mut page = HEAD.to_owned();
    for run in runs.iter().rev() {
        let machine = read(&run.join("machine.json"))?;
        let text = |key: &str| cell(&machine[key]);
        let _ = writeln!(page, "\n## {}, {}\n", text("date"), text("cpu"));
        let facts = [text("cores") + " cores", text("memory"), text("rustc"), text("note")];
        let facts: Vec<String> = facts.into_iter().filter(|fact| !fact.is_empty()).collect();
        let _ = writeln!(page, "{}.", facts.join(", "));
        for file in entries(run)? {
            let is_result = file.extension().is_some_and(|extension| extension == "json");
            if is_result && !file.ends_with("machine.json") {
                let figures = read(&file).with_context(|| file.display().to_string())?;
                page += &section(&figures);
            }
        }
    }
    Ok(page)
}

/// A heading, a note, a table and the commands.
fn section(result: &Value) -> String {
    let mut text = format!("\n### {}\n", cell(&result["title"]));
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let note = cell(&result["note"]);
    if !note.is_empty() {
        let _ = write!(text, "\n{note}\n");
    }
    let rows: Vec<Vec<Value>> = list(&result["rows"]).iter().map(list).collect();
    // A column without a single cell is left out.
    let heads = list(&result["columns"]);
    let used = |i: &usize| rows.iter().any(|row| row.get(*i).is_some_and(|c| !cell(c).is_empty()));
    let columns: Vec<usize> = (0..heads.len()).filter(used).collect();
    let line = |cells: &[Value]| {
        let cells: Vec<String> =
            columns.iter().map(|&i| cells.get(i).map(cell).unwrap_or_default()).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    let _ = write!(text, "\n{}", line(&heads));
    let is_number = |i: usize| {
        let mut cells = rows.iter().filter_map(|row| row.get(i));
        cells.any(Value::is_number)
    };
    let rules = columns.iter().map(|&i| if is_number(i) { "---:" } else { "---" });
    let _ = writeln!(text, "| {} |", rules.collect::<Vec<_>>().join(" | "));
    rows.iter().for_each(|row| text += &line(row));
    let commands: Vec<String> = list(&result["commands"]).iter().map(cell).collect();
    if !commands.is_empty() {
        let _ = write!(text, "\n```\n{}\n```\n", commands.join("\n"));
    }
    text
}

/// A figure for people: numbers with at most three digits that count, thousands set apart.
fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.replace('|', "\\|"),
        Value::Number(number) => match (number.as_u64(), number.as_f64()) {
            (Some(whole), _) => thousands(whole),
            (None, Some(real)) if real.abs() >= 1000.0 => thousands(real.round() as u64),
            (None, Some(real)) if real != 0.0 => {
                let digits = (2 - real.abs().log10().floor() as i32).max(0) as usize;
                let text = format!("{real:.digits$}");
                let trimmed = text.trim_end_matches('0').trim_end_matches('.');
                if text.contains('.') { trimmed.to_owned() } else { text }
            }
            _ => number.to_string(),
        },
        other => other.to_string(),
    }
}

fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let groups = digits.as_bytes().rchunks(3).rev();
    groups.map(|group| String::from_utf8_lossy(group)).collect::<Vec<_>>().join(",")
}

fn read(path: &Path) -> anyhow::Result<Value> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_str(&text).with_context(|| path.display().to_string())
}

fn entries(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let entries =
        fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<anyhow::Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_have_at_most_three_digits_that_count() {
        let cells = [json!(0.123_456), json!(1.0), json!(12_345_678), json!(1234.5), json!(null)];
        assert_eq!(cells.map(|value| cell(&value)), ["0.123", "1", "12,345,678", "1,235", ""]);
    }

    #[test]
    fn columns_without_a_cell_are_left_out() {
        let result = json!({
            "title": "T", "note": "N.", "commands": ["run me"],
            "columns": ["", "a", "b"], "rows": [["x", 1, null], ["y", 2, null]],
        });
        let expected =
            "\n### T\n\nN.\n\n|  | a |\n| --- | ---: |\n| x | 1 |\n| y | 2 |\n\n```\nrun me\n```\n";
        assert_eq!(section(&result), expected);
    }
}
