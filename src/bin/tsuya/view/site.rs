//! Which files the page consists of: its own, within the program or in a folder, and the one that it shows.

use super::references::{LeftOut, References};
use crate::source::has_extension;
use anyhow::{Context, Result};
use hyper::body::Bytes;
use serde_json::json;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use tsuya::input::{self, Folder};
use tsuya::{Error, gltf};

/// The page as `tools/web/viewer/build` makes it; empty in a program that was built without it.
#[derive(rust_embed::RustEmbed)]
#[folder = "tools/web/dist"]
#[allow_missing = true]
struct Built;

/// The page's first file.
const FIRST: &str = "index.html";
/// Where the file that is shown lies, and what lies beside it.
const SHOWN: &str = "shown/";
/// Files of a page in a folder; a folder with more is none.
const MAX_PAGE_FILES: usize = 1000;

/// One file's content.
#[derive(Clone)]
pub enum Content {
    /// Within the program.
    Held(Bytes),
    /// On disk, as the user calls it.
    File(PathBuf),
    /// On disk, as a document calls it that may not lead out of its folder.
    Named(Folder, String),
}

impl Content {
    /// All of it.
    pub fn read(&self) -> tsuya::Result<Bytes> {
        let path = match self {
            Content::Held(bytes) => return Ok(bytes.clone()),
            on_disk => on_disk.path()?,
        };
        let mut bytes = Vec::new();
        input::open(&path)?.0.read_to_end(&mut bytes).map_err(|e| Error::io(&path, e))?;
        Ok(bytes.into())
    }

    /// Opens the file, wherever its name leads by now.
    pub fn open(&self) -> tsuya::Result<File> {
        Ok(input::open(&self.path()?)?.0)
    }

    fn path(&self) -> tsuya::Result<PathBuf> {
        match self {
            Content::Held(_) => Err(Error::parameter("not a file on disk")),
            Content::File(path) => Ok(path.clone()),
            Content::Named(folder, name) => folder.resolve(name),
        }
    }
}

/// All that is served, by path below the root. Nothing else can be asked for.
pub struct Site {
    files: BTreeMap<String, Content>,
    left_out: LeftOut,
}

impl Site {
    /// The page from `assets` or within the program, and the file that it shows.
    pub fn new(file: &Path, assets: Option<&Path>, allow_outside: bool) -> Result<Self> {
        if !["tsuya", "glb", "gltf"].iter().any(|extension| has_extension(file, extension)) {
            return Err(
                Error::parameter(format!("{}: a .tsuya, .glb or .gltf file can be viewed", file.display())).into()
            );
        }
        input::open(file)?;
        let mut files = page(assets)?;
        let folder = Folder::containing(file, allow_outside);
        let references =
            if has_extension(file, "tsuya") { References::default() } else { References::of(file, &folder) };
        for (place, path) in &references.files {
            files.insert(format!("{SHOWN}{place}"), Content::Named(folder.clone(), path.clone()));
        }
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let place = |name: &str| format!("{SHOWN}{}", references.place_of(name));
        let description = json!({"file": place(&gltf::reference(&name)), "name": name});
        files.insert(place(&name), Content::File(file.to_owned()));
        files.insert("viewer.json".into(), Content::Held(description.to_string().into()));
        Ok(Site { files, left_out: references.left_out })
    }

    /// The content at a path below the root; the root itself is the page.
    pub fn get(&self, path: &str) -> Option<&Content> {
        self.files.get(if path.is_empty() { FIRST } else { path })
    }

    /// True for the page's own files, false for what it shows.
    pub fn is_page(&self, path: &str) -> bool {
        !path.starts_with(SHOWN)
    }

    /// Paths and contents.
    pub fn files(&self) -> impl Iterator<Item = (&String, &Content)> {
        self.files.iter()
    }

    /// What the document refers to and is not taken along.
    pub fn take_left_out(&mut self) -> LeftOut {
        std::mem::take(&mut self.left_out)
    }
}

/// The page's own files.
fn page(assets: Option<&Path>) -> Result<BTreeMap<String, Content>> {
    let files = match assets {
        Some(folder) => folder_files(folder)?,
        None => {
            let held = |path: Cow<'static, str>| {
                let content = match Built::get(&path)?.data {
                    Cow::Borrowed(bytes) => Bytes::from_static(bytes),
                    Cow::Owned(bytes) => bytes.into(),
                };
                Some((path.into_owned(), Content::Held(content)))
            };
            Built::iter().filter_map(held).collect()
        }
    };
    if files.contains_key(FIRST) {
        return Ok(files);
    }
    let message = match assets {
        Some(folder) => format!(
            "{}: has no {FIRST}: run tools/web/build and tools/web/viewer/build, and name tools/web/dist",
            folder.display()
        ),
        None => "this program was built without the viewer's page: run tools/web/build and tools/web/viewer/build, \
                 and build it again, or name the page's folder with --assets"
            .into(),
    };
    Err(Error::Unsupported(message).into())
}

/// The files of a folder and those below, by relative path. Links are not followed; what is hidden, and what an exported site shows, is no page's.
fn folder_files(folder: &Path) -> Result<BTreeMap<String, Content>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![(folder.to_owned(), String::new())];
    while let Some((path, prefix)) = folders.pop() {
        let failed = |e| Error::io(&path, e);
        for entry in std::fs::read_dir(&path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let kind = entry.file_type().map_err(failed)?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.file_name().to_string_lossy().starts_with('.') {
                continue;
            }
            if kind.is_dir() {
                folders.push((entry.path(), format!("{name}/")));
            } else if kind.is_file() && !name.starts_with(SHOWN) {
                files.insert(name, Content::File(entry.path()));
            }
            if files.len() + folders.len() > MAX_PAGE_FILES {
                let message = format!("has more than {MAX_PAGE_FILES} files: name tools/web/dist");
                return Err(Error::input(folder, message)).context("the page's folder");
            }
        }
    }
    Ok(files)
}
