//! `tsuya view` abused over HTTP: after each kind of abuse, and while its connections are still there, the next honest request is answered.

#[path = "support/viewer.rs"]
mod viewer;

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};
use viewer::{Answer, Viewer};

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
    ("giant Content-Length", giant_lengths),
    ("six Content-Lengths of 2^64 - 1", six_largest_lengths),
    ("wrong and contradicting Content-Lengths", wrong_lengths),
    ("chunks of giant and wrong sizes", giant_chunks),
    ("length and chunks at once", smuggled_request),
    ("bodies of a GET", bodies),
    ("Expect: 100-continue", expectations),
    ("heads that come byte by byte", slow_heads),
    ("thousands of header fields", many_fields),
    ("a header field of megabytes", long_field),
    ("a request line without end", long_target),
    ("garbage", garbage),
    ("TLS", tls_hello),
    ("HTTP/0.9, 2 and 9.9", other_versions),
    ("a thousand requests in one go", pipelined_requests),
    ("other methods", other_methods),
    ("wrong percent-encoding", wrong_escapes),
    ("paths out of the site", escaping_paths),
    ("wrong hosts", wrong_hosts),
    ("targets that are whole addresses", absolute_targets),
    ("control characters", control_characters),
    ("folded and nameless fields", malformed_fields),
    ("ranges of all kinds", ranges),
    ("upgrades", upgrades),
    ("500 connections left open", idle_connections),
    ("connections closed on one side", half_closed_connections),
    ("connections reset within the answer", reset_connections),
    ("200 readers that stall", stalled_readers),
    ("200 readers of a byte at a time", trickling_readers),
    ("200 writers of a byte at a time", trickling_writers),
    ("pipelines that nobody reads", unread_pipelines),
    ("connections opened all along", flood),
];

/// The answer to raw bytes: what comes until the other side closes or says nothing for a while.
fn raw(viewer: &Viewer, request: &[u8]) -> Vec<u8> {
    let mut stream = viewer.connect();
    // The server may have closed before all of it is written.
    let _ = stream.write_all(request);
    let _ = stream.shutdown(Shutdown::Write);
    let mut answer = Vec::new();
    match (&mut stream).take(1 << 20).read_to_end(&mut answer) {
        Err(error) => assert_ne!(error.kind(), ErrorKind::WouldBlock, "the connection hangs: {:?}", show(request)),
        Ok(_) => (),
    }
    answer
}

/// Status of the answer to raw bytes in which HOST stands for the server; 0 where there is none.
fn status_of(viewer: &Viewer, request: &str) -> u16 {
    let answer = raw(viewer, request.replace("HOST", &viewer.address).as_bytes());
    Answer::parse(&answer).map_or(0, |answer| answer.status())
}

/// Asks each and asserts that it is refused: no answer at all, or a status of those who ask wrongly.
fn refused(viewer: &Viewer, requests: &[&str]) -> Kept {
    for request in requests {
        let status = status_of(viewer, request);
        assert!(status == 0 || (400..600).contains(&status), "{status}: {:?}", show(request.as_bytes()));
    }
    Vec::new()
}

fn show(request: &[u8]) -> String {
    String::from_utf8_lossy(&request[..request.len().min(100)]).into_owned()
}

/// Many connections, each of which has sent `request`.
fn many(viewer: &Viewer, count: usize, request: &str) -> Kept {
    let request = request.replace("HOST", &viewer.address);
    let open = |_| {
        let mut stream = viewer.connect();
        let _ = stream.write_all(request.as_bytes());
        stream
    };
    (0..count).map(open).collect()
}

fn giant_lengths(viewer: &Viewer) -> Kept {
    many(viewer, 6, "GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: 99999999999\r\n\r\n")
}

fn six_largest_lengths(viewer: &Viewer) -> Kept {
    many(viewer, 6, "GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: 18446744073709551615\r\n\r\n")
}

