//! Raw requests and what may come of them.

use crate::Kept;
use crate::viewer::{Answer, Viewer};
use std::io::{ErrorKind, Read, Write};
use std::net::Shutdown;

/// The answer to raw bytes: what comes until the other side closes or says nothing for a while.
pub fn raw(viewer: &Viewer, request: &[u8]) -> Vec<u8> {
    let mut stream = viewer.connect();
    // The server may have closed before all of it is written.
    let _ = stream.write_all(request);
    let _ = stream.shutdown(Shutdown::Write);
    let mut answer = Vec::new();
    if let Err(error) = (&mut stream).take(1 << 20).read_to_end(&mut answer) {
        assert_ne!(error.kind(), ErrorKind::WouldBlock, "the connection hangs: {:?}", show(request));
    }
    answer
}

/// Status of the answer to raw bytes in which HOST stands for the server; 0 where there is none.
pub fn status_of(viewer: &Viewer, request: &str) -> u16 {
    let answer = raw(viewer, request.replace("HOST", &viewer.address).as_bytes());
    Answer::parse(&answer).map_or(0, |answer| answer.status())
}

/// Asks each and asserts that it is refused: no answer at all, or a status of those who ask wrongly.
pub fn refused(viewer: &Viewer, requests: &[&str]) -> Kept {
    for request in requests {
        let status = status_of(viewer, request);
        assert!(status == 0 || (400..600).contains(&status), "{status}: {:?}", show(request.as_bytes()));
    }
    Vec::new()
}

pub fn show(request: &[u8]) -> String {
    String::from_utf8_lossy(&request[..request.len().min(100)]).into_owned()
}

/// Many connections, each of which has sent `request`.
pub fn many(viewer: &Viewer, count: usize, request: &str) -> Kept {
    let request = request.replace("HOST", &viewer.address);
    let open = |_| {
        let mut stream = viewer.connect();
        let _ = stream.write_all(request.as_bytes());
        stream
    };
    (0..count).map(open).collect()
}

/// Asks for each path and asserts that there is no such file.
pub fn absent(viewer: &Viewer, paths: &[&str]) -> Kept {
    refused(
        viewer,
        &paths
            .iter()
            .map(|path| format!("GET {path} HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n\r\n"))
            .collect::<Vec<_>>()
            .iter()
            .map(String::as_str)
            .collect::<Vec<_>>(),
    )
}
