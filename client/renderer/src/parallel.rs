//! Work on independent parts of a picture: on all threads of the current rayon pool with the
//! feature `threads`, one part after the other without it.
//!
//! The order of the results never depends on the threads. Where only one thread is there, the work
//! is done on the calling thread and no pool is used.

/// Calls `work` with each item and its index.
#[cfg(feature = "threads")]
pub(super) fn for_each<T: Send>(items: Vec<T>, work: impl Fn(usize, T) + Sync + Send) {
    use rayon::prelude::*;
    if rayon::current_num_threads() == 1 {
        items.into_iter().enumerate().for_each(|(at, item)| work(at, item));
    } else {
        items.into_par_iter().enumerate().for_each(|(at, item)| work(at, item));
    }
}

/// Calls `work` with each item and its index.
#[cfg(not(feature = "threads"))]
pub(super) fn for_each<T>(items: Vec<T>, work: impl Fn(usize, T)) {
    items.into_iter().enumerate().for_each(|(at, item)| work(at, item));
}

/// All that `work` makes of the items, in their order.
#[cfg(feature = "threads")]
pub(super) fn flat_map<T: Sync, I: IntoIterator<Item: Send>>(
    items: &[T],
    work: impl Fn(&T) -> I + Sync + Send,
) -> Vec<I::Item> {
    use rayon::prelude::*;
    if rayon::current_num_threads() == 1 {
        items.iter().flat_map(work).collect()
    } else {
        items.par_iter().flat_map_iter(work).collect()
    }
}

/// All that `work` makes of the items, in their order.
#[cfg(not(feature = "threads"))]
pub(super) fn flat_map<T, I: IntoIterator>(items: &[T], work: impl Fn(&T) -> I) -> Vec<I::Item> {
    items.iter().flat_map(work).collect()
}
