pub(crate) mod clearance;
pub(crate) mod consistency;
pub(crate) mod movement_budget;
pub(crate) mod walkability;
