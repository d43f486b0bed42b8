//! A stream of bytes to and from a controller, whatever carries it.

use std::fmt;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serialport::{SerialPort, TTYPort};

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
    /// Takes what has come, waiting for the first byte at most `timeout`; 0
    /// when none came.
    ///
    /// # Errors
    /// When the stream has ended ([`io::ErrorKind::UnexpectedEof`]) or broken.
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize>;

    /// Hands over all bytes.
    ///
    /// # Errors
    /// When the stream has ended or broken, or takes nothing for a second.
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()>;
}

impl<T: ByteStream + ?Sized> ByteStream for Box<T> {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        (**self).read(bytes, timeout)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        (**self).write_all(bytes)
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

/// Whether it can be read from, or written to, within `timeout`.
fn ready(stream: &impl AsFd, what: PollFlags, timeout: Duration) -> io::Result<bool> {
    // Nanoseconds, where a socket's own timeout counts in ticks of the kernel's clock.
    let timeout = Timespec::try_from(timeout).ok();
    match poll(&mut [PollFd::new(stream, what)], timeout.as_ref()) {
        // A signal: the caller checks the stop flag.
        Err(rustix::io::Errno::INTR) => Ok(false),
        ready => Ok(ready? > 0),
    }
}

/// A socket that never blocks by itself.
struct Socket<S>(S);

impl<S: Read + Write + AsFd + Send> ByteStream for Socket<S> {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if !ready(&self.0, PollFlags::IN, timeout)? {
            return Ok(0);
        }
        match self.0.read(bytes) {
            Ok(0) => Err(ended()),
            Err(error) if is_nothing(&error) => Ok(0),
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
                Err(error) => return Err(error),
            }
        }
        Ok(())
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

/// A stream over a connected unix socket.
///
/// # Errors
/// When the system refuses to make it non-blocking.
pub fn over_unix(socket: UnixStream) -> io::Result<Box<dyn ByteStream>> {
    socket.set_nonblocking(true)?;
    Ok(Box::new(Socket(socket)))
}

/// A stream over a TCP connection; small messages go out at once.
///
/// # Errors
/// When the system refuses to make it non-blocking.
pub fn over_tcp(socket: TcpStream) -> io::Result<Box<dyn ByteStream>> {
    socket.set_nonblocking(true)?;
    // Without it, an acknowledgement that is waited for costs 40 ms a round trip.
    socket.set_nodelay(true)?;
    Ok(Box::new(Socket(socket)))
}

impl ByteStream for TTYPort {
    fn read(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.set_timeout(timeout)?;
        match Read::read(self, bytes) {
            // The error of a port that was unplugged.
            Ok(0) => Err(ended()),
            Err(error) if is_nothing(&error) => Ok(0),
            result => result,
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.set_timeout(WRITE_PATIENCE)?;
        match Write::write_all(self, bytes) {
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Err(stuck()),
            result => result,
        }
    }
}

/// Where a controller is to be reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// A serial port, 8 data bits, no parity, 1 stop bit.
    Serial {
        /// Such as `/dev/ttyACM0`.
        path: PathBuf,
        /// Bits a second; a USB port takes any.
        baud: u32,
    },
    /// A unix socket that somebody listens on.
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
        AddrNotAvailable, ConnectionRefused, InvalidInput, NotFound, PermissionDenied, ResourceBusy,
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
        (Endpoint::Serial { .. }, ResourceBusy) => {
            "; another program has the port open: end it, or reach the controller through that \
             bridge's shared socket"
                .into()
        }
        (Endpoint::Serial { .. }, InvalidInput) => {
            "; does the port support this baud rate? 115200 works anywhere".into()
        }
        (Endpoint::Unix(_), NotFound | ConnectionRefused) => {
            "; nobody listens there: start the emulator or the bridge with this socket first".into()
        }
        (Endpoint::Unix(_), PermissionDenied) => {
            "; the socket belongs to another user: run both as the same one".into()
        }
        (Endpoint::Tcp(_), ConnectionRefused | AddrNotAvailable | NotFound) => {
            "; nobody listens there: start the emulator or the serial server first".into()
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
            Self::Serial { path, baud } => open_port(path, *baud),
            Self::Unix(path) => over_unix(UnixStream::connect(path)?),
            Self::Tcp(address) => over_tcp(connect(address)?),
        }
    }
}

fn open_port(path: &Path, baud: u32) -> io::Result<Box<dyn ByteStream>> {
    // serialport tells neither a missing port nor a forbidden one by its kind.
    let port = std::fs::File::options().read(true).write(true).custom_flags_for_a_port().open(path);
    drop(port?);
    let name = path.to_str().ok_or(io::ErrorKind::InvalidFilename)?;
    let port = TTYPort::open(&serialport::new(name, baud)).map_err(|error| match error.kind() {
        serialport::ErrorKind::NoDevice => {
            io::Error::new(io::ErrorKind::ResourceBusy, error.description)
        }
        serialport::ErrorKind::InvalidInput => {
            io::Error::new(io::ErrorKind::InvalidInput, error.description)
        }
        _ => error.into(),
    })?;
    Ok(Box::new(port))
}

/// Opening a port waits for a carrier, and may make it the process's terminal,
/// by default.
trait PortOptions {
    fn custom_flags_for_a_port(&mut self) -> &mut Self;
}

impl PortOptions for std::fs::OpenOptions {
    fn custom_flags_for_a_port(&mut self) -> &mut Self {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        self.custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed())
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
