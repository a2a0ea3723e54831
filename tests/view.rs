//! `tsuya view` over HTTP: ranges, nothing but its own files, the static site.

mod support;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use support::{complaint, encoded_sample, output, text};

/// A running server, ended when dropped.
struct Viewer {
    child: Child,
    address: String,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Viewer {
    fn new(file: &Path, assets: &Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tsuya"));
        command.args(["view", text(file), "--no-open", "--assets", text(assets)]).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
        let address = line.strip_prefix("http://").and_then(|rest| rest.split('/').next()).unwrap().to_owned();
        Viewer { child, address }
    }

    /// Head and body of the answer to a request; `headers` end with line ends, `Host` is put before them unless they have it.
    fn ask(&self, request: &str, headers: &str) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let host = if headers.contains("Host:") { String::new() } else { format!("Host: {}\r\n", self.address) };
        write!(stream, "{request} HTTP/1.1\r\n{host}{headers}Connection: close\r\n\r\n").unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        (String::from_utf8(answer[..end].to_vec()).unwrap(), answer[end + 4..].to_vec())
    }

    fn status(&self, request: &str, headers: &str) -> u16 {
        self.ask(request, headers).0.split(' ').nth(1).unwrap().parse().unwrap()
    }
}

#[test]
fn the_file_is_served_in_parts_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let (assets, file) = (folder.path().join("page"), folder.path().join("a vase.tsuya"));
    std::fs::create_dir_all(assets.join("three")).unwrap();
    std::fs::write(assets.join("index.html"), "<!doctype html>").unwrap();
    std::fs::write(assets.join("three/index.js"), "export {}").unwrap();
    std::fs::write(folder.path().join("secret.tsuya"), "secret").unwrap();
    let bytes = &encoded_sample().bytes;
    std::fs::write(&file, bytes).unwrap();
    let viewer = Viewer::new(&file, &assets);

    let (head, body) = viewer.ask("GET /", "");
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("text/html") && body == b"<!doctype html>", "{head}");
    let (head, body) = viewer.ask("GET /viewer.json", "");
    assert!(head.contains("application/json"), "{head}");
    let description: serde_json::Value = serde_json::from_slice(&body).unwrap();
    assert_eq!((&description["file"], &description["name"]), (&"shown/a%20vase.tsuya".into(), &"a vase.tsuya".into()));
    let place = "GET /shown/a%20vase.tsuya";
    let (head, body) = viewer.ask(place, "");
    assert!(head.contains("model/vnd.tsuya") && head.contains(&format!("Content-Length: {}", bytes.len())), "{head}");
    assert_eq!(&body, bytes);
    let (head, body) = viewer.ask(place, "Range: bytes=100-299\r\n");
    assert!(head.starts_with("HTTP/1.1 206"), "{head}");
    assert!(head.contains(&format!("Content-Range: bytes 100-299/{}", bytes.len())), "{head}");
    assert_eq!(body, bytes[100..300]);
    assert_eq!(viewer.ask(place, "Range: bytes=-8\r\n").1, bytes[bytes.len() - 8..]);
    let (head, _) = viewer.ask(place, "Range: bytes=99999999-\r\n");
    assert!(head.starts_with("HTTP/1.1 416") && head.contains("bytes */"), "{head}");
    let (head, body) = viewer.ask("HEAD /shown/a%20vase.tsuya", "");
    assert!(head.contains(&format!("Content-Length: {}", bytes.len())) && body.is_empty(), "{head}");

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
