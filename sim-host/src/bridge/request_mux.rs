//! Clients' requests to a controller whose line the bridge uses.
//!
//! Other programs send their requests to the bridge, on unix sockets, in the same
//! protocol. It forwards them one by one, between samples, under its own ids, and refuses
//! those that would interfere with the run.

use std::io::Write;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::mpsc::{Receiver as Queue, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use leg_control::serial::frame::{self, MAX_FRAME, Receiver};
use leg_control::serial::message::{Reply, Request, RequestError, ToController, ToHost};
use leg_host::socket::SocketError;
use leg_host::socket_server::{Connection, SocketServer};

/// The requests of the clients of all sockets.
#[derive(Debug)]
pub(super) struct RequestMux {
    queue: Queue<ClientRequest>,
    sender: Sender<ClientRequest>,
    sockets: Vec<SocketServer>,
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
        let queue = self.sender.clone();
        let connect = move |socket| Client {
            receiver: Receiver::new(),
            caller: Caller(Arc::new(Mutex::new(Answers { socket, last: None }))),
            queue: queue.clone(),
        };
        self.sockets.push(SocketServer::open(path, connect)?);
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

/// A connected client.
struct Client {
    receiver: Receiver,
    caller: Caller,
    queue: Sender<ClientRequest>,
}

impl Connection for Client {
    fn receive(&mut self, bytes: &[u8]) -> bool {
        for &byte in bytes {
            if let Some(Ok(payload)) = self.receiver.push(byte)
                && let Ok(ToController::Request { id, request }) = frame::decode(payload)
                && self.caller.is_new(id)
            {
                if matches!(request, Request::Reset { .. } | Request::SetMode(_)) {
                    self.caller.answer(id, Reply::Refused(RequestError::InSession));
                    continue;
                }
                let (caller, payload) = (self.caller.clone(), payload.to_vec());
                if self.queue.send(ClientRequest { caller, id, payload }).is_err() {
                    return false;
                }
            }
        }
        true
    }
}
