pub(crate) mod partition;
