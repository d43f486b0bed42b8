//! The firmware in the emulator, with its UART as a Unix socket.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use crate::board::Image;

const EMULATOR: &str = "qemu-system-arm";
/// Usually the emulator listens within a few hundred milliseconds; a busy machine needs longer.
const PATIENCE: Duration = Duration::from_secs(30);
/// A board whose processor has not run for this time sleeps.
const ASLEEP_FOR: Duration = Duration::from_millis(100);

/// A running emulator; killed when dropped.
#[derive(Debug)]
pub struct Emulator {
    child: Child,
    uart: PathBuf,
}

impl Emulator {
    /// Starts the image with an optional policy file in slot A. The UART is the socket
    /// `uart.sock` in `folder`.
    ///
    /// # Errors
    /// Fails if the emulator is missing or does not start.
    pub fn start(image: &Image, policy: Option<&Path>, folder: &Path) -> Result<Self> {
        let uart = folder.join("uart.sock");
        let mut command = Command::new(EMULATOR);
        command
            .args(["-machine", image.board.machine])
            .args(["-display", "none", "-monitor", "none", "-nodefaults"])
            .args(image.board.peripherals)
            .args(["-semihosting-config", "enable=on,target=native"])
            .arg("-serial")
            .arg(format!("unix:{},server=on,wait=off", uart.display()))
            .arg("-kernel")
            .arg(&image.path)
            .stdin(Stdio::null());
        if let Some(policy) = policy {
            let at = image.symbol("__slot_a")?;
            let file = policy.display();
            command.args(["-device", &format!("loader,file={file},addr={at:#x},force-raw=on")]);
        }
        let child = command
            .spawn()
            .with_context(|| format!("cannot start {EMULATOR}; `cargo xtask setup` installs it"))?;
        let mut emulator = Self { child, uart };
        let begun = Instant::now();
        while !is_listened_on(&emulator.uart) {
            if let Some(status) = emulator.ended()? {
                bail!("{EMULATOR} ended at once, with {status}; its message is above");
            }
            if begun.elapsed() > PATIENCE {
                bail!("{EMULATOR} has not opened {} in {PATIENCE:?}", emulator.uart.display());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(emulator)
    }

    /// Returns the socket of the UART.
    #[must_use]
    pub fn uart(&self) -> &Path {
        &self.uart
    }

    /// Waits until the board sleeps: its start-up is complete, and only bytes on the UART wake
    /// it again.
    ///
    /// # Errors
    /// Fails if the emulator ends or the board does not sleep in time.
    pub fn wait_until_asleep(&mut self) -> Result<()> {
        let begun = Instant::now();
        let mut before = None;
        loop {
            let now = asleep(self.pid())?;
            if now.is_some() && now == before {
                return Ok(());
            }
            if let Some(status) = self.ended()? {
                bail!("{EMULATOR} ended with {status} before its board slept");
            }
            ensure!(begun.elapsed() <= PATIENCE, "the board has not slept once in {PATIENCE:?}");
            before = now;
            std::thread::sleep(ASLEEP_FOR);
        }
    }

    /// Returns the process id.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Returns the exit status, chosen by the firmware, if the emulator has ended.
    ///
    /// # Errors
    /// Fails if the system call fails.
    pub fn ended(&mut self) -> Result<Option<ExitStatus>> {
        self.child.try_wait().context("cannot wait for the emulator")
    }
}

/// Returns the context switches of each thread of a process if all of them sleep now. Two
/// equal results mean that no thread has run in between, however busy the machine: a thread
/// that waits for a core does not count as sleeping.
fn asleep(pid: u32) -> Result<Option<Vec<String>>> {
    let mut switches = Vec::new();
    for thread in std::fs::read_dir(format!("/proc/{pid}/task")).context("no such process")? {
        let status = std::fs::read_to_string(thread?.path().join("status"))?;
        let is_asleep = |line: &str| line.starts_with("State:") && line.contains("(sleeping)");
        if !status.lines().any(is_asleep) {
            return Ok(None);
        }
        let counts = status.lines().filter(|line| line.contains("ctxt_switches"));
        switches.extend(counts.map(str::to_owned));
    }
    Ok(Some(switches))
}

/// Returns whether a process listens on a socket. The file exists some time before that, and
/// a trial connection would use up the only one that the UART accepts.
fn is_listened_on(socket: &Path) -> bool {
    /// `__SO_ACCEPTCON` in the fourth column.
    const LISTENS: &str = "00010000";
    let sockets = std::fs::read_to_string("/proc/net/unix").unwrap_or_default();
    let mut lines = sockets.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    lines.any(|columns| {
        columns.get(3) == Some(&LISTENS)
            && columns.last().is_some_and(|&path| Path::new(path) == socket)
    })
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_file(&self.uart);
    }
}
