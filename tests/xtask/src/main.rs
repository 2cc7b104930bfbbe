//! Chores of the repository.
//!
//! `cargo xtask results` measures the product on this machine. Every measurement becomes a JSON
//! file in `tests/results/DATE-CPU/`, and all of these files together become
//! `tests/results/RESULTS.md`.
//!
//! `cargo xtask web` compiles the client for browsers, [`web`].
//!
//! * [`measurement`]: a command to run, and what its table shows.
//! * [`measurements`]: what is measured.
//! * [`machine`]: the date and the hardware.
//! * [`page`]: the page of tables.

mod machine;
mod measurement;
mod measurements;
mod page;
mod web;

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::{Context, ensure};
use clap::Parser;
use serde_json::{Value, json};

use measurement::{Measurement, Program};
use measurements::{ALL, WORLDS};

/// Longer lists of figures are left out of the files.
const LIST_MAX: usize = 40;

#[derive(Parser)]
#[command(bin_name = "cargo xtask", about = "Chores of the repository.")]
enum Chore {
    /// Measure the product, and write the tables of all results.
    Results(Args),
    /// Compile the client for browsers, which the server embeds.
    Web(web::Args),
}

#[derive(clap::Args)]
struct Args {
    /// Measure only what has this name; may be given several times.
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// List the measurements.
    #[arg(long)]
    list: bool,
    /// Measure little, to see that everything works. The results go to `target/results` instead.
    #[arg(long)]
    quick: bool,
    /// What a reader should know of the run, such as what else the machine did.
    #[arg(long, value_name = "TEXT", default_value = "")]
    note: String,
    /// Measure nothing: only write the page anew from the files.
    #[arg(long, conflicts_with_all = ["only", "quick"])]
    page: bool,
}

/// The folders of a run.
struct Folders {
    /// Maps and traces.
    data: PathBuf,
    /// Compiled worlds, kept for the next run.
    worlds: PathBuf,
    /// A folder for each day and machine, and the page.
    results: PathBuf,
}

fn main() -> anyhow::Result<()> {
    match Chore::parse() {
        Chore::Results(args) => results(&args),
        Chore::Web(args) => web::run(&args),
    }
}

fn results(args: &Args) -> anyhow::Result<()> {
    if args.list {
        ALL.iter().for_each(|m| println!("{:<20} {}", m.name, m.title));
        return Ok(());
    }
    for name in &args.only {
        let known = ALL.iter().any(|m| m.name == name);
        ensure!(known, "no measurement is called {name}: see --list");
    }
    let folders = folders(args.quick);
    if !args.page {
        measure_all(args, &folders)?;
    }
    let page = page::page(&folders.results)?;
    let path = folders.results.join("RESULTS.md");
    fs::write(&path, page).with_context(|| format!("cannot write {}", path.display()))?;
    println!("wrote {}", path.display());
    Ok(())
}

fn folders(quick: bool) -> Folders {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let root = root.canonicalize().unwrap_or(root);
    let data = std::env::var_os("SIGHTLINE_SHARED").map(PathBuf::from);
    let results = if quick { "target/results/quick" } else { "tests/results" };
    Folders {
        data: data.unwrap_or_else(|| root.join("../shared")),
        worlds: root.join("target/results/worlds"),
        results: root.join(results),
    }
}

fn measure_all(args: &Args, folders: &Folders) -> anyhow::Result<()> {
    let machine = machine::describe(&args.note);
    let folder = folders.results.join(machine::folder_name(&machine));
    fs::create_dir_all(&folder)?;
    fs::create_dir_all(&folders.worlds)?;
    write_json(&folder.join("machine.json"), &machine)?;
    for measurement in ALL {
        if !args.only.is_empty() && !args.only.iter().any(|name| name == measurement.name) {
            continue;
        }
        let file = folder.join(format!("{}.json", measurement.name));
        match measure(measurement, args.quick, folders)? {
            Some(result) => write_json(&file, &result)?,
            None => println!("{}: skipped, its files are not there", measurement.name),
        }
    }
    Ok(())
}

