//! Work on all cores, without the GIL.

use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};
use trainer::threads::Threads;

/// Items between two looks for a signal, such as Ctrl-C: well under a second of work.
const BETWEEN_SIGNALS: usize = 100_000;
/// Fewest items for which a second thread is worth waking.
const FOR_ANOTHER_THREAD: usize = 16;
/// Parts of the work that a thread takes one after the other.
const PARTS_OF_A_THREAD: usize = 16;

/// The threads of a process.
struct Own {
    process: u32,
    threads: Option<&'static Threads>,
}

/// The threads of this process. A process that was forked, as by `multiprocessing`, inherits the
/// memory of its parent's, but not the threads.
static THREADS: Mutex<Option<Own>> = Mutex::new(None);

/// Returns the threads; `None` where the system starts none.
fn threads() -> Option<&'static Threads> {
    let process = std::process::id();
    // Held for this alone and by a thread that has the GIL, as one that forks has, too.
    let mut own = THREADS.lock().unwrap_or_else(PoisonError::into_inner);
    if own.as_ref().is_none_or(|own| own.process != process) {
        let threads = Threads::start().ok().map(|threads| &*Box::leak(Box::new(threads)));
        *own = Some(Own { process, threads });
    }
    own.as_ref().and_then(|own| own.threads)
}

/// Calls `work` for each item, on all cores where there are enough of them. The order of the calls
/// is open, so `work` must depend on its item only.
///
/// # Errors
/// The exception of a signal, such as `KeyboardInterrupt`; a part of the items is then done.
pub(crate) fn for_each<T: Send>(
    py: Python<'_>,
    items: &mut [T],
    work: impl Fn(&mut T) + Send + Sync,
) -> PyResult<()> {
    for part in items.chunks_mut(BETWEEN_SIGNALS) {
        for_each_uninterrupted(py, part, &work);
        py.check_signals()?;
    }
    Ok(())
}

/// Calls `work` for each item as [`for_each`] does, all of them whatever signal comes.
///
/// This thread works, too: the time until a sleeping one has woken up is that of many hops.
pub(crate) fn for_each_uninterrupted<T: Send>(
    py: Python<'_>,
    items: &mut [T],
    work: impl Fn(&mut T) + Send + Sync,
) {
    let others = items.len().div_ceil(FOR_ANOTHER_THREAD).saturating_sub(1);
    let pool = if others == 0 { None } else { threads().map(|threads| &threads.pool) };
    let others = pool.map_or(0, |pool| others.min(pool.current_num_threads() - 1));
    // In parts, as hops differ in their cost; few enough that taking one costs nothing.
    let part = (items.len() / (PARTS_OF_A_THREAD * (others + 1))).max(1);
    let parts = Mutex::new(items.chunks_mut(part));
    let take = || parts.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work_off = || {
        while let Some(part) = take() {
            part.iter_mut().for_each(&work);
        }
    };
    py.detach(|| match pool {
        Some(pool) if others > 0 => pool.in_place_scope(|scope| {
            for _ in 0..others {
                scope.spawn(|_| work_off());
            }
            work_off();
        }),
        _ => work_off(),
    });
}
