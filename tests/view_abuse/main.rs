//! `tsuya view` abused over HTTP: after each kind of abuse, and while its connections are still there, the next honest request is answered.

mod asking;
mod connections;
mod requests;
#[path = "../support/viewer.rs"]
mod viewer;

use std::net::TcpStream;
use std::time::{Duration, Instant};
use viewer::Viewer;

/// What the file that is served begins with; zeros follow.
const BEGINNING: &[u8] = b"the first bytes of the file";
/// Length of the file: more than the memory that the server may take.
const LENGTH: u64 = 1 << 30;
/// Time for an honest answer. It takes milliseconds; machines may be busy.
const MAX_ANSWER_TIME: Duration = Duration::from_secs(10);
const MAX_MEMORY: u64 = 200 << 20;

/// Connections that stay open while the honest request is made.
type Kept = Vec<TcpStream>;
type Abuse = fn(&Viewer) -> Kept;

#[test]
fn honest_requests_are_answered_whatever_others_do() {
    let folder = tempfile::tempdir().unwrap();
    let (page, path) = (folder.path().join("page"), folder.path().join("big.tsuya"));
    std::fs::create_dir(&page).unwrap();
    std::fs::write(page.join("index.html"), "<!doctype html>").unwrap();
    std::fs::write(&path, BEGINNING).unwrap();
    std::fs::File::options().write(true).open(&path).unwrap().set_len(LENGTH).unwrap();
    let mut viewer = Viewer::new(&path, &page, &[]);

    println!("{:40} {:>12} {:>10}", "abuse", "next answer", "peak");
    for (name, abuse) in ABUSES {
        let kept = abuse(&viewer);
        let began = Instant::now();
        let answer = viewer.ask("GET /shown/big.tsuya", &format!("Range: bytes=0-{}\r\n", BEGINNING.len() - 1));
        let time = began.elapsed();
        let memory = viewer.peak_memory().unwrap_or_default();
        println!("{name:40} {:9.1} ms {:7.1} MB", time.as_secs_f64() * 1e3, memory as f64 / 1e6);
        assert_eq!((answer.status(), answer.body.as_slice()), (206, BEGINNING), "after {name}");
        assert!(time < MAX_ANSWER_TIME, "after {name}: {time:?}");
        assert!(memory < MAX_MEMORY, "after {name}: {memory} bytes");
        drop(kept);
        assert!(viewer.lives(), "after {name}");
    }
}

const ABUSES: &[(&str, Abuse)] = &[
    ("giant Content-Length", requests::giant_lengths),
    ("six Content-Lengths of 2^64 - 1", requests::six_largest_lengths),
    ("wrong and contradicting Content-Lengths", requests::wrong_lengths),
    ("chunks of giant and wrong sizes", requests::giant_chunks),
    ("length and chunks at once", requests::smuggled_request),
    ("bodies of a GET", requests::bodies),
    ("Expect: 100-continue", requests::expectations),
    ("heads that come byte by byte", connections::slow_heads),
    ("thousands of header fields", requests::many_fields),
    ("a header field of megabytes", requests::long_field),
    ("a request line without end", requests::long_target),
    ("garbage", requests::garbage),
    ("TLS", requests::tls_hello),
    ("HTTP/0.9, 2 and 9.9", requests::other_versions),
    ("a thousand requests in one go", connections::pipelined_requests),
    ("other methods", requests::other_methods),
    ("wrong percent-encoding", requests::wrong_escapes),
    ("paths out of the site", requests::escaping_paths),
    ("wrong hosts", requests::wrong_hosts),
    ("targets that are whole addresses", requests::absolute_targets),
    ("control characters", requests::control_characters),
    ("folded and nameless fields", requests::malformed_fields),
    ("ranges of all kinds", requests::ranges),
    ("upgrades", connections::upgrades),
    ("500 connections left open", connections::idle_connections),
    ("connections closed on one side", connections::half_closed_connections),
    ("connections reset within the answer", connections::reset_connections),
    ("200 readers that stall", connections::stalled_readers),
    ("200 readers of a byte at a time", connections::trickling_readers),
    ("200 writers of a byte at a time", connections::trickling_writers),
    ("pipelines that nobody reads", connections::unread_pipelines),
    ("pipelines without end that are read", connections::eager_pipelines),
    ("connections opened all along", connections::flood),
];
