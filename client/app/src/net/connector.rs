//! Joining a server while the caller does something else, such as drawing a window.

use std::{
    net::SocketAddr,
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
};

use tokio::{
    runtime::Runtime,
    sync::oneshot::{self, error::TryRecvError},
    task::JoinHandle,
};

use super::{
    dialer::{ConnectOptions, Dialer},
    error::ConnectError,
    passage::JoinProgress,
    session::Session,
};

/// Joins one server, as often as it is asked to, on a runtime of its own. Its sessions run there
/// too. For threads that have no runtime.
pub struct Connector {
    runtime: Runtime,
    dialer: Arc<Dialer>,
    address: SocketAddr,
    options: ConnectOptions,
}

/// An attempt to join a server. It ends when it is dropped.
pub struct Joining {
    progress: Arc<Mutex<JoinProgress>>,
    outcome: oneshot::Receiver<Result<Session, ConnectError>>,
    task: JoinHandle<()>,
}

impl Connector {
    /// A connector for an address that keeps worlds in a folder, or only in memory when `None`.
    /// Attempts tell their progress by [`Joining::progress`], in place of
    /// [`ConnectOptions::progress`].
    ///
    /// # Errors
    /// When the system gives no threads.
    pub fn new(
        address: SocketAddr,
        options: ConnectOptions,
        world_folder: Option<PathBuf>,
    ) -> Result<Self, ConnectError> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .map_err(ConnectError::Socket)?;
        Ok(Self { runtime, dialer: Arc::new(Dialer::new(world_folder)), address, options })
    }

    /// The server's address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Begins to join the server, as [`Dialer::connect`] does.
    pub fn join(&self) -> Joining {
        let progress = Arc::new(Mutex::new(JoinProgress::Connecting));
        let (sender, outcome) = oneshot::channel();
        let (dialer, address, heard) = (self.dialer.clone(), self.address, progress.clone());
        let listener = move |step| *heard.lock().unwrap_or_else(PoisonError::into_inner) = step;
        let options = ConnectOptions { progress: Some(Arc::new(listener)), ..self.options.clone() };
        let task = self.runtime.spawn(async move {
            // Nobody waits any more for an outcome that cannot be sent.
            let _ = sender.send(dialer.connect(address, &options).await);
        });
        Joining { progress, outcome, task }
    }

    /// Says goodbye, and waits until it has arrived, for at most two seconds.
    pub fn leave(&self, session: Session) {
        self.runtime.block_on(session.leave());
    }

    /// Ends the runtime without waiting for what still runs on it.
    pub fn shut_down(self) {
        self.runtime.shutdown_background();
    }
}

impl Joining {
    /// How far the attempt is.
    pub fn progress(&self) -> JoinProgress {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What came of the attempt, once; `None` while it goes on. Never waits.
    pub fn outcome(&mut self) -> Option<Result<Session, ConnectError>> {
        match self.outcome.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Closed) => {
                Some(Err(ConnectError::Lost("the attempt to join failed".to_owned())))
            }
        }
    }
}

impl Drop for Joining {
    fn drop(&mut self) {
        self.task.abort();
    }
}
