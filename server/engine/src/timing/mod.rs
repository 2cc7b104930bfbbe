pub(crate) mod horizon;
pub(crate) mod jitter;
