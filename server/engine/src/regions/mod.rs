//! Regions: every place that an eye or a body can be at within some time.

mod cover_boxes;
mod footprint;
mod hidden_footprint;
mod index;
mod live_regions;
mod motion_bound;
mod reach;
mod sight_tester;

pub(crate) use cover_boxes::CoverBoxes;
pub(crate) use footprint::RegionFootprint;
pub(crate) use hidden_footprint::{FootprintCover, HiddenFootprint};
pub(crate) use index::{Indices, OccupantIndex, Occupied};
pub(crate) use live_regions::{CoarseRegion, LineEnd, LiveRegions, RegionKind};
pub(crate) use motion_bound::{Motion, MotionBound, lasting_margin_m, scaled, with_margin_ahead};
pub(crate) use reach::{Reach, ReachSearch, ReachStart};
pub(crate) use sight_tester::{BoxTest, SightTester};
