//! A stream of bytes to and from a controller, whatever carries it.

use std::fmt;
use std::fs::File;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, ioctl_fionbio};

use super::port::{Port, other_users};
use crate::socket;

/// Bits a second on a serial port, by default: the rate of the boards.
pub const USUAL_BAUD: u32 = 2_000_000;
/// Slowest and fastest baud rate.
const BAUDS: std::ops::RangeInclusive<u32> = 9_600..=12_000_000;
/// A peer that takes no bytes for so long is stuck.
const WRITE_PATIENCE: Duration = Duration::from_secs(1);
/// Longest wait for a TCP connection.
const CONNECT_PATIENCE: Duration = Duration::from_secs(3);

/// Bytes both ways. Whatever wraps one (noise, a recorder) is again one.
pub trait ByteStream: Send {
    /// Reads what has arrived; waits for the first byte at most `timeout`. Returns 0 if none
    /// has arrived.
    ///
    /// # Errors
    /// When the stream has ended ([`io::ErrorKind::UnexpectedEof`]) or broken.
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize>;

    /// Writes all bytes.
    ///
    /// # Errors
    /// When the stream has ended or broken, or takes nothing for a second.
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Returns the other processes that have the device of the stream open, and so may take
    /// bytes away.
    fn other_users(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns whether the stream is a serial port, and not a socket.
    fn is_serial_port(&self) -> bool {
        false
    }
}

impl<T: ByteStream + ?Sized> ByteStream for Box<T> {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        (**self).read(bytes, timeout)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        (**self).write_all(bytes)
    }

    fn other_users(&self) -> Vec<String> {
        (**self).other_users()
    }

    fn is_serial_port(&self) -> bool {
        (**self).is_serial_port()
    }
}

fn ended() -> io::Error {
    io::Error::new(io::ErrorKind::UnexpectedEof, "the stream has ended")
}

fn stuck() -> io::Error {
    io::Error::new(
        io::ErrorKind::TimedOut,
        format!("the other end has taken no bytes for {WRITE_PATIENCE:?}"),
    )
}

/// Waits until `stream` can be read or written; returns false after `timeout`.
fn ready(stream: &impl AsFd, what: PollFlags, timeout: Duration) -> io::Result<bool> {
    // Nanoseconds, where a socket's own timeout counts in ticks of the kernel's clock.
    let timeout = Timespec::try_from(timeout).ok();
    match poll(&mut [PollFd::new(stream, what)], timeout.as_ref()) {
        // A signal: the caller checks the stop flag.
        Err(Errno::INTR) => Ok(false),
        ready => Ok(ready? > 0),
    }
}

/// A descriptor that never blocks: every wait is a `poll` with a limit.
#[derive(Debug)]
pub(super) struct NonBlocking<S>(S);

impl<S: AsFd> NonBlocking<S> {
    /// Makes a descriptor non-blocking.
    pub(super) fn new(stream: S) -> io::Result<Self> {
        ioctl_fionbio(&stream, true)?;
        Ok(Self(stream))
    }

    pub(super) fn get(&self) -> &S {
        &self.0
    }
}

