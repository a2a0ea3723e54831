//! HTTP server of the page, on a loopback address.
//!
//! Requests are read by hyper 1 on one thread of tokio. hyper is kept and widely used, bounds the head of a request by bytes, fields and
//! time, reads no body that nobody asks for and refuses lengths that contradict each other. (tiny_http 0.12, which was here before, allocates
//! the length that a request claims and waits for ever for those who stall.) hyper leaves to its user how many connections there are and for
//! how long one may stand still; that is in [`connections`](super::connections).

use super::answer::Answers;
use super::connections::{Connections, Watched};
use super::site::Site;
use anyhow::Result;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::net::{Ipv4Addr, SocketAddr};
use std::rc::Rc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::runtime::Runtime;
use tokio::task::LocalSet;
use tsuya::Error;

/// Bytes of a request's head: request line and header fields. Browsers send less than one KiB.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// Header fields of a request.
const MAX_HEADER_FIELDS: usize = 64;
/// Time for a request's head to arrive, and for a connection to stay open without a request.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// Connections that the system keeps until they are accepted.
const BACKLOG: u32 = 1024;
/// Bytes that the system keeps of an answer for a connection whose other side does not read.
const SEND_BUFFER_BYTES: u32 = 256 << 10;
/// Connections accepted before those that are open go on. Much less than may be open, so that a newcomer has been served before later ones
/// take its place.
const ACCEPTED_AT_ONCE: u32 = 8;
/// Threads that read files.
const READING_THREADS: usize = 4;
/// Pause after the system refused a connection, for want of file descriptors mostly.
const REFUSED_PAUSE: Duration = Duration::from_millis(20);
/// How often connections that stand still are looked for.
const SWEEP_INTERVAL: Duration = Duration::from_secs(5);

/// HTTP server of one site.
pub struct Server {
    runtime: Runtime,
    listener: TcpListener,
    site: Site,
    port: u16,
}

impl Server {
    /// Takes a port of 127.0.0.1; 0 is any that is free.
    pub fn bind(port: u16, site: Site) -> Result<Self> {
        let failed = |e| Error::io(format!("127.0.0.1:{port}"), e);
        let mut builder = tokio::runtime::Builder::new_current_thread();
        let runtime = builder.enable_all().max_blocking_threads(READING_THREADS).build().map_err(failed)?;
        let listener = runtime.block_on(async { listen(port) }).map_err(failed)?;
        let port = listener.local_addr().map_err(failed)?.port();
        Ok(Server { runtime, listener, site, port })
    }

    /// Address of the page.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Answers until the program is ended.
    pub fn run(self) {
        let answers = Rc::new(Answers::new(self.site, self.port));
        LocalSet::new().block_on(&self.runtime, accept(self.listener, answers));
    }
}

fn listen(port: u16) -> std::io::Result<TcpListener> {
    let socket = TcpSocket::new_v4()?;
    // Elsewhere than on Windows this only allows the port of a server that has just ended.
    #[cfg(not(windows))]
    socket.set_reuseaddr(true)?;
    // Connections inherit it.
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    socket.bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port)))?;
    socket.listen(BACKLOG)
}

/// Accepts connections and ends those that stand still.
async fn accept(listener: TcpListener, answers: Rc<Answers>) {
    let mut connections = Connections::default();
    let mut sweep = tokio::time::interval(SWEEP_INTERVAL);
    let mut accepted_at_once = 0;
    loop {
        let accepted = std::future::poll_fn(|context| match listener.poll_accept(context) {
            std::task::Poll::Pending => sweep.poll_tick(context).map(|_| None),
            accepted => accepted.map(Some),
        });
        match accepted.await {
            None => connections.end_stalled(),
            Some(Ok((stream, _))) => {
                connections.make_room().await;
                connections.open(stream, |stream| serve(stream, answers.clone()));
                accepted_at_once = (accepted_at_once + 1) % ACCEPTED_AT_ONCE;
                if accepted_at_once == 0 {
                    tokio::task::yield_now().await;
                }
            }
            Some(Err(_)) => {
                connections.end_one().await;
                tokio::time::sleep(REFUSED_PAUSE).await;
            }
        }
    }
}

/// Answers one connection's requests.
async fn serve(stream: Watched<TcpStream>, answers: Rc<Answers>) {
    let service = service_fn(|request| {
        let answers = answers.clone();
        async move { Ok::<_, Infallible>(answers.answer(request).await) }
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        // Who has asked all and closes that side still hears the answer.
        .half_close(true)
        .header_read_timeout(HEAD_TIME)
        .max_buf_size(MAX_HEAD_BYTES)
        .max_header_size(MAX_HEAD_BYTES)
        .max_headers(MAX_HEADER_FIELDS)
        .serve_connection(TokioIo::new(stream), service);
    // Whoever asked may be gone.
    let _ = connection.await;
}
