use super::*;

/// All files below a folder with what they hold, and the folders with a slash.
fn content(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(below) = folders.pop() {
        for name in entries(&folder.join(&below)).unwrap() {
            let within = below.join(name);
            let path = folder.join(&within);
            if path.symlink_metadata().unwrap().is_dir() {
                found.push((format!("{}/", within.display()), Vec::new()));
                folders.push(within);
            } else {
                found.push((within.display().to_string(), std::fs::read(path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

fn named(all: &[(&str, &str)]) -> Vec<(String, Vec<u8>)> {
    all.iter().map(|(name, bytes)| (name.to_string(), bytes.as_bytes().to_vec())).collect()
}

fn made(target: &Path) -> Folder {
    let folder = Folder::create(target, true, Some("index"), &[]).unwrap();
    folder.write("off/1", b"new").unwrap();
    folder.write("off/2", b"new").unwrap();
    folder.write("index", b"new").unwrap();
    folder
}

/// A folder of an earlier run, with files of the user's.
fn earlier(target: &Path) {
    for folder in ["off", "mine/deep"] {
        std::fs::create_dir_all(target.join(folder)).unwrap();
    }
    for (name, bytes) in [("off/1", "old"), ("off/notes", "mine"), ("mine/deep/a", "mine"), ("index", "old")] {
        std::fs::write(target.join(name), bytes).unwrap();
    }
}

const AFTER: [(&str, &str); 8] = [
    ("index", "new"),
    ("mine/", ""),
    ("mine/deep/", ""),
    ("mine/deep/a", "mine"),
    ("off/", ""),
    ("off/1", "new"),
    ("off/2", "new"),
    ("off/notes", "mine"),
];

#[test]
fn a_folder_takes_the_place_of_another_and_foreign_files_stay() {
    for way in ["exchange", "two steps", "one by one"] {
        let parent = tempfile::tempdir().unwrap();
        let target = parent.path().join("out");
        earlier(&target);
        let before = content(&target);
        drop(made(&target));
        assert_eq!(content(&target), before, "{way}");
        let folder = made(&target);
        assert_eq!(content(&target), before);
        match way {
            "exchange" => folder.commit().unwrap(),
            "two steps" => {
                assert!(folder.carry_over(Path::new(""), &mut 0).is_ok());
                let old = folder.take_place_in_two_steps(&folder.staging.join(NEW)).unwrap();
                let written = folder.written.lock().unwrap().clone();
                folder.remove_old(&old, Path::new(""), &written).unwrap();
                drop(folder);
            }
            _ => {
                let written = folder.written.lock().unwrap().clone();
                folder.one_by_one(&folder.staging.join(NEW), &written).unwrap();
                drop(written);
                drop(folder);
            }
        }
        assert_eq!(content(&target), named(&AFTER), "{way}");
        assert_eq!(entries(parent.path()).unwrap().len(), 1, "{way}");
    }
}

#[test]
fn what_comes_while_a_folder_is_made_is_not_lost() {
    let parent = tempfile::tempdir().unwrap();
    let target = parent.path().join("out");
    earlier(&target);
    let folder = made(&target);
    assert!(folder.carry_over(Path::new(""), &mut 0).is_ok());
    std::fs::create_dir(target.join("late")).unwrap();
    std::fs::write(target.join("late/a"), b"mine").unwrap();
    std::fs::write(target.join("newer"), b"newer").unwrap();
    std::fs::rename(target.join("newer"), target.join("off/notes")).unwrap();
    let old = folder.take_place(&folder.staging.join(NEW)).unwrap();
    let written = folder.written.lock().unwrap().clone();
    folder.remove_old(&old, Path::new(""), &written).unwrap();
    assert!(std::fs::read(target.join("late/a")).unwrap() == b"mine");
    assert!(std::fs::read(target.join("off/notes")).unwrap() == b"newer");
    assert!(std::fs::read(target.join("off/1")).unwrap() == b"new");
}

#[test]
fn what_is_in_the_way_is_named_before_anything_is_changed() {
    let parent = tempfile::tempdir().unwrap();
    let target = parent.path().join("out");
    let refused = || made(&target).commit().unwrap_err().to_string();
    std::fs::create_dir_all(target.join("index/mine")).unwrap();
    assert!(refused().contains("index: is a folder where a file is to be written"), "{}", refused());
    std::fs::remove_dir_all(&target).unwrap();
    std::fs::create_dir(&target).unwrap();
    std::fs::write(target.join("off"), b"mine").unwrap();
    assert!(refused().contains("off: is a file where a folder is to be written"), "{}", refused());
    assert_eq!(content(parent.path()), named(&[("out/", ""), ("out/off", "mine")]));
    // An input is not overwritten, whatever it is called.
    let input = parent.path().join("input");
    std::fs::write(&input, b"input").unwrap();
    std::fs::remove_file(target.join("off")).unwrap();
    std::fs::hard_link(&input, target.join("index")).unwrap();
    let folder = Folder::create(&target, true, Some("index"), &[&input]).unwrap();
    assert!(folder.write("index", b"new").unwrap_err().to_string().contains("would be overwritten"));
    // Nor is a folder without being told so.
    let error = Folder::create(&target, false, None, &[]).err().unwrap();
    assert!(error.to_string().contains("not empty; --force"), "{error}");
}

#[cfg(unix)]
#[test]
fn permissions_links_and_other_processes_work_are_left_as_they_are() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let parent = tempfile::tempdir().unwrap();
    let target = parent.path().join("out");
    earlier(&target);
    let mode = |name: &str| target.join(name).metadata().unwrap().permissions().mode() & 0o777;
    for (name, mode) in [("off/1", 0o600), ("off", 0o750), ("mine/deep", 0o700), ("", 0o711)] {
        std::fs::set_permissions(target.join(name), std::fs::Permissions::from_mode(mode)).unwrap();
    }
    symlink("/nowhere", target.join("mine/link")).unwrap();
    symlink(&target, parent.path().join("link")).unwrap();
    made(&parent.path().join("link")).commit().unwrap();
    assert!(parent.path().join("link").symlink_metadata().unwrap().is_symlink());
    assert_eq!([mode("off/1"), mode("off"), mode("mine/deep"), mode("")], [0o600, 0o750, 0o700, 0o711]);
    assert_eq!(std::fs::read_link(target.join("mine/link")).unwrap(), Path::new("/nowhere"));
    // What another process makes within it stays where it is.
    let other = target.join(".tsuya-0123456789abcdef");
    std::fs::create_dir(&other).unwrap();
    let lock = File::create(other.join("lock")).unwrap();
    lock.lock().unwrap();
    made(&target).commit().unwrap();
    assert!(std::fs::read(target.join("off/1")).unwrap() == b"new" && other.join("lock").exists());
}
