//! The interface of a message that the fault stages need.

use core::fmt::Debug;

use bytemuck::Pod;
use leg_control::wire::{Command, Header, Sample};

/// A message that a fault stage can identify and damage.
pub trait WireMessage: Pod + Debug + Send {
    /// Number of bits in the message.
    const BITS: u32 = 8 * size_of::<Self>() as u32;

    /// Returns the header.
    fn header(&self) -> &Header;

    /// Inverts one bit of the message in memory order, bit 0 being the lowest bit of the first
    /// byte. A bit at or beyond [`WireMessage::BITS`] changes nothing.
    ///
    /// On a little-endian machine, and on the wire, this counts through the fields in their order,
    /// each from its lowest bit.
    fn flip(&mut self, bit: u32) {
        if let Some(byte) = bytemuck::bytes_of_mut(self).get_mut(bit as usize / 8) {
            *byte ^= 1 << (bit % 8);
        }
    }
}

impl WireMessage for Sample {
    fn header(&self) -> &Header {
        &self.header
    }
}

impl WireMessage for Command {
    fn header(&self) -> &Header {
        &self.header
    }
}
