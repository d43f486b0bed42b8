//! The messages' memory layout in shared memory; the only unsafe code of this package.
#![allow(
    unsafe_code,
    reason = "iceoryx2 cannot verify that a message may be shared between processes"
)]

use core::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;

use leg_control::wire::{Command, Sample};

use crate::link::Role;

mod sealed {
    pub trait Sealed {}
    impl Sealed for leg_control::wire::Sample {}
    impl Sealed for leg_control::wire::Command {}
}

/// A message type with a shared-memory service of its own. The trait is sealed: this
/// module implements it for the types whose layout it has checked.
pub trait Message: sealed::Sealed + Copy + Debug + Send + 'static {
    /// Name of the service that transports the message.
    const SERVICE: &'static str;
    /// Name of the type in shared memory, including the wire version.
    const TYPE_NAME: &'static str;
    /// Role of the process that sends the message.
    const SENDER: Role;
}

impl Message for Sample {
    const SERVICE: &'static str = "leg/samples";
    const TYPE_NAME: &'static str = "leg.sample.v2";
    const SENDER: Role = Role::Leg;
}

impl Message for Command {
    const SERVICE: &'static str = "leg/commands";
    const TYPE_NAME: &'static str = "leg.command.v2";
    const SENDER: Role = Role::Controller;
}

/// A message in shared memory. It has the same layout as the message itself.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub struct Payload<M>(pub M);

// SAFETY: `Message` is sealed. Its implementors are `#[repr(C)]` without padding (asserted in
// `leg_control::wire`) and hold only integers and floats: no pointers, no handles, and every
// bit pattern is a valid value.
unsafe impl<M: Message> ZeroCopySend for Payload<M> {
    unsafe fn type_name() -> &'static str {
        M::TYPE_NAME
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use leg_control::wire::WIRE_VERSION;

    #[test]
    fn type_names_include_the_wire_version() {
        let suffix = format!(".v{WIRE_VERSION}");
        let names = [Sample::TYPE_NAME, Command::TYPE_NAME];
        assert!(names.iter().all(|name| name.ends_with(&suffix)), "{names:?}");
    }
}
