//! A stop flag raised by signals.

use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::{flag, low_level};

/// Signals within this time of the first count as one: `timeout` sends two, and a
/// terminal signals every process of a group, whose parent then signals it again.
const GRACE: Duration = Duration::from_millis(500);
/// Stack of the thread that waits for signals, bytes.
const STACK: usize = 64 * 1024;

/// A flag that asks this process to stop. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Returns a flag that SIGINT, SIGTERM and SIGHUP (a closed terminal) raise, so
    /// that loops end and shared memory is released.
    ///
    /// A further signal half a second later or more ends the process immediately
    /// with status 1. If SIGHUP is ignored at the start, as under `nohup`, it stays
    /// ignored.
    ///
    /// # Errors
    /// Returns the system's error when the handlers cannot be installed.
    pub fn on_signals() -> io::Result<Self> {
        let sighup = (!is_ignored(SIGHUP)).then_some(SIGHUP);
        Self::on([SIGINT, SIGTERM].into_iter().chain(sighup))
    }

    /// As [`Stop::on_signals`], except that SIGHUP does not raise the flag but is
    /// reported by the [`SighupListener`].
    ///
    /// # Errors
    /// Returns the system's error when the handlers cannot be installed.
    pub fn on_signals_except_sighup() -> io::Result<(Self, SighupListener)> {
        let stop = Self::on([SIGINT, SIGTERM].into_iter())?;
        let sighup = SighupListener { received: Arc::default(), had_terminal: has_terminal() };
        if !is_ignored(SIGHUP) {
            flag::register(SIGHUP, Arc::clone(&sighup.received))?;
        }
        Ok((stop, sighup))
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
            .spawn(move || exit_on_second_signal(signals))?;
        Ok(stop)
    }

    /// Raises the flag.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns true once the flag has been raised.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Ends the process at the first signal that arrives [`GRACE`] or more after the
/// first one, which then had no effect.
fn exit_on_second_signal(mut signals: Signals) {
    let mut first: Option<Instant> = None;
    for _ in signals.forever() {
        if first.get_or_insert_with(Instant::now).elapsed() >= GRACE {
            low_level::exit(1);
        }
    }
}

/// Reports SIGHUP and what it asks for.
///
/// The signal has two meanings: the controlling terminal was closed or, by the
/// convention of daemons, which have no terminal, "reload the files".
#[derive(Debug)]
pub struct SighupListener {
    received: Arc<AtomicBool>,
    /// Whether the process had a controlling terminal at its start.
    had_terminal: bool,
}

/// The action that a SIGHUP asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SighupAction {
    /// The controlling terminal was closed: the process should end.
    TerminalClosed,
    /// The process should reload its files.
    Reload,
}

impl SighupListener {
    /// Returns the action of a SIGHUP received since the last call.
    #[must_use]
    pub fn take(&self) -> Option<SighupAction> {
        self.received.swap(false, Ordering::Relaxed).then(|| {
            if self.had_terminal && !has_terminal() {
                SighupAction::TerminalClosed
            } else {
                SighupAction::Reload
            }
        })
    }
}

/// Returns whether this process has a controlling terminal.
fn has_terminal() -> bool {
    File::open("/dev/tty").is_ok()
}

/// Returns whether this process ignores `signal`, as it may from its start; false
/// where `/proc` does not show it.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignored_mask(&status).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Parses the mask of ignored signals from the text of `/proc/PID/status`: bit 0 is
/// signal 1.
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

    /// Environment variable that marks the child process of the test.
    const CHILD: &str = "SIGNALS_TEST_CHILD";

    /// Runs itself again as a child process that never checks the flag.
    #[test]
    fn a_second_signal_after_the_grace_period_ends_the_process() {
        if std::env::var_os(CHILD).is_some() {
            let _stop = Stop::on_signals().unwrap();
            println!("\nready");
            thread::sleep(Duration::from_mins(1));
            return;
        }
        let this = "signals::tests::a_second_signal_after_the_grace_period_ends_the_process";
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", this, "--nocapture"])
            .env(CHILD, "1")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap() == "ready"), "the child does not start");
        let pid = Pid::from_child(&child);
        let mut first_sent = None;
        while child.try_wait().unwrap().is_none() {
            kill_process(pid, Signal::TERM).unwrap();
            let first = *first_sent.get_or_insert_with(Instant::now);
            assert!(first.elapsed() < Duration::from_secs(30), "the child does not end");
            thread::sleep(Duration::from_millis(20));
        }
        assert_eq!(child.wait().unwrap().code(), Some(1));
        assert!(
            first_sent.unwrap().elapsed() >= GRACE,
            "signals within the grace period count as one"
        );
    }

    #[test]
    fn the_mask_of_ignored_signals_is_parsed() {
        let status = "Name:\ttrainer\nSigBlk:\t0000000000000002\nSigIgn:\t0000000000001001\n";
        assert_eq!(ignored_mask(status), Some(0x1001));
        assert_eq!(ignored_mask("Name:\ttrainer\n"), None);
    }
}
