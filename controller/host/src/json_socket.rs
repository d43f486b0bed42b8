//! JSON requests to a running process over a unix socket, answered beside its loop.
//!
//! The socket lies in the folder of the domain. A client writes one request, a line of JSON,
//! and reads one answer, a line of JSON; then both close the connection. A thread serves one
//! client after the other, so the loop takes no part. Each program defines its requests.

use std::fmt::Display;
use std::io::{self, ErrorKind, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::discovery::{Domain, DomainError, Whereabouts};
use super::link::Role;
use super::socket::{SocketError, SocketFile, connect};

/// Longest request and longest answer, bytes.
pub const MAX_LINE: usize = 4 << 20;
/// A client must send its request and read the answer within this time.
const TIMEOUT: Duration = Duration::from_secs(2);
/// How often the thread checks whether to end.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// What the socket returns: the answer, or the reason of a refusal.
type Answer = Result<Value, String>;

/// Why a request was not answered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AskError {
    /// The name of the domain is not valid.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// No process has that role in the domain.
    #[error("no {role} is running in domain `{domain}`{whereabouts}")]
    Nobody {
        /// The role.
        role: Role,
        /// The domain.
        domain: String,
        /// Where it was looked for, and where else one runs.
        whereabouts: Whereabouts,
    },
    /// The process did not answer in time.
    #[error("the {role} in domain `{domain}` has not answered for {:.1} s; is it stopped?", waited.as_secs_f64())]
    Silent {
        /// The role.
        role: Role,
        /// The domain.
        domain: String,
        /// Time waited.
        waited: Duration,
    },
    /// The process refuses, with this reason.
    #[error("{0}")]
    Refused(String),
    /// The request is not valid JSON, or longer than the limit.
    #[error("the request is {0} bytes long; the limit is {MAX_LINE}")]
    TooLong(usize),
    /// The answer is not of the expected type.
    #[error(
        "the {role} in domain `{domain}` answers what this program cannot read ({cause}); build both from the same release"
    )]
    Unreadable {
        /// The role.
        role: Role,
        /// The domain.
        domain: String,
        /// What is wrong with it.
        cause: String,
    },
    /// The system call failed.
    #[error("cannot ask the {role} at {}: {cause}", path.display())]
    Io {
        /// The role.
        role: Role,
        /// The socket.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },
}

/// Returns the path of the socket of `role`.
fn path(root: &Path, role: Role) -> PathBuf {
    root.join(format!("{}.sock", role.as_str()))
}

/// An open socket; it closes when dropped.
#[derive(Debug)]
pub struct JsonSocket {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    file: Option<SocketFile>,
    // Last: the socket lies in its folder.
    _domain: Arc<Domain>,
}

impl JsonSocket {
    /// Opens the socket of `role`, which this process must have; replaces one that a killed
    /// process left. `answer` receives every valid request, on a thread of its own; its `Err`
    /// is returned to the client as [`AskError::Refused`].
    ///
    /// # Errors
    /// [`SocketError`] when the socket cannot be bound.
    pub fn open<Q: DeserializeOwned, R: Serialize>(
        domain: &Arc<Domain>,
        role: Role,
        mut answer: impl FnMut(Q) -> Result<R, String> + Send + 'static,
    ) -> Result<Self, SocketError> {
        let path = path(domain.root(), role);
        let (file, listener) = SocketFile::bind(&path)?;
        let failed = |cause| SocketError::Io { path: path.clone(), cause };
        listener.set_nonblocking(true).map_err(failed)?;
        let end = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&end);
        let answer = move |line: &[u8]| -> Answer {
            let request = serde_json::from_slice(line)
                .map_err(|cause| format!("this is no request that is known here: {cause}"))?;
            serde_json::to_value(answer(request)?).map_err(|cause| cause.to_string())
        };
        let thread = std::thread::Builder::new()
            .name("json socket".into())
            .spawn(move || serve(&listener, &ends, answer))
            .map_err(failed)?;
        Ok(Self { end, thread: Some(thread), file: Some(file), _domain: Arc::clone(domain) })
    }
}