impl<S: Read + Write + AsFd + Send> ByteStream for NonBlocking<S> {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if !ready(&self.0, PollFlags::IN, timeout)? {
            return Ok(0);
        }
        match self.0.read(bytes) {
            Ok(0) => Err(ended()),
            Err(error) if is_nothing(&error) => Ok(0),
            Err(error) if is_hang_up(&error) => Err(ended()),
            result => result,
        }
    }

    fn write_all(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        let begun = Instant::now();
        while !bytes.is_empty() {
            match self.0.write(bytes) {
                Ok(0) => return Err(ended()),
                Ok(taken) => bytes = &bytes[taken..],
                Err(error) if is_nothing(&error) => {
                    let left = WRITE_PATIENCE.saturating_sub(begun.elapsed());
                    if left.is_zero() {
                        return Err(stuck());
                    }
                    ready(&self.0, PollFlags::OUT, left)?;
                }
                Err(error) if is_hang_up(&error) => return Err(ended()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Returns whether an error is that of a terminal whose other end is gone, as of a port that
/// was unplugged.
fn is_hang_up(error: &io::Error) -> bool {
    error.raw_os_error() == Some(Errno::IO.raw_os_error())
}

/// A stream that was closed at this end.
pub(super) struct Closed;

impl ByteStream for Closed {
    fn read(&mut self, _bytes: &mut [u8], _timeout: Duration) -> io::Result<usize> {
        Err(ended())
    }

    fn write_all(&mut self, _bytes: &[u8]) -> io::Result<()> {
        Err(ended())
    }
}

/// Returns whether an error means that the other end has closed the stream.
pub(super) fn is_end(error: &io::Error) -> bool {
    use io::ErrorKind::{BrokenPipe, ConnectionReset, UnexpectedEof};
    matches!(error.kind(), UnexpectedEof | BrokenPipe | ConnectionReset)
}

fn is_nothing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted | io::ErrorKind::TimedOut
    )
}

/// Returns a stream over a connected unix socket.
///
/// # Errors
/// When the system refuses to make it non-blocking.
pub fn over_unix(socket: UnixStream) -> io::Result<Box<dyn ByteStream>> {
    Ok(Box::new(NonBlocking::new(socket)?))
}

/// Returns a stream over a TCP connection; small messages are sent at once.
///
/// # Errors
/// When the system refuses to make it non-blocking.
pub fn over_tcp(socket: TcpStream) -> io::Result<Box<dyn ByteStream>> {
    // Without it, an acknowledgement that is waited for costs 40 ms a round trip.
    socket.set_nodelay(true)?;
    Ok(Box::new(NonBlocking::new(socket)?))
}

/// Returns a stream over an open device, such as the master of a pseudo-terminal.
///
/// # Errors
/// When the system refuses to make it non-blocking.
pub fn over_device(device: File) -> io::Result<Box<dyn ByteStream>> {
    Ok(Box::new(NonBlocking::new(device)?))
}

/// Where a controller can be reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// A serial port, 8 data bits, no parity, 1 stop bit.
    Serial {
        /// Such as `/dev/ttyACM0`.
        path: PathBuf,
        /// Bits a second; a USB port takes any.
        baud: u32,
    },
    /// A unix socket on which a process listens.
    Unix(PathBuf),
    /// `host:port`.
    Tcp(String),
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { path, baud } => write!(f, "{} at {baud} baud", path.display()),
            Self::Unix(path) => write!(f, "{}", path.display()),
            Self::Tcp(address) => f.write_str(address),
        }
    }
}

/// A stream that could not be opened, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[error("cannot open {endpoint}: {cause}{}", hint(endpoint, cause.kind()))]
pub struct OpenError {
    /// Which.
    pub endpoint: Endpoint,
    /// The error of the system.
    pub cause: io::Error,
}

