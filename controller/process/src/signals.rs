//! A stop flag raised by signals.

use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU, SIGXFSZ};
use signal_hook::iterator::Signals;
use signal_hook::{flag, low_level};

use crate::remedy;

/// Signals within this time of the first count as one: `timeout` sends two, and a
/// terminal signals every process of a group, whose parent then signals it again.
const GRACE: Duration = Duration::from_millis(500);
/// Signals that raise [`Stop`] unless they are ignored at the start: a closed terminal, and
/// those that batch systems send before the end of a job's time and the kernel at the soft
/// limit of processor time.
const IGNORABLE: [i32; 4] = [SIGHUP, SIGUSR1, SIGUSR2, SIGXCPU];
/// Signals that always raise [`Stop`].
const ALWAYS: [i32; 2] = [SIGINT, SIGTERM];
/// Stack of the thread that waits for signals, bytes.
const STACK: usize = 64 * 1024;

/// A flag that asks this process to stop. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Returns a flag that SIGINT, SIGTERM, SIGHUP (a closed terminal), SIGUSR1, SIGUSR2
    /// and SIGXCPU (batch systems, the limit of processor time) raise, so that loops end
    /// and shared memory is released.
    ///
    /// A further signal half a second later or more ends the process immediately
    /// with status 1, except for SIGXCPU, which the kernel repeats every second. If
    /// SIGHUP is ignored at the start, as under `nohup`, or one of the last three, it
    /// stays ignored.
    ///
    /// # Errors
    /// Returns the system's error when the handlers cannot be installed.
    pub fn on_signals() -> io::Result<Self> {
        Self::on(&IGNORABLE)
    }

    /// As [`Stop::on_signals`], except that SIGHUP does not raise the flag but is
    /// reported by the [`SighupListener`].
    ///
    /// # Errors
    /// Returns the system's error when the handlers cannot be installed.
    pub fn on_signals_except_sighup() -> io::Result<(Self, SighupListener)> {
        let stop = Self::on(&IGNORABLE[1..])?;
        let sighup = SighupListener { received: Arc::default(), had_terminal: has_terminal() };
        if !is_ignored(SIGHUP) {
            flag::register(SIGHUP, Arc::clone(&sighup.received))?;
        }
        Ok((stop, sighup))
    }

    fn on(ignorable: &[i32]) -> io::Result<Self> {
        report_size_limit();
        let stop = Self::default();
        let heeded = ignorable.iter().copied().filter(|&signal| !is_ignored(signal));
        let signals: Vec<i32> = ALWAYS.into_iter().chain(heeded).collect();
        for &signal in &signals {
            flag::register(signal, Arc::clone(&stop.0))?;
        }
        let signals = Signals::new(signals)?;
        thread::Builder::new()
            .name("signals".to_owned())
            .stack_size(STACK)
            .spawn(move || exit_on_second_signal(signals))
            .map_err(|e| {
                let text = format!("no thread can be started ({e}); {}", remedy::OF_THREAD);
                io::Error::new(e.kind(), text)
            })?;
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

/// Ends the process at the first signal other than SIGXCPU that arrives [`GRACE`] or more
/// after the first one, which then had no effect.
fn exit_on_second_signal(mut signals: Signals) {
    let mut first: Option<Instant> = None;
    for signal in signals.forever() {
        if first.get_or_insert_with(Instant::now).elapsed() >= GRACE && signal != SIGXCPU {
            low_level::exit(1);
        }
    }
}

/// Keeps this process alive when one of the signals arrives that raise [`Stop`] in others,
/// for a helper that ends when the program that uses it does.
///
/// # Errors
/// Returns the system's error when the handlers cannot be installed.
pub fn disregard_stop_signals() -> io::Result<()> {
    for signal in ALWAYS.into_iter().chain(IGNORABLE) {
        flag::register(signal, Arc::default())?;
    }
    Ok(())
}

/// Makes a write beyond the limit of file sizes (`ulimit -f`) fail with the error "File too
/// large", as a full disk does, instead of ending the process by SIGXFSZ without a word.
/// Every program calls this first; [`Stop`] does as well.
pub fn report_size_limit() {
    // A handler, not the disposition "ignore", so that programs that this one starts begin
    // with the default. It fails for invalid signals only.
    _ = flag::register(SIGXFSZ, Arc::default());
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
    use std::fs::OpenOptions;
    use std::io::{BufRead as _, BufReader, ErrorKind, Write as _};
    use std::process::{Child, Command, Stdio};

    use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, setrlimit};

    use super::*;

    /// Environment variable that marks the child process of a test.
    const CHILD: &str = "SIGNALS_TEST_CHILD";

    fn is_child() -> bool {
        std::env::var_os(CHILD).is_some()
    }

    /// Runs a test of this module again as a child process, and waits until it is ready.
    fn child(test: &str) -> Child {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", &format!("signals::tests::{test}"), "--nocapture"])
            .env(CHILD, "1")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap() == "ready"), "the child does not start");
        child
    }

    /// Sends signals until the child ends. Returns its exit status and how long this took.
    fn end(mut child: Child, mut next: impl FnMut() -> Signal) -> (Option<i32>, Duration) {
        let pid = Pid::from_child(&child);
        let first = Instant::now();
        while child.try_wait().unwrap().is_none() {
            kill_process(pid, next()).unwrap();
            assert!(first.elapsed() < Duration::from_secs(30), "the child does not end");
            thread::sleep(Duration::from_millis(20));
        }
        (child.wait().unwrap().code(), first.elapsed())
    }

    /// The child never checks the flag.
    #[test]
    fn a_second_signal_after_the_grace_period_ends_the_process() {
        if is_child() {
            let _stop = Stop::on_signals().unwrap();
            println!("\nready");
            thread::sleep(Duration::from_mins(1));
            low_level::exit(7);
        }
        let child = child("a_second_signal_after_the_grace_period_ends_the_process");
        let (code, took) = end(child, || Signal::TERM);
        assert_eq!(code, Some(1));
        assert!(took >= GRACE, "signals within the grace period count as one");
    }

    /// The child ends with status 7 two grace periods after the flag was raised.
    #[test]
    fn the_signals_of_batch_systems_raise_the_flag() {
        if is_child() {
            let stop = Stop::on_signals().unwrap();
            println!("\nready");
            while !stop.is_raised() {
                thread::sleep(Duration::from_millis(5));
            }
            thread::sleep(2 * GRACE);
            low_level::exit(7);
        }
        for signal in [Signal::USR1, Signal::USR2, Signal::XCPU] {
            let child = child("the_signals_of_batch_systems_raise_the_flag");
            let mut sent = false;
            // The kernel repeats SIGXCPU; the others are sent once, SIGCONT has no effect.
            let next = || {
                if signal != Signal::XCPU && sent {
                    return Signal::CONT;
                }
                sent = true;
                signal
            };
            assert_eq!(end(child, next).0, Some(7), "{signal:?}");
        }
    }

    #[test]
    fn a_write_beyond_the_size_limit_is_an_error() {
        if is_child() {
            report_size_limit();
            let limit = Rlimit { current: Some(4096), maximum: None };
            setrlimit(Resource::Fsize, limit).unwrap();
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("file");
            let mut file = OpenOptions::new().write(true).create_new(true).open(path).unwrap();
            let error = file.write_all(&[0; 8192]).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::FileTooLarge);
            println!("\nready");
            // The test harness would print more, into a pipe that may be closed.
            low_level::exit(7);
        }
        let mut child = child("a_write_beyond_the_size_limit_is_an_error");
        assert_eq!(child.wait().unwrap().code(), Some(7));
    }

    #[test]
    fn the_mask_of_ignored_signals_is_parsed() {
        let status = "Name:\ttrainer\nSigBlk:\t0000000000000002\nSigIgn:\t0000000000001001\n";
        assert_eq!(ignored_mask(status), Some(0x1001));
        assert_eq!(ignored_mask("Name:\ttrainer\n"), None);
    }
}
