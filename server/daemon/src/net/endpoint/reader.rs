//! Reading the socket, on a thread of its own.
//!
//! One task of quinn reads the socket for all connections. It reads for 50 µs and then lets other
//! tasks run. Where hundreds of sessions have something to send at a tick, its turn comes after
//! all of theirs: it reads a few dozen packets in that time, and thousands more arrive meanwhile.
//! On a thread of its own it is always the next.

use std::{
    fmt, io,
    net::UdpSocket,
    pin::Pin,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::Instant,
};

use quinn::{AsyncTimer, AsyncUdpSocket, Runtime, TokioRuntime};
use tokio::runtime::{Builder, Handle};

/// A task of quinn.
type Task = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Runs the first task, which reads the socket, on its own thread, and all others where they are
/// started. An endpoint starts its reader before it has any connection.
pub(super) struct ReaderRuntime {
    reader: Handle,
    has_reader: AtomicBool,
    /// The thread ends when nobody can send this any more.
    _running: tokio::sync::oneshot::Sender<()>,
}

impl ReaderRuntime {
    /// Starts the thread. It ends with the endpoint.
    pub(super) fn start() -> io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let reader = runtime.handle().clone();
        let (running, ended) = tokio::sync::oneshot::channel();
        std::thread::Builder::new().name("reader".into()).spawn(move || {
            // The sender is dropped, never used.
            let _ = runtime.block_on(ended);
        })?;
        Ok(Self { reader, has_reader: AtomicBool::new(false), _running: running })
    }
}

impl fmt::Debug for ReaderRuntime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ReaderRuntime").finish_non_exhaustive()
    }
}

impl Runtime for ReaderRuntime {
    fn new_timer(&self, at: Instant) -> Pin<Box<dyn AsyncTimer>> {
        TokioRuntime.new_timer(at)
    }

    fn spawn(&self, task: Task) {
        if self.has_reader.swap(true, Relaxed) {
            TokioRuntime.spawn(task);
        } else {
            self.reader.spawn(task);
        }
    }

    fn wrap_udp_socket(&self, socket: UdpSocket) -> io::Result<Arc<dyn AsyncUdpSocket>> {
        let _entered = self.reader.enter();
        TokioRuntime.wrap_udp_socket(socket)
    }

    fn now(&self) -> Instant {
        TokioRuntime.now()
    }
}
