//! Serving the clients of a Unix socket on a thread.

use std::io::{self, ErrorKind, Read};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::socket::{SocketError, SocketFile};

/// Time between two checks whether to end.
const END_CHECK_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
/// Wait after a failure of the system, before the next try.
const PAUSE: Duration = Duration::from_millis(10);

/// What a server does with the bytes of one client.
pub trait Connection: Send + 'static {
    /// Processes what the client has sent. Returns false to close the connection.
    fn receive(&mut self, bytes: &[u8]) -> bool;
}

/// A listening socket, and the thread that serves its clients; both end when dropped.
#[derive(Debug)]
pub struct SocketServer {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    file: Option<SocketFile>,
}

impl SocketServer {
    /// Listens at `path`, in place of a socket that a dead process left there. `connect`
    /// receives a non-blocking socket of each client, on which to answer.
    ///
    /// # Errors
    /// [`SocketError`] when the socket cannot be bound or the thread not be started.
    pub fn open<C: Connection>(
        path: &Path,
        connect: impl FnMut(UnixStream) -> C + Send + 'static,
    ) -> Result<Self, SocketError> {
        let (file, listener) = SocketFile::bind(path)?;
        let failed = |cause| SocketError::Io { path: path.to_owned(), cause };
        listener.set_nonblocking(true).map_err(failed)?;
        let end = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&end);
        let thread = std::thread::Builder::new()
            .name("socket server".into())
            .spawn(move || serve(&listener, connect, &ends))
            .map_err(failed)?;
        Ok(Self { end, thread: Some(thread), file: Some(file) })
    }
}

impl Drop for SocketServer {
    fn drop(&mut self) {
        // Removed while this process still listens, so it is not another's.
        drop(self.file.take());
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn serve<C: Connection>(
    listener: &UnixListener,
    mut connect: impl FnMut(UnixStream) -> C,
    end: &AtomicBool,
) {
    let mut connections: Vec<(UnixStream, C)> = Vec::new();
    while !end.load(Ordering::Relaxed) {
        let waited = {
            let mut all = vec![PollFd::new(listener, PollFlags::IN)];
            all.extend(connections.iter().map(|(socket, _)| PollFd::new(socket, PollFlags::IN)));
            poll(&mut all, Some(&END_CHECK_INTERVAL))
        };
        if waited.is_err() {
            std::thread::sleep(PAUSE);
        }
        match accept(listener) {
            Ok((socket, answers)) => connections.push((socket, connect(answers))),
            Err(error) if error.kind() == ErrorKind::WouldBlock => (),
            Err(_) => std::thread::sleep(PAUSE),
        }
        connections.retain_mut(|(socket, connection)| receive(socket, connection));
    }
}

fn accept(listener: &UnixListener) -> io::Result<(UnixStream, UnixStream)> {
    let (socket, _) = listener.accept()?;
    socket.set_nonblocking(true)?;
    let answers = socket.try_clone()?;
    Ok((socket, answers))
}

/// Reads what has arrived; returns false when the connection is over.
fn receive(socket: &mut UnixStream, connection: &mut impl Connection) -> bool {
    let mut bytes = [0; 1024];
    match socket.read(&mut bytes) {
        Ok(0) => false,
        Ok(count) => connection.receive(&bytes[..count]),
        Err(error) => error.kind() == ErrorKind::WouldBlock,
    }
}
