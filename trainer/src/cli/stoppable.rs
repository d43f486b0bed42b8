//! Work that a signal can interrupt.

use crate::threads::redraw;
use indicatif::{ProgressBar, ProgressStyle};
use leg_process::Stop;
use rayon::ThreadPool;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Runs `work` on the threads of a pool, with a spinner on a terminal. Returns `None` when a
/// signal stops it; it then ends with the process.
pub(super) fn unless_stopped<T: Send + 'static>(
    pool: &ThreadPool,
    stop: &Stop,
    doing: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let style = ProgressStyle::with_template("{spinner} {msg}  {elapsed}").expect("a template");
    let spinner = ProgressBar::new_spinner().with_style(style).with_message(doing);
    redraw(&spinner, Duration::from_millis(200));
    let (sender, receiver) = channel();
    pool.spawn(move || {
        // Sending fails only after a stop.
        _ = sender.send(catch_unwind(AssertUnwindSafe(work)));
    });
    let result = loop {
        match receiver.recv_timeout(Duration::from_millis(50)) {
            Ok(_) | Err(RecvTimeoutError::Timeout) if stop.is_raised() => break None,
            Ok(result) => break Some(result),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => unreachable!("it sends before it ends"),
        }
    };
    spinner.finish_and_clear();
    result.map(|result| result.unwrap_or_else(|panic| resume_unwind(panic)))
}
