//! Stopping in good order when a signal asks for it.

use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

/// Whether this process was asked to stop. Clones share the answer.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Raised by SIGINT, SIGTERM and SIGHUP (a closed terminal), so that loops
    /// end, and shared memory is given back. A second signal ends the process
    /// at once, with status 1. Where SIGHUP is ignored, as under `nohup`, it stays so.
    ///
    /// # Errors
    /// When the system refuses the handlers.
    pub fn on_signals() -> io::Result<Self> {
        let stop = Self::default();
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            stop.raise_on(signal)?;
        }
        Ok(stop)
    }

    /// As [`Stop::on_signals`], but for SIGHUP: what that asks for is to be
    /// looked at, see [`HangUp`].
    ///
    /// # Errors
    /// When the system refuses the handlers.
    pub fn on_signals_but_hang_up() -> io::Result<(Self, HangUp)> {
        let stop = Self::default();
        for signal in [SIGINT, SIGTERM] {
            stop.raise_on(signal)?;
        }
        let hang_up = HangUp { came: Arc::default(), had_terminal: has_terminal() };
        if !is_ignored(SIGHUP) {
            flag::register(SIGHUP, Arc::clone(&hang_up.came))?;
        }
        Ok((stop, hang_up))
    }

    fn raise_on(&self, signal: i32) -> io::Result<()> {
        if signal == SIGHUP && is_ignored(signal) {
            return Ok(());
        }
        // In this order: the second signal must find the flag raised by the first.
        flag::register_conditional_shutdown(signal, 1, Arc::clone(&self.0))?;
        flag::register(signal, Arc::clone(&self.0))?;
        Ok(())
    }

    /// Asks this process to stop.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked to.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// A SIGHUP that need not be the end.
///
/// It has two meanings: the terminal is closed, or, by an old habit of
/// programs without one, "read your files again".
#[derive(Debug)]
pub struct HangUp {
    came: Arc<AtomicBool>,
    /// At the start.
    had_terminal: bool,
}

/// What a SIGHUP asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HungUp {
    /// To end: the terminal that there was is no more.
    TerminalClosed,
    /// To read the files again.
    Reload,
}

impl HangUp {
    /// What was asked for since the last call.
    #[must_use]
    pub fn take(&self) -> Option<HungUp> {
        self.came.swap(false, Ordering::Relaxed).then(|| {
            if self.had_terminal && !has_terminal() {
                HungUp::TerminalClosed
            } else {
                HungUp::Reload
            }
        })
    }
}

/// Whether this process has a terminal that controls it.
fn has_terminal() -> bool {
    File::open("/dev/tty").is_ok()
}

/// Whether this process ignores a signal, as it may from its start; false where
/// the system does not tell.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignored_mask(&status).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// The signals ignored, one bit each from signal 1, in the text of `/proc/PID/status`.
fn ignored_mask(status: &str) -> Option<u64> {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
    u64::from_str_radix(mask.trim(), 16).ok()
}

#[cfg(test)]
mod tests {
    use super::ignored_mask;

    #[test]
    fn the_signals_ignored_are_read_from_the_status() {
        let status = "Name:\ttrainer\nSigBlk:\t0000000000000002\nSigIgn:\t0000000000001001\n";
        assert_eq!(ignored_mask(status), Some(0x1001));
        assert_eq!(ignored_mask("Name:\ttrainer\n"), None);
    }
}