fn hint(endpoint: &Endpoint, kind: io::ErrorKind) -> String {
    use io::ErrorKind::{
        AddrNotAvailable, ConnectionRefused, InvalidInput, NotFound, PermissionDenied,
        ResourceBusy, WouldBlock,
    };
    match (endpoint, kind) {
        (Endpoint::Serial { .. }, NotFound) => {
            "; is the board plugged in? `ls /dev/ttyACM* /dev/ttyUSB*` shows the ports".into()
        }
        (Endpoint::Serial { path, .. }, PermissionDenied) => format!(
            "; `ls -l {}` names the group that may (dialout on Debian, uucp on Arch): join it by \
             `sudo usermod -aG dialout $USER`, and log in again",
            path.display()
        ),
        (Endpoint::Serial { path, .. }, ResourceBusy) => {
            let others = other_users(path);
            let who = if others.is_empty() { "another program".into() } else { others.join(", ") };
            format!(
                "; {who} has the port open: end it or, if it is a bridge, reach the controller \
                 through its domain"
            )
        }
        (Endpoint::Serial { .. }, InvalidInput) => {
            "; does the port support this baud rate? 115200 works anywhere".into()
        }
        (Endpoint::Unix(_), NotFound | ConnectionRefused) => {
            "; no process listens there: start the emulator or the bridge with this socket first"
                .into()
        }
        (Endpoint::Unix(_), WouldBlock) => {
            "; too many callers wait there: is the process that listens stopped?".into()
        }
        (Endpoint::Unix(_), PermissionDenied) => {
            "; the socket belongs to another user: run both as the same one".into()
        }
        (Endpoint::Tcp(_), ConnectionRefused | AddrNotAvailable | NotFound) => {
            "; no process listens there: start the emulator or the serial server first".into()
        }
        (Endpoint::Serial { .. }, _) => "; is it a serial port?".into(),
        _ => String::new(),
    }
}

impl Endpoint {
    /// Opens it.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn open(&self) -> Result<Box<dyn ByteStream>, OpenError> {
        self.try_open().map_err(|cause| OpenError { endpoint: self.clone(), cause })
    }

    fn try_open(&self) -> io::Result<Box<dyn ByteStream>> {
        match self {
            Self::Serial { path, baud } => Ok(Box::new(Port::open(path, *baud)?)),
            Self::Unix(path) => over_unix(socket::connect(path)?),
            Self::Tcp(address) => over_tcp(connect(address)?),
        }
    }
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut refused = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_PATIENCE) {
            Ok(socket) => return Ok(socket),
            Err(error) => refused = error,
        }
    }
    Err(refused)
}

/// The options that name an [`Endpoint`]: exactly one of three.
#[derive(Clone, Debug, clap::Args)]
#[group(skip)]
pub struct EndpointArgs {
    #[command(flatten)]
    which: Which,
    /// Bits a second on the serial port; a USB port takes any [default: 2000000].
    #[arg(long, value_name = "BAUD", conflicts_with_all = ["unix", "tcp"], value_parser = parse_baud, allow_negative_numbers = true)]
    baud: Option<u32>,
}

#[derive(Clone, Debug, clap::Args)]
#[group(id = "endpoint", required = true, multiple = false)]
struct Which {
    /// The controller is on this serial port.
    #[arg(long, value_name = "PATH")]
    serial: Option<PathBuf>,
    /// The controller is behind this unix socket: an emulator's, or a bridge's --share.
    #[arg(long, value_name = "PATH")]
    unix: Option<PathBuf>,
    /// The controller is behind this TCP port.
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address)]
    tcp: Option<String>,
}

/// Reads a baud rate.
///
/// # Errors
/// A message with the limits.
pub fn parse_baud(text: &str) -> Result<u32, String> {
    text.parse().ok().filter(|baud| BAUDS.contains(baud)).ok_or_else(|| {
        format!("it must be a whole number of bits a second, {} to {}", BAUDS.start(), BAUDS.end())
    })
}

/// Reads `host:port`.
///
/// # Errors
/// A message with the format.
pub fn parse_address(text: &str) -> Result<String, String> {
    let is_one = text
        .rsplit_once(':')
        .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
    if is_one {
        Ok(text.to_owned())
    } else {
        Err("it must be HOST:PORT, the port up to 65535".into())
    }
}

impl EndpointArgs {
    /// What they name.
    #[must_use]
    pub fn endpoint(&self) -> Endpoint {
        match &self.which {
            Which { serial: Some(path), .. } => {
                Endpoint::Serial { path: path.clone(), baud: self.baud.unwrap_or(USUAL_BAUD) }
            }
            Which { unix: Some(path), .. } => Endpoint::Unix(path.clone()),
            Which { tcp, .. } => Endpoint::Tcp(tcp.clone().unwrap_or_default()),
        }
    }
}
