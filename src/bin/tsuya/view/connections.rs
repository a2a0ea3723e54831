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
/// Time within which a connection that waits for the server keeps its place.
const OWED_TIME: Duration = Duration::from_millis(500);
/// How often a newcomer looks for a place where all have to keep theirs.
const LOOKING_INTERVAL: Duration = Duration::from_millis(2);

/// The open connections. When all are taken, a newcomer gets the place of one that waits for its other side: of those that have asked, the one
/// that has moved no byte for the longest; failing that, the first of those that have just come. Those that wait for the server are spared, or
/// on a machine with much else to do others would cut short what it is about to send; where all do and never stop asking, the one that has
/// done so for the longest makes room.
#[derive(Default)]
pub struct Connections(Vec<Connection>);

struct Connection {
    task: JoinHandle<()>,
    movement: Rc<Movement>,
}

/// What a connection waits for, and when it has moved bytes.
struct Movement {
    opened: Instant,
    last: Cell<Instant>,
    has_asked: Cell<bool>,
    /// Since when it waits for the server; `None` while it waits for bytes of its other side, or for room there. A newcomer waits for the server
    /// to look at what it has sent.
    owed: Cell<Option<Instant>>,
}

/// In what order connections make room for others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    /// It waits for the other side. Since when it has moved no byte.
    Waiting(Instant),
    /// It has just come and not asked yet. Since when it is there.
    New(Instant),
    /// It waits for the server. Since when it does.
    Owed(Instant),
}

impl Movement {
    fn new() -> Self {
        let opened = Instant::now();
        Movement { opened, last: Cell::new(opened), has_asked: Cell::new(false), owed: Cell::new(Some(opened)) }
    }

    fn place(&self) -> Place {
        if let Some(since) = self.owed.get() {
            Place::Owed(since)
        } else if !self.has_asked.get() && self.opened.elapsed() < ASKING_TIME {
            Place::New(self.opened)
        } else {
            Place::Waiting(self.last.get())
        }
    }

    /// Notes how many bytes were moved; `None` where none can be before the other side has done something.
    fn note(&self, moved: Option<usize>) {
        let now = Instant::now();
        self.owed.set(moved.map(|_| self.owed.get().unwrap_or(now)));
        if moved.is_some_and(|count| count > 0) {
            self.last.set(now);
        }
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
        let movement = Rc::new(Movement::new());
        let task = spawn_local(serve(Watched { stream, movement: movement.clone() }));
        self.0.push(Connection { task, movement });
    }

    /// Sees to it that there is room for one more.
    pub async fn make_room(&mut self) {
        self.leave_less_than(MAX_CONNECTIONS).await;
    }

    /// Ends one connection.
    pub async fn end_one(&mut self) {
        self.leave_less_than(self.0.len()).await;
    }

    async fn leave_less_than(&mut self, count: usize) {
        loop {
            self.0.retain(|connection| !connection.task.is_finished());
            if self.0.len() < count {
                return;
            }
            let places = self.0.iter().map(|connection| connection.movement.place());
            let Some((first, index)) = places.zip(0..).min() else { return };
            if matches!(first, Place::Owed(since) if since.elapsed() < OWED_TIME) {
                tokio::time::sleep(LOOKING_INTERVAL).await;
                continue;
            }
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

/// A stream that notes what it waits for and when it has last moved a byte.
pub struct Watched<S> {
    stream: S,
    movement: Rc<Movement>,
}

/// How many bytes a write has moved, `None` where it waits.
fn written(result: &Poll<Result<usize>>) -> Option<usize> {
    match result {
        Poll::Ready(count) => Some(*count.as_ref().unwrap_or(&0)),
        Poll::Pending => None,
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Watched<S> {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        let result = Pin::new(&mut self.stream).poll_read(context, buffer);
        let count = buffer.filled().len() - before;
        self.movement.note(result.is_ready().then_some(count));
        if count > 0 {
            self.movement.has_asked.set(true);
        }
        result
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Watched<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.movement.note(written(&result));
        result
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write_vectored(context, slices);
        self.movement.note(written(&result));
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
