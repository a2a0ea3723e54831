//! The page on a loopback address.

use super::range::{self, Wanted};
use super::site::{Content, Site};
use anyhow::Result;
use std::fs::File;
use std::io::{Cursor, Read, Seek, SeekFrom, Write};
use std::net::Ipv4Addr;
use tiny_http::{Method, Request, StatusCode};
use tsuya::Error;
use tsuya::gltf;

/// Requests answered side by side: browsers ask for six at once.
const THREADS: usize = 6;

/// A server of one site.
pub struct Server {
    http: tiny_http::Server,
    site: Site,
    port: u16,
}

/// An answer's body, of known length.
type Body = Box<dyn Read + Send>;

/// What is answered to a request.
struct Answer {
    status: u16,
    fields: Vec<(&'static str, String)>,
    body: Body,
    length: u64,
}

impl Server {
    /// Takes a port of 127.0.0.1; 0 is any that is free.
    pub fn bind(port: u16, site: Site) -> Result<Self> {
        let failed = |e: Box<dyn std::error::Error + Send + Sync>| {
            Error::io(format!("127.0.0.1:{port}"), std::io::Error::other(e))
        };
        let http = tiny_http::Server::http((Ipv4Addr::LOCALHOST, port)).map_err(failed)?;
        let port = http.server_addr().to_ip().map_or(port, |address| address.port());
        Ok(Server { http, site, port })
    }

    /// Where the page is.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Answers until the program is ended.
    pub fn run(&self) {
        std::thread::scope(|scope| {
            for _ in 0..THREADS {
                scope.spawn(|| {
                    while let Ok(request) = self.http.recv() {
                        let answer = self.answer(&request);
                        // Who asked may be gone.
                        let _ = send(request, answer);
                    }
                });
            }
        });
    }

    fn answer(&self, request: &Request) -> Answer {
        let header =
            |name: &'static str| request.headers().iter().find(|h| h.field.equiv(name)).map(|h| h.value.as_str());
        // Pages of other names that lead to this address must not read what is shown.
        let own = |host: &str| {
            [format!("127.0.0.1:{}", self.port), format!("localhost:{}", self.port)].iter().any(|h| h == host)
        };
        if !header("Host").is_some_and(own) {
            return words(403, "This server answers to its own address only.");
        }
        if !matches!(request.method(), Method::Get | Method::Head) {
            return words(405, "GET and HEAD only.");
        }
        let path = request.url().split(['?', '#']).next().unwrap_or_default();
        let path = path.strip_prefix('/').and_then(gltf::path_of);
        let Some((path, content)) = path.and_then(|path| self.site.get(&path).map(|content| (path, content))) else {
            return words(404, "There is no such file here.");
        };
        match body(content, header("Range")) {
            Ok((status, body, length, range)) => {
                let mut fields = vec![
                    ("Content-Type", media_type(&path).to_string()),
                    ("Accept-Ranges", "bytes".into()),
                    // The file may be another one at the next call.
                    ("Cache-Control", "no-store".into()),
                    ("X-Content-Type-Options", "nosniff".into()),
                ];
                fields.extend(range.map(|range| ("Content-Range", range)));
                Answer { status, fields, body, length }
            }
            Err(error) => words(404, &error.to_string()),
        }
    }
}

/// Status, body, its length, and the header `Content-Range`.
fn body(content: &Content, range: Option<&str>) -> std::io::Result<(u16, Body, u64, Option<String>)> {
    let length = match content {
        Content::Held(bytes) => bytes.len() as u64,
        Content::File(path) => std::fs::metadata(path)?.len(),
    };
    let (status, first, end) = match range.map_or(Wanted::Whole, |header| range::parse(header, length)) {
        Wanted::Whole => (200, 0, length),
        Wanted::Part(first, end) => (206, first, end),
        Wanted::Unsatisfiable => {
            return Ok((416, Box::new(std::io::empty()), 0, Some(format!("bytes */{length}"))));
        }
    };
    let count = end - first;
    let body: Body = match content {
        Content::Held(bytes) => {
            let part = bytes.get(first as usize..end as usize).unwrap_or_default();
            Box::new(Cursor::new(part.to_vec()))
        }
        Content::File(path) => {
            let mut file = File::open(path)?;
            file.seek(SeekFrom::Start(first))?;
            Box::new(file.take(count))
        }
    };
    let range = (status == 206).then(|| format!("bytes {first}-{}/{length}", end.saturating_sub(1)));
    Ok((status, body, count, range))
}

fn words(status: u16, text: &str) -> Answer {
    let bytes = text.as_bytes().to_vec();
    let length = bytes.len() as u64;
    let fields = vec![("Content-Type", "text/plain; charset=utf-8".to_string())];
    Answer { status, fields, body: Box::new(Cursor::new(bytes)), length }
}

/// Writes an answer and ends the connection: tiny_http lets a connection that stays open keep its thread, and has only a
/// few for more connections than browsers open.
fn send(request: Request, answer: Answer) -> std::io::Result<()> {
    let head_only = *request.method() == Method::Head;
    let Answer { status, fields, mut body, length } = answer;
    let mut writer = request.into_writer();
    write!(writer, "HTTP/1.1 {status} {}\r\n", StatusCode(status).default_reason_phrase())?;
    for (name, value) in fields {
        write!(writer, "{name}: {value}\r\n")?;
    }
    write!(writer, "Content-Length: {length}\r\nConnection: close\r\n\r\n")?;
    if !head_only {
        std::io::copy(&mut body, &mut writer)?;
    }
    writer.flush()
}

fn media_type(path: &str) -> &'static str {
    match path.rsplit('.').next() {
        Some("js" | "mjs") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("json" | "gltf") => "application/json",
        Some("wasm") => "application/wasm",
        Some("glb") => "model/gltf-binary",
        Some("tsuya") => gltf::MIME_TYPE,
        Some("png") => "image/png",
        Some("jpg" | "jpeg") => "image/jpeg",
        Some("svg") => "image/svg+xml",
        _ if path.is_empty() || path.ends_with(".html") => "text/html; charset=utf-8",
        _ => "application/octet-stream",
    }
}
