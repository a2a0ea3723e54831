//! Names of views as files: within the folder, apart from each other, and possible on every system.

use crate::values::stem;
use std::collections::HashSet;
use tsuya::View;
use unicode_normalization::UnicodeNormalization;

/// Names in the folder that are not views'.
const TAKEN: [&str; 10] =
    ["mask", "diffuse", "specular", "preview", "maps", "white", "mesh", "surface", "transforms", "metadata"];
/// Longest part of a path and longest path, in bytes: room for the folders and endings that are added.
const MAX_PART: usize = 120;
const MAX_NAME: usize = 1000;
/// Names that Windows has given to devices, whatever their ending.
const DEVICES: [&str; 6] = ["CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"];

/// Names of views as relative paths without extension: nothing that leads out of the folder, is hidden, or meets another file, also
/// where upper and lower case, or two spellings of one letter, are the same.
pub fn view_names(views: &[View]) -> Vec<String> {
    let mut used = HashSet::new();
    let name = |(index, view): (usize, &View)| {
        let mut parts: Vec<String> = stem(&view.name).split(['/', '\\']).filter_map(portable).collect();
        // Files end with .exr or .png: no folder does, so that none is called like a file.
        let folders = parts.len().saturating_sub(1);
        for folder in &mut parts[..folders] {
            if stem(folder) != folder {
                *folder += "_";
            }
        }
        let mut name = parts.join("/");
        if name.is_empty() || name.len() > MAX_NAME {
            name = format!("view-{index:03}");
        }
        let first = parts.first().and_then(|first| first.split('.').next()).map(key);
        if first.is_some_and(|first| TAKEN.contains(&first.as_str())) {
            name = format!("photograph/{name}");
        }
        while !used.insert(key(&name)) {
            name = format!("{name}-{index:03}");
        }
        name
    };
    views.iter().enumerate().map(name).collect()
}

/// The same for all names that some file system takes for one.
fn key(name: &str) -> String {
    name.nfkd().flat_map(char::to_lowercase).nfkd().collect()
}

/// A part of a path as every system takes it; `None` for one that says nothing or is too long.
fn portable(part: &str) -> Option<String> {
    let shown: String = part.chars().filter(|&c| !r#":*?"<>|"#.contains(c)).collect();
    let shown = crate::output::without_controls(&shown);
    // Hidden files are not read; Windows drops dots and spaces at the end.
    let mut part = shown.trim_start_matches(['.', ' ']).trim_end_matches(['.', ' ']).to_owned();
    let device = part.split('.').next().unwrap_or_default().trim_end().to_uppercase();
    let numbered = device.strip_prefix("COM").or(device.strip_prefix("LPT"));
    let is_number =
        |rest: &str| rest.chars().count() == 1 && rest.chars().all(|c| "0123456789\u{b9}\u{b2}\u{b3}".contains(c));
    if DEVICES.contains(&device.as_str()) || numbered.is_some_and(is_number) {
        part = format!("_{part}");
    }
    (!part.is_empty() && part.len() <= MAX_PART).then_some(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(names: &[&str]) -> Vec<String> {
        let view = |name: &&str| View { name: name.to_string(), camera: Default::default(), light: None };
        view_names(&names.iter().map(view).collect::<Vec<_>>())
    }

    #[test]
    fn names_stay_in_the_folder_and_apart() {
        let names = ["off/000.exr", "../../etc/x", "/abs/y.png", "mask/a", "", "OFF/000.png", "..", "C:\\z.jpg", "v.1"];
        let expected =
            ["off/000", "etc/x", "abs/y", "photograph/mask/a", "view-004", "OFF/000-005", "view-006", "C/z", "v.1"];
        assert_eq!(found(&names), expected);
        // A file is never where a folder is to be.
        assert_eq!(found(&["a", "a.exr/b", "b.PNG", "b.png/c/d.exr"]), ["a", "a.exr_/b", "b", "b.png_/c/d"]);
        assert_eq!(
            found(&["mesh.ply/a", "Transforms.json/b"]),
            ["photograph/mesh.ply/a", "photograph/Transforms.json/b"]
        );
        // What is the same once letters are taken away, in another case, or spelt otherwise.
        let same = ["a?b", "a*b", "A\u{7}B", "\u{e9}", "e\u{301}", "\u{212a}", "k"];
        assert_eq!(found(&same), ["ab", "ab-001", "AB-002", "\u{e9}", "e\u{301}-004", "\u{212a}", "k-006"]);
    }

    #[test]
    fn names_are_possible_everywhere() {
        let names = [
            "CON",
            "nul.exr",
            "com1.a/x",
            "LPT\u{b2}",
            "a. . ",
            ".ssh/id",
            "aux .png",
            "console",
            "x\u{202e}gpj.y",
            "...",
        ];
        let expected =
            ["_CON", "_nul", "_com1.a/x", "_LPT\u{b2}", "a", "ssh/id", "_aux", "console", "xgpj.y", "view-009"];
        assert_eq!(found(&names), expected);
        let long = format!("{}/{}/x", "a".repeat(121), "b".repeat(120));
        assert_eq!(found(&[&long]), [format!("{}/x", "b".repeat(120))]);
    }
}
