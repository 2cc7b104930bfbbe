pub(crate) mod expiry_queue;
pub(crate) mod search;
pub(crate) mod transitions;
