//! Open connections, bounded in number, and when each has last moved a byte.

use std::cell::Cell;
use std::future::Future;
use std::io::{IoSlice, Result};
use std::pin::Pin;
use std::rc::Rc;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::task::{JoinHandle, spawn_local};

/// Connections that are open at once. Browsers open six; each may need two file descriptors, of which some systems give 256.
const MAX_CONNECTIONS: usize = 96;
/// Time without a byte after which a connection is ended. Pages that decode may leave an answer waiting for a while.
const STALL_TIME: Duration = Duration::from_secs(60);
/// Time within which a newcomer may ask before its place is given to others.
const ASKING_TIME: Duration = Duration::from_secs(1);

/// The open connections. When all are taken, a newcomer gets the place of the one that has moved no byte for the longest: those who stall keep
/// nobody out. Those who have just come and not asked yet are spared while there are others, so that many who ask at once keep nobody out either.
#[derive(Default)]
pub struct Connections(Vec<Connection>);

struct Connection {
    task: JoinHandle<()>,
    movement: Rc<Movement>,
}

/// When a connection has moved bytes.
struct Movement {
    opened: Instant,
    last: Cell<Instant>,
    has_asked: Cell<bool>,
}

impl Movement {
    /// Whether it has just come and not asked yet.
    fn is_new(&self) -> bool {
        !self.has_asked.get() && self.opened.elapsed() < ASKING_TIME
    }
}

impl Connections {
    /// Serves a connection beside the others.
    pub fn open<F: Future<Output = ()> + 'static>(
        &mut self,
        stream: TcpStream,
        serve: impl FnOnce(Watched<TcpStream>) -> F,
    ) {
        // Answers are written as a whole; without this the last part of one may wait for the other side.
        let _ = stream.set_nodelay(true);
        let opened = Instant::now();
        let movement = Rc::new(Movement { opened, last: Cell::new(opened), has_asked: Cell::new(false) });
        let task = spawn_local(serve(Watched { stream, movement: movement.clone() }));
        self.0.push(Connection { task, movement });
    }

    /// Sees to it that there is room for one more.
    pub async fn make_room(&mut self) {
        self.0.retain(|connection| !connection.task.is_finished());
        while self.0.len() >= MAX_CONNECTIONS {
            self.end_oldest().await;
        }
    }

    /// Ends the connection that has moved no byte for the longest, a new one only where there are no others.
    pub async fn end_oldest(&mut self) {
        self.0.retain(|connection| !connection.task.is_finished());
        let oldest = (0..self.0.len()).min_by_key(|&index| {
            let movement = &self.0[index].movement;
            (movement.is_new(), movement.last.get())
        });
        if let Some(index) = oldest {
            let task = self.0.swap_remove(index).task;
            task.abort();
            // The socket is closed when the task is gone.
            let _ = task.await;
        }
    }

    /// Ends the connections that have moved no byte for too long.
    pub fn end_stalled(&mut self) {
        self.0.retain(|connection| !connection.task.is_finished());
        let now = Instant::now();
        self.0
            .iter()
            .filter(|connection| now.duration_since(connection.movement.last.get()) > STALL_TIME)
            .for_each(|connection| connection.task.abort());
    }
}

/// A stream that notes when it has last moved a byte.
pub struct Watched<S> {
    stream: S,
    movement: Rc<Movement>,
}

impl<S> Watched<S> {
    /// Notes that `count` bytes were moved.
    fn note(&self, count: usize) {
        if count > 0 {
            self.movement.last.set(Instant::now());
        }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        let result = Pin::new(&mut self.stream).poll_read(context, buffer);
        let count = buffer.filled().len() - before;
        self.note(count);
        if count > 0 {
            self.movement.has_asked.set(true);
        }
        result
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Watched<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write(context, bytes);
        if let Poll::Ready(Ok(count)) = result {
            self.note(count);
        }
        result
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write_vectored(context, slices);
        if let Poll::Ready(Ok(count)) = result {
            self.note(count);
        }
        result
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
