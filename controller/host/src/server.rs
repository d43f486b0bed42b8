//! The control socket of a controller process: its protocol endpoint in the
//! folder of its domain.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::discovery::Domain;
use super::node_server::NodeServer;
use super::socket::SocketError;
use super::socket_server::{Connection, SocketServer};
use leg_control::serial::endpoint::Endpoint;

/// Returns the path of the control socket in the folder of a domain.
#[must_use]
pub fn socket_in(root: &Path) -> PathBuf {
    root.join("controller.sock")
}

/// An open control socket, with a thread that serves it; both end when dropped.
#[derive(Debug)]
pub struct ControlSocket {
    _server: SocketServer,
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
        let connect =
            move |socket| Client { socket, endpoint: Endpoint::new(), server: Arc::clone(&server) };
        let server = SocketServer::open(&socket_in(domain.root()), connect)?;
        Ok(Self { _server: server, _domain: Arc::clone(domain) })
    }
}

/// A connected client.
struct Client {
    socket: UnixStream,
    endpoint: Endpoint,
    server: Arc<Mutex<NodeServer>>,
}

impl Connection for Client {
    /// Answers what has come; returns false when the client does not read its answers.
    fn receive(&mut self, bytes: &[u8]) -> bool {
        let mut server = self.server.lock().unwrap_or_else(PoisonError::into_inner);
        bytes.iter().all(|&byte| match server.push(&mut self.endpoint, byte) {
            Some(frame) => self.socket.write(frame).is_ok_and(|taken| taken == frame.len()),
            None => true,
        })
    }
}