fn wrong_lengths(viewer: &Viewer) -> Kept {
    for length in
        ["-1", "+5", "0x10", "1e9", "", "five", "5, 6", "99999999999999999999999999", "5\r\nContent-Length: 6"]
    {
        refused(viewer, &[&format!("GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: {length}\r\n\r\nhello")]);
    }
    Vec::new()
}

fn giant_chunks(viewer: &Viewer) -> Kept {
    for size in ["ffffffffffffffff", "7fffffffffffffff", "fffffffffffffffffffff", "-1", "g", "", "5;ext=\"\r\n\""] {
        let head = "POST / HTTP/1.1\r\nHost: HOST\r\nTransfer-Encoding: chunked\r\n\r\n";
        refused(viewer, &[&format!("{head}{size}\r\nhello")]);
    }
    many(viewer, 6, "GET / HTTP/1.1\r\nHost: HOST\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\nhello")
}

fn smuggled_request(viewer: &Viewer) -> Kept {
    let inner = "0\r\n\r\nGET /viewer.json HTTP/1.1\r\nHost: HOST\r\n\r\n";
    for encoding in
        ["chunked", "Chunked", "chunked, identity", "identity", "\tchunked", "chunked\r\nTransfer-Encoding: x"]
    {
        let head = "GET / HTTP/1.1\r\nHost: HOST\r\n";
        for fields in ["Content-Length: 4\r\nTransfer-Encoding: ", "Transfer-Encoding: "] {
            let request = format!("{head}{fields}{encoding}\r\n\r\n{inner}").replace("HOST", &viewer.address);
            let answer = String::from_utf8_lossy(&raw(viewer, request.as_bytes())).into_owned();
            assert!(!answer.contains("big.tsuya"), "{request:?} gives {answer:?}");
        }
    }
    Vec::new()
}

fn bodies(viewer: &Viewer) -> Kept {
    let body = "x".repeat(1 << 20);
    refused(viewer, &[&format!("GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: {}\r\n\r\n{body}", body.len())])
}

fn expectations(viewer: &Viewer) -> Kept {
    let fields = "Expect: 100-continue\r\nContent-Length: 999999999999\r\n";
    refused(
        viewer,
        &[
            &format!("POST / HTTP/1.1\r\nHost: HOST\r\n{fields}\r\n"),
            &format!("GET / HTTP/1.1\r\nHost: HOST\r\n{fields}\r\n"),
        ],
    )
}

fn slow_heads(viewer: &Viewer) -> Kept {
    let mut kept = many(viewer, 50, "GET / HT");
    for byte in "TP/1.1\r\nHost".as_bytes() {
        kept.iter_mut().for_each(|stream| drop(stream.write_all(&[*byte])));
        std::thread::sleep(Duration::from_millis(5));
    }
    kept
}

fn many_fields(viewer: &Viewer) -> Kept {
    let fields = |count: usize| (0..count).map(|k| format!("X-{k}: y\r\n")).collect::<String>();
    refused(
        viewer,
        &[200, 5000, 100_000]
            .map(|count| format!("GET / HTTP/1.1\r\nHost: HOST\r\n{}\r\n", fields(count)))
            .each_ref()
            .map(String::as_str),
    )
}

fn long_field(viewer: &Viewer) -> Kept {
    let long = "y".repeat(8 << 20);
    refused(
        viewer,
        &[
            &format!("GET / HTTP/1.1\r\nHost: HOST\r\nX: {long}\r\n\r\n"),
            &format!("GET / HTTP/1.1\r\n{long}: x\r\n\r\n"),
        ],
    )
}

fn long_target(viewer: &Viewer) -> Kept {
    refused(
        viewer,
        &[
            &format!("GET /{}", "a".repeat(8 << 20)),
            &"A".repeat(8 << 20),
            &" ".repeat(1 << 20),
            &"\r\n".repeat(1 << 20),
        ],
    )
}

