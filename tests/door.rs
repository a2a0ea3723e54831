//! The library's door stays narrow: few public modules, and a type's name that stands for one type only.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const MAX_PUBLIC_MODULES: usize = 15;
/// Share of type definitions whose name another type has as well, private ones counted.
const MAX_REUSED_NAMES: f64 = 0.05;

/// The library's files, the program's left out.
fn sources() -> Vec<(PathBuf, String)> {
    fn visit(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() && !entry.ends_with("bin") {
                visit(&entry, files);
            } else if entry.extension().is_some_and(|extension| extension == "rs") {
                files.push(entry);
            }
        }
    }
    let mut files = Vec::new();
    visit(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut files);
    files.into_iter().map(|path| (path.clone(), std::fs::read_to_string(path).unwrap())).collect()
}

#[test]
fn few_modules_are_public() {
    let mut modules: Vec<String> = Vec::new();
    for (path, text) in sources().iter().filter(|(path, _)| !path.ends_with("internals.rs")) {
        let names = text.lines().filter_map(|line| line.trim_start().strip_prefix("pub mod "));
        modules.extend(names.map(|name| format!("{}: {name}", path.display())));
    }
    modules.retain(|module| !module.ends_with(": internals;"));
    assert!(
        !modules.is_empty() && modules.len() <= MAX_PUBLIC_MODULES,
        "{} public modules: {modules:#?}",
        modules.len()
    );
}

#[test]
fn a_type_has_a_name_of_its_own() {
    let mut places: BTreeMap<String, Vec<(bool, String)>> = BTreeMap::new();
    for (path, text) in sources() {
        let text = &text[..text.find("#[cfg(test)]\nmod tests {").unwrap_or(text.len())];
        // Associated types and those of a function's body are indented.
        for line in text.lines().filter(|line| !line.starts_with(' ')) {
            let is_public = line.starts_with("pub ");
            let item =
                line.strip_prefix("pub").map_or(line, |rest| rest.trim_start_matches(|c: char| c != ' ').trim_start());
            let kinds = ["struct ", "enum ", "trait ", "type ", "union "];
            let Some(name) = kinds.iter().find_map(|kind| item.strip_prefix(kind)) else { continue };
            let name: String = name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            places.entry(name).or_default().push((is_public, path.display().to_string()));
        }
    }
    let total: usize = places.values().map(Vec::len).sum();
    places.retain(|_, definitions| definitions.len() > 1);
    let public =
        places.iter().find(|(_, definitions)| definitions.iter().filter(|(is_public, _)| *is_public).count() > 1);
    assert!(public.is_none(), "public twice: {public:?}");
    let reused: usize = places.values().map(Vec::len).sum();
    assert!(total > 300 && reused as f64 <= MAX_REUSED_NAMES * total as f64, "{reused} of {total}: {places:#?}");
}

/// glam's version is then no part of the interface.
#[test]
fn public_functions_take_arrays() {
    let mut signatures = 0;
    for (path, text) in sources() {
        for (at, _) in text.match_indices("pub fn ") {
            let signature = text[at..].split(['{', ';']).next().unwrap();
            let mut words = signature.split(|c: char| !c.is_alphanumeric());
            let glam = words
                .find(|word| ["Vec2", "Vec3", "Vec4", "Mat3", "Mat4", "Quat"].contains(&word.trim_start_matches('D')));
            assert!(glam.is_none(), "{}: {signature}", path.display());
            signatures += 1;
        }
    }
    assert!(signatures > 200, "{signatures}");
}

#[test]
fn every_dependency_is_used() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).unwrap();
    let (mut table, mut dependencies) = (String::new(), Vec::new());
    for line in manifest.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            table = name.to_owned();
        } else if let Some((name, _)) = line.split_once(" = ")
            && (table == "dependencies" || table.ends_with(".dependencies"))
        {
            dependencies.push(name.replace('-', "_"));
        }
    }
    assert!(dependencies.len() > 20, "{dependencies:?}");
    let mut text: String = sources().into_iter().map(|(_, text)| text).collect();
    text += &program_sources(&root.join("src/bin"));
    let is_named = |name: &str| {
        let is_start = |at: usize| !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        text.match_indices(name).any(|(at, _)| is_start(at) && text[at + name.len()..].starts_with("::"))
    };
    dependencies.retain(|name| !is_named(name));
    assert!(dependencies.is_empty(), "no source names {dependencies:?}");
}

fn program_sources(folder: &Path) -> String {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let text = |path: PathBuf| match path.is_dir() {
        true => program_sources(&path),
        false => std::fs::read_to_string(path).unwrap(),
    };
    entries.map(text).collect()
}
