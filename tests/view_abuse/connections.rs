//! Connections that stand still, trickle, break or come in masses.

use crate::Kept;
use crate::asking::many;
use crate::viewer::Viewer;
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

pub fn slow_heads(viewer: &Viewer) -> Kept {
    let mut kept = many(viewer, 50, "GET / HT");
    for byte in "TP/1.1\r\nHost".as_bytes() {
        kept.iter_mut().for_each(|stream| drop(stream.write_all(&[*byte])));
        std::thread::sleep(Duration::from_millis(5));
    }
    kept
}

pub fn idle_connections(viewer: &Viewer) -> Kept {
    many(viewer, 500, "")
}

pub fn half_closed_connections(viewer: &Viewer) -> Kept {
    let kept = many(viewer, 100, "GET / HTTP/1.1\r\nHo");
    kept.iter().for_each(|stream| drop(stream.shutdown(Shutdown::Write)));
    kept
}

const WHOLE_FILE: &str = "GET /shown/big.tsuya HTTP/1.1\r\nHost: HOST\r\n\r\n";

pub fn reset_connections(viewer: &Viewer) -> Kept {
    for mut stream in many(viewer, 100, WHOLE_FILE) {
        // Closing with bytes that were not read resets the connection.
        let _ = stream.read(&mut [0; 100]);
    }
    Vec::new()
}

pub fn stalled_readers(viewer: &Viewer) -> Kept {
    many(viewer, 200, WHOLE_FILE)
}

pub fn trickling_readers(viewer: &Viewer) -> Kept {
    let mut kept = many(viewer, 200, WHOLE_FILE);
    for stream in kept.iter_mut().rev().take(50) {
        stream.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
        (0..20).for_each(|_| drop(stream.read(&mut [0])));
    }
    kept
}

pub fn trickling_writers(viewer: &Viewer) -> Kept {
    let mut kept = many(viewer, 200, "GET /shown/big.tsuya HTTP/1.1\r\nHost: HOST\r\nX: ");
    (0..20).for_each(|_| kept.iter_mut().for_each(|stream| drop(stream.write_all(b"x"))));
    kept
}

pub fn unread_pipelines(viewer: &Viewer) -> Kept {
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
pub fn flood(viewer: &Viewer) -> Kept {
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

/// More connections than may be open, all of which ask without end and read at once what they get. Goes on for a second after it returns.
pub fn eager_pipelines(viewer: &Viewer) -> Kept {
    let requests =
        format!("GET /shown/big.tsuya HTTP/1.1\r\nHost: {}\r\nRange: bytes=0-9\r\n\r\n", viewer.address).repeat(20);
    let kept = many(viewer, 150, "");
    let mut streams: Vec<TcpStream> = kept.iter().map(|stream| stream.try_clone().unwrap()).collect();
    streams.iter().for_each(|stream| stream.set_nonblocking(true).unwrap());
    std::thread::spawn(move || {
        let (began, mut answers) = (Instant::now(), vec![0; 64 << 10]);
        while began.elapsed() < Duration::from_millis(1300) {
            for stream in &mut streams {
                let _ = stream.write(requests.as_bytes());
                let _ = stream.read(&mut answers);
            }
        }
    });
    std::thread::sleep(Duration::from_millis(300));
    kept
}

pub fn pipelined_requests(viewer: &Viewer) -> Kept {
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

pub fn upgrades(viewer: &Viewer) -> Kept {
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
