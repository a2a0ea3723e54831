//! Requests that are wrong, or right but unwanted.

use crate::Kept;
use crate::asking::{absent, many, raw, refused, show, status_of};
use crate::viewer::Viewer;

pub fn giant_lengths(viewer: &Viewer) -> Kept {
    many(viewer, 6, "GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: 99999999999\r\n\r\n")
}

pub fn six_largest_lengths(viewer: &Viewer) -> Kept {
    many(viewer, 6, "GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: 18446744073709551615\r\n\r\n")
}

pub fn wrong_lengths(viewer: &Viewer) -> Kept {
    for length in
        ["-1", "+5", "0x10", "1e9", "", "five", "5, 6", "99999999999999999999999999", "5\r\nContent-Length: 6"]
    {
        refused(viewer, &[&format!("GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: {length}\r\n\r\nhello")]);
    }
    Vec::new()
}

pub fn giant_chunks(viewer: &Viewer) -> Kept {
    for size in ["ffffffffffffffff", "7fffffffffffffff", "fffffffffffffffffffff", "-1", "g", "", "5;ext=\"\r\n\""] {
        let head = "POST / HTTP/1.1\r\nHost: HOST\r\nTransfer-Encoding: chunked\r\n\r\n";
        refused(viewer, &[&format!("{head}{size}\r\nhello")]);
    }
    many(viewer, 6, "GET / HTTP/1.1\r\nHost: HOST\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\nhello")
}

pub fn smuggled_request(viewer: &Viewer) -> Kept {
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

pub fn bodies(viewer: &Viewer) -> Kept {
    let body = "x".repeat(1 << 20);
    refused(viewer, &[&format!("GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: {}\r\n\r\n{body}", body.len())])
}

pub fn expectations(viewer: &Viewer) -> Kept {
    let fields = "Expect: 100-continue\r\nContent-Length: 999999999999\r\n";
    refused(
        viewer,
        &[
            &format!("POST / HTTP/1.1\r\nHost: HOST\r\n{fields}\r\n"),
            &format!("GET / HTTP/1.1\r\nHost: HOST\r\n{fields}\r\n"),
        ],
    )
}

pub fn many_fields(viewer: &Viewer) -> Kept {
    let fields = |count: usize| (0..count).map(|k| format!("X-{k}: y\r\n")).collect::<String>();
    refused(
        viewer,
        &[200, 5000, 100_000]
            .map(|count| format!("GET / HTTP/1.1\r\nHost: HOST\r\n{}\r\n", fields(count)))
            .each_ref()
            .map(String::as_str),
    )
}

pub fn long_field(viewer: &Viewer) -> Kept {
    let long = "y".repeat(8 << 20);
    refused(
        viewer,
        &[
            &format!("GET / HTTP/1.1\r\nHost: HOST\r\nX: {long}\r\n\r\n"),
            &format!("GET / HTTP/1.1\r\n{long}: x\r\n\r\n"),
        ],
    )
}

pub fn long_target(viewer: &Viewer) -> Kept {
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

pub fn garbage(viewer: &Viewer) -> Kept {
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

pub fn tls_hello(viewer: &Viewer) -> Kept {
    let mut hello = vec![0x16, 3, 1, 2, 0, 1, 0, 1, 0xfc, 3, 3];
    hello.resize(517, 0x5a);
    assert!(!raw(viewer, &hello).starts_with(b"HTTP/1.1 2"));
    Vec::new()
}

pub fn other_versions(viewer: &Viewer) -> Kept {
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

pub fn other_methods(viewer: &Viewer) -> Kept {
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

pub fn wrong_escapes(viewer: &Viewer) -> Kept {
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

pub fn escaping_paths(viewer: &Viewer) -> Kept {
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

pub fn wrong_hosts(viewer: &Viewer) -> Kept {
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

pub fn absolute_targets(viewer: &Viewer) -> Kept {
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

pub fn control_characters(viewer: &Viewer) -> Kept {
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

pub fn malformed_fields(viewer: &Viewer) -> Kept {
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

pub fn ranges(viewer: &Viewer) -> Kept {
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
