//! Single files: each made whole beside its place, then renamed into it.

use super::place::{exchange, folder_of, is_same_file, keep_permissions, rename_file, resolved, sync_folder};
use super::staging::{Staging, making, taking_places};
use super::{eprint_line, exists, is_stream};
use anyhow::Result;
use std::fs::{File, OpenOptions};
use std::io::{Error as IoError, IsTerminal, Write};
use std::path::{Path, PathBuf};
use tsuya::Error;

/// Files that take their places one directly after the other once all of them are made: until then, and wherever the program
/// ends, each of these places has what it had before.
pub struct Files {
    force: bool,
    stagings: Vec<(PathBuf, Staging)>,
    made: Vec<Made>,
    direct: Vec<(PathBuf, Vec<u8>)>,
}

/// A file beside its place.
struct Made {
    /// As the user calls it.
    shown: PathBuf,
    target: PathBuf,
    new: PathBuf,
}

impl Files {
    /// None yet; `force` says whether they may take the places of others.
    pub fn new(force: bool) -> Self {
        Files { force, stagings: Vec::new(), made: Vec::new(), direct: Vec::new() }
    }

    /// Makes a whole file. `-` is standard output; devices and pipes get their bytes when the others take their places.
    pub fn add(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        if is_stream(path) || std::fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
            check_terminal(path, bytes)?;
            self.direct.push((path.to_owned(), bytes.to_vec()));
            return Ok(());
        }
        let new = self.reserve(path)?;
        let failed = |e| Error::io(path, e);
        let _guard = making();
        let mut file = File::create_new(&new).map_err(failed)?;
        file.write_all(bytes).and_then(|()| file.sync_all()).map_err(failed)?;
        Ok(())
    }

    /// Where a file is to be made, with the ending of its name, by whoever makes it.
    pub fn reserve(&mut self, path: &Path) -> Result<PathBuf> {
        let failed = |e| Error::io(path, e);
        let target = resolved(path).map_err(failed)?;
        if !self.force && target.symlink_metadata().is_ok() {
            return Err(exists(path).into());
        }
        if target.file_name().is_none() {
            return Err(failed(IoError::new(std::io::ErrorKind::InvalidInput, "is no name of a file")).into());
        }
        let folder = folder_of(&target).to_owned();
        if self
            .made
            .iter()
            .any(|made| folder_of(&made.target) == folder && made.target.file_name() == target.file_name())
        {
            return Err(same_output(path, path).into());
        }
        let staging = match self.stagings.iter().position(|(other, _)| *other == folder) {
            Some(at) => &self.stagings[at].1,
            None => {
                let staging = Staging::create_in(&folder).map_err(failed)?;
                self.stagings.push((folder, staging));
                &self.stagings[self.stagings.len() - 1].1
            }
        };
        let ending = target.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
        let new = staging.join(format!("{}{ending}", self.made.len()));
        self.made.push(Made { shown: path.to_owned(), target, new: new.clone() });
        Ok(new)
    }

    /// Puts all of them into their places.
    pub fn commit(self) -> Result<()> {
        let Files { force, stagings, made, direct } = self;
        for (path, bytes) in &direct {
            write_directly(path, bytes)?;
        }
        for Made { shown, target, new } in &made {
            if let Ok(old) = std::fs::metadata(target)
                && let Some(message) = keep_permissions(new, &old)
            {
                eprint_line(&format!("warning: {}: {message}", shown.display()));
            }
        }
        // Files that change places free none in between, which takes the system long: whatever ends the program at a random moment
        // hardly ever finds one file new and the next still old.
        let exchanged: Vec<bool> = made
            .iter()
            .map(|Made { target, .. }| {
                force && made.len() > 1 && std::fs::symlink_metadata(target).is_ok_and(|m| m.is_file())
            })
            .collect();
        let _guard = taking_places();
        for (Made { shown, target, new }, exchanged) in made.iter().zip(exchanged) {
            if exchanged && exchange(new, target).is_ok() {
                continue;
            }
            rename_file(new, target, force).map_err(|e| match e.kind() {
                std::io::ErrorKind::AlreadyExists => exists(shown),
                _ => Error::io(shown, e),
            })?;
        }
        stagings.iter().for_each(|(folder, _)| sync_folder(folder));
        Ok(())
    }
}

/// Writes one file.
pub fn write(path: &Path, bytes: &[u8], force: bool) -> Result<()> {
    let mut files = Files::new(force);
    files.add(path, bytes)?;
    files.commit()
}

/// Bytes that are no text do strange things to a terminal.
fn check_terminal(path: &Path, bytes: &[u8]) -> Result<()> {
    if is_stream(path) && std::io::stdout().is_terminal() && super::terminal::has_controls(bytes) {
        let message =
            "what is written is no text for a terminal: give a file with -o, or send it into a file or another program";
        return Err(Error::parameter(message).into());
    }
    Ok(())
}