fn garbage(viewer: &Viewer) -> Kept {
    // xorshift64 (Marsaglia, 2003): the same bytes each time.
    let mut state = 88_172_645_463_325_252u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    for length in [1, 100, 10_000, 1_000_000] {
        let bytes: Vec<u8> = (0..length).map(|_| next() as u8).collect();
        assert!(!raw(viewer, &bytes).starts_with(b"HTTP/1.1 2"));
    }
    Vec::new()
}

fn tls_hello(viewer: &Viewer) -> Kept {
    let mut hello = vec![0x16, 3, 1, 2, 0, 1, 0, 1, 0xfc, 3, 3];
    hello.resize(517, 0x5a);
    assert!(!raw(viewer, &hello).starts_with(b"HTTP/1.1 2"));
    Vec::new()
}

fn other_versions(viewer: &Viewer) -> Kept {
    let http2 = "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\u{4}\0\0\0\0\0";
    refused(
        viewer,
        &[
            "GET /\r\n",
            "GET / HTTP/9.9\r\nHost: HOST\r\n\r\n",
            "GET / HTTP/1.10\r\nHost: HOST\r\n\r\n",
            "GET / HTTP/1.0\r\n\r\n",
            http2,
        ],
    )
}

fn pipelined_requests(viewer: &Viewer) -> Kept {
    let request = format!("GET / HTTP/1.1\r\nHost: {}\r\n\r\n", viewer.address).repeat(1000);
    let mut stream = viewer.connect();
    let mut reader = stream.try_clone().unwrap();
    let reading = std::thread::spawn(move || {
        let mut answers = String::new();
        reader.read_to_string(&mut answers).map(|_| answers)
    });
    stream.write_all(request.as_bytes()).unwrap();
    stream.shutdown(Shutdown::Write).unwrap();
    let answers = reading.join().unwrap().unwrap();
    assert_eq!(answers.matches("HTTP/1.1 200 OK").count(), 1000);
    Vec::new()
}

fn other_methods(viewer: &Viewer) -> Kept {
    for method in ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "PROPFIND", "get", "X"] {
        assert_eq!(
            status_of(viewer, &format!("{method} / HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n\r\n")),
            405,
            "{method}"
        );
    }
    refused(
        viewer,
        &[
            "CONNECT HOST HTTP/1.1\r\nHost: HOST\r\n\r\n",
            "OPTIONS * HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n\r\n",
            "GET * HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n\r\n",
        ],
    )
}

