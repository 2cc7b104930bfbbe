pub(crate) mod cover_boxes;
pub(crate) mod footprints;
pub(crate) mod live_regions;
pub(crate) mod reach;
