//! The folder that an input was given in, which the paths in it must not leave.

use super::quoted;
use crate::error::{Error, Result};
use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

/// A folder, and the file in it whose paths are resolved: only files in the folder and below are found, links followed.
#[derive(Debug, Clone)]
pub struct Folder {
    path: PathBuf,
    named_by: PathBuf,
    allow_outside: bool,
}

impl Folder {
    /// The folder that paths in the file `named_by` are relative to; with `allow_outside` they may lead anywhere.
    pub fn new(path: impl AsRef<Path>, named_by: impl AsRef<Path>, allow_outside: bool) -> Self {
        let path = path.as_ref();
        let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
        Folder { path: path.to_owned(), named_by: named_by.as_ref().to_owned(), allow_outside }
    }

    /// The folder of a file, for the paths in it.
    pub fn containing(file: &Path, allow_outside: bool) -> Self {
        Folder::new(file.parent().unwrap_or(Path::new("")), file, allow_outside)
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether paths may lead anywhere.
    pub fn allows_outside(&self) -> bool {
        self.allow_outside
    }

    /// The path that `name` means, whether something is there or not.
    ///
    /// An error, unless outside is allowed, where it leads out of the folder: by `..` (backslashes count as separators), as an absolute
    /// path of this system or another, as a URI, or through a link; and where it names something hidden (`.name`).
    pub fn resolve(&self, name: &str) -> Result<PathBuf> {
        if name.is_empty() || name.contains('\0') {
            return Err(Error::input(&self.named_by, format!("the path {} is not one of a file", quoted(name))));
        }
        let name = &*self.portable(name);
        if self.allow_outside {
            return Ok(self.path.join(name));
        }
        let relative = self.relative(name).map_err(|why| self.refused(name, why))?;
        let path = self.path.join(&relative);
        self.check_links(&path).map_err(|why| self.refused(name, why))?;
        Ok(path)
    }

    /// A name with slashes between its folders: backslashes, which other systems write there, become slashes, unless they belong to the name of
    /// a file that is there.
    pub fn portable<'n>(&self, name: &'n str) -> Cow<'n, str> {
        if name.contains('\\') && !self.path.join(name).exists() {
            Cow::Owned(name.replace('\\', "/"))
        } else {
            Cow::Borrowed(name)
        }
    }

    /// As [`Folder::resolve`] for a path that was read as one.
    pub fn resolve_path(&self, path: &Path) -> Result<PathBuf> {
        match path.to_str() {
            Some(name) => self.resolve(name),
            None => Err(Error::input(&self.named_by, format!("the path {path:?} is not UTF-8 text"))),
        }
    }

    /// As [`Folder::resolve`] for a relative reference with its `%` escapes; where outside is allowed, also for a `file:` URI.
    pub fn resolve_uri(&self, uri: &str) -> Result<PathBuf> {
        let Some(name) = percent_decoded(uri) else {
            return Err(Error::input(&self.named_by, format!("the reference {} has a wrong % escape", quoted(uri))));
        };
        let local = name.strip_prefix("file:").filter(|_| self.allow_outside);
        self.resolve(local.map_or(name.as_str(), |path| path.strip_prefix("//").unwrap_or(path)))
    }

    fn refused(&self, name: &str, why: &str) -> Error {
        let message = format!(
            "the path {} {why}; only files in its own folder are read, unless option `allow_outside` is given",
            quoted(name)
        );
        Error::input(&self.named_by, message)
    }

    /// The path as one below the folder; absolute ones only where they begin with the folder's own.
    fn relative(&self, name: &str) -> Result<PathBuf, &'static str> {
        let native = Path::new(name);
        let name = if native.is_absolute() {
            let own = std::path::absolute(&self.path).ok();
            let real = self.path.canonicalize().ok();
            let below =
                [own, real].into_iter().flatten().find_map(|root| native.strip_prefix(root).ok().map(Path::to_owned));
            below.and_then(|path| path.to_str().map(str::to_owned)).ok_or("is absolute and leads out of its folder")?
        } else {
            name.to_owned()
        };
        let mut depth = 0;
        for (index, part) in name.split(['/', '\\']).enumerate() {
            match part {
                "" if index == 0 && name.len() > 1 => return Err("is absolute and leads out of its folder"),
                "" | "." => {}
                ".." if depth == 0 => return Err("leads out of its folder"),
                ".." => depth -= 1,
                _ if part.starts_with('.') => return Err("names something hidden"),
                _ if index == 0 && is_drive_or_scheme(part) => return Err("is absolute and leads out of its folder"),
                _ => depth += 1,
            }
        }
        Ok(PathBuf::from(name))
    }

    /// Whether the path, with its links followed as far as it exists, is still in the folder and nothing hidden.
    fn check_links(&self, path: &Path) -> Result<(), &'static str> {
        // Where the folder itself is not there, nothing is.
        let Ok(root) = self.path.canonicalize() else { return Ok(()) };
        let there = path.ancestors().find_map(|ancestor| {
            let exists = std::fs::symlink_metadata(ancestor).is_ok();
            exists.then(|| ancestor.canonicalize())
        });
        let real = match there {
            Some(Ok(real)) => real,
            // A link without a target, or links in a circle.
            Some(Err(_)) => return Err("is a link that leads nowhere"),
            None => return Ok(()),
        };
        let Ok(below) = real.strip_prefix(&root) else { return Err("leads out of its folder by a link") };
        let hidden = |part: Component<'_>| part.as_os_str().to_string_lossy().starts_with('.');
        if below.components().any(hidden) { Err("names something hidden by a link") } else { Ok(()) }
    }
}

