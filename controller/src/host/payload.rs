//! The one place that vouches for the messages' memory layout.
#![allow(
    unsafe_code,
    reason = "iceoryx2 cannot check by itself that a message may be shared between processes"
)]

use core::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;

use super::card::Role;
use crate::wire::{Command, Sample};

/// A message with a shared-memory service of its own.
pub trait Message: ZeroCopySend + Copy + Debug + 'static {
    /// Name of the service that carries it.
    const SERVICE: &'static str;
    /// Who sends it.
    const SENDER: Role;
}

impl Message for Sample {
    const SERVICE: &'static str = "leg/samples";
    const SENDER: Role = Role::Leg;
}

impl Message for Command {
    const SERVICE: &'static str = "leg/commands";
    const SENDER: Role = Role::Controller;
}

// SAFETY: `#[repr(C)]`, no padding (asserted in `wire`), and only integers and
// floats: no pointers, no handles, and no bits that are not a value.
unsafe impl ZeroCopySend for Sample {
    unsafe fn type_name() -> &'static str {
        "leg.sample.v1"
    }
}

// SAFETY: as for `Sample`.
unsafe impl ZeroCopySend for Command {
    unsafe fn type_name() -> &'static str {
        "leg.command.v1"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::WIRE_VERSION;

    #[test]
    fn type_names_carry_the_wire_version() {
        let suffix = std::format!(".v{WIRE_VERSION}");
        // SAFETY: nothing to uphold in a call; the trait marks it so for its implementors.
        let names = unsafe { [Sample::type_name(), Command::type_name()] };
        assert!(names.iter().all(|name| name.ends_with(&suffix)), "{names:?}");
    }
}
