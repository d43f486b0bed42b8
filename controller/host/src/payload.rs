//! The one place that vouches for the messages' memory layout.
#![allow(
    unsafe_code,
    reason = "iceoryx2 cannot check by itself that a message may be shared between processes"
)]

use core::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;

use crate::card::Role;
use leg_control::wire::{Command, Sample};

mod sealed {
    pub trait Sealed {}
    impl Sealed for leg_control::wire::Sample {}
    impl Sealed for leg_control::wire::Command {}
}

/// A message with a shared-memory service of its own. Implemented here only, for
/// the types whose layout this module has checked.
pub trait Message: sealed::Sealed + Copy + Debug + Send + 'static {
    /// Name of the service that carries it.
    const SERVICE: &'static str;
    /// Name of its type in shared memory, the wire version included.
    const TYPE_NAME: &'static str;
    /// Role of the process that sends it.
    const SENDER: Role;
}

impl Message for Sample {
    const SERVICE: &'static str = "leg/samples";
    const TYPE_NAME: &'static str = "leg.sample.v1";
    const SENDER: Role = Role::Leg;
}

impl Message for Command {
    const SERVICE: &'static str = "leg/commands";
    const TYPE_NAME: &'static str = "leg.command.v1";
    const SENDER: Role = Role::Controller;
}

/// A message in shared memory, with the layout of the message itself.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub struct Shared<M>(pub M);

// SAFETY: `Message` is sealed: its implementors are `#[repr(C)]` without padding
// (asserted in `leg_control::wire`) and hold only integers and floats: no pointers, no
// handles, and no bits that are not a value.
unsafe impl<M: Message> ZeroCopySend for Shared<M> {
    unsafe fn type_name() -> &'static str {
        M::TYPE_NAME
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::wire::WIRE_VERSION;

    #[test]
    fn type_names_carry_the_wire_version() {
        let suffix = format!(".v{WIRE_VERSION}");
        let names = [Sample::TYPE_NAME, Command::TYPE_NAME];
        assert!(names.iter().all(|name| name.ends_with(&suffix)), "{names:?}");
    }
}
