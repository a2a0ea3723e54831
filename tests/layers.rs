//! The stages of `src` import downwards only: each stands on a floor, and what a file names with `crate::` is on a lower floor or in its own
//! stage. Inside a stage no two files import each other in a circle.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Bottom up.
const FLOORS: &[&[&str]] = &[
    &["elementary", "error", "parallel", "vector"],
    &["limits"],
    &["entropy", "input", "optimise", "options", "sphere"],
    &["image"],
    &["container", "transform"],
    &["quantise"],
    &["residual"],
    &["mesh", "views"],
    &["brdf", "lighting", "surface"],
    &["metrics"],
    &["capture", "rate", "reflectance", "visibility"],
    &["separate"],
    &["asset", "illumination", "predictive", "refine", "wavelet_texture"],
    &["decoder", "relight"],
    &["gltf", "marker", "repair"],
    &["ar", "encoder"],
];

/// Files of the library with their module's path (`["surface", "warp"]`), text without tests.
fn files() -> Vec<(PathBuf, Vec<String>, String)> {
    fn visit(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            let name = entry.file_name().unwrap().to_str().unwrap();
            if entry.is_dir() && name != "bin" {
                visit(&entry, files);
            } else if name.ends_with(".rs") && !["lib.rs", "internals.rs"].contains(&name) && !name.starts_with("test")
            {
                files.push(entry);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    visit(&root, &mut paths);
    paths.sort();
    let module = |path: &Path| {
        let parts = path.strip_prefix(&root).unwrap().with_extension("");
        let mut parts: Vec<String> = parts.iter().map(|part| part.to_str().unwrap().to_string()).collect();
        parts.pop_if(|last| last == "mod");
        parts
    };
    let without_tests = |text: String| {
        let end = ["#[cfg(test)]\nmod tests", "#[cfg(all(test"].iter().filter_map(|mark| text.find(mark)).min();
        text[..end.unwrap_or(text.len())].to_string()
    };
    paths
        .into_iter()
        .map(|path| (path.clone(), module(&path), without_tests(std::fs::read_to_string(&path).unwrap())))
        .collect()
}

/// Paths that a text imports or names, each as its parts from `crate`, `super` or `self` on; groups in braces are taken apart.
fn imports(text: &str) -> Vec<Vec<String>> {
    fn expand(tree: &str, prefix: &[String], found: &mut Vec<Vec<String>>) {
        let tree = tree.trim();
        let Some((head, group)) = tree.split_once('{') else {
            let parts = tree.split("::").map(|part| part.split_whitespace().next().unwrap_or_default().to_string());
            return found.push(prefix.iter().cloned().chain(parts).collect());
        };
        let head = head.split("::").map(str::to_string).filter(|part| !part.is_empty());
        let prefix: Vec<String> = prefix.iter().cloned().chain(head).collect();
        let (mut depth, mut start) = (0, 0);
        let group = &group[..group.rfind('}').unwrap_or(group.len())];
        for (at, sign) in group.char_indices().chain([(group.len(), ',')]) {
            match sign {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    expand(&group[start..at], &prefix, found);
                    start = at + 1;
                }
                _ => {}
            }
        }
    }
    let mut found = Vec::new();
    let code: String = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    for statement in code.split(';') {
        let import = statement.find("use ").map(|at| statement[at + 4..].trim());
        match import.filter(|import| ["crate::", "super::", "self::"].iter().any(|root| import.starts_with(root))) {
            Some(import) => expand(import, &[], &mut found),
            None => {
                for (at, _) in statement.match_indices("crate::").chain(statement.match_indices("super::")) {
                    let path =
                        statement[at..].split(|sign: char| !sign.is_alphanumeric() && sign != '_' && sign != ':');
                    found.push(path.take(1).flat_map(|path| path.split("::")).map(str::to_string).collect());
                }
            }
        }
    }
    found
}

#[test]
fn stages_import_downwards_only() {
    let floor = |stage: &str| FLOORS.iter().position(|floor| floor.contains(&stage));
    let mut wrong = Vec::new();
    for (path, module, text) in files() {
        let Some(own) = floor(&module[0]) else {
            panic!("{}: the stage `{}` stands on no floor", path.display(), module[0])
        };
        for import in imports(&text).iter().filter(|import| import[0] == "crate") {
            match import.get(1).map(|stage| (stage, floor(stage))) {
                Some((stage, Some(other))) if *stage != module[0] && other >= own => {
                    wrong.push(format!("{} imports {}", path.display(), import.join("::")));
                }
                _ => {}
            }
        }
    }
    assert!(wrong.is_empty(), "upwards or sideways:\n{}", wrong.join("\n"));
}

#[test]
fn no_two_files_import_each_other_in_a_circle() {
    let files = files();
    let modules: BTreeSet<Vec<String>> = files.iter().map(|(_, module, _)| module.clone()).collect();
    let mut arrows: BTreeMap<Vec<String>, BTreeSet<Vec<String>>> = BTreeMap::new();
    for (_, module, text) in &files {
        for import in imports(text) {
            let supers = import.iter().take_while(|part| *part == "super").count();
            let base = if import[0] == "crate" { &[][..] } else { &module[..module.len().saturating_sub(supers)] };
            let named = import.iter().filter(|part| !["crate", "super", "self"].contains(&part.as_str())).cloned();
            let mut target: Vec<String> = base.iter().cloned().chain(named).collect();
            while !target.is_empty() && !modules.contains(&target) {
                target.pop();
            }
            // A folder's `mod.rs` and its files may name each other: re-exports and shared constants.
            if !target.is_empty() && !module.starts_with(&target) && !target.starts_with(module) {
                arrows.entry(module.clone()).or_default().insert(target);
            }
        }
    }
    // What imports nothing of the rest, or is imported by nothing of it, stands in no circle.
    loop {
        let before = arrows.len();
        let sources: BTreeSet<_> = arrows.keys().cloned().collect();
        arrows.values_mut().for_each(|targets| targets.retain(|target| sources.contains(target)));
        let targets: BTreeSet<_> = arrows.values().flatten().cloned().collect();
        arrows.retain(|module, imported| !imported.is_empty() && targets.contains(module));
        if arrows.len() == before {
            break;
        }
    }
    let line =
        |(module, target): (&Vec<String>, &Vec<String>)| format!("{} imports {}", module.join("::"), target.join("::"));
    let circles: Vec<_> =
        arrows.iter().flat_map(|(module, targets)| targets.iter().map(move |target| line((module, target)))).collect();
    assert!(circles.is_empty(), "in circles, or between them:\n{}", circles.join("\n"));
}
