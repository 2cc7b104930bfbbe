//! Interruption by Ctrl-C or by the system.

use std::{
    io,
    ops::ControlFlow,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::Duration,
};

use sightline_cli::{exit, output};

/// The name of the program in its errors.
const PROGRAM: &str = "sightline-server";
/// How long a task may take to end in order. Some steps of a task do not look for an interruption.
const PATIENCE: Duration = Duration::from_millis(700);

/// Listens for an interruption, so that a long task can end in order. A task that does not, or a
/// second interruption, ends the program at once, but not while a file is being written.
pub struct Interrupt {
    is_noticed: Arc<AtomicBool>,
    /// Held while a file is being written.
    writing: Arc<Mutex<()>>,
}

impl Interrupt {
    /// Starts to listen.
    ///
    /// # Errors
    /// When the system gives no thread or no signal handler.
    pub fn listen() -> io::Result<Self> {
        let is_noticed = Arc::new(AtomicBool::new(false));
        let writing = Arc::new(Mutex::new(()));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (flag, lock) = (is_noticed.clone(), writing.clone());
        std::thread::Builder::new().name("interrupt".into()).spawn(move || {
            runtime.block_on(async {
                if ended().await.is_err() {
                    return;
                }
                flag.store(true, Relaxed);
                // The task ends in order if it notices soon, or if the user does not insist.
                let _ = tokio::time::timeout(PATIENCE, ended()).await;
                let _lock = lock.lock().unwrap_or_else(PoisonError::into_inner);
                output::note(&format!("{PROGRAM}: {}", exit::Interrupted));
                std::process::exit(exit::INTERRUPTED.into());
            });
        })?;
        Ok(Self { is_noticed, writing })
    }

    /// Whether the task goes on or stops.
    pub fn flow(&self) -> ControlFlow<()> {
        match self.is_noticed.load(Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// Keeps a second interruption from ending the program while the guard lives.
    pub fn hold_off(&self) -> MutexGuard<'_, ()> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Waits for Ctrl-C, or for the signal by which the system ends a program.
///
/// # Errors
/// When the system gives no signal handler.
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
