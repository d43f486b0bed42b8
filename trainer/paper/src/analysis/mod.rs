//! Measurements that several figures share.

pub(crate) mod apex_run;
pub(crate) mod bodies;
pub(crate) mod density_source;
pub(crate) mod landscape;
pub(crate) mod landscape_charts;
pub(crate) mod learning_curves;
pub(crate) mod one_step;