impl Drop for JsonSocket {
    fn drop(&mut self) {
        // As long as this process listens there, the file is its own, and may be removed.
        drop(self.file.take());
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn serve(listener: &UnixListener, end: &AtomicBool, mut answer: impl FnMut(&[u8]) -> Answer) {
    while !end.load(Ordering::Relaxed) {
        match listener.accept() {
            // An error on a client's connection concerns that client only.
            Ok((socket, _)) => drop(attend(socket, &mut answer)),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                let _ = poll(&mut [PollFd::new(listener, PollFlags::IN)], Some(&LOOK));
            }
            Err(_) => std::thread::sleep(Duration::from_millis(10)),
        }
    }
}

/// Serves one client, from its request to its answer.
fn attend(mut socket: UnixStream, answer: &mut impl FnMut(&[u8]) -> Answer) -> io::Result<()> {
    socket.set_nonblocking(false)?;
    let deadline = Instant::now() + TIMEOUT;
    let answer: Answer = match read_line(&mut socket, deadline) {
        Ok(line) => answer(&line),
        Err(error) if error.kind() == ErrorKind::FileTooLarge => Err(error.to_string()),
        Err(error) => return Err(error),
    };
    write_line(&mut socket, &serde_json::to_vec(&answer)?, deadline)?;
    socket.shutdown(Shutdown::Both)
}

/// Reads the next line, without its end.
fn read_line(socket: &mut UnixStream, deadline: Instant) -> io::Result<Vec<u8>> {
    let mut line = Vec::new();
    let mut room = [0; 4096];
    loop {
        socket.set_read_timeout(Some(left(deadline)?))?;
        let count = match socket.read(&mut room) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            count => count?,
        };
        if let Some(end) = room[..count].iter().position(|byte| *byte == b'\n') {
            line.extend_from_slice(&room[..end]);
            return Ok(line);
        }
        line.extend_from_slice(&room[..count]);
        if line.len() > MAX_LINE {
            let what = format!("longer than the limit of {MAX_LINE} bytes, and no end of line");
            return Err(io::Error::new(ErrorKind::FileTooLarge, what));
        }
    }
}

fn write_line(socket: &mut UnixStream, line: &[u8], deadline: Instant) -> io::Result<()> {
    for part in [line, b"\n"] {
        socket.set_write_timeout(Some(left(deadline)?))?;
        socket.write_all(part)?;
    }
    Ok(())
}

/// Returns the time until `deadline`; an error once it is over.
fn left(deadline: Instant) -> io::Result<Duration> {
    let left = deadline.saturating_duration_since(Instant::now());
    if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
}

/// Sends a request to the process with `role` in `domain` and waits for the answer, at most
/// for `timeout`.
///
/// # Errors
/// [`AskError`]: no such process, a refusal, or no answer in time.
pub fn ask<Q: Serialize, R: DeserializeOwned>(
    domain: &str,
    role: Role,
    request: &Q,
    timeout: Duration,
) -> Result<R, AskError> {
    ask_at(&Domain::folder(domain)?, domain, role, request, timeout)
}

fn ask_at<Q: Serialize, R: DeserializeOwned>(
    root: &Path,
    domain: &str,
    role: Role,
    request: &Q,
    timeout: Duration,
) -> Result<R, AskError> {
    let path = path(root, role);
    let domain = domain.to_owned();
    let unreadable = |cause: &dyn Display| AskError::Unreadable {
        role,
        domain: domain.clone(),
        cause: cause.to_string(),
    };
    let line = serde_json::to_vec(request).map_err(|cause| unreadable(&cause))?;
    if line.len() > MAX_LINE {
        return Err(AskError::TooLong(line.len()));
    }
    let exchange = || -> io::Result<Vec<u8>> {
        let deadline = Instant::now() + timeout;
        let mut socket = connect(&path)?;
        socket.set_nonblocking(false)?;
        let written = write_line(&mut socket, &line, deadline);
        // The process may answer and close before it has read the whole request: an answer that
        // has arrived is read before a failure to write is reported.
        match (read_line(&mut socket, deadline), written) {
            (Err(_), Err(error)) => Err(error),
            (answer, _) => answer,
        }
    };
    let answer = exchange().map_err(|cause| match cause.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => AskError::Nobody {
            role,
            domain: domain.clone(),
            whereabouts: Whereabouts::of(role, root),
        },
        ErrorKind::TimedOut | ErrorKind::WouldBlock => {
            AskError::Silent { role, domain: domain.clone(), waited: timeout }
        }
        _ => AskError::Io { role, path: path.clone(), cause },
    })?;
    let answer: Answer = serde_json::from_slice(&answer).map_err(|cause| unreadable(&cause))?;
    serde_json::from_value(answer.map_err(AskError::Refused)?).map_err(|cause| unreadable(&cause))
}

#[cfg(test)]
mod tests;
