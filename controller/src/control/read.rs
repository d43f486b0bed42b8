//! In place of the law on an estimate, where the feature `estimator` is off: there is none.

use super::Controller;
use crate::command::Status;
use crate::config::Config;
use crate::guard::Trusted;
use crate::policy::Policy;

/// No estimator: the compiler leaves out what would need one.
#[derive(Clone, Debug)]
pub(super) enum Tracked {}

impl Tracked {
    pub(super) fn new(_: &Policy<'_>, _: &Config) -> Option<Self> {
        None
    }
}

impl Controller<'_> {
    pub(super) fn forget_estimate(&mut self) {}

    pub(super) fn begin_estimate(&mut self) {}

    pub(super) fn set_leg_of_estimate(&mut self) {}

    pub(super) fn advance_estimated(&mut self, _: Trusted<'_>) -> Status {
        Status::Safe
    }
}
