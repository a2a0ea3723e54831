//! Which files the page consists of: its own, within the program or in a folder, and the one that it shows.

use crate::source::{self, has_extension, limits};
use anyhow::Result;
use hyper::body::Bytes;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tsuya::gltf::{self, Document, EXTENSION};
use tsuya::{Budget, Error};

/// The page as `tools/web/viewer/build` makes it; empty in a program that was built without it.
#[derive(rust_embed::RustEmbed)]
#[folder = "tools/web/dist"]
#[allow_missing = true]
struct Built;

/// The page's first file.
const FIRST: &str = "index.html";
/// Where the file that is shown lies, and what lies beside it.
const SHOWN: &str = "shown";

/// One file's content.
pub enum Content {
    /// Within the program.
    Held(Bytes),
    /// On disk.
    File(PathBuf),
}

impl Content {
    /// All of it.
    pub fn read(&self) -> Result<Bytes> {
        match self {
            Content::Held(bytes) => Ok(bytes.clone()),
            Content::File(path) => Ok(std::fs::read(path).map_err(|e| Error::io(path, e))?.into()),
        }
    }
}

/// All that is served, by path below the root. Nothing else can be asked for.
pub struct Site(BTreeMap<String, Content>);

impl Site {
    /// The page from `assets` or within the program, and the file that it shows.
    pub fn new(file: &Path, assets: Option<&Path>) -> Result<Self> {
        if !["tsuya", "glb", "gltf"].iter().any(|extension| has_extension(file, extension)) {
            return Err(
                Error::parameter(format!("{}: a .tsuya, .glb or .gltf file can be viewed", file.display())).into()
            );
        }
        std::fs::File::open(file).map_err(|e| Error::io(file, e))?;
        let mut files = match assets {
            Some(folder) => folder_files(folder)?,
            None => Built::iter()
                .filter_map(|path| Some((path.to_string(), Content::Held(held(Built::get(&path)?.data)))))
                .collect(),
        };
        if !files.contains_key(FIRST) {
            let message = match assets {
                Some(folder) => format!(
                    "{}: has no {FIRST}: run tools/web/build and tools/web/viewer/build, and name tools/web/dist",
                    folder.display()
                ),
                None => {
                    "this program was built without the viewer's page: run tools/web/build and tools/web/viewer/build, \
                         and build it again, or name the page's folder with --assets"
                        .into()
                }
            };
            return Err(Error::Unsupported(message).into());
        }
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        files.insert(format!("{SHOWN}/{name}"), Content::File(file.to_owned()));
        if !has_extension(file, "tsuya") {
            let folder = file.parent().unwrap_or(Path::new(""));
            for path in references(file) {
                files.insert(format!("{SHOWN}/{path}"), Content::File(folder.join(path)));
            }
        }
        let description = json!({"file": format!("{SHOWN}/{}", gltf::reference(&name)), "name": name});
        files.insert("viewer.json".into(), Content::Held(description.to_string().into()));
        Ok(Site(files))
    }

    /// The content at a path below the root; the root itself is the page.
    pub fn get(&self, path: &str) -> Option<&Content> {
        self.0.get(if path.is_empty() { FIRST } else { path })
    }

    /// True for the page's own files, false for what it shows.
    pub fn is_page(&self, path: &str) -> bool {
        !path.strip_prefix(SHOWN).is_some_and(|rest| rest.starts_with('/'))
    }

    /// Paths and contents.
    pub fn files(&self) -> impl Iterator<Item = (&String, &Content)> {
        self.0.iter()
    }
}

fn held(bytes: Cow<'static, [u8]>) -> Bytes {
    match bytes {
        Cow::Borrowed(bytes) => Bytes::from_static(bytes),
        Cow::Owned(bytes) => bytes.into(),
    }
}

/// The files of a folder and those below, by relative path; links are not followed.
fn folder_files(folder: &Path) -> Result<BTreeMap<String, Content>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![(folder.to_owned(), String::new())];
    while let Some((folder, prefix)) = folders.pop() {
        let failed = |e| Error::io(&folder, e);
        for entry in std::fs::read_dir(&folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let (kind, name) = (entry.file_type().map_err(failed)?, entry.file_name().to_string_lossy().into_owned());
            if kind.is_dir() {
                folders.push((entry.path(), format!("{prefix}{name}/")));
            } else if kind.is_file() {
                files.insert(format!("{prefix}{name}"), Content::File(entry.path()));
            }
        }
    }
    Ok(files)
}

/// What a glTF file has beside it: buffers, pictures, streams that are there. What is wrong with the file, the page says.
fn references(path: &Path) -> Vec<String> {
    let budget = Budget::new(limits());
    let read = || Document::parse(path, &source::read(path).ok()?, &budget).ok();
    let Some(document) = read() else { return Vec::new() };
    let appearances = document.json.get("extensions").and_then(|e| e.get(EXTENSION)?.get("appearances")?.as_array());
    let streams = appearances.map_or(&[][..], Vec::as_slice);
    let objects = document.list("buffers").iter().chain(document.list("images")).chain(streams);
    let folder = path.parent().unwrap_or(Path::new(""));
    let references = objects.filter_map(|object| object.get("uri").and_then(Value::as_str));
    let inside = references.filter_map(|uri| document.check_uri(uri).ok());
    inside.filter(|path| folder.join(path).is_file()).collect()
}
