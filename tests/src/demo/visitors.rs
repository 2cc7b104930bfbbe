//! The simulated visitors of the demo, on a thread of their own.

use std::{
    net::SocketAddr,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc,
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use anyhow::{Context, anyhow};
use sightline_client::{
    net::{Dialer, Trust},
    swarm::{self, SwarmOptions, SwarmReport, SwarmSnapshot},
};
use tokio::runtime::Runtime;

use super::options::DemoOptions;

/// How often the true poses are recorded, together with what each visitor's replica holds.
const SNAPSHOT_INTERVAL: Duration = Duration::from_millis(100);
/// How often the thread checks whether it was asked to stop.
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(50);

/// Visitors who walk through the building until their time is over or somebody stops them.
pub(super) struct Visitors {
    thread: JoinHandle<anyhow::Result<SwarmReport>>,
    #[cfg_attr(not(feature = "desktop"), expect(dead_code, reason = "only a window stops them"))]
    stop: mpsc::Sender<()>,
    snapshots: Arc<Mutex<Vec<SwarmSnapshot>>>,
    /// Set when they have ended.
    is_over: Arc<AtomicBool>,
}

impl Visitors {
    /// Sends the visitors in. An error of theirs is returned by [`Visitors::end`].
    pub(super) fn send(
        runtime: &Runtime,
        dialer: Arc<Dialer>,
        address: SocketAddr,
        trust: Trust,
        options: &DemoOptions,
    ) -> anyhow::Result<Self> {
        let swarm_options = SwarmOptions {
            seed: options.seed,
            snapshot_interval: SNAPSHOT_INTERVAL,
            dialer,
            ..SwarmOptions::new(options.visitors, options.duration, trust)
        };
        let snapshots: Arc<Mutex<Vec<SwarmSnapshot>>> = Arc::default();
        let is_over = Arc::new(AtomicBool::new(false));
        let (stop, stopped) = mpsc::channel();
        let handle = runtime.handle().clone();
        let thread = thread::Builder::new().name("visitors".into()).spawn({
            let (snapshots, is_over) = (snapshots.clone(), is_over.clone());
            move || {
                let walk = swarm::run(address, &swarm_options, |snapshot| {
                    lock(&snapshots).push(snapshot.clone());
                });
                let report = handle.block_on(async {
                    tokio::select! {
                        report = walk => report.map_err(anyhow::Error::from),
                        () = interrupted(stopped) => Ok(SwarmReport::default()),
                    }
                });
                is_over.store(true, Relaxed);
                report
            }
        })?;
        Ok(Self { thread, stop, snapshots, is_over })
    }

    /// Asks the visitors to leave.
    #[cfg(feature = "desktop")]
    pub(super) fn stop(&self) {
        // They may have left by themselves: then nobody listens.
        let _ = self.stop.send(());
    }

    /// A flag that becomes true when the visitors have left.
    pub(super) fn is_over(&self) -> &AtomicBool {
        &self.is_over
    }

    /// The snapshots so far, oldest first.
    pub(super) fn snapshots(&self) -> MutexGuard<'_, Vec<SwarmSnapshot>> {
        lock(&self.snapshots)
    }

    /// Waits until the visitors have left. The report is empty when they were stopped.
    ///
    /// # Errors
    /// When none of them could come in, or they were stopped before that.
    pub(super) fn end(self) -> anyhow::Result<(Vec<SwarmSnapshot>, SwarmReport)> {
        let report = self.thread.join().map_err(|_| anyhow!("the visitors' thread failed"))??;
        let snapshots = std::mem::take(&mut *lock(&self.snapshots));
        snapshots.first().context("the visitors were stopped before they came in")?;
        Ok((snapshots, report))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits for Ctrl-C, or for a message on the channel.
async fn interrupted(stopped: mpsc::Receiver<()>) {
    let mut checks = tokio::time::interval(STOP_CHECK_INTERVAL);
    loop {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => return,
            _ = checks.tick() => {
                if stopped.try_recv().is_ok() {
                    return;
                }
            }
        }
    }
}
