//! Places in the file system: what is there, what is the same, and how a new file takes the place of an old one.

use std::fs::{File, Metadata};
use std::io::{Error as IoError, ErrorKind, Result};
use std::path::{Path, PathBuf};

/// Links that are followed before a circle is assumed.
const MAX_LINKS: usize = 40;

/// The folder that holds a path.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Where a path leads: links are followed, so that the file behind them is written and the link stays.
pub fn resolved(path: &Path) -> Result<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        match std::fs::read_link(&path) {
            Ok(target) => path = folder_of(&path).join(target),
            Err(_) => return Ok(path),
        }
    }
    Err(IoError::other("too many links"))
}

/// Whether two paths are the same file, by whatever links and spellings.
pub fn is_same_file(one: &Path, other: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let identity = |path: &Path| std::fs::metadata(path).ok().map(|m| (m.dev(), m.ino()));
        identity(one).is_some_and(|identified| identity(other) == Some(identified))
    }
    #[cfg(not(unix))]
    {
        one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
    }
}

/// Gives a new file or folder the permissions of the one whose place it takes. What can't be kept, the returned words say.
pub fn keep_permissions(new: &Path, old: &Metadata) -> Option<String> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
        let owner = |m: &Metadata| (m.uid(), m.gid());
        let is_other = std::fs::symlink_metadata(new).is_ok_and(|metadata| owner(&metadata) != owner(old));
        // Before the mode: another owner takes some of its bits away.
        if is_other && let Err(e) = chown(new, Some(old.uid()), Some(old.gid())) {
            return Some(format!("owner {}:{} can't be kept: {e}", old.uid(), old.gid()));
        }
        let mode = old.mode() & 0o777;
        let kept = std::fs::set_permissions(new, std::fs::Permissions::from_mode(mode));
        kept.err().map(|e| format!("permissions {mode:03o} can't be kept: {e}"))
    }
    #[cfg(not(unix))]
    {
        let kept = std::fs::set_permissions(new, old.permissions());
        kept.err().map(|e| format!("permissions can't be kept: {e}"))
    }
}

/// Brings a folder's entries to the disk. Not every file system can, and none fails for it.
pub fn sync_folder(path: &Path) {
    if cfg!(unix)
        && let Ok(folder) = File::open(path)
    {
        let _ = folder.sync_all();
    }
}

/// Lets two files or folders change places at once, where the system can.
pub fn exchange(one: &Path, other: &Path) -> Result<()> {
    #[cfg(any(target_os = "linux", target_os = "macos"))]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        Ok(renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE)?)
    }
    #[cfg(not(any(target_os = "linux", target_os = "macos")))]
    {
        let _ = (one, other);
        Err(ErrorKind::Unsupported.into())
    }
}

/// Puts a finished file into its place; `force` says whether another may be there.
pub fn rename_file(new: &Path, target: &Path, force: bool) -> Result<()> {
    if force {
        return std::fs::rename(new, target);
    }
    tempfile::TempPath::try_from_path(new)?.persist_noclobber(target).map_err(|e| e.error)
}

/// Whether an error says that something can't be moved from here to there at all.
pub fn is_other_file_system(error: &IoError) -> bool {
    matches!(error.kind(), ErrorKind::CrossesDevices | ErrorKind::ResourceBusy | ErrorKind::PermissionDenied)
}
