//! Messages of recordings made by earlier versions of the messages on shared memory.

use std::ops::RangeInclusive;

use leg_control::wire::{WIRE_VERSION, flags};

use super::schema::{AnyMessage, Command, Sample};

/// Versions of the messages on shared memory whose recordings are read.
pub const READABLE: RangeInclusive<u32> = 1..=WIRE_VERSION as u32;

/// Returns a message as one of this version, if it is one of an earlier version.
///
/// In version 1 every sample carried velocities and height, and had no flags for them.
pub(super) fn as_of_this_version(message: AnyMessage) -> AnyMessage {
    match message {
        AnyMessage::Sample(sample) if sample.version == 1 => AnyMessage::Sample(Sample {
            version: WIRE_VERSION.into(),
            flags: sample.flags | u32::from(flags::STATE_SENSED),
            ..sample
        }),
        AnyMessage::Command(command) if command.version == 1 => {
            AnyMessage::Command(Command { version: WIRE_VERSION.into(), ..command })
        }
        other => other,
    }
}
