//! Files that a glTF document refers to, and which of them a page may be given.
//!
//! A document may come from anybody, and what it refers to is served or published with it. So only files of its own folder are taken, links
//! followed, nothing hidden, and only those that are called as buffers, images and streams are.

use crate::source::{self, limits};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use tsuya::gltf::{self, EXTENSION, GltfDocument};
use tsuya::input::{Folder, quoted};
use tsuya::{Budget, Error};

/// References of one document that are looked at.
const MAX_REFERENCES: usize = 10_000;
/// Folders above its own that a document may refer to where it may at all.
const MAX_LEVELS_UP: usize = 16;
/// Endings of glTF buffers (IANA, model/gltf-buffer), of images by glTF 2.0 and its extensions, and of streams.
const KINDS: [(&str, &[&str]); 3] = [
    ("buffers", &["bin", "glbin", "glbuf"]),
    ("images", &["png", "jpg", "jpeg", "webp", "avif", "ktx2", "dds"]),
    ("appearances", &["tsuya"]),
];

/// What a document refers to.
#[derive(Default)]
pub struct References {
    /// Paths on disk, relative to the document's folder, by the paths that a browser asks for: the same without `.` and `..`, seen from the
    /// folder `levels_up` above the document's.
    pub files: BTreeMap<String, String>,
    /// Levels of folders above the document's own that paths lead up to.
    pub levels_up: usize,
    /// What is not taken along.
    pub left_out: LeftOut,
}

/// References that are not taken along, and why.
#[derive(Default)]
pub struct LeftOut {
    /// Those that may not.
    pub refused: Vec<Error>,
    /// Those of which there is no file.
    pub missing: Vec<Error>,
}

/// A reference's path on disk and, for the browser, how far it leads up and then down.
struct Reference {
    path: String,
    levels_up: usize,
    below: String,
}

impl References {
    /// Reads the document at `path`. What is wrong with it as a whole, the page says.
    pub fn of(path: &Path, folder: &Folder) -> Self {
        let mut references = References::default();
        let budget = Budget::new(limits());
        let document = source::read(path).ok().and_then(|bytes| GltfDocument::parse(path, &bytes, &budget).ok());
        let Some(document) = document else { return references };
        let mut seen = BTreeSet::new();
        let uris: Vec<(&str, usize)> = (0..KINDS.len())
            .flat_map(|kind| objects(&document, KINDS[kind].0).iter().map(move |object| (object, kind)))
            .filter_map(|(object, kind)| Some((object.get("uri")?.as_str()?, kind)))
            .filter(|&(uri, kind)| !is_data(uri) && seen.insert((uri, kind)))
            .collect();
        let mut taken = Vec::new();
        for &(uri, kind) in uris.iter().take(MAX_REFERENCES) {
            match checked(path, folder, uri, KINDS[kind]) {
                Ok(reference) if folder.resolve(&reference.path).is_ok_and(|path| path.is_file()) => {
                    taken.push(reference)
                }
                Ok(reference) => {
                    references
                        .left_out
                        .missing
                        .push(Error::input(path, format!("{} is not there", quoted(&reference.path))));
                }
                Err(error) => references.left_out.refused.push(error),
            }
        }
        if let Some(more) = uris.len().checked_sub(MAX_REFERENCES).filter(|&more| more > 0) {
            let message = format!("{more} files are left out: {MAX_REFERENCES} at most are taken along");
            references.left_out.refused.push(Error::input(path, message));
        }
        references.levels_up = taken.iter().map(|reference| reference.levels_up).max().unwrap_or(0);
        let key = |reference: &Reference| {
            let up = "up/".repeat(references.levels_up - reference.levels_up);
            format!("{up}{}", reference.below)
        };
        references.files = taken.iter().map(|reference| (key(reference), reference.path.clone())).collect();
        references
    }

    /// Where the document itself is for the browser.
    pub fn place_of(&self, name: &str) -> String {
        format!("{}{name}", "up/".repeat(self.levels_up))
    }
}

/// Objects of a document that may have a `uri`.
fn objects<'a>(document: &'a GltfDocument, list: &str) -> &'a [Value] {
    if list != "appearances" {
        return document.list(list);
    }
    let extension = document.json.get("extensions").and_then(|extensions| extensions.get(EXTENSION));
    extension.and_then(|extension| extension.get(list)?.as_array()).map_or(&[], Vec::as_slice)
}

/// Whether a reference holds the data itself.
fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// The reference as a path that a page may be given.
fn checked(document: &Path, folder: &Folder, uri: &str, (list, endings): (&str, &[&str])) -> Result<Reference, Error> {
    let wrong = |why: &str| Error::input(document, format!("the reference {} {why}", quoted(uri)));
    let path = gltf::path_of(uri).ok_or_else(|| wrong("has a wrong % escape"))?;
    let before_colon = uri.split(['/', '?', '#']).next().unwrap_or_default();
    if before_colon.contains(':') {
        return Err(wrong("is an address; pages are given files beside the document alone"));
    }
    if path.starts_with('/') {
        folder.resolve(&path)?;
        return Err(wrong("is absolute; a browser finds files by paths from the document's folder alone"));
    }
    if uri.contains(['?', '#']) || path.contains('\\') || path.chars().any(char::is_control) {
        return Err(wrong("has characters that no path of a file here has (\\, ?, #, control characters)"));
    }
    folder.resolve(&path)?;
    let ending = path.rsplit_once('.').map_or("", |(_, ending)| ending);
    if !folder.allows_outside() && !endings.iter().any(|known| known.eq_ignore_ascii_case(ending)) {
        let known = endings.join(", .");
        return Err(wrong(&format!(
            "is not called as {list} are (.{known}), and is not taken along unless --allow-outside is given"
        )));
    }
    let (levels_up, below) = as_asked_for(&path);
    if levels_up > MAX_LEVELS_UP {
        return Err(wrong("leads up too far"));
    }
    Ok(Reference { path, levels_up, below })
}

