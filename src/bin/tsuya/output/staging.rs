//! Folders in which files are made beside their places: locked while their process lives, swept when it does not.
//!
//! A staging folder `.tsuya-` and 16 letters or digits holds `lock` (locked by its process), what is being made, and for the moment in
//! which a folder is moved aside, `old` with the file `target`, which says what it is called.

use std::collections::HashSet;
use std::ffi::OsStr;
use std::fs::{File, OpenOptions, TryLockError};
use std::hash::{BuildHasher, RandomState};
use std::io::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard};

const PREFIX: &str = ".tsuya-";
const LETTERS: usize = 16;
const LOCK: &str = "lock";
/// What was in a place, moved aside, and the name of that place.
const OLD: &str = "old";
const TARGET: &str = "target";
/// Names that are tried before giving up.
const ATTEMPTS: usize = 16;

/// Held for reading while something is made in a staging folder, so that none comes back when a signal removes them.
static MAKING: RwLock<()> = RwLock::new(());
/// Staging folders of this process.
static LIVE: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Held while files take their places, so that a signal never ends the program halfway.
static TAKING_PLACES: Mutex<()> = Mutex::new(());
static SWEPT: LazyLock<Mutex<HashSet<PathBuf>>> = LazyLock::new(Mutex::default);

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits until no files are taking their places, and keeps others from it.
pub fn taking_places() -> MutexGuard<'static, ()> {
    locked(&TAKING_PLACES)
}

/// Keeps a signal from removing staging folders while something is made there; waits for ever once one has.
pub fn making() -> RwLockReadGuard<'static, ()> {
    MAKING.read().unwrap_or_else(PoisonError::into_inner)
}

/// A folder in which something is made; removed with all that is left in it when dropped.
#[derive(Debug)]
pub struct Staging {
    path: PathBuf,
    _lock: File,
}

impl Staging {
    /// Makes one in `folder`, and sweeps what ended processes of the same user left there.
    pub fn create_in(folder: &Path) -> Result<Staging> {
        for _ in 0..ATTEMPTS {
            let guard = making();
            let number = RandomState::new().hash_one(std::process::id());
            let path = folder.join(format!("{PREFIX}{number:0LETTERS$x}"));
            match make_own_folder(&path) {
                Err(e) if e.kind() == ErrorKind::AlreadyExists => continue,
                made => made?,
            }
            // A sweeper may have taken the lock, or even removed the folder, before it could be locked.
            let lock = match OpenOptions::new().write(true).create_new(true).open(path.join(LOCK)) {
                Ok(lock) => lock,
                Err(e) if matches!(e.kind(), ErrorKind::AlreadyExists | ErrorKind::NotFound) => continue,
                Err(e) => return Err(e),
            };
            // Where files can't be locked, none are swept either.
            if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) || !path.join(LOCK).exists() {
                continue;
            }
            locked(&LIVE).push(path.clone());
            drop(guard);
            let staging = Staging { path, _lock: lock };
            let first = locked(&SWEPT).insert(folder.to_owned());
            if first {
                staging.sweep(folder);
            }
            return Ok(staging);
        }
        Err(Error::other("no temporary folder can be made here"))
    }

    /// A place in it.
    pub fn join(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join(name)
    }

    /// Moves `target` aside, into this folder, in such a way that the next run brings it back if this one ends before
    /// something else is there. Returns where it is.
    pub fn move_aside(&self, target: &Path) -> Result<PathBuf> {
        let name = target.file_name().ok_or_else(|| Error::other("has no name"))?;
        let record = self.join(TARGET);
        std::fs::write(&record, name.as_encoded_bytes())?;
        File::open(&record)?.sync_all()?;
        let old = self.join(OLD);
        std::fs::rename(target, &old)?;
        Ok(old)
    }

    /// Removes staging folders in `folder` whose processes have ended, those of this user only.
    fn sweep(&self, folder: &Path) {
        let Ok(entries) = std::fs::read_dir(folder) else { return };
        for entry in entries.flatten() {
            let path = entry.path();
            if path != self.path && is_staging(&entry.file_name()) && is_own_folder(&path, &self.path) {
                sweep_one(&path, folder);
            }
        }
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.path);
        locked(&LIVE).retain(|path| *path != self.path);
    }
}

