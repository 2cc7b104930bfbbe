pub(crate) mod candidates;
pub(crate) mod explain;
pub(crate) mod notify;
pub(crate) mod sight_tests;
pub(crate) mod snapshot;
