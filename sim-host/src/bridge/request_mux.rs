//! Clients' requests to a controller whose line the bridge uses.
//!
//! Other programs send their requests to the bridge, on unix sockets, in the same
//! protocol. It forwards them one by one, between samples, under its own ids, and refuses
//! those that would interfere with the run.

use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver as Queue, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use leg_control::serial::frame::{self, MAX_FRAME, Receiver};
use leg_control::serial::message::{Reply, Request, RequestError, ToController, ToHost};
use leg_host::socket::{SocketError, SocketFile};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// How often the thread checks whether to end.
const POLL: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
/// Pause after a system error, before the next try.
const PAUSE: Duration = Duration::from_millis(50);

/// The requests of the clients of all sockets.
#[derive(Debug)]
pub(super) struct RequestMux {
    queue: Queue<ClientRequest>,
    sender: Sender<ClientRequest>,
    sockets: Vec<ListeningSocket>,
}

/// A socket, and the thread that listens on it; both end when dropped.
#[derive(Debug)]
struct ListeningSocket {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    file: Option<SocketFile>,
}

/// The connection on which a client receives its replies.
#[derive(Clone, Debug)]
struct Caller(Arc<Mutex<Answers>>);

#[derive(Debug)]
struct Answers {
    socket: UnixStream,
    /// The last request that was passed on, and the frame that answered it.
    last: Option<(u32, Option<Vec<u8>>)>,
}

/// A request to forward.
#[derive(Debug)]
pub(super) struct ClientRequest {
    caller: Caller,
    id: u32,
    payload: Vec<u8>,
}

impl ClientRequest {
    /// Returns the request.
    pub(super) fn request(&self) -> Option<Request<'_>> {
        match frame::decode(&self.payload) {
            Ok(ToController::Request { request, .. }) => Some(request),
            _ => None,
        }
    }

    /// Sends the client its reply.
    pub(super) fn answer(&self, reply: Reply<'_>) {
        self.caller.answer(self.id, reply);
    }

    /// Closes the connection, because the line broke and there will be no reply.
    pub(super) fn hang_up(&self) {
        self.caller.with(|answers| {
            let _ = answers.socket.shutdown(Shutdown::Both);
        });
    }
}

impl Caller {
    fn with<R>(&self, f: impl FnOnce(&mut Answers) -> R) -> R {
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn answer(&self, id: u32, reply: Reply<'_>) {
        let mut room = [0; MAX_FRAME];
        if let Ok(frame) = frame::encode(&ToHost::Reply { id, reply }, &mut room) {
            self.with(|answers| {
                answers.send(frame);
                answers.last = Some((id, Some(frame.to_vec())));
            });
        }
    }

    /// Returns whether a request is new; a repeated one gets the same reply again.
    fn is_new(&self, id: u32) -> bool {
        self.with(|answers| match answers.last.take() {
            Some((last, answer)) if last == id => {
                if let Some(frame) = &answer {
                    answers.send(frame);
                }
                answers.last = Some((last, answer));
                false
            }
            _ => {
                answers.last = Some((id, None));
                true
            }
        })
    }
}

impl Answers {
    /// Sends a frame without waiting; closes the connection of a client that does not read.
    fn send(&mut self, frame: &[u8]) {
        if !self.socket.write(frame).is_ok_and(|taken| taken == frame.len()) {
            let _ = self.socket.shutdown(Shutdown::Both);
        }
    }
}

impl RequestMux {
    pub(super) fn new() -> Self {
        let (sender, queue) = channel();
        Self { queue, sender, sockets: Vec::new() }
    }

    /// Listens on the unix socket at `path`, too.
    pub(super) fn listen(&mut self, path: &Path) -> Result<(), SocketError> {
        let (file, listener) = SocketFile::bind(path)?;
        let failed = |cause| SocketError::Io { path: path.to_owned(), cause };
        listener.set_nonblocking(true).map_err(failed)?;
        let end = Arc::new(AtomicBool::new(false));
        let (ends, sender) = (Arc::clone(&end), self.sender.clone());
        let thread = std::thread::Builder::new()
            .name("requests".into())
            .spawn(move || serve(&listener, &sender, &ends))
            .map_err(failed)?;
        self.sockets.push(ListeningSocket { end, thread: Some(thread), file: Some(file) });
        Ok(())
    }

    /// Closes all sockets; what has arrived stays in the queue.
    pub(super) fn close(&mut self) {
        self.sockets.clear();
    }

    /// Returns the next request, if there is one.
    pub(super) fn next(&self) -> Option<ClientRequest> {
        self.queue.try_recv().ok()
    }
}

impl Drop for ListeningSocket {
    fn drop(&mut self) {
        // Removed while this process still listens, so it is not another's.
        drop(self.file.take());
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A client's connection.
struct Connection {
    socket: UnixStream,
    receiver: Receiver,
    caller: Caller,
}

fn serve(listener: &UnixListener, queue: &Sender<ClientRequest>, end: &AtomicBool) {
    let mut connections: Vec<Connection> = Vec::new();
    while !end.load(Ordering::Relaxed) {
        let waited = {
            let mut all = vec![PollFd::new(listener, PollFlags::IN)];
            all.extend(connections.iter().map(|c| PollFd::new(&c.socket, PollFlags::IN)));
            poll(&mut all, Some(&POLL))
        };
        if waited.is_err() {
            std::thread::sleep(PAUSE);
        }
        match listener.accept().and_then(|(socket, _)| Connection::new(socket)) {
            Ok(connection) => connections.push(connection),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => (),
            Err(_) => std::thread::sleep(PAUSE),
        }
        connections.retain_mut(|connection| connection.receive(queue));
    }
}

impl Connection {
    fn new(socket: UnixStream) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        let answers = Answers { socket: socket.try_clone()?, last: None };
        let caller = Caller(Arc::new(Mutex::new(answers)));
        Ok(Self { socket, receiver: Receiver::new(), caller })
    }

    /// Reads what has arrived; returns false when the client has closed the connection.
    fn receive(&mut self, queue: &Sender<ClientRequest>) -> bool {
        let mut bytes = [0; 1024];
        let count = match self.socket.read(&mut bytes) {
            Ok(0) => return false,
            Ok(count) => count,
            Err(error) => return error.kind() == io::ErrorKind::WouldBlock,
        };
        for &byte in &bytes[..count] {
            if let Some(Ok(payload)) = self.receiver.push(byte)
                && let Ok(ToController::Request { id, request }) = frame::decode(payload)
                && self.caller.is_new(id)
            {
                if matches!(request, Request::Reset { .. } | Request::SetMode(_)) {
                    self.caller.answer(id, Reply::Refused(RequestError::InSession));
                    continue;
                }
                let (caller, payload) = (self.caller.clone(), payload.to_vec());
                if queue.send(ClientRequest { caller, id, payload }).is_err() {
                    return false;
                }
            }
        }
        true
    }
}
