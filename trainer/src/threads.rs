//! Threads, as many as the system allows.

use indicatif::ProgressBar;
use leg_process::remedy;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::num::NonZeroUsize;
use std::thread;
use std::time::Duration;

/// Largest number of threads for each CPU. More are of no use, and their stacks could use up
/// the address space that a limit (`ulimit -v`) leaves.
const MOST_FOR_A_CPU: usize = 4;
/// Time for the threads of a pool that could not be completed to end.
const PAUSE: Duration = Duration::from_millis(20);

/// The system starts no thread.
#[derive(Debug, thiserror::Error)]
#[error("no thread can be started ({cause}); {}", remedy::OF_THREAD)]
pub struct NoThreadError {
    cause: ThreadPoolBuildError,
}

/// Threads to compute on.
#[derive(Debug)]
pub struct Threads {
    /// The pool.
    pub pool: ThreadPool,
    /// Number of threads that were tried first.
    wanted: usize,
    /// Number of threads that the user stated.
    stated: Option<usize>,
}

impl Threads {
    /// Starts as many threads as `RAYON_NUM_THREADS` states, at most four for each CPU, else
    /// one for each CPU; fewer where the system starts fewer. Results do not depend on their
    /// number.
    ///
    /// # Errors
    /// [`NoThreadError`] when there is not even one.
    pub fn start() -> Result<Self, NoThreadError> {
        let stated = std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.parse().ok());
        let stated = stated.filter(|&count| count > 0);
        let cpus = thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let wanted = stated.unwrap_or(cpus).min(MOST_FOR_A_CPU * cpus);
        let mut count = wanted;
        loop {
            // rayon's global pool could not be tried again.
            match ThreadPoolBuilder::new().num_threads(count).build() {
                Ok(pool) => return Ok(Self { pool, wanted, stated }),
                Err(cause) if count == 1 => return Err(NoThreadError { cause }),
                Err(_) => count /= 2,
            }
            thread::sleep(PAUSE);
        }
    }

    /// Returns a sentence for the user where there are fewer threads than stated or usual.
    #[must_use]
    pub fn shortage(&self) -> Option<String> {
        let count = self.pool.current_num_threads();
        if count < self.wanted {
            let (wanted, remedy) = (self.wanted, remedy::OF_THREAD);
            return Some(format!("computing on {count} instead of {wanted} threads; {remedy}"));
        }
        let stated = self.stated.filter(|&stated| stated > count)?;
        Some(format!(
            "computing on {count} instead of {stated} threads (RAYON_NUM_THREADS): more than \
             {MOST_FOR_A_CPU} for each CPU are of no use"
        ))
    }
}

/// Redraws a progress bar periodically until it is finished. Where no thread can be started
/// for that, the bar is redrawn when it advances.
pub fn redraw(bar: &ProgressBar, every: Duration) {
    if bar.is_hidden() {
        return;
    }
    let bar = bar.downgrade();
    let redraw = move || {
        while let Some(bar) = bar.upgrade().filter(|bar| !bar.is_finished()) {
            bar.tick();
            drop(bar);
            thread::sleep(every);
        }
    };
    _ = thread::Builder::new().name("progress".into()).spawn(redraw);
}
