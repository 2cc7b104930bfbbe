//! Work beside the running server, at a lower priority.

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// By how much the work is nicer than the server.
#[cfg(target_os = "linux")]
const NICENESS: i32 = 10;

/// Threads for work beside the running server: as many as there are cores.
pub(super) fn threads() -> Result<ThreadPool, ThreadPoolBuildError> {
    ThreadPoolBuilder::new()
        .thread_name(|i| format!("compile {i}"))
        .start_handler(|_| lower_priority())
        .build()
}

/// Lowers the priority of this thread. Only Linux has priorities of threads by this call; elsewhere
/// it would lower the server's own.
fn lower_priority() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(NICENESS) {
        tracing::debug!(%error, "the priority stays");
    }
}
