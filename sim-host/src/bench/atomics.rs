//! The lower bound: atomic words in shared memory, with a counter in each direction.
#![allow(unsafe_code, reason = "a view of shared memory as atomics; nothing else here can do it")]

use std::fs::File;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use leg_host::Domain;
use memmap2::{MmapOptions, MmapRaw};

use super::{Ping, Pong, spin_for};

/// Distance of the two directions in words; they share no pair of cache lines.
const STRIDE: usize = 32;
const WORDS: usize = 2 * STRIDE;
/// Index of the counter of each direction, followed by its words.
const PING: usize = 0;
const PONG: usize = STRIDE;

/// The words shared by the two processes.
struct Shared(MmapRaw);

impl Shared {
    fn path(domain: &Domain) -> PathBuf {
        // With the domain's prefix, so that it is removed with the domain.
        PathBuf::from(format!("/dev/shm/{}bench", domain.prefix()))
    }

    fn map(file: &File) -> std::io::Result<Self> {
        MmapOptions::new().len(8 * WORDS).map_raw(file).map(Self)
    }

    #[expect(clippy::cast_ptr_alignment, reason = "a map begins at a page")]
    fn words(&self) -> &[AtomicU64; WORDS] {
        let words = self.0.as_ptr().cast::<[AtomicU64; WORDS]>();
        // SAFETY: the map is `8 * WORDS` bytes of a file of that length, page-aligned, and
        // lives as long as `self`; every process touches it by atomics only, and every bit
        // pattern is a u64.
        unsafe { &*words }
    }

    /// Writes words, then the counter that publishes them.
    fn send(&self, at: usize, count: u64, message: &[u64]) {
        let words = self.words();
        for (word, value) in words[at + 1..].iter().zip(message) {
            word.store(*value, Ordering::Relaxed);
        }
        words[at].store(count, Ordering::Release);
    }

    /// Waits for the counter, then reads the words.
    fn receive<const N: usize>(&self, at: usize, count: u64) -> anyhow::Result<[u64; N]> {
        let words = self.words();
        spin_for(|| Ok((words[at].load(Ordering::Acquire) == count).then_some(())))?;
        Ok(std::array::from_fn(|i| words[at + 1 + i].load(Ordering::Relaxed)))
    }
}

/// The end that sends first.
pub(super) struct Requester {
    shared: Shared,
    count: u64,
}

impl Requester {
    pub(super) fn create(domain: &Domain) -> anyhow::Result<Self> {
        let path = Shared::path(domain);
        let file = File::options().create(true).truncate(true).read(true).write(true).open(&path);
        let shared = file.and_then(|file| {
            file.set_len(8 * WORDS as u64)?;
            Shared::map(&file)
        });
        let shared = shared.with_context(|| format!("cannot share {}", path.display()))?;
        Ok(Self { shared, count: 0 })
    }

    pub(super) fn exchange(&mut self, i: u64) -> anyhow::Result<()> {
        self.count += 1;
        let ping: Ping = [i; 6];
        self.shared.send(PING, self.count, &ping);
        let pong: Pong = self.shared.receive(PONG, self.count)?;
        anyhow::ensure!(pong == [i; 8], "sent {i}, received {pong:?}");
        Ok(())
    }
}

/// The end that echoes.
pub(super) struct Responder {
    shared: Shared,
    count: u64,
}

impl Responder {
    /// Waits until the other end has created the memory.
    pub(super) fn open(domain: &Domain, timeout: Duration) -> anyhow::Result<Self> {
        let path = Shared::path(domain);
        let start = Instant::now();
        loop {
            match File::options().read(true).write(true).open(&path) {
                Ok(file) if file.metadata()?.len() == 8 * WORDS as u64 => {
                    return Ok(Self { shared: Shared::map(&file)?, count: 0 });
                }
                Err(cause) if start.elapsed() > timeout => {
                    return Err(cause).with_context(|| format!("cannot open {}", path.display()));
                }
                _ => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    pub(super) fn respond(&mut self, times: u64) -> anyhow::Result<()> {
        for _ in 0..times {
            self.count += 1;
            let ping: Ping = self.shared.receive(PING, self.count)?;
            let pong: Pong = [ping[0]; 8];
            self.shared.send(PONG, self.count, &pong);
        }
        Ok(())
    }
}
