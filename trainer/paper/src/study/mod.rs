//! What several figures measure: learning curves, reward landscapes, stops in one
//! step, flights over the apex map, other bodies.

pub(crate) mod body;
pub(crate) mod flown;
pub(crate) mod landscape;
pub(crate) mod landscape_sheet;
pub(crate) mod learning;
pub(crate) mod one_step;
pub(crate) mod sensed;
