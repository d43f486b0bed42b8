//! Fault injection: a stream that damages what it carries.

use std::io;
use std::time::Duration;

use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};

use super::stream::ByteStream;

/// A stream around another that replaces bytes at random, both ways, by others;
/// the same seed damages the same bytes.
#[derive(Clone, Debug)]
pub struct Noisy<S> {
    stream: S,
    /// Of 2^32, so many bytes are damaged.
    share: u64,
    random: Pcg32,
    damaged: u64,
}

impl<S> Noisy<S> {
    /// Damages the fraction `share` of the bytes, 0 to 1.
    #[must_use]
    pub fn new(stream: S, share: f64, seed: u64) -> Self {
        let share = (share.clamp(0.0, 1.0) * 4_294_967_296.0) as u64;
        Self { stream, share, random: Pcg32::seed_from_u64(seed), damaged: 0 }
    }

    /// Bytes damaged so far.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    fn damage(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            if u64::from(self.random.next_u32()) < self.share {
                // Never 0: the byte is another one.
                *byte ^= (self.random.next_u32() % 255 + 1) as u8;
                self.damaged += 1;
            }
        }
    }
}

impl<S: ByteStream> ByteStream for Noisy<S> {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let count = self.stream.read(bytes, timeout)?;
        self.damage(&mut bytes[..count]);
        Ok(count)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut bytes = bytes.to_vec();
        self.damage(&mut bytes);
        self.stream.write_all(&bytes)
    }

    fn other_users(&self) -> Vec<String> {
        self.stream.other_users()
    }

    fn is_serial_port(&self) -> bool {
        self.stream.is_serial_port()
    }
}
