//! What the faults need to know of a message.

use core::fmt::Debug;

use leg_control::wire::{Command, Header, Sample};

const HEADER_BITS: u32 = 8 * size_of::<Header>() as u32;

/// A message that middleware can look at, and damage.
pub(crate) trait OldWire: Copy + Debug + Send + 'static {
    /// Bits of the whole message.
    const BITS: u32;

    /// Its header.
    fn header(&self) -> &Header;

    /// Turns over one bit, counted from the first of the header, field by field
    /// as the wire has them; one beyond the last does nothing.
    fn flip(&mut self, bit: u32);
}

fn flip_in_header(header: &mut Header, bit: u32) {
    match bit {
        0..16 => header.version ^= 1 << bit,
        16..32 => header.flags ^= 1 << (bit - 16),
        32..64 => header.run_id ^= 1 << (bit - 32),
        64..128 => header.seq ^= 1 << (bit - 64),
        128..192 => header.t_ns ^= 1 << (bit - 128),
        _ => (),
    }
}

fn flip_in_figure(figure: &mut f32, bit: u32) {
    *figure = f32::from_bits(figure.to_bits() ^ 1 << bit);
}

impl OldWire for Sample {
    const BITS: u32 = 8 * size_of::<Self>() as u32;

    fn header(&self) -> &Header {
        &self.header
    }

    fn flip(&mut self, bit: u32) {
        let Some(bit) = bit.checked_sub(HEADER_BITS) else {
            return flip_in_header(&mut self.header, bit);
        };
        let figures = [
            &mut self.set_point_m_s,
            &mut self.vx_m_s,
            &mut self.y_m,
            &mut self.vy_m_s,
            &mut self.leg_length_m,
            &mut self.density_ratio,
        ];
        if let Some(figure) = figures.into_iter().nth(bit as usize / 32) {
            flip_in_figure(figure, bit % 32);
        }
    }
}

impl OldWire for Command {
    const BITS: u32 = 8 * size_of::<Self>() as u32;

    fn header(&self) -> &Header {
        &self.header
    }

    fn flip(&mut self, bit: u32) {
        let Some(bit) = bit.checked_sub(HEADER_BITS) else {
            return flip_in_header(&mut self.header, bit);
        };
        let figures = [
            &mut self.leg_angle_rad,
            &mut self.elongation_m,
            &mut self.elongation_rate_m_s,
            &mut self.apex_vx_m_s,
            &mut self.apex_y_m,
            &mut self.density_ratio,
            &mut self.velocity_offset_m_s,
        ];
        let counts = [&mut self.apexes, &mut self.rejected, &mut self.set_points_refused];
        let (word, bit) = (bit as usize / 32, bit % 32);
        let after = word.checked_sub(figures.len());
        if let Some(figure) = figures.into_iter().nth(word) {
            flip_in_figure(figure, bit);
        } else if let Some(count) = after.and_then(|after| counts.into_iter().nth(after)) {
            *count ^= 1 << bit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use super::super::WireMessage;
    #[test]
    fn same_bits() {
        for bit in 0..600 {
            let (mut a, mut b) = (Sample::default(), Sample::default());
            OldWire::flip(&mut a, bit); WireMessage::flip(&mut b, bit);
            assert_eq!(bytemuck::bytes_of(&a), bytemuck::bytes_of(&b), "{bit}");
            let (mut a, mut b) = (Command::default(), Command::default());
            OldWire::flip(&mut a, bit); WireMessage::flip(&mut b, bit);
            assert_eq!(bytemuck::bytes_of(&a), bytemuck::bytes_of(&b), "{bit}");
            assert_eq!(<Sample as OldWire>::BITS, <Sample as WireMessage>::BITS);
            assert_eq!(<Command as OldWire>::BITS, <Command as WireMessage>::BITS);
        }
    }
}
