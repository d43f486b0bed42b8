//! Others' requests while the bridge holds the line.
//!
//! A board has one line, and the bridge is on it. Other programs say their
//! requests to the bridge, on a unix socket, in the same protocol; it passes
//! them on one by one, between samples, under numbers of its own. What would
//! interfere with the run it refuses itself.

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

/// How often the thread looks whether to end.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
/// After a failure of the system's, before the next try.
const PAUSE: Duration = Duration::from_millis(50);

/// The socket, and the thread that listens on it.
#[derive(Debug)]
pub(super) struct Share {
    queue: Queue<Asked>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    // Removed once nobody listens.
    _file: SocketFile,
}

/// Where a caller's answers go.
#[derive(Clone, Debug)]
struct Caller(Arc<Mutex<Answers>>);

#[derive(Debug)]
struct Answers {
    socket: UnixStream,
    /// The last request that was passed on, and the frame that answered it.
    last: Option<(u32, Option<Vec<u8>>)>,
}

/// A request to pass on.
#[derive(Debug)]
pub(super) struct Asked {
    caller: Caller,
    id: u32,
    payload: Vec<u8>,
}

impl Asked {
    /// What is asked for.
    pub(super) fn request(&self) -> Option<Request<'_>> {
        match frame::decode(&self.payload) {
            Ok(ToController::Request { request, .. }) => Some(request),
            _ => None,
        }
    }

    /// Hands the caller its answer.
    pub(super) fn answer(&self, reply: Reply<'_>) {
        self.caller.answer(self.id, reply);
    }

    /// There will be no answer: the line broke.
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
                answers.say(frame);
                answers.last = Some((id, Some(frame.to_vec())));
            });
        }
    }

    /// Whether it is for the bridge to pass on: not when the same was asked before.
    fn is_new(&self, id: u32) -> bool {
        self.with(|answers| match answers.last.take() {
            Some((last, answer)) if last == id => {
                if let Some(frame) = &answer {
                    answers.say(frame);
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
    /// Never waits: a caller that does not listen is hung up on.
    fn say(&mut self, frame: &[u8]) {
        if !self.socket.write(frame).is_ok_and(|taken| taken == frame.len()) {
            let _ = self.socket.shutdown(Shutdown::Both);
        }
    }
}

impl Share {
    /// Listens at `path`.
    pub(super) fn listen(path: &Path) -> Result<Self, SocketError> {
        let (file, listener) = SocketFile::bind(path)?;
        let failed = |cause| SocketError::Io { path: path.to_owned(), cause };
        listener.set_nonblocking(true).map_err(failed)?;
        let (sender, queue) = channel();
        let end = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&end);
        let thread = std::thread::Builder::new()
            .name("share".into())
            .spawn(move || serve(&listener, &sender, &ends))
            .map_err(failed)?;
        Ok(Self { queue, end, thread: Some(thread), _file: file })
    }

    /// The next request, if there is one.
    pub(super) fn next(&self) -> Option<Asked> {
        self.queue.try_recv().ok()
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A caller's end of its connection.
struct Connection {
    socket: UnixStream,
    receiver: Receiver,
    caller: Caller,
}

fn serve(listener: &UnixListener, queue: &Sender<Asked>, end: &AtomicBool) {
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
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => (),
            Err(_) => std::thread::sleep(PAUSE),
        }
        connections.retain_mut(|connection| connection.hear(queue));
    }
}

impl Connection {
    fn new(socket: UnixStream) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        let answers = Answers { socket: socket.try_clone()?, last: None };
        let caller = Caller(Arc::new(Mutex::new(answers)));
        Ok(Self { socket, receiver: Receiver::new(), caller })
    }

    /// Takes what has come; `false` when the caller has gone.
    fn hear(&mut self, queue: &Sender<Asked>) -> bool {
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
                if queue.send(Asked { caller, id, payload }).is_err() {
                    return false;
                }
            }
        }
        true
    }
}
