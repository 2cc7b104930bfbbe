//! Ctrl-C, and the system's wish that the program end.

use std::{
    io,
    ops::ControlFlow,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
};

use sightline_cli::exit;

/// Takes note of an interruption, so that a long task can end in order. A second one ends the
/// program at once, though never while a file is being written.
pub struct Interrupt {
    noticed: Arc<AtomicBool>,
    writing: Arc<Mutex<()>>,
}

impl Interrupt {
    /// Begins to listen.
    ///
    /// # Errors
    /// When the system gives no thread or no handler.
    pub fn listen() -> io::Result<Self> {
        let noticed = Arc::new(AtomicBool::new(false));
        let writing = Arc::new(Mutex::new(()));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (flag, lock) = (noticed.clone(), writing.clone());
        std::thread::Builder::new().name("interrupt".into()).spawn(move || {
            runtime.block_on(async {
                while ended().await.is_ok() {
                    if flag.swap(true, Relaxed) {
                        let _lock = lock.lock().unwrap_or_else(PoisonError::into_inner);
                        std::process::exit(exit::INTERRUPTED.into());
                    }
                }
            });
        })?;
        Ok(Self { noticed, writing })
    }

    /// Whether to go on.
    pub fn flow(&self) -> ControlFlow<()> {
        match self.noticed.load(Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// Hold it while a file is written.
    pub fn hold_off(&self) -> MutexGuard<'_, ()> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Waits for Ctrl-C, or for the system to end the program.
pub async fn ended() -> io::Result<()> {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let mut terminate = signal(SignalKind::terminate())?;
        tokio::select! {
            interrupted = tokio::signal::ctrl_c() => interrupted,
            _ = terminate.recv() => Ok(()),
        }
    }
    #[cfg(not(unix))]
    tokio::signal::ctrl_c().await
}
