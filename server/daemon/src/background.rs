//! Work beside the running server, at a lower priority.

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// By how much the work is nicer than the server.
#[cfg(target_os = "linux")]
const NICENESS: i32 = 10;

/// Threads for work beside the running server; zero stands for as many as there are cores.
pub(crate) fn threads(count: usize) -> Result<ThreadPool, ThreadPoolBuildError> {
    ThreadPoolBuilder::new()
        .num_threads(count)
        .thread_name(|i| format!("beside {i}"))
        .start_handler(|_| lower_priority())
        .build()
}

/// Lowers the priority of this thread. Only Linux has priorities of threads by this call; elsewhere
/// it would lower the server's own.
pub(crate) fn lower_priority() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(NICENESS) {
        tracing::debug!(%error, "the priority stays");
    }
}
