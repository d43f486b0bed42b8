//! Stopping in good order when a signal asks for it.

use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::{flag, low_level};

/// Signals that come within so long of the first mean the same: `timeout` sends
/// two, a terminal one to each process of a group, and a parent its own after that.
const GRACE: Duration = Duration::from_millis(500);
/// For a thread that counts signals.
const STACK: usize = 64 * 1024;

/// Whether this process was asked to stop. Clones share the answer.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Raised by SIGINT, SIGTERM and SIGHUP (a closed terminal), so that loops
    /// end, and shared memory is given back. Another signal, half a second later or
    /// more, ends the process at once, with status 1. Where SIGHUP is ignored, as
    /// under `nohup`, it stays so.
    ///
    /// # Errors
    /// When the system refuses the handlers.
    pub fn on_signals() -> io::Result<Self> {
        let hang_up = (!is_ignored(SIGHUP)).then_some(SIGHUP);
        Self::on([SIGINT, SIGTERM].into_iter().chain(hang_up))
    }

    /// As [`Stop::on_signals`], but for SIGHUP: what that asks for is to be
    /// looked at, see [`HangUp`].
    ///
    /// # Errors
    /// When the system refuses the handlers.
    pub fn on_signals_but_hang_up() -> io::Result<(Self, HangUp)> {
        let stop = Self::on([SIGINT, SIGTERM].into_iter())?;
        let hang_up = HangUp { came: Arc::default(), had_terminal: has_terminal() };
        if !is_ignored(SIGHUP) {
            flag::register(SIGHUP, Arc::clone(&hang_up.came))?;
        }
        Ok((stop, hang_up))
    }

    fn on(signals: impl Iterator<Item = i32> + Clone) -> io::Result<Self> {
        let stop = Self::default();
        for signal in signals.clone() {
            flag::register(signal, Arc::clone(&stop.0))?;
        }
        let signals = Signals::new(signals)?;
        thread::Builder::new()
            .name("signals".to_owned())
            .stack_size(STACK)
            .spawn(move || end_when_pressed(signals))?;
        Ok(stop)
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

/// Ends the process when a signal comes that can only mean that the first had no
/// effect.
fn end_when_pressed(mut signals: Signals) {
    let mut first: Option<Instant> = None;
    for _ in signals.forever() {
        if first.get_or_insert_with(Instant::now).elapsed() >= GRACE {
            low_level::exit(1);
        }
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
    use std::io::{BufRead as _, BufReader};
    use std::process::{Command, Stdio};

    use rustix::process::{Pid, Signal, kill_process};

    use super::*;

    /// In the environment: this is the process to be stopped.
    const DEAF: &str = "STOP_TEST_DEAF";

    /// This test runs itself again, as a process that looks at no flag.
    #[test]
    fn a_later_signal_ends_a_process_that_does_not_stop() {
        if std::env::var_os(DEAF).is_some() {
            let _stop = Stop::on_signals().unwrap();
            println!("\nready");
            thread::sleep(Duration::from_mins(1));
            return;
        }
        let this = "stop::tests::a_later_signal_ends_a_process_that_does_not_stop";
        let mut deaf = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", this, "--nocapture"])
            .env(DEAF, "1")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(deaf.stdout.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap() == "ready"), "it does not begin");
        let pid = Pid::from_child(&deaf);
        let mut asked = None;
        while deaf.try_wait().unwrap().is_none() {
            kill_process(pid, Signal::TERM).unwrap();
            let first = *asked.get_or_insert_with(Instant::now);
            assert!(first.elapsed() < Duration::from_secs(30), "it does not end");
            thread::sleep(Duration::from_millis(20));
        }
        assert_eq!(deaf.wait().unwrap().code(), Some(1));
        assert!(asked.unwrap().elapsed() >= GRACE, "signals that come together are one");
    }

    #[test]
    fn the_signals_ignored_are_read_from_the_status() {
        let status = "Name:\ttrainer\nSigBlk:\t0000000000000002\nSigIgn:\t0000000000001001\n";
        assert_eq!(ignored_mask(status), Some(0x1001));
        assert_eq!(ignored_mask("Name:\ttrainer\n"), None);
    }
}
