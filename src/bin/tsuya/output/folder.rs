//! Folders: made whole beside their place and exchanged with what is there.
//!
//! What the folder in that place holds besides (files of the user, or of an earlier run with other options) is carried over into the new
//! one by hard links before the exchange, so that at each moment the place has either the old folder or the new one, both with these files.
//! Where a folder can't be exchanged (a mount point, the working directory, a parent folder that can't be written to), its files are
//! renamed into place one by one; the index, which names all others, goes first and comes last.

use super::place::{exchange, folder_of, is_other_file_system, is_same_file, keep_permissions, resolved, sync_folder};
use super::staging::{Staging, is_staging, making, taking_places};
use super::{eprint_line, files::is_input};
use anyhow::Result;
use std::collections::BTreeSet;
use std::fs::{File, Metadata};
use std::io::{Error as IoError, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tsuya::Error;

/// What is made, within the staging folder.
const NEW: &str = "new";
/// Most files that are carried over; where a folder has more, ours are renamed into it one by one.
const MAX_CARRIED: usize = 20_000;

/// A folder in the making.
pub struct Folder {
    /// As the user calls it.
    shown: PathBuf,
    target: PathBuf,
    staging: Staging,
    /// Whether the staging folder is within the target.
    is_inside: bool,
    index: Option<&'static str>,
    inputs: Vec<PathBuf>,
    written: Mutex<BTreeSet<PathBuf>>,
}

/// Why a folder is not exchanged.
enum Refusal {
    /// Its files can be renamed into place one by one.
    OneByOne,
    Error(Error),
}

impl Folder {
    /// Begins a folder. One that is not empty is an error unless `force`; then its other files stay. `index` is the file that is
    /// there only when all it names is there, where there is such a file; no file of `inputs` is ever overwritten.
    pub fn create(path: &Path, force: bool, index: Option<&'static str>, inputs: &[&Path]) -> Result<Folder> {
        let failed = |e| Error::io(path, e);
        let target = resolved(path).map_err(failed)?;
        let target = target.canonicalize().unwrap_or(target);
        if target.symlink_metadata().is_ok_and(|metadata| !metadata.is_dir()) {
            return Err(failed(IoError::new(ErrorKind::NotADirectory, "is a file, not a folder")).into());
        }
        let is_empty = entries(&target).map_or(true, |all| all.is_empty());
        if !force && !is_empty {
            let message = "the folder is not empty; --force writes into it, over files of the same names";
            return Err(failed(IoError::new(ErrorKind::AlreadyExists, message)).into());
        }
        let parent = folder_of(&target).to_owned();
        std::fs::create_dir_all(&parent).map_err(failed)?;
        let beside = if can_be_exchanged(&target) { Staging::create_in(&parent).ok() } else { None };
        let is_inside = beside.is_none();
        let staging = match beside {
            Some(staging) => {
                // What an earlier run may have left within it.
                drop(target.is_dir().then(|| Staging::create_in(&target)));
                staging
            }
            None => {
                std::fs::create_dir_all(&target).map_err(failed)?;
                Staging::create_in(&target).map_err(failed)?
            }
        };
        let guard = making();
        std::fs::create_dir(staging.join(NEW)).map_err(failed)?;
        drop(guard);
        let inputs = inputs.iter().map(|path| path.to_path_buf()).collect();
        let written = Mutex::default();
        Ok(Folder { shown: path.to_owned(), target, staging, is_inside, index, inputs, written })
    }

    /// Makes a file in it; names have `/` between folders.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let shown = self.shown.join(name);
        let failed = |e| Error::io(&shown, e);
        let old = self.target.join(name);
        if let Some(input) = self.inputs.iter().find(|input| is_same_file(&old, input)) {
            return Err(is_input(&shown, input).into());
        }
        let new = self.staging.join(NEW).join(name);
        let _guard = making();
        std::fs::create_dir_all(folder_of(&new)).map_err(failed)?;
        let mut file = File::create_new(&new).map_err(failed)?;
        file.write_all(bytes).and_then(|()| file.sync_all()).map_err(failed)?;
        if let Some(message) =
            old.symlink_metadata().ok().filter(Metadata::is_file).and_then(|m| keep_permissions(&new, &m))
        {
            eprint_line(&format!("warning: {}: {message}", shown.display()));
        }
        self.written.lock().unwrap_or_else(PoisonError::into_inner).insert(PathBuf::from(name));
        Ok(())
    }

    /// Puts it into its place.
    pub fn commit(self) -> Result<()> {
        let failed = |e| Error::io(&self.shown, e);
        let (new, written) =
            (self.staging.join(NEW), self.written.lock().unwrap_or_else(PoisonError::into_inner).clone());
        for folder in written.iter().map(|name| folder_of(name)).collect::<BTreeSet<_>>() {
            sync_folder(&new.join(folder));
        }
        if self.is_inside {
            return Ok(self.one_by_one(&new, &written)?);
        }
        if self.target.symlink_metadata().is_err() {
            let _guard = taking_places();
            std::fs::rename(&new, &self.target).map_err(failed)?;
            sync_folder(folder_of(&self.target));
            return Ok(());
        }
        let mut carried = 0;
        let guard = making();
        let carried_over = self.carry_over(Path::new(""), &mut carried);
        drop(guard);
        match carried_over {
            Ok(()) => {}
            Err(Refusal::OneByOne) => return Ok(self.one_by_one(&new, &written)?),
            Err(Refusal::Error(error)) => return Err(error.into()),
        }
        if let Some(message) = self.target.metadata().ok().and_then(|metadata| keep_permissions(&new, &metadata)) {
            eprint_line(&format!("warning: {}: {message}", self.shown.display()));
        }
        match self.take_place(&new) {
            Ok(old) => {
                sync_folder(folder_of(&self.target));
                Ok(self.remove_old(&old, Path::new(""), &written).map_err(failed)?)
            }
            Err(e) if is_other_file_system(&e) => Ok(self.one_by_one(&new, &written)?),
            Err(e) => Err(failed(e).into()),
        }
    }

    /// Lets the new folder take the old one's place; returns where the old one is then.
    fn take_place(&self, new: &Path) -> std::io::Result<PathBuf> {
        let _guard = taking_places();
        match exchange(new, &self.target) {
            Ok(()) => Ok(new.to_owned()),
            Err(e) if is_other_file_system(&e) => Err(e),
            Err(_) => self.take_place_in_two_steps(new),
        }
    }

    /// Where the system has no exchange: between the two steps the old folder is in the staging folder, from where the next run
    /// would bring it back.
    fn take_place_in_two_steps(&self, new: &Path) -> std::io::Result<PathBuf> {
        let old = self.staging.move_aside(&self.target)?;
        if let Err(e) = std::fs::rename(new, &self.target) {
            std::fs::rename(&old, &self.target)?;
            return Err(e);
        }
        Ok(old)
    }

    /// Links what the old folder has and the new one has not into the new one.
    fn carry_over(&self, below: &Path, carried: &mut usize) -> Result<(), Refusal> {
        let (old, new) = (self.target.join(below), self.staging.join(NEW).join(below));
        let one_by_one = |_| Refusal::OneByOne;
        for name in entries(&old).map_err(|e| Refusal::Error(Error::io(&old, e)))? {
            let (from, to) = (old.join(&name), new.join(&name));
            let metadata = from.symlink_metadata().map_err(one_by_one)?;
            if let Ok(ours) = to.symlink_metadata() {
                self.check_kinds(&below.join(&name), &metadata, &ours).map_err(Refusal::Error)?;
            }
            *carried += 1;
            // What another process is making there must stay where it is.
            if *carried > MAX_CARRIED || is_staging(&name) {
                return Err(Refusal::OneByOne);
            }
            if !metadata.is_dir() {
                if to.symlink_metadata().is_err() {
                    std::fs::hard_link(&from, &to).map_err(one_by_one)?;
                }
                continue;
            }
            if !is_same_device(&metadata, &old) {
                return Err(Refusal::OneByOne);
            }
            if to.symlink_metadata().is_err() {
                std::fs::create_dir(&to).map_err(one_by_one)?;
            }
            if keep_permissions(&to, &metadata).is_some() {
                return Err(Refusal::OneByOne);
            }
            self.carry_over(&below.join(&name), carried)?;
        }
        Ok(())
    }

    /// A file does not take the place of a folder, nor a folder that of a file.
    fn check_kinds(&self, name: &Path, old: &Metadata, new: &Metadata) -> tsuya::Result<()> {
        if old.is_dir() == new.is_dir() {
            return Ok(());
        }
        let (there, wanted) = if old.is_dir() { ("a folder", "a file") } else { ("a file", "a folder") };
        let message = format!("is {there} where {wanted} is to be written: move it away, or write into another folder");
        Err(Error::io(self.shown.join(name), IoError::new(ErrorKind::AlreadyExists, message)))
    }

    /// Removes the old folder; what came into it only while the new one was made moves over.
    fn remove_old(&self, old: &Path, below: &Path, written: &BTreeSet<PathBuf>) -> std::io::Result<()> {
        for name in entries(old)? {
            let (from, within) = (old.join(&name), below.join(&name));
            let to = self.target.join(&within);
            if from.symlink_metadata()?.is_dir() && to.symlink_metadata().is_ok_and(|metadata| metadata.is_dir()) {
                self.remove_old(&from, &within, written)?;
            } else if to.symlink_metadata().is_err() || !written.contains(&within) && !is_same_link(&from, &to) {
                std::fs::rename(&from, &to)?;
            } else {
                std::fs::remove_file(&from)?;
            }
        }
        std::fs::remove_dir(old)
    }

    /// Renames the files into the folder, the index last; until then there is none.
    fn one_by_one(&self, new: &Path, written: &BTreeSet<PathBuf>) -> tsuya::Result<()> {
        let index = self.index.map(Path::new);
        for name in written {
            let mut part = PathBuf::new();
            for component in name.components() {
                part.push(component);
                if let (Ok(old), Ok(new)) =
                    (self.target.join(&part).symlink_metadata(), new.join(&part).symlink_metadata())
                {
                    self.check_kinds(&part, &old, &new)?;
                }
            }
        }
        let _guard = taking_places();
        if let Some(index) = index.filter(|index| written.contains(*index))
            && self.target.join(index).symlink_metadata().is_ok()
        {
            std::fs::remove_file(self.target.join(index)).map_err(|e| Error::io(self.shown.join(index), e))?;
        }
        let last = index.filter(|index| written.contains(*index));
        for name in written.iter().map(PathBuf::as_path).filter(|name| index != Some(name)).chain(last) {
            let target = self.target.join(name);
            let put = || {
                std::fs::create_dir_all(folder_of(&target))?;
                put(&new.join(name), &target)
            };
            put().map_err(|e| Error::io(self.shown.join(name), e))?;
        }
        sync_folder(&self.target);
        Ok(())
    }
}