/// A relative reference without its `%` escapes. `None` where an escape is not two hexadecimal digits, or not UTF-8 comes out.
pub fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = uri.as_bytes();
    while let Some((&byte, tail)) = rest.split_first() {
        rest = tail;
        if byte == b'%' {
            let digits = rest.get(..2).filter(|digits| digits.iter().all(u8::is_ascii_hexdigit))?;
            bytes.push(u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?);
            rest = &rest[2..];
        } else {
            bytes.push(byte);
        }
    }
    String::from_utf8(bytes).ok()
}

/// `C:` and `C:name`, `file:` and `https:`.
fn is_drive_or_scheme(part: &str) -> bool {
    let Some((before, after)) = part.split_once(':') else { return false };
    let is_word = before.starts_with(|c: char| c.is_ascii_alphabetic())
        && before.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    is_word && (after.is_empty() || before.len() == 1 || before.eq_ignore_ascii_case("file"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_in_their_folder() {
        let outer = tempfile::tempdir().unwrap();
        let root = outer.path().join("capture");
        std::fs::create_dir_all(root.join("images")).unwrap();
        std::fs::write(root.join("images/a.png"), "a").unwrap();
        std::fs::write(outer.path().join("secret.png"), "s").unwrap();
        let folder = Folder::containing(&root.join("transforms.json"), false);
        let inside =
            ["images/a.png", "./images/a.png", "images/../images/a.png", "images/missing.png", "ab:c.png", "1:2/c.png"];
        for name in inside {
            assert_eq!(folder.resolve(name).unwrap(), root.join(name), "{name}");
        }
        let absolute = root.join("images/a.png");
        assert_eq!(folder.resolve(absolute.to_str().unwrap()).unwrap(), absolute);
        let refused = [
            ("../secret.png", "leads out of its folder"),
            ("images/../../secret.png", "leads out of its folder"),
            ("..\\secret.png", "leads out of its folder"),
            ("images\\..\\../secret.png", "leads out of its folder"),
            ("/etc/passwd", "is absolute"),
            ("\\\\server\\share\\a.png", "is absolute"),
            ("C:\\a.png", "is absolute"),
            ("c:a.png", "is absolute"),
            ("file:///etc/passwd", "is absolute"),
            ("FILE:/etc/passwd", "is absolute"),
            (".ssh/id_rsa", "names something hidden"),
            ("images/.hidden.png", "names something hidden"),
            ("images\\.hidden.png", "names something hidden"),
            ("...", "names something hidden"),
            ("", "is not one of a file"),
            ("a\0.png", "is not one of a file"),
        ];
        for (name, why) in refused {
            let error = folder.resolve(name).unwrap_err().to_string();
            assert!(error.contains("transforms.json: the path ") && error.contains(why), "{name}: {error}");
            if !why.contains("not one") {
                assert!(error.contains("`allow_outside`"), "{error}");
            }
        }
        let message = folder.resolve("../x\u{1b}[2J.png").unwrap_err().to_string();
        assert!(message.contains("\\u{1b}") && !message.contains('\u{1b}'), "{message}");
        assert_eq!(folder.resolve_uri("images/%61.png").unwrap(), root.join("images/a.png"));
        for uri in ["%2e%2e/secret.png", "..%5csecret.png", "%2Fetc/passwd", "file:///etc/passwd", "%2essh/id_rsa"] {
            assert!(folder.resolve_uri(uri).unwrap_err().to_string().contains("`allow_outside`"), "{uri}");
        }
        assert_eq!(folder.resolve("images\\a.png").unwrap(), root.join("images/a.png"));
        assert!(folder.resolve_uri("a%2").unwrap_err().to_string().contains("wrong % escape"));
        let outside = Folder::containing(&root.join("transforms.json"), true);
        assert_eq!(outside.resolve_uri("file:///etc/pass%77d").unwrap(), Path::new("/etc/passwd"));
        assert_eq!(outside.resolve("../secret.png").unwrap(), root.join("../secret.png"));
        assert_eq!(outside.resolve("/etc/passwd").unwrap(), Path::new("/etc/passwd"));
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_before_they_are_judged() {
        use std::os::unix::fs::symlink;
        let outer = tempfile::tempdir().unwrap();
        let root = outer.path().join("capture");
        std::fs::create_dir_all(root.join(".git")).unwrap();
        std::fs::write(root.join("a.png"), "a").unwrap();
        std::fs::write(root.join(".git/config"), "g").unwrap();
        std::fs::write(outer.path().join("secret"), "s").unwrap();
        symlink("a.png", root.join("inner")).unwrap();
        symlink("../secret", root.join("outer")).unwrap();
        symlink("..", root.join("up")).unwrap();
        symlink(".git", root.join("git")).unwrap();
        symlink("circle", root.join("circle")).unwrap();
        // The capture's own folder may well be a link.
        symlink("capture", outer.path().join("link")).unwrap();
        for root in [root, outer.path().join("link")] {
            let folder = Folder::containing(&root.join("transforms.json"), false);
            assert!(folder.resolve("inner").is_ok());
            for (name, why) in [
                ("outer", "leads out of its folder by a link"),
                ("up/secret", "leads out of its folder by a link"),
                ("up/not-there", "leads out of its folder by a link"),
                ("up/capture/../secret", "leads out of its folder by a link"),
                ("git/config", "names something hidden by a link"),
                ("circle", "is a link that leads nowhere"),
            ] {
                let error = folder.resolve(name).unwrap_err().to_string();
                assert!(error.contains(why), "{name}: {error}");
            }
        }
    }
}
