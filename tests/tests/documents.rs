//! What the documents say of the code, and how its modules depend on each other.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

type Graph = BTreeMap<String, BTreeSet<String>>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All files below a folder that end in `.extension`, apart from build products.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = entry.file_name();
            if path.is_dir() {
                if name != "target" && !name.to_string_lossy().starts_with('.') {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|is| is == extension) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// The folders of all crates of the workspace, as the root manifest lists them.
fn members() -> Vec<PathBuf> {
    let manifest = read(&root().join("Cargo.toml"));
    let list = manifest.split_once("members = [").and_then(|(_, rest)| rest.split_once(']'));
    let (list, _) = list.expect("the workspace lists its members");
    list.split(',')
        .map(|member| member.trim().trim_matches('"'))
        .filter(|member| !member.is_empty())
        .map(|member| root().join(member))
        .collect()
}

/// Which crate of the workspace depends on which, as the manifests say; tests left out.
fn crates() -> Graph {
    let of = |folder: &PathBuf| {
        let manifest = read(&folder.join("Cargo.toml"));
        let name = manifest.lines().find_map(|line| line.strip_prefix("name = "));
        let mut section = "";
        let mut uses = BTreeSet::new();
        for line in manifest.lines() {
            if line.starts_with('[') {
                section = line;
            } else if section == "[dependencies]"
                && let Some(rest) = line.strip_prefix("sightline-")
            {
                uses.insert(rest.split(['.', ' ']).next().unwrap_or_default().to_owned());
            }
        }
        let name = name.expect("every crate has a name").trim_matches('"');
        (name.strip_prefix("sightline-").unwrap_or(name).to_owned(), uses)
    };
    members().iter().map(of).collect()
}

/// The nodes that lie on cycles of a graph, or between two of them.
fn cycle(graph: &Graph) -> Graph {
    let mut left = graph.clone();
    loop {
        let used: BTreeSet<String> = left.values().flatten().cloned().collect();
        let count = left.len();
        let known: BTreeSet<String> = left.keys().cloned().collect();
        left.retain(|name, uses| used.contains(name) && !uses.is_disjoint(&known));
        let known: BTreeSet<String> = left.keys().cloned().collect();
        left.values_mut().for_each(|uses| uses.retain(|name| known.contains(name)));
        if left.len() == count {
            return left;
        }
    }
}

#[test]
fn the_architecture_page_names_every_crate_and_arrow() {
    let page = read(&root().join("ARCHITECTURE.md"));
    let mut told = Graph::new();
    for line in page.lines() {
        if let Some((name, uses)) = line.split_once(" -> ") {
            let uses = uses.split_whitespace().filter(|word| *word != "-").map(str::to_owned);
            told.insert(name.trim().to_owned(), uses.collect());
        }
    }
    assert_eq!(told, crates());
    assert_eq!(cycle(&told), Graph::new());
}

#[test]
fn front_pages_are_short() {
    for (page, bytes_max) in [("README.md", 5_000), ("ARCHITECTURE.md", 8_192)] {
        let bytes = read(&root().join(page)).len();
        assert!(bytes <= bytes_max, "{page} has {bytes} bytes");
    }
}

#[test]
fn links_of_documents_lead_somewhere() {
    let mut broken = Vec::new();
    for page in files(&root(), "md") {
        let text = read(&page);
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let target = link.split('#').next().unwrap_or_default();
            let is_file = !target.is_empty() && !target.contains("://");
            let folder = page.parent().unwrap_or(Path::new("."));
            if is_file && !target.contains(' ') && !folder.join(target).exists() {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

/// Documents name tests as "`FILE`: `TEST`, `TEST`".
#[test]
fn tests_that_documents_name_exist() {
    let mut missing = Vec::new();
    for page in files(&root(), "md") {
        let text = read(&page);
        let parts: Vec<&str> = text.split('`').collect();
        let mut file = None;
        for pair in parts.windows(2).step_by(2) {
            let [between, code] = [pair[0], pair[1]];
            let path = root().join(code);
            let is_name =
                code.contains('_') && code.chars().all(|c| c == '_' || c.is_alphanumeric());
            if code.ends_with(".rs") && path.is_file() {
                file = Some(read(&path));
            } else if !(is_name && [": ", ", "].contains(&between)) {
                file = None;
            } else if file.as_ref().is_some_and(|file| !file.contains(&format!("fn {code}("))) {
                missing.push(format!("{}: {code}", page.display()));
            }
        }
    }
    assert!(missing.is_empty(), "{missing:#?}");
}

#[test]
fn paths_that_documents_name_exist() {
    let mut broken = Vec::new();
    for page in files(&root(), "md") {
        for code in read(&page).split('`').skip(1).step_by(2) {
            let is_path = ["shared/", "server/", "client/", "tests/", "docs/"]
                .iter()
                .any(|folder| code.starts_with(folder));
            let is_plain = code.chars().all(|c| c.is_ascii_alphanumeric() || "/_-.".contains(c));
            let is_module = || root().join(format!("{code}.rs")).exists();
            if is_path && is_plain && !root().join(code).exists() && !is_module() {
                broken.push(format!("{}: {code}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

/// The part of a source file that is no test.
fn production(text: &str) -> &str {
    text.split_once("#[cfg(test)]\nmod tests {").map_or(text, |(head, _)| head)
}

/// The top-level modules of a crate, and which of them name which.
fn modules(source: &Path) -> Graph {
    let front = fs::read_to_string(source.join("lib.rs")).unwrap_or_default();
    let declared = |line: &str| {
        let line = line.trim_start_matches("pub ").trim_start_matches("pub(crate) ");
        line.strip_prefix("mod ").and_then(|rest| rest.strip_suffix(';')).map(str::to_owned)
    };
    let names: BTreeSet<String> = front.lines().filter_map(declared).collect();
    let exports = exports(&front, &names);
    let mut graph: Graph = names.iter().map(|name| (name.clone(), BTreeSet::new())).collect();
    for file in files(source, "rs") {
        let inside = file.strip_prefix(source).unwrap_or(&file);
        let mut parts: Vec<String> =
            inside.iter().map(|part| part.to_string_lossy().replace(".rs", "")).collect();
        if parts.iter().any(|part| part == "tests") {
            continue;
        }
        let is_folder = parts.last().is_some_and(|last| last == "mod");
        let depth = parts.len() - usize::from(is_folder);
        parts.truncate(1);
        let Some(own) = parts.pop().filter(|own| names.contains(own)) else { continue };
        let text = read(&file);
        for path in paths(production(&text), depth) {
            let target = exports.get(&path).unwrap_or(&path);
            if names.contains(target) && *target != own {
                graph.entry(own.clone()).or_default().insert(target.clone());
            }
        }
    }
    graph
}

/// Which module each name comes from that the front page of a crate hands on.
fn exports(front: &str, names: &BTreeSet<String>) -> BTreeMap<String, String> {
    let mut exports = BTreeMap::new();
    for statement in front.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next()) {
        let Some((module, items)) = statement.split_once("::") else { continue };
        if names.contains(module) {
            for item in items.split(|c: char| !c.is_alphanumeric() && c != '_') {
                exports.insert(item.to_owned(), module.to_owned());
            }
        }
    }
    exports
}

/// The first names of all paths from the root of the crate, in a file `depth` folders below it.
fn paths(text: &str, depth: usize) -> BTreeSet<String> {
    let up = "super::".repeat(depth);
    let mut found = BTreeSet::new();
    for line in text.lines().filter(|line| !line.trim_start().starts_with("//")) {
        for start in ["crate::", up.as_str()] {
            for (at, _) in line.match_indices(start) {
                let before = line[..at].chars().next_back();
                if start != "crate::" && before.is_some_and(|c| c == ':' || c.is_alphanumeric()) {
                    continue;
                }
                let rest = &line[at + start.len()..];
                found.extend(first_name(rest));
            }
        }
    }
    for statement in text.split("use ").skip(1).filter_map(|rest| rest.split(';').next()) {
        for start in ["crate::{", &format!("{up}{{")] {
            if let Some(list) = statement.strip_prefix(start) {
                found.extend(list_heads(list));
            }
        }
    }
    found
}

fn first_name(path: &str) -> Option<String> {
    let end = path.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(path.len());
    (end > 0).then(|| path[..end].to_owned())
}

/// The first names of the items of a braced list, whose opening brace is left out.
fn list_heads(list: &str) -> Vec<String> {
    let mut heads = Vec::new();
    let (mut depth, mut is_start) = (0, true);
    for (at, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => is_start = true,
            c if is_start && depth == 0 && !c.is_whitespace() => {
                heads.extend(first_name(&list[at..]));
                is_start = false;
            }
            _ => {}
        }
    }
    heads
}

#[test]
fn no_crate_has_a_cycle_between_its_modules() {
    let mut cycles = BTreeMap::new();
    for folder in members() {
        let found = cycle(&modules(&folder.join("src")));
        if !found.is_empty() {
            cycles.insert(folder, found);
        }
    }
    assert!(cycles.is_empty(), "{cycles:#?}");
}