/// Names in a folder, but for those of staging folders that this process just made.
fn entries(folder: &Path) -> std::io::Result<Vec<std::ffi::OsString>> {
    std::fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name())).collect()
}

/// Renames a file, or where it comes from another file system copies it beside its place first.
fn put(new: &Path, target: &Path) -> std::io::Result<()> {
    match std::fs::rename(new, target) {
        Err(e) if is_other_file_system(&e) => {
            let staging = Staging::create_in(folder_of(target))?;
            let copy = staging.join(NEW);
            std::fs::copy(new, &copy)?;
            File::open(&copy)?.sync_all()?;
            std::fs::rename(&copy, target)
        }
        done => done,
    }
}

/// Whether a folder may be exchanged for another without harm: it is not there, or neither a mount point nor where this process works.
fn can_be_exchanged(target: &Path) -> bool {
    let Ok(metadata) = target.metadata() else { return true };
    let is_working =
        std::env::current_dir().and_then(|here| here.canonicalize()).is_ok_and(|here| here.starts_with(target));
    !is_working && target.file_name().is_some() && is_same_device(&metadata, folder_of(target))
}

fn is_same_device(metadata: &Metadata, other: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        other.metadata().is_ok_and(|other| other.dev() == metadata.dev())
    }
    #[cfg(not(unix))]
    {
        let _ = (metadata, other);
        true
    }
}

/// Whether two names are of one file, without following links.
fn is_same_link(one: &Path, other: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let identity = |path: &Path| path.symlink_metadata().ok().map(|m| (m.dev(), m.ino()));
        identity(one).is_some() && identity(one) == identity(other)
    }
    #[cfg(not(unix))]
    {
        let _ = (one, other);
        true
    }
}

#[cfg(test)]
mod tests;