/// Asks for each path and asserts that there is no such file.
fn absent(viewer: &Viewer, paths: &[&str]) -> Kept {
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

fn wrong_escapes(viewer: &Viewer) -> Kept {
    absent(
        viewer,
        &[
            "/%",
            "/%2",
            "/%zz",
            "/%ff",
            "/%c0%af",
            "/shown/%",
            "/%%32%65",
            "/%u002e",
            "/shown/big.tsuya%00",
            "/shown/big.tsuya%0a",
            "/%00",
        ],
    )
}

fn escaping_paths(viewer: &Viewer) -> Kept {
    let plain = [
        "/..",
        "/../big.tsuya",
        "/shown/../../etc/passwd",
        "/shown/..",
        "/./big.tsuya",
        "//etc/passwd",
        "/shown//big.tsuya",
        "/etc/passwd",
        "etc/passwd",
    ];
    let escaped = [
        "/%2e%2e/%2e%2e/etc/passwd",
        "/shown/%2e%2e%2f%2e%2e%2fetc%2fpasswd",
        "/%252e%252e/etc/passwd",
        "/%2fetc/passwd",
        "/shown%2f..%2fbig.tsuya",
    ];
    let windows = [
        "/..%5c..%5cwindows%5cwin.ini",
        "/..\\..\\windows\\win.ini",
        "/c:/windows/win.ini",
        "/c:%5cwindows%5cwin.ini",
        "/shown/big.tsuya::$DATA",
        "/shown/big.tsuya.",
        "/SHOWN/BIG.TSUYA",
        "/shown/..;/big.tsuya",
    ];
    let folders = [
        "/shown",
        "/shown/",
        "/page",
        "/page/index.html",
        "/shown/.",
        "/file:///etc/passwd",
        "/shown/big.tsuya/",
        "/index.html/",
    ];
    [&plain[..], &escaped, &windows, &folders].into_iter().flat_map(|paths| absent(viewer, paths)).collect()
}

fn wrong_hosts(viewer: &Viewer) -> Kept {
    let port = viewer.address.rsplit(':').next().unwrap();
    let other = [
        "elsewhere.example",
        "elsewhere.example:PORT",
        "127.0.0.1",
        "localhost",
        "127.0.0.1:1",
        "127.0.0.1.elsewhere.example:PORT",
        "",
        "0.0.0.0:PORT",
        "user@127.0.0.1:PORT",
        "127.0.0.1:PORT, elsewhere.example",
        "2130706433:PORT",
        "127.0.0.1:PORT\r\nHost: elsewhere.example",
        "127.0.0.1:PORT\r\nHost: 127.0.0.1:PORT",
    ];
    for host in other.map(|host| host.replace("PORT", port)) {
        let status = status_of(viewer, &format!("GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"));
        assert!(matches!(status, 400 | 403), "{host:?} gives {status}");
    }
    assert!(matches!(status_of(viewer, "GET / HTTP/1.1\r\nConnection: close\r\n\r\n"), 400 | 403));
    for host in ["localhost", "LocalHost", "[::1]"] {
        assert_eq!(viewer.status("GET /", &format!("Host: {host}:{port}\r\n")), 200, "{host}");
    }
    Vec::new()
}

fn absolute_targets(viewer: &Viewer) -> Kept {
    assert_eq!(viewer.status(&format!("GET http://{}/", viewer.address), ""), 200);
    refused(
        viewer,
        &[
            "http://elsewhere.example/",
            "http://user@HOST/",
            "https://elsewhere.example",
            "file:///etc/passwd",
            "http://",
            "elsewhere.example:443",
        ]
        .map(|target| format!("GET {target} HTTP/1.1\r\nHost: HOST\r\nConnection: close\r\n\r\n"))
        .each_ref()
        .map(String::as_str),
    )
}

fn control_characters(viewer: &Viewer) -> Kept {
    refused(
        viewer,
        &[
            "GET /\0 HTTP/1.1\r\nHost: HOST\r\n\r\n",
            "GET /\u{1b}[2J HTTP/1.1\r\nHost: HOST\r\n\r\n",
            "GET /\u{7f} HTTP/1.1\r\nHost: HOST\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: HOST\r\nX: a\0b\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: HOST\0\r\n\r\n",
            "G\0T / HTTP/1.1\r\nHost: HOST\r\n\r\n",
            "GET /\r HTTP/1.1\r\nHost: HOST\r\n\r\n",
        ],
    )
}

fn malformed_fields(viewer: &Viewer) -> Kept {
    refused(
        viewer,
        &[
            "GET / HTTP/1.1\r\nHost: HOST\r\n: x\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: HOST\r\nX: a\r\n b\r\n\r\n",
            "GET / HTTP/1.1\r\nHost : HOST\r\n\r\n",
            "GET / HTTP/1.1\r\n Host: HOST\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: HOST\r\nno colon\r\n\r\n",
        ],
    )
}

fn ranges(viewer: &Viewer) -> Kept {
    let overlapping = format!("bytes={}", vec!["0-"; 1000].join(","));
    let huge = format!("bytes=0-{}", "9".repeat(1000));
    for (range, status) in [
        (overlapping.as_str(), 200),
        (huge.as_str(), 200),
        ("bytes=0-1,-1", 200),
        ("bytes=5-4", 200),
        ("bytes=-0", 416),
        ("bytes=18446744073709551615-18446744073709551615", 416),
        ("bytes=1073741824-", 416),
        ("bytes=0-18446744073709551615", 206),
        ("bytes=-18446744073709551615", 206),
        ("bytes=1073741823-", 206),
        ("bytes=0-0\r\nRange: bytes=1-1", 200),
    ] {
        let answer = viewer.ask("HEAD /shown/big.tsuya", &format!("Range: {range}\r\n"));
        assert_eq!(answer.status(), status, "{}", show(range.as_bytes()));
    }
    many(viewer, 50, &format!("GET /shown/big.tsuya HTTP/1.1\r\nHost: HOST\r\nRange: {overlapping}\r\n\r\n"))
}

fn upgrades(viewer: &Viewer) -> Kept {
    let mut kept = many(
        viewer,
        5,
        "GET / HTTP/1.1\r\nHost: HOST\r\nConnection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: AAMAAABkAAQAAP__\r\n\r\n",
    );
    kept.extend(many(viewer, 5, "GET / HTTP/1.1\r\nHost: HOST\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"));
    for stream in &mut kept {
        let mut start = [0; 12];
        stream.read_exact(&mut start).unwrap();
        assert_eq!(&start, b"HTTP/1.1 200");
    }
    kept
}

fn idle_connections(viewer: &Viewer) -> Kept {
    many(viewer, 500, "")
}

fn half_closed_connections(viewer: &Viewer) -> Kept {
    let kept = many(viewer, 100, "GET / HTTP/1.1\r\nHo");
    kept.iter().for_each(|stream| drop(stream.shutdown(Shutdown::Write)));
    kept
}

const WHOLE_FILE: &str = "GET /shown/big.tsuya HTTP/1.1\r\nHost: HOST\r\n\r\n";

fn reset_connections(viewer: &Viewer) -> Kept {
    for mut stream in many(viewer, 100, WHOLE_FILE) {
        // Closing with bytes that were not read resets the connection.
        let _ = stream.read(&mut [0; 100]);
    }
    Vec::new()
}

fn stalled_readers(viewer: &Viewer) -> Kept {
    many(viewer, 200, WHOLE_FILE)
}

fn trickling_readers(viewer: &Viewer) -> Kept {
    let mut kept = many(viewer, 200, WHOLE_FILE);
    for stream in kept.iter_mut().rev().take(50) {
        stream.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
        (0..20).for_each(|_| drop(stream.read(&mut [0])));
    }
    kept
}

fn trickling_writers(viewer: &Viewer) -> Kept {
    let mut kept = many(viewer, 200, "GET /shown/big.tsuya HTTP/1.1\r\nHost: HOST\r\nX: ");
    (0..20).for_each(|_| kept.iter_mut().for_each(|stream| drop(stream.write_all(b"x"))));
    kept
}

fn unread_pipelines(viewer: &Viewer) -> Kept {
    let requests = format!("GET /shown/big.tsuya HTTP/1.1\r\nHost: {}\r\nRange: bytes=0-99999\r\n\r\n", viewer.address)
        .repeat(100);
    let kept = many(viewer, 50, "");
    for mut stream in &kept {
        stream.set_nonblocking(true).unwrap();
        let _ = stream.write_all(requests.as_bytes());
    }
    kept
}

/// Goes on for a second after it returns.
fn flood(viewer: &Viewer) -> Kept {
    let (address, request) = (viewer.address.clone(), WHOLE_FILE.replace("HOST", &viewer.address));
    std::thread::spawn(move || {
        let (began, mut kept) = (Instant::now(), VecDeque::new());
        while began.elapsed() < Duration::from_secs(1) {
            let Ok(mut stream) = TcpStream::connect(&address) else { break };
            let _ = stream.write_all(request.as_bytes());
            kept.push_back(stream);
            kept.drain(..kept.len().saturating_sub(100));
        }
    });
    std::thread::sleep(Duration::from_millis(300));
    Vec::new()
}
