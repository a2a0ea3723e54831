//! Names of views, from the paths of their photographs.

use crate::input::Folder;
use std::path::Path;

/// Names of the views: the photographs' paths relative to the capture. Where photographs outside are allowed, what they all have in
/// common is left out, so that no file tells how somebody's disk is ordered.
pub(super) fn view_names(folder: &Folder, paths: &[&str]) -> Vec<String> {
    let portable: Vec<_> = paths.iter().map(|path| folder.portable(path)).collect();
    let paths: Vec<&str> = portable.iter().map(|path| &**path).collect();
    let roots = [std::path::absolute(folder.path()).ok(), folder.path().canonicalize().ok()];
    let inside = |path: &str| -> Option<String> {
        if !Path::new(path).is_absolute() {
            let leaves = |part: &str| part == ".." || part.ends_with(':');
            return (!path.split(['/', '\\']).any(leaves)).then(|| path.to_owned());
        }
        let below = roots.iter().flatten().find_map(|root| Path::new(path).strip_prefix(root).ok())?;
        Some(below.to_str()?.to_owned())
    };
    let relative: Vec<Option<String>> = paths.iter().map(|path| inside(path)).collect();
    let outside = || paths.iter().zip(&relative).filter(|(_, inside)| inside.is_none()).map(|(path, _)| *path);
    let mut common: Option<Vec<&str>> = None;
    for path in outside() {
        let folders = path.rsplit_once(['/', '\\']).map_or("", |(folders, _)| folders);
        let parts = folders.split(['/', '\\']);
        common = Some(match common {
            None => parts.collect(),
            Some(before) => before.into_iter().zip(parts).take_while(|(a, b)| a == b).map(|(a, _)| a).collect(),
        });
    }
    let skipped = common.map_or(0, |parts| parts.len());
    let name = |(path, inside): (&&str, &Option<String>)| match inside {
        Some(name) => name.trim_start_matches("./").to_owned(),
        None => path
            .split(['/', '\\'])
            .skip(skipped)
            .filter(|part| !["", ".", ".."].contains(part))
            .collect::<Vec<_>>()
            .join("/"),
    };
    paths.iter().zip(&relative).map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_tells_where_the_capture_lies() {
        let outer = tempfile::tempdir().unwrap();
        let folder = Folder::new(outer.path(), "transforms.json", true);
        let own = outer.path().join("b/2.png");
        let paths =
            ["./a/1.png", own.to_str().unwrap(), "/home/somebody/x/3.png", "/home/somebody/y/3.png", "a/./4.png"];
        assert_eq!(view_names(&folder, &paths), ["a/1.png", "b/2.png", "x/3.png", "y/3.png", "a/./4.png"]);
        assert_eq!(view_names(&folder, &["../x/1.png", "../x/2.png"]), ["1.png", "2.png"]);
        assert_eq!(view_names(&folder, &["../x/1.png", "/y/2.png"]), ["x/1.png", "y/2.png"]);
        assert_eq!(view_names(&folder, &["C:\\Users\\me\\1.png"]), ["1.png"]);
    }
}