fn write_directly(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = |e| Error::io(path, e);
    if is_stream(path) {
        let mut out = std::io::stdout().lock();
        return Ok(out.write_all(bytes).and_then(|()| out.flush()).map_err(failed)?);
    }
    let mut file = OpenOptions::new().write(true).open(path).map_err(failed)?;
    Ok(file.write_all(bytes).and_then(|()| file.flush()).map_err(failed)?)
}

fn same_output(one: &Path, other: &Path) -> Error {
    Error::parameter(format!("{} and {} are the same file: two outputs can't be", one.display(), other.display()))
}

/// Asked before long work: an error where a file stands that may not be overwritten, where an output is one of the inputs, by
/// whatever name, or where two outputs are the same.
pub fn check_outputs(outputs: &[&Path], inputs: &[&Path], force: bool) -> Result<()> {
    let mut places: Vec<(&Path, PathBuf)> = Vec::new();
    for output in outputs.iter().filter(|output| !is_stream(output)) {
        if let Some(input) = inputs.iter().find(|input| !is_stream(input) && is_same_file(output, input)) {
            return Err(is_input(output, input).into());
        }
        if !force && output.is_file() {
            return Err(exists(output).into());
        }
        let target = resolved(output).map_err(|e| Error::io(output, e))?;
        let folder = folder_of(&target);
        let place = folder.canonicalize().unwrap_or(folder.to_owned()).join(target.file_name().unwrap_or_default());
        if let Some((other, _)) = places.iter().find(|(other, known)| *known == place || is_same_file(other, output)) {
            return Err(same_output(other, output).into());
        }
        places.push((output, place));
    }
    Ok(())
}

/// What is said where an output is an input.
pub fn is_input(output: &Path, input: &Path) -> Error {
    let (output, input) = (output.display(), input.display());
    let what = if output.to_string() == input.to_string() { String::new() } else { format!(" is {input}, which") };
    Error::parameter(format!("{output}:{what} is read, and would be overwritten: give the output another name"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(folder: &Path) -> usize {
        std::fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn files_take_their_places_together_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("a"), b"old").unwrap();
        let mut files = Files::new(true);
        files.add(&path("a"), b"new").unwrap();
        files.add(&path("b"), b"second").unwrap();
        assert!(files.add(&path("a"), b"twice").unwrap_err().to_string().contains("two outputs"));
        assert_eq!(std::fs::read(path("a")).unwrap(), b"old");
        drop(files);
        assert!(entries(folder.path()) == 1 && std::fs::read(path("a")).unwrap() == b"old");
        write(&path("a"), b"new", true).unwrap();
        assert!(entries(folder.path()) == 1 && std::fs::read(path("a")).unwrap() == b"new");
        assert!(write(&path("a"), b"newer", false).unwrap_err().to_string().contains("--force"));
        // Two that change places with what is there, and one that finds nothing.
        write(&path("b"), b"old", false).unwrap();
        let mut files = Files::new(true);
        ["a", "b", "c"].iter().for_each(|name| files.add(&path(name), name.as_bytes()).unwrap());
        files.commit().unwrap();
        assert!(["a", "b", "c"].iter().all(|name| std::fs::read(path(name)).unwrap() == name.as_bytes()));
        assert_eq!(entries(folder.path()), 3);
    }

    #[cfg(unix)]
    #[test]
    fn links_and_permissions_stay() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir(path("below")).unwrap();
        std::fs::write(path("below/file"), b"old").unwrap();
        std::fs::set_permissions(path("below/file"), std::fs::Permissions::from_mode(0o640)).unwrap();
        symlink("below/file", path("link")).unwrap();
        symlink(path("link"), path("link to link")).unwrap();
        write(&path("link to link"), b"new", true).unwrap();
        assert!(path("link").symlink_metadata().unwrap().is_symlink());
        assert_eq!(std::fs::read(path("below/file")).unwrap(), b"new");
        assert_eq!(path("below/file").metadata().unwrap().permissions().mode() & 0o777, 0o640);
        // Where nothing is yet, the link says where it will be.
        symlink("below/later", path("ahead")).unwrap();
        write(&path("ahead"), b"new", false).unwrap();
        assert!(path("below/later").metadata().unwrap().is_file());
        symlink("circle", path("circle")).unwrap();
        assert!(write(&path("circle"), b"", true).unwrap_err().to_string().contains("too many links"));
        // An output that is an input, by a link or another spelling.
        std::fs::hard_link(path("below/file"), path("hard")).unwrap();
        for name in ["link", "below/../below/file", "hard"] {
            let error = check_outputs(&[&path(name)], &[&path("below/file")], true).unwrap_err();
            assert!(error.to_string().contains("would be overwritten"), "{name}: {error}");
        }
        let error = check_outputs(&[&path("none"), &path("below/../none")], &[], false).unwrap_err();
        assert!(error.to_string().contains("two outputs"), "{error}");
    }
}
