//! Answers to requests: whom, which file, which part of it, and under what policy.

use super::body::{Body, OpenFile};
use super::policy;
use super::range::{self, Wanted};
use super::site::{Content, Site};
use hyper::body::{Body as _, Bytes, Incoming};
use hyper::header::{self, HeaderMap, HeaderName, HeaderValue};
use hyper::{Method, Request, Response, StatusCode};
use std::rc::Rc;
use tokio::task::spawn_blocking;
use tsuya::gltf;

/// Answers the requests for the files of one site.
pub struct Answers {
    site: Rc<Site>,
    /// What requests may call this server.
    hosts: Vec<String>,
    /// Content-Security-Policy of the page's own files.
    page_policy: HeaderValue,
}

impl Answers {
    /// For a site that is served at `port`.
    pub fn new(site: Site, port: u16) -> Self {
        let names = ["127.0.0.1", "localhost", "[::1]"];
        let mut hosts: Vec<String> = names.iter().map(|name| format!("{name}:{port}")).collect();
        if port == 80 {
            hosts.extend(names.map(String::from));
        }
        let page_policy = policy::of_page(&site);
        Answers { site: Rc::new(site), hosts, page_policy }
    }

    /// Answers one request.
    pub async fn answer(&self, request: Request<Incoming>) -> Response<Body> {
        let has_body = !request.body().is_end_stream();
        let mut response = self.respond(&request, has_body).await.unwrap_or_else(|refusal| refusal.into_response());
        let headers = response.headers_mut();
        policy::ENCLOSURE.iter().for_each(|(name, value)| drop(headers.insert(name, HeaderValue::from_static(value))));
        if !headers.contains_key(header::CONTENT_SECURITY_POLICY) {
            headers.insert(header::CONTENT_SECURITY_POLICY, policy::OF_DATA);
        }
        if has_body {
            // What comes next would be the body.
            headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        response
    }

    async fn respond(&self, request: &Request<Incoming>, has_body: bool) -> Result<Response<Body>, Refusal> {
        if !self.is_addressed(request) {
            // Pages of other names that lead to this address must not read what is shown.
            return Err(Refusal(StatusCode::FORBIDDEN, "This server answers to its own address only."));
        }
        if !matches!(*request.method(), Method::GET | Method::HEAD) {
            return Err(Refusal(StatusCode::METHOD_NOT_ALLOWED, "GET and HEAD only."));
        }
        if has_body {
            return Err(Refusal(StatusCode::BAD_REQUEST, "Requests have no body here."));
        }
        let path = request.uri().path().strip_prefix('/').and_then(gltf::path_of).ok_or(NOT_FOUND)?;
        let content = self.site.get(&path).ok_or(NOT_FOUND)?;
        let mut response = match content {
            Content::Held(bytes) => held(bytes, request.headers()),
            on_disk => {
                let content = on_disk.clone();
                let opened = spawn_blocking(move || OpenFile::new(content.open().ok()?).ok()).await;
                let file = opened.ok().flatten().ok_or(NOT_FOUND)?;
                file_part(file, request.headers()).ok_or(NOT_FOUND)?
            }
        };
        if request.method() == Method::HEAD {
            *response.body_mut() = Body::empty();
        }
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type(&path)));
        headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        if self.site.is_page(&path) {
            headers.insert(header::CONTENT_SECURITY_POLICY, self.page_policy.clone());
        }
        Ok(response)
    }

    /// Whether the request calls this server by its own address: once in `Host`, and in the target where that is a whole address.
    fn is_addressed(&self, request: &Request<Incoming>) -> bool {
        let own = |name: &str| self.hosts.iter().any(|host| host.eq_ignore_ascii_case(name));
        let host = only(request.headers(), header::HOST);
        host.is_some_and(own) && request.uri().authority().is_none_or(|authority| own(authority.as_str()))
    }
}

/// An answer that only says why there is no other.
struct Refusal(StatusCode, &'static str);

const NOT_FOUND: Refusal = Refusal(StatusCode::NOT_FOUND, "There is no such file here.");

impl Refusal {
    fn into_response(self) -> Response<Body> {
        let mut response = Response::new(Body::Held(Bytes::from_static(self.1.as_bytes())));
        *response.status_mut() = self.0;
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/plain; charset=utf-8"));
        if self.0 == StatusCode::METHOD_NOT_ALLOWED {
            headers.insert(header::ALLOW, HeaderValue::from_static("GET, HEAD"));
        }
        response
    }
}

/// The value of a header field that is there once, as text.
fn only(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    let mut values = headers.get_all(name).iter();
    values.next().filter(|_| values.next().is_none())?.to_str().ok()
}

fn held(bytes: &Bytes, headers: &HeaderMap) -> Response<Body> {
    let wanted = wanted(headers, bytes.len() as u64, None);
    let slice = |first: u64, end: u64| Some(Body::Held(bytes.slice(first as usize..end as usize)));
    ranged(wanted, bytes.len() as u64, slice).unwrap_or_else(|| NOT_FOUND.into_response())
}

fn file_part(file: OpenFile, headers: &HeaderMap) -> Option<Response<Body>> {
    let (length, tag) = (file.length(), HeaderValue::try_from(file.tag()).ok()?);
    let wanted = wanted(headers, length, Some(&tag));
    let mut response = ranged(wanted, length, |first, end| Body::part_of(file, first, end).ok())?;
    response.headers_mut().insert(header::ETAG, tag);
    Some(response)
}

/// The part that is asked for. What was asked for of another version of the file is the whole of this one.
fn wanted(headers: &HeaderMap, length: u64, tag: Option<&HeaderValue>) -> Wanted {
    let same = headers.get(header::IF_RANGE).is_none_or(|value| Some(value) == tag);
    match only(headers, header::RANGE).filter(|_| same) {
        Some(range) => range::parse(range, length),
        None => Wanted::Whole,
    }
}

/// An answer with the part of `length` bytes that `body` makes of its first byte and the one after its last.
fn ranged(wanted: Wanted, length: u64, body: impl FnOnce(u64, u64) -> Option<Body>) -> Option<Response<Body>> {
    let (status, (first, end)) = match wanted {
        Wanted::Whole => (StatusCode::OK, (0, length)),
        Wanted::Part(first, end) => (StatusCode::PARTIAL_CONTENT, (first, end)),
        Wanted::Unsatisfiable => (StatusCode::RANGE_NOT_SATISFIABLE, (0, 0)),
    };
    let range = match wanted {
        Wanted::Whole => None,
        Wanted::Part(..) => Some(format!("bytes {first}-{}/{length}", end.saturating_sub(1))),
        Wanted::Unsatisfiable => Some(format!("bytes */{length}")),
    };
    let mut response = Response::new(if first < end { body(first, end)? } else { Body::empty() });
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_LENGTH, HeaderValue::from(end - first));
    if let Some(range) = range.and_then(|range| HeaderValue::try_from(range).ok()) {
        response.headers_mut().insert(header::CONTENT_RANGE, range);
    }
    Some(response)
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