/// Makes a folder that others can't look into: what it holds has no permissions of its own yet.
fn make_own_folder(path: &Path) -> Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(path)
}

/// Whether a name is that of a staging folder.
pub fn is_staging(name: &OsStr) -> bool {
    let letters = name.to_str().and_then(|name| name.strip_prefix(PREFIX));
    letters.is_some_and(|letters| letters.len() == LETTERS && letters.bytes().all(|b| b.is_ascii_alphanumeric()))
}

/// Whether a path is a folder, no link, of the same owner as another.
fn is_own_folder(path: &Path, own: &Path) -> bool {
    let (Ok(found), Ok(own)) = (std::fs::symlink_metadata(path), std::fs::symlink_metadata(own)) else { return false };
    #[cfg(unix)]
    let same = std::os::unix::fs::MetadataExt::uid(&found) == std::os::unix::fs::MetadataExt::uid(&own);
    #[cfg(not(unix))]
    let same = own.is_dir();
    found.is_dir() && same
}

fn sweep_one(path: &Path, folder: &Path) {
    let lock = OpenOptions::new().write(true).create(true).truncate(false).open(path.join(LOCK));
    let Ok(lock) = lock else { return };
    if lock.try_lock().is_err() {
        return;
    }
    if !bring_back(path, folder) {
        return;
    }
    let _ = std::fs::remove_dir_all(path);
}

/// Puts what was moved aside back where it was, unless something is there; false where that fails.
fn bring_back(path: &Path, folder: &Path) -> bool {
    let old = path.join(OLD);
    if !old.exists() {
        return true;
    }
    let Ok(name) = std::fs::read(path.join(TARGET)) else { return false };
    #[cfg(unix)]
    let name: &OsStr = std::os::unix::ffi::OsStrExt::from_bytes(&name[..]);
    #[cfg(not(unix))]
    let name: &OsStr = OsStr::new(std::str::from_utf8(&name).unwrap_or_default());
    let target = folder.join(name);
    if target.parent() != Some(folder) || target.file_name() != Some(name) {
        return false;
    }
    target.symlink_metadata().is_ok() || std::fs::rename(&old, &target).is_ok()
}

/// Waits for files that are being made or are taking their places and removes all staging folders of this process; from then on none
/// is made and none takes its place.
pub fn abandon_all() {
    std::mem::forget(taking_places());
    std::mem::forget(MAKING.write().unwrap_or_else(PoisonError::into_inner));
    for path in locked(&LIVE).iter() {
        let _ = std::fs::remove_dir_all(path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stale(folder: &Path, letters: &str) -> PathBuf {
        let path = folder.join(format!("{PREFIX}{letters}"));
        std::fs::create_dir_all(path.join("new/deep")).unwrap();
        std::fs::write(path.join("new/deep/file"), b"half").unwrap();
        path
    }

    #[test]
    fn what_ended_processes_left_is_swept_and_what_others_make_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let dead = stale(folder.path(), "0123456789abcdef");
        let live = stale(folder.path(), "fedcba9876543210");
        let lock = File::create(live.join(LOCK)).unwrap();
        lock.lock().unwrap();
        let foreign = stale(folder.path(), "of-another-tool");
        let staging = Staging::create_in(folder.path()).unwrap();
        assert!(!dead.exists() && live.join("new/deep/file").exists() && foreign.exists() && staging.path.exists());
        drop(staging);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn what_was_moved_aside_is_brought_back_unless_something_is_there() {
        for there in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let dead = stale(folder.path(), "0123456789abcdef");
            let target = folder.path().join("out é");
            std::fs::create_dir(&target).unwrap();
            std::fs::write(target.join("kept"), b"old").unwrap();
            let lock = File::create(dead.join(LOCK)).unwrap();
            let staging = Staging { path: dead.clone(), _lock: lock };
            staging.move_aside(&target).unwrap();
            std::mem::forget(staging);
            assert!(!target.exists());
            if there {
                std::fs::create_dir(&target).unwrap();
            }
            drop(Staging::create_in(folder.path()).unwrap());
            assert_eq!(target.join("kept").exists(), !there);
            assert!(!dead.exists());
        }
    }
}
