//! The control socket of a controller process: its protocol endpoint in the
//! folder of its domain.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::discovery::Domain;
use super::node_server::NodeServer;
use super::socket::{SocketError, SocketFile};
use leg_control::serial::endpoint::Endpoint;

/// Time between two checks whether to end.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
/// Wait after a failure of the system, before the next try.
const PAUSE: Duration = Duration::from_millis(10);

/// Returns the path of the control socket in the folder of a domain.
#[must_use]
pub fn socket_in(root: &Path) -> PathBuf {
    root.join("controller.sock")
}

/// An open control socket, with a thread that serves it; both end when dropped.
#[derive(Debug)]
pub struct ControlSocket {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    file: Option<SocketFile>,
    // Last: the socket lies in its folder.
    _domain: Arc<Domain>,
}

impl ControlSocket {
    /// Opens the socket of the controller in `domain`, which this process must
    /// be, in place of one that a killed predecessor left.
    ///
    /// # Errors
    /// [`SocketError`] when the socket cannot be bound.
    pub fn open(domain: &Arc<Domain>, server: Arc<Mutex<NodeServer>>) -> Result<Self, SocketError> {
        let path = socket_in(domain.root());
        let (file, listener) = SocketFile::bind(&path)?;
        let failed = |cause| SocketError::Io { path: path.clone(), cause };
        listener.set_nonblocking(true).map_err(failed)?;
        let end = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&end);
        let thread = std::thread::Builder::new()
            .name("control socket".into())
            .spawn(move || serve(&listener, &server, &ends))
            .map_err(failed)?;
        Ok(Self { end, thread: Some(thread), file: Some(file), _domain: Arc::clone(domain) })
    }
}

impl Drop for ControlSocket {
    fn drop(&mut self) {
        // Removed while this process still listens, so it is not another's.
        drop(self.file.take());
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A connected client.
struct Connection {
    socket: UnixStream,
    endpoint: Endpoint,
}

fn serve(listener: &UnixListener, server: &Mutex<NodeServer>, end: &AtomicBool) {
    let mut connections: Vec<Connection> = Vec::new();
    while !end.load(Ordering::Relaxed) {
        let waited = {
            let mut all = vec![PollFd::new(listener, PollFlags::IN)];
            all.extend(connections.iter().map(|c| PollFd::new(&c.socket, PollFlags::IN)));
            poll(&mut all, Some(&LOOK))
        };
        if waited.is_err() {
            std::thread::sleep(PAUSE);
        }
        match listener.accept().and_then(|(socket, _)| Connection::new(socket)) {
            Ok(connection) => connections.push(connection),
            Err(error) if error.kind() == ErrorKind::WouldBlock => (),
            Err(_) => std::thread::sleep(PAUSE),
        }
        connections.retain_mut(|connection| connection.serve(server));
    }
}

impl Connection {
    fn new(socket: UnixStream) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self { socket, endpoint: Endpoint::new() })
    }

    /// Answers what has come; returns false when the client has left, or does not
    /// read its answers.
    fn serve(&mut self, server: &Mutex<NodeServer>) -> bool {
        let mut bytes = [0; 1024];
        let count = match self.socket.read(&mut bytes) {
            Ok(0) => return false,
            Ok(count) => count,
            Err(error) => return error.kind() == ErrorKind::WouldBlock,
        };
        let mut server = server.lock().unwrap_or_else(PoisonError::into_inner);
        bytes[..count].iter().all(|&byte| match server.push(&mut self.endpoint, byte) {
            Some(frame) => self.socket.write(frame).is_ok_and(|taken| taken == frame.len()),
            None => true,
        })
    }
}
