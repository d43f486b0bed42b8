//! A hash of all states and commands of a run, to compare runs bit for bit.

use leg_control::wire::Command;

use leg_plant::Body;

/// Hash of a run's states and commands, 64 bits.
///
/// Each word `w`, the bits of one `f64` or of two 32-bit values, changes the hash
/// `h` to `(rotl(h, 5) xor w) * 0x9e3779b97f4a7c15` (2^64 over the golden
/// ratio). Both steps are bijective, so two runs that differ in one word have
/// different hashes, and runs that differ in more words almost surely do. It
/// detects accidental differences and resists no attack. A tick takes a few
/// nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StateHash(u64);

impl Default for StateHash {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl StateHash {
    fn word(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn pair(&mut self, high: u32, low: u32) {
        self.word(u64::from(high) << 32 | u64::from(low));
    }

    /// Adds a state.
    pub fn body(&mut self, body: &Body) {
        let Body { x_m, vx_m_s, y_m, vy_m_s } = *body;
        for value in [x_m, vx_m_s, y_m, vy_m_s] {
            self.word(value.to_bits());
        }
    }

    /// Adds a command without its version and run id, which differ between equal runs.
    pub fn command(&mut self, command: &Command) {
        let c = command;
        self.word(c.header.seq);
        self.word(c.header.t_ns);
        self.pair(c.header.flags.into(), c.leg_angle_rad.to_bits());
        self.pair(c.elongation_m.to_bits(), c.elongation_rate_m_s.to_bits());
        self.pair(c.apex_vx_m_s.to_bits(), c.apex_y_m.to_bits());
        self.pair(c.density_ratio.to_bits(), c.velocity_offset_m_s.to_bits());
        self.pair(c.apexes, c.rejected);
    }

    /// Returns the hash of everything added so far.
    #[must_use]
    pub fn value(&self) -> u64 {
        // Mixes the high bits of the last words into the low bits.
        let h = (self.0 ^ (self.0 >> 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^ (h >> 29)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depends_on_every_bit_and_on_the_order() {
        let body = Body { x_m: 1.0, vx_m_s: 2.0, y_m: 3.0, vy_m_s: 4.0 };
        let hash = |bodies: &[Body]| {
            let mut hash = StateHash::default();
            for body in bodies {
                hash.body(body);
            }
            hash.value()
        };
        let other = Body { x_m: 1.0 + f64::EPSILON, ..body };
        let negative = Body { vy_m_s: -4.0, ..body };
        assert_eq!(hash(&[body, other]), hash(&[body, other]));
        assert_ne!(hash(&[body]), hash(&[other]));
        assert_ne!(hash(&[body]), hash(&[negative]));
        assert_ne!(hash(&[body, other]), hash(&[other, body]));

        let mut silent = StateHash::default();
        silent.command(&Command::default());
        let mut safe = StateHash::default();
        safe.command(&Command { apexes: 1, ..Command::default() });
        assert_ne!(silent, safe);
    }
}