/// How a browser takes a relative path: levels up, and the path from there, without `.` and `..`.
fn as_asked_for(path: &str) -> (usize, String) {
    let (mut levels_up, mut parts) = (0, Vec::new());
    for part in path.split('/') {
        match part {
            "." => {}
            ".." if parts.is_empty() => levels_up += 1,
            ".." => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    (levels_up, parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Files taken along and refusals of a document with these buffers and images, in a folder with some files.
    fn references(buffers: &[&str], images: &[&str], allow_outside: bool) -> (Vec<String>, usize, String) {
        let outer = tempfile::tempdir().unwrap();
        let root = outer.path().join("object");
        std::fs::create_dir_all(root.join("maps")).unwrap();
        std::fs::create_dir_all(root.join(".ssh")).unwrap();
        let files =
            ["a.bin", "maps/a b.png", "tax.pdf", ".ssh/id.bin", ".ssh/id_rsa", ".a.png", "../outside.bin", "id"];
        files.iter().for_each(|name| std::fs::write(root.join(name), name).unwrap());
        #[cfg(unix)]
        std::os::unix::fs::symlink("../outside.bin", root.join("link.bin")).unwrap();
        let list = |uris: &[&str]| uris.iter().map(|uri| json!({ "uri": uri })).collect::<Vec<_>>();
        let document = json!({"asset": {"version": "2.0"}, "buffers": list(buffers), "images": list(images)});
        let path = root.join("object.gltf");
        std::fs::write(&path, document.to_string()).unwrap();
        let references = References::of(&path, &Folder::containing(&path, allow_outside));
        let refused: Vec<String> = references.left_out.refused.iter().map(|error| error.to_string()).collect();
        (references.files.into_keys().collect(), references.levels_up, refused.join("\n"))
    }

    #[test]
    fn only_buffers_and_images_of_the_documents_own_folder_are_taken_along() {
        let (files, levels_up, refused) =
            references(&["a.bin", "./maps/../a.bin"], &["maps/a%20b.png", "maps/none.png"], false);
        assert_eq!((files, levels_up, refused.as_str()), (vec!["a.bin".into(), "maps/a b.png".into()], 0, ""));
        for (uri, why) in [
            (".ssh/id.bin", "names something hidden"),
            ("%2essh/id.bin", "names something hidden"),
            (".ssh/id_rsa", "names something hidden"),
            ("id", "is not called as buffers are (.bin, .glbin, .glbuf)"),
            ("tax.pdf", "is not called as buffers are"),
            ("../outside.bin", "leads out of its folder"),
            ("%2e%2E/outside.bin", "leads out of its folder"),
            ("..%2foutside.bin", "leads out of its folder"),
            ("maps/../../outside.bin", "leads out of its folder"),
            ("..\\outside.bin", "has characters"),
            ("..%5Coutside.bin", "has characters"),
            ("/etc/passwd", "is absolute"),
            ("%2fetc/passwd", "is absolute"),
            ("//host/a.bin", "is absolute"),
            ("file:///etc/passwd", "is an address"),
            ("FILE:a.bin", "is an address"),
            ("C:/a.bin", "is an address"),
            ("https://elsewhere.example/a.bin", "is an address"),
            ("a.bin%00.png", "has characters"),
            ("a.bin%", "has a wrong % escape"),
            ("a.bin?b", "has characters"),
            #[cfg(unix)]
            ("link.bin", "leads out of its folder by a link"),
        ] {
            let (files, _, refused) = references(&[uri], &[], false);
            assert!(files.is_empty() && refused.contains(why), "{uri}: {files:?}, {refused}");
            assert!(refused.contains("object.gltf: "), "{refused}");
        }
        assert!(references(&[], &["a.bin"], false).2.contains("is not called as images are (.png, .jpg"));
        assert_eq!(references(&["data:,a", "DATA:;base64,"], &[], false), (Vec::new(), 0, String::new()));
    }

    #[test]
    fn outside_is_taken_along_where_it_is_allowed() {
        let (files, levels_up, refused) = references(&["a.bin", "../outside.bin", ".ssh/id.bin"], &["tax.pdf"], true);
        // The document is one level down, as the browser counts.
        assert_eq!(
            (files, levels_up),
            (["outside.bin", "up/.ssh/id.bin", "up/a.bin", "up/tax.pdf"].map(String::from).into(), 1)
        );
        assert_eq!(refused, "");
        assert!(references(&["/etc/passwd"], &[], true).2.contains("is absolute"));
    }
}
