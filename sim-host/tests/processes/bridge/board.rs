//! A board on a thread: the flashed controller's code behind a line that can be disturbed.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use leg_control::serial::frame::{self, MAX_FRAME};
use leg_control::serial::message::{Alarm, Slot, ToHost};
use leg_host::flash::MemoryFlash;
use leg_host::serial::VirtualBoard;
use leg_host::serial::stream::{ByteStream, over_device, over_unix};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};

use crate::SOON;
use crate::place::{Place, text};

/// A disturbance of a board.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Disturbance {
    /// The line is unplugged and plugged in again; the board keeps running.
    Unplug,
    /// The board is reset; the line stays open.
    Reset,
    /// The board is reset and the line unplugged.
    PowerCut,
    /// Another program changes the settings of the terminal.
    ChangeSettings,
    /// The board sends this alarm and is gone.
    Crash(Alarm),
}

/// What carries the bytes.
enum Carrier {
    /// The socket on which the board listens.
    Socket(UnixListener),
    /// The master of a pseudo-terminal. Its other end has a link, which stays when the
    /// terminal is replaced.
    Terminal(File),
}

/// A board behind a socket or a terminal, with disturbances.
pub(crate) struct Board {
    pub(super) path: PathBuf,
    option: &'static str,
    on: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Board {
    /// Starts a board behind a socket with the place's policy in slot A. Each disturbance
    /// comes after this many reads from the line since the one before, about one message each.
    pub(crate) fn new(place: &Place, disturbances: &[(u64, Disturbance)]) -> Self {
        let path = place.file("board");
        let listener = UnixListener::bind(&path).unwrap();
        listener.set_nonblocking(true).unwrap();
        Self::start(place, path, "--unix", Carrier::Socket(listener), disturbances)
    }

    /// Starts a board behind a pseudo-terminal.
    pub(super) fn on_terminal(place: &Place, disturbances: &[(u64, Disturbance)]) -> Self {
        let path = place.file("tty");
        let carrier = Carrier::Terminal(terminal(&path));
        Self::start(place, path, "--serial", carrier, disturbances)
    }

    fn start(
        place: &Place,
        path: PathBuf,
        option: &'static str,
        carrier: Carrier,
        disturbances: &[(u64, Disturbance)],
    ) -> Self {
        let policy = fs::read(place.policy()).unwrap();
        let on = Arc::new(AtomicBool::new(true));
        let line = Line {
            path: path.clone(),
            carrier,
            board: VirtualBoard::power_up(MemoryFlash::new().loaded(Slot::A, &policy)),
            on: Arc::clone(&on),
        };
        let disturbances = disturbances.to_vec();
        let thread = std::thread::spawn(move || line.live(&disturbances));
        Self { path, option, on, thread: Some(thread) }
    }

    /// Returns the option of the bridge that names the line.
    pub(super) fn option(&self) -> [&str; 2] {
        [self.option, text(&self.path)]
    }

    pub(super) fn socket(&self) -> &str {
        text(&self.path)
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.on.store(false, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

/// Makes a pseudo-terminal; returns its master, and links its other end to `path`.
pub(super) fn terminal(path: &Path) -> File {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let _ = fs::remove_file(path);
    symlink(OsStr::from_bytes(name.as_bytes()), path).unwrap();
    File::from(master)
}

struct Line {
    path: PathBuf,
    carrier: Carrier,
    board: VirtualBoard,
    on: Arc<AtomicBool>,
}

impl Line {
    fn live(mut self, disturbances: &[(u64, Disturbance)]) {
        let mut disturbances = disturbances.iter();
        let mut next = disturbances.next();
        let mut reads = 0;
        while self.on.load(Ordering::Relaxed) {
            let Some(mut stream) = self.next_stream() else {
                std::thread::sleep(Duration::from_millis(2));
                continue;
            };
            loop {
                let due = |reads| next.is_some_and(|(after, _)| reads >= *after);
                let on = &self.on;
                let served = self.board.serve(&mut *stream, || {
                    reads += 1;
                    on.load(Ordering::Relaxed) && !due(reads)
                });
                served.unwrap();
                let Some((_, disturbance)) = next.filter(|_| due(reads)) else {
                    break; // The caller has closed the line.
                };
                (next, reads) = (disturbances.next(), 0);
                match *disturbance {
                    Disturbance::Reset => self.board.power_cycle(),
                    Disturbance::ChangeSettings => self.change_settings(),
                    Disturbance::Unplug => break self.unplug(),
                    Disturbance::PowerCut => {
                        self.board.power_cycle();
                        break self.unplug();
                    }
                    Disturbance::Crash(alarm) => {
                        let mut room = [0; MAX_FRAME];
                        let frame = frame::encode(&ToHost::Alarm(alarm), &mut room).unwrap();
                        stream.write_all(frame).unwrap();
                        return;
                    }
                }
            }
            // A terminal that nobody has open ends each time.
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn next_stream(&mut self) -> Option<Box<dyn ByteStream>> {
        match &self.carrier {
            Carrier::Socket(listener) => {
                listener.accept().ok().map(|(socket, _)| over_unix(socket).unwrap())
            }
            Carrier::Terminal(master) => Some(over_device(master.try_clone().unwrap()).unwrap()),
        }
    }

    fn unplug(&mut self) {
        if let Carrier::Terminal(master) = &mut self.carrier {
            *master = terminal(&self.path);
        }
    }

    /// Changes the settings of the terminal, and waits until the bridge has set them again.
    fn change_settings(&self) {
        let port = File::options().read(true).write(true).open(&self.path).unwrap();
        let mut settings = tcgetattr(&port).unwrap();
        let changed = LocalModes::ICANON | LocalModes::ECHO;
        settings.local_modes |= changed;
        tcsetattr(&port, OptionalActions::Now, &settings).unwrap();
        let deadline = Instant::now() + SOON;
        while tcgetattr(&port).unwrap().local_modes.contains(changed) {
            assert!(Instant::now() < deadline, "the settings stay changed");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