/// The result of a measurement; `None` when no run has the files that it needs.
fn measure(
    measurement: &Measurement,
    quick: bool,
    folders: &Folders,
) -> anyhow::Result<Option<Value>> {
    let (mut rows, mut commands, mut figures) = (Vec::new(), Vec::new(), Vec::new());
    for run in measurement.runs {
        let words = run.args.iter().chain(if quick { run.quick } else { run.full });
        let Some(words) = prepare(words, folders)? else { continue };
        println!("{}: {}", measurement.name, run.label);
        let mut found = execute(measurement.program, &words)?;
        rows.extend(measurement.rows_of(run, &found));
        drop_long_lists(&mut found);
        figures.push(found);
        commands.push(measurement.program.shown(&words));
    }
    Ok((!commands.is_empty()).then(|| {
        json!({
            "title": measurement.title,
            "note": measurement.note,
            "commands": commands,
            "columns": measurement.heads(),
            "rows": rows,
            "figures": figures,
        })
    }))
}

/// The words of a command with the paths of its files, worlds compiled; `None` when a file is not
/// there.
fn prepare<'a>(
    words: impl Iterator<Item = &'a &'static str>,
    folders: &Folders,
) -> anyhow::Result<Option<Vec<String>>> {
    let mut ready = Vec::new();
    for word in words {
        let path = if let Some(file) = word.strip_prefix("DATA/") {
            folders.data.join(file)
        } else if let Some(name) = word.strip_prefix("WORLD/") {
            match compile(name, folders)? {
                Some(path) => path,
                None => return Ok(None),
            }
        } else {
            let out = word.strip_prefix("OUT/").map(|file| folders.worlds.join(file));
            ready.push(out.map_or_else(|| (*word).to_owned(), |path| path.display().to_string()));
            continue;
        };
        if !path.is_file() {
            return Ok(None);
        }
        ready.push(path.display().to_string());
    }
    Ok(Some(ready))
}

/// Compiles a world of [`WORLDS`] unless an earlier run has; `None` when its source is not there.
fn compile(name: &str, folders: &Folders) -> anyhow::Result<Option<PathBuf>> {
    let world = WORLDS.iter().find(|world| world.name == name).context("no such world")?;
    let (source, path) =
        (folders.data.join(world.source), folders.worlds.join(format!("{name}.slw")));
    if !source.is_file() {
        return Ok(None);
    }
    if !path.is_file() {
        println!("compiling {name}");
        let mut words = vec!["compile".to_owned(), source.display().to_string(), "-o".into()];
        words.push(path.display().to_string());
        words.extend(world.flags.iter().map(ToString::to_string));
        run_to_end(Program::Server, &words)?;
    }
    Ok(Some(path))
}

/// Runs a program with `--json` and reads what it wrote.
fn execute(program: Program, words: &[String]) -> anyhow::Result<Value> {
    let file = std::env::temp_dir().join(format!("sightline-xtask-{}.json", std::process::id()));
    let json = ["--json".to_owned(), file.display().to_string()];
    run_to_end(program, &[words, &json].concat())?;
    let text = fs::read_to_string(&file).context("the program wrote no figures")?;
    fs::remove_file(&file)?;
    Ok(serde_json::from_str(&text)?)
}

fn run_to_end(program: Program, words: &[String]) -> anyhow::Result<()> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(program.cargo_words()).arg("--").args(words).stdout(Stdio::null());
    let status = command.status().context("cannot run cargo")?;
    ensure!(status.success(), "failed: {}", program.shown(words));
    Ok(())
}

fn drop_long_lists(figures: &mut Value) {
    match figures {
        Value::Array(list) => list.iter_mut().for_each(drop_long_lists),
        Value::Object(map) => {
            map.retain(|_, value| value.as_array().is_none_or(|list| list.len() <= LIST_MAX));
            map.values_mut().for_each(drop_long_lists);
        }
        _ => {}
    }
}

fn write_json(path: &Path, value: &Value) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)? + "\n";
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::Run;

    #[test]
    fn long_lists_are_dropped_at_any_depth() {
        let long = vec![0; LIST_MAX + 1];
        let mut figures = json!([{ "a": { "long": long, "short": [1] } }]);
        drop_long_lists(&mut figures);
        assert_eq!(figures, json!([{ "a": { "short": [1] } }]));
    }

    #[test]
    fn every_world_that_a_measurement_names_is_known() {
        let runs = ALL.iter().flat_map(|measurement| measurement.runs);
        let words = runs.flat_map(|Run { args, full, quick, .. }| {
            args.iter().chain(full.iter()).chain(quick.iter())
        });
        let named: Vec<&str> = words.filter_map(|word| word.strip_prefix("WORLD/")).collect();
        assert!(!named.is_empty());
        for name in named {
            assert!(WORLDS.iter().any(|world| world.name == name), "{name}");
        }
    }
}
