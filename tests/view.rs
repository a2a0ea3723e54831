//! `tsuya view` over HTTP: ranges, nothing but its own files, the static site.

use crate::support::{complaint, encoded_sample, output, text};
use crate::viewer::{Answer, Viewer};
use std::io::{Read, Write};
use std::path::PathBuf;
use std::time::{Duration, SystemTime};
use tempfile::TempDir;

/// A folder with a page of two files, and files beside it: names and contents.
fn folder_of(files: &[(&str, &[u8])]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page");
    std::fs::create_dir_all(page.join("three")).unwrap();
    std::fs::write(page.join("index.html"), PAGE).unwrap();
    std::fs::write(page.join("three/index.js"), "export {}").unwrap();
    for (name, content) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }
    (folder, page)
}

const PAGE: &str = "<!doctype html><script type=\"importmap\">{}</script>";

#[test]
fn the_file_is_served_in_parts_and_nothing_else() {
    let bytes = &encoded_sample().bytes;
    let (folder, page) = folder_of(&[("a vase.tsuya", bytes), ("secret.tsuya", b"secret")]);
    let viewer = Viewer::new(&folder.path().join("a vase.tsuya"), &page, &[]);

    let answer = viewer.ask("GET /", "");
    assert_eq!((answer.status(), answer.body.as_slice()), (200, PAGE.as_bytes()), "{}", answer.head);
    assert_eq!(answer.field("content-type"), Some("text/html; charset=utf-8"));
    let answer = viewer.ask("GET /viewer.json", "");
    assert_eq!(answer.field("content-type"), Some("application/json"));
    let description: serde_json::Value = serde_json::from_slice(&answer.body).unwrap();
    assert_eq!((&description["file"], &description["name"]), (&"shown/a%20vase.tsuya".into(), &"a vase.tsuya".into()));
    let place = "GET /shown/a%20vase.tsuya";
    let whole = viewer.ask(place, "");
    assert_eq!(whole.field("content-type"), Some("model/vnd.tsuya"));
    assert_eq!(whole.field("content-length"), Some(bytes.len().to_string().as_str()));
    assert_eq!(&whole.body, bytes);
    let part = viewer.ask(place, "Range: bytes=100-299\r\n");
    let range = format!("bytes 100-299/{}", bytes.len());
    assert_eq!((part.status(), part.field("content-range")), (206, Some(range.as_str())));
    assert_eq!(part.body, bytes[100..300]);
    assert_eq!(viewer.ask(place, "Range: bytes=-8\r\n").body, bytes[bytes.len() - 8..]);
    assert_eq!(viewer.ask(place, "Range: bytes=0-1,5-6\r\n").body.len(), bytes.len());
    let beyond = viewer.ask(place, "Range: bytes=99999999-\r\n");
    let range = format!("bytes */{}", bytes.len());
    assert_eq!((beyond.status(), beyond.field("content-range")), (416, Some(range.as_str())));
    let head = viewer.ask("HEAD /shown/a%20vase.tsuya", "");
    assert_eq!(head.field("content-length"), Some(bytes.len().to_string().as_str()));
    assert!(head.body.is_empty());

    for path in [
        "/shown/secret.tsuya",
        "/shown/../secret.tsuya",
        "/../secret.tsuya",
        "/%2e%2e/secret.tsuya",
        "/three",
        "/shown/",
        "/%",
    ] {
        assert_eq!(viewer.status(&format!("GET {path}"), ""), 404, "{path}");
    }
    assert_eq!(viewer.status("GET /", "Host: elsewhere.example\r\n"), 403);
    assert_eq!(viewer.status("POST /", "Content-Length: 0\r\n"), 405);
}

#[test]
fn answers_say_what_a_browser_may_do_with_them() {
    let (folder, page) = folder_of(&[("a.tsuya", b"bytes")]);
    let viewer = Viewer::new(&folder.path().join("a.tsuya"), &page, &[]);
    for path in ["/", "/three/index.js", "/viewer.json", "/shown/a.tsuya", "/absent"] {
        let answer = viewer.ask(&format!("GET {path}"), "");
        assert_eq!(answer.field("x-content-type-options"), Some("nosniff"), "{path}");
        assert_eq!(answer.field("referrer-policy"), Some("no-referrer"), "{path}");
        assert_eq!(answer.field("cross-origin-resource-policy"), Some("same-origin"), "{path}");
        let policy = answer.field("content-security-policy").unwrap();
        assert!(
            policy.starts_with("default-src 'none'") && policy.contains("frame-ancestors 'none'"),
            "{path}: {policy}"
        );
        let is_page = !matches!(path, "/shown/a.tsuya" | "/absent");
        assert_eq!(policy.contains("script-src 'self' 'wasm-unsafe-eval'"), is_page, "{path}: {policy}");
        assert_eq!(policy.contains("sandbox"), !is_page, "{path}: {policy}");
    }
}

