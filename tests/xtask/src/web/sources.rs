//! The hash of what the client for browsers is compiled from: the sources of the crates in it, and
//! which packages of others they use. Tests are left out.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, anyhow};
use toml::{Table, Value};

/// The folder of the crate that the page calls.
const FRONT: &str = "client/web";

/// The hash, as a line of text.
pub(super) fn hash(root: &Path) -> anyhow::Result<String> {
    let workspace = table(&root.join("Cargo.toml"))?;
    let mut hasher = blake3::Hasher::new();
    let mut take = |name: &str, bytes: &[u8]| {
        for part in [name.as_bytes(), bytes] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part);
        }
    };
    let dependencies = dependencies(&workspace)?;
    let (mut crates, mut packages) = (vec![root.join(FRONT)], BTreeSet::new());
    let mut at = 0;
    while let Some(folder) = crates.get(at).cloned() {
        at += 1;
        for name in used(&table(&folder.join("Cargo.toml"))?) {
            let (package, folder) = dependencies.get(&name).context("every package is listed")?;
            match folder {
                Some(folder) if !crates.contains(&root.join(folder)) => {
                    crates.push(root.join(folder));
                }
                Some(_) => {}
                None => {
                    take(&name, package.to_string().as_bytes());
                    packages.insert(name);
                }
            }
        }
    }
    for profile in ["release", "web"] {
        let profile = &workspace["profile"][profile];
        take("profile", profile.to_string().as_bytes());
    }
    for line in locked(&table(&root.join("Cargo.lock"))?, packages)? {
        take("package", line.as_bytes());
    }
    let mut files = Vec::new();
    for folder in &crates {
        files.push(folder.join("Cargo.toml"));
        list(&folder.join("src"), &mut files)?;
    }
    files.retain(|file| !is_test(file));
    files.sort();
    for file in files {
        let name = file.strip_prefix(root)?.to_string_lossy().into_owned();
        take(&name, &fs::read(&file).with_context(|| format!("cannot read {name}"))?);
    }
    Ok(format!("{}\n", hasher.finalize()))
}

fn table(path: &Path) -> anyhow::Result<Table> {
    let text =
        fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(text.parse()?)
}

/// The packages that crates of the workspace may use, and the folders of those that are its own.
fn dependencies(workspace: &Table) -> anyhow::Result<BTreeMap<String, (Value, Option<String>)>> {
    let listed = workspace["workspace"]["dependencies"].as_table();
    let listed = listed.ok_or_else(|| anyhow!("the workspace lists no packages"))?;
    let folder = |value: &Value| Some(value.get("path")?.as_str()?.to_owned());
    Ok(listed.iter().map(|(name, value)| (name.clone(), (value.clone(), folder(value)))).collect())
}

/// The packages that a crate uses in a browser.
fn used(manifest: &Table) -> BTreeSet<String> {
    let mut tables: Vec<&Value> = manifest.get("dependencies").into_iter().collect();
    if let Some(targets) = manifest.get("target").and_then(Value::as_table) {
        let in_browsers = targets.iter().filter(|(target, _)| !target.contains("not("));
        tables.extend(in_browsers.filter_map(|(_, of)| of.get("dependencies")));
    }
    let is_optional = |value: &Value| value.get("optional").and_then(Value::as_bool) == Some(true);
    let of_table = |table: &&Value| {
        let entries = table.as_table().cloned().unwrap_or_default();
        entries.into_iter().filter(move |(_, value)| !is_optional(value)).map(|(name, _)| name)
    };
    tables.iter().flat_map(of_table).collect()
}

/// The names and versions of packages, and of those that they use, as they are locked.
fn locked(lock: &Table, names: BTreeSet<String>) -> anyhow::Result<BTreeSet<String>> {
    let packages = lock["package"].as_array().context("Cargo.lock lists packages")?;
    let text = |of: &Value, key: &str| of.get(key).and_then(Value::as_str).map(str::to_owned);
    let mut open: Vec<String> = names.into_iter().collect();
    let mut found = BTreeSet::new();
    while let Some(wanted) = open.pop() {
        // A version follows the name where there are several.
        let (name, version) = match wanted.split_once(' ') {
            Some((name, version)) => (name.to_owned(), Some(version.to_owned())),
            None => (wanted, None),
        };
        for package in packages {
            let is_it = text(package, "name").as_ref() == Some(&name)
                && (version.is_none() || text(package, "version") == version);
            if is_it && found.insert(format!("{name} {:?}", text(package, "version"))) {
                let uses = package.get("dependencies").and_then(Value::as_array);
                open.extend(
                    uses.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned),
                );
            }
        }
    }
    Ok(found)
}

/// Lists all files below a folder.
fn list(folder: &Path, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    for entry in
        fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?
    {
        let path = entry?.path();
        if path.is_dir() {
            list(&path, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}

fn is_test(file: &Path) -> bool {
    file.iter().any(|part| part == "tests" || part == "tests.rs")
}
