//! A serial port: raw bytes, 8 data bits, no parity, 1 stop bit.
//!
//! The descriptor never blocks, so that a read or write waits in `poll` alone, with a
//! limit, also while another program takes the bytes away.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use rustix::termios::{
    ControlModes, OptionalActions, SpecialCodeIndex, Termios, ioctl_tiocexcl, ioctl_tiocnxcl,
    tcgetattr, tcsetattr,
};

use super::stream::{ByteStream, NonBlocking, is_end};

/// Major device numbers of pseudo-terminals (Documentation/admin-guide/devices.txt of Linux).
const PSEUDO_TERMINALS: std::ops::RangeInclusive<u32> = 136..=143;
/// Time between two checks of the settings.
const CHECK_INTERVAL: Duration = Duration::from_millis(100);

/// An open port, which no other program that locks its ports can open.
#[derive(Debug)]
pub(super) struct Port {
    path: PathBuf,
    stream: NonBlocking<File>,
    /// The settings that the driver has accepted.
    settings: Settings,
    checked: Instant,
}

/// The settings of a port, for comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Settings {
    modes: [u32; 4],
    least: u8,
    wait: u8,
    speeds: [u32; 2],
}

impl Settings {
    fn of(port: &File) -> io::Result<Self> {
        let found = tcgetattr(port)?;
        Ok(Self {
            modes: [
                found.input_modes.bits(),
                found.output_modes.bits(),
                found.control_modes.bits(),
                found.local_modes.bits(),
            ],
            least: found.special_codes[SpecialCodeIndex::VMIN],
            wait: found.special_codes[SpecialCodeIndex::VTIME],
            speeds: [found.input_speed(), found.output_speed()],
        })
    }
}

impl Port {
    /// Opens the port at `path` at `baud` bits a second.
    ///
    /// # Errors
    /// Returns the error of the system; [`ErrorKind::ResourceBusy`] when another program has
    /// locked the port, [`ErrorKind::InvalidInput`] when the port refuses the baud rate.
    pub(super) fn open(path: &Path, baud: u32) -> io::Result<Self> {
        // By default, opening waits for a carrier, and may make the port the process's terminal.
        let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed();
        let file = File::options().read(true).write(true).custom_flags(flags).open(path)?;
        let found = tcgetattr(&file)?;
        // The kernel releases this lock however the process ends.
        match file.try_lock() {
            Ok(()) => (),
            Err(TryLockError::WouldBlock) => return Err(ErrorKind::ResourceBusy.into()),
            Err(TryLockError::Error(error)) => return Err(error),
        }
        // Keeps out programs that do not lock. Not on a pseudo-terminal: its flag outlives a
        // process that is killed, for as long as the program at the other end keeps it open.
        if !PSEUDO_TERMINALS.contains(&rustix::fs::major(file.metadata()?.rdev())) {
            ioctl_tiocexcl(&file)?;
        }
        let raw = raw(found, baud)?;
        tcsetattr(&file, OptionalActions::Now, &raw)?;
        // The driver may round the baud rate.
        let settings = Settings::of(&file)?;
        if settings.modes[3] != raw.local_modes.bits() {
            return Err(io::Error::other("the port does not take the settings of a raw line"));
        }
        let stream = NonBlocking::new(file)?;
        Ok(Self { path: path.to_owned(), stream, settings, checked: Instant::now() })
    }

    /// Checks now and then that no other program has changed the settings.
    fn check_settings(&mut self) -> io::Result<()> {
        if self.checked.elapsed() < CHECK_INTERVAL {
            return Ok(());
        }
        self.checked = Instant::now();
        self.check_settings_now()
    }

    fn check_settings_now(&self) -> io::Result<()> {
        match Settings::of(self.stream.get()) {
            Ok(found) if found != self.settings => {
                Err(io::Error::other("another program has changed the settings of the port"))
            }
            // A port that is gone has none; reading reports that, after what has arrived.
            _ => Ok(()),
        }
    }
}

impl ByteStream for Port {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.check_settings()?;
        let result = self.stream.read(bytes, timeout);
        // With changed settings a read may return nothing, as if the port were gone.
        if let Err(error) = &result
            && is_end(error)
        {
            self.check_settings_now()?;
        }
        result
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)
    }

    fn other_users(&self) -> Vec<String> {
        other_users(&self.path)
    }

    fn is_serial_port(&self) -> bool {
        true
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        // For others that still have it open: with them the flag would stay.
        let _ = ioctl_tiocnxcl(self.stream.get());
    }
}

/// Returns the settings for raw bytes at `baud`, from those found.
fn raw(mut settings: Termios, baud: u32) -> io::Result<Termios> {
    settings.make_raw();
    let parts = ControlModes::CSIZE | ControlModes::PARENB | ControlModes::CSTOPB;
    settings.control_modes.remove(parts | ControlModes::CRTSCTS);
    settings.control_modes |= ControlModes::CS8 | ControlModes::CREAD | ControlModes::CLOCAL;
    settings.special_codes[SpecialCodeIndex::VMIN] = 1;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    settings.set_speed(baud).map_err(|_| ErrorKind::InvalidInput)?;
    Ok(settings)
}

/// Returns the other processes that have the port at `path` open, as `name (process id)`; of
/// other users' processes the system shows none, except to root.
#[must_use]
pub fn other_users(path: &Path) -> Vec<String> {
    let Ok(port) = fs::metadata(path) else { return Vec::new() };
    if !port.file_type().is_char_device() {
        return Vec::new();
    }
    let has_open = |process: &Path| {
        fs::read_dir(process.join("fd")).into_iter().flatten().flatten().any(|open| {
            // Follows the link to what is open.
            fs::metadata(open.path()).is_ok_and(|m| (m.dev(), m.ino()) == (port.dev(), port.ino()))
        })
    };
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    processes
        .filter_map(|entry| {
            let pid: u32 = entry.file_name().to_str()?.parse().ok()?;
            (pid != std::process::id() && has_open(&entry.path())).then(|| {
                let name = fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
                format!("{} (process {pid})", name.trim())
            })
        })
        .collect()
}

#[cfg(test)]
mod tests;