#[test]
fn a_file_that_changes_is_served_as_one_version_or_not_to_the_end() {
    let (folder, page) = folder_of(&[("a.tsuya", b"the first version"), ("other", b"another one")]);
    let path = folder.path().join("a.tsuya");
    let viewer = Viewer::new(&path, &page, &[]);
    let place = "GET /shown/a.tsuya";
    let tag = viewer.ask(place, "").field("etag").unwrap().to_owned();
    let part = |tag: &str| viewer.ask(place, &format!("Range: bytes=4-8\r\nIf-Range: {tag}\r\n"));
    assert_eq!((part(&tag).status(), part(&tag).body.as_slice()), (206, &b"first"[..]));
    // Replaced as programs do that write beside the file and rename.
    std::fs::rename(folder.path().join("other"), &path).unwrap();
    assert_eq!((part(&tag).status(), part(&tag).body.as_slice()), (200, &b"another one"[..]));
    assert_ne!(part(&tag).field("etag"), Some(tag.as_str()));
    std::fs::remove_file(&path).unwrap();
    assert_eq!(viewer.status(place, ""), 404);

    // Written to while it is sent: what arrives is short, never a mixture of its stated length.
    let length = 64 << 20;
    std::fs::write(&path, vec![b'1'; length]).unwrap();
    std::fs::File::open(&path).unwrap().set_modified(SystemTime::now() - Duration::from_secs(9)).unwrap();
    let mut stream = viewer.connect();
    write!(stream, "{place} HTTP/1.1\r\nHost: {}\r\n\r\n", viewer.address).unwrap();
    let mut bytes = vec![0; 4096];
    stream.read_exact(&mut bytes).unwrap();
    std::fs::write(&path, vec![b'2'; length]).unwrap();
    let _ = stream.read_to_end(&mut bytes);
    let answer = Answer::parse(&bytes).unwrap();
    assert_eq!(answer.field("content-length"), Some(length.to_string().as_str()));
    assert!(answer.body.len() < length && answer.body.iter().all(|&byte| byte == b'1'), "{}", answer.body.len());
}

#[test]
fn a_static_site_holds_page_and_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("page")).unwrap();
    std::fs::write(path("page/index.html"), "<!doctype html>").unwrap();
    std::fs::write(path("a.tsuya"), &encoded_sample().bytes).unwrap();
    let (glb, site, page) = (path("a.glb"), path("site"), path("page"));
    output(&["gltf", "export", text(&path("a.tsuya")), "-o", text(&glb), "--external"]);
    let export = ["view", text(&glb), "--export", text(&site), "--assets", text(&page)];
    assert!(output(&export).contains("4 files"));
    // The stream beside the GLB comes along.
    assert_eq!(std::fs::read(site.join("shown/a.tsuya")).unwrap(), encoded_sample().bytes);
    assert!(site.join("shown/a.glb").is_file() && site.join("index.html").is_file());
    assert!(complaint(2, &export).contains("--force"));

    let empty = path("empty");
    std::fs::create_dir(&empty).unwrap();
    assert!(complaint(5, &["view", text(&glb), "--assets", text(&empty)]).contains("tools/web/build"));
    assert!(complaint(2, &["view", text(&path("none.tsuya"))]).contains("none.tsuya"));
    assert!(complaint(1, &["view", "Cargo.toml"]).contains(".glb"));
}

#[test]
fn a_document_makes_nothing_public_but_what_belongs_to_it() {
    let document = r#"{"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin"}, {"uri": ".ssh/id_rsa"}, {"uri": "link.bin"}],
        "images": [{"uri": "maps/a%20b.png"}, {"uri": "tax.pdf"}, {"uri": "../srv.log"}, {"uri": "/etc/passwd"}]}"#;
    let (folder, page) = folder_of(&[
        ("object/evil.gltf", document.as_bytes()),
        ("object/a.bin", b"buffer"),
        ("object/maps/a b.png", b"picture"),
        ("object/.ssh/id_rsa", b"secret"),
        ("object/tax.pdf", b"secret"),
        ("srv.log", b"secret"),
    ]);
    let path = |name: &str| folder.path().join(name);
    #[cfg(unix)]
    std::os::unix::fs::symlink("../srv.log", path("object/link.bin")).unwrap();
    let (file, site) = (path("object/evil.gltf"), path("site"));
    let export = ["view", text(&file), "--export", text(&site), "--assets", text(&page)];
    let message = complaint(3, &export);
    assert!(
        message.contains("nothing is exported") && message.contains("evil.gltf: the path \".ssh/id_rsa\""),
        "{message}"
    );
    assert!(message.contains("--allow-outside") && !site.exists(), "{message}");

    let viewer = Viewer::new(&file, &page, &[]);
    assert_eq!(viewer.ask("GET /shown/a.bin", "").body, b"buffer");
    assert_eq!(viewer.ask("GET /shown/maps/a%20b.png", "").body, b"picture");
    for path in
        ["/shown/.ssh/id_rsa", "/shown/link.bin", "/shown/tax.pdf", "/srv.log", "/shown/../srv.log", "/etc/passwd"]
    {
        assert_eq!(viewer.status(&format!("GET {path}"), ""), 404, "{path}");
    }
    // What lay in the folder when the server began, and leads out of it now.
    std::fs::remove_file(path("object/a.bin")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("../srv.log", path("object/a.bin")).unwrap();
    assert_eq!(viewer.status("GET /shown/a.bin", ""), 404);

    // What leads up lies beside the document's place in the site; an absolute path has no place there.
    std::fs::write(&file, document.replace(r#", {"uri": "/etc/passwd"}"#, "")).unwrap();
    output(&[&export[..], &["--allow-outside"]].concat());
    assert_eq!(std::fs::read(site.join("shown/srv.log")).unwrap(), b"secret");
    assert_eq!(std::fs::read(site.join("shown/up/.ssh/id_rsa")).unwrap(), b"secret");
    let description: serde_json::Value =
        serde_json::from_slice(&std::fs::read(site.join("viewer.json")).unwrap()).unwrap();
    assert_eq!((&description["file"], &description["name"]), (&"shown/up/evil.gltf".into(), &"evil.gltf".into()));
}
