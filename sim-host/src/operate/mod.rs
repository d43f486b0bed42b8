//! A run operated from beside it: asked how it goes, given another set-point,
//! paused, ended.
//!
//! The leg answers in JSON over a socket, from a thread of its own; the
//! loop and it share a [`Board`] of atomic numbers, so neither waits for the
//! other.

mod board;
mod requests;

use std::sync::Arc;

use leg_host::discovery::DomainError;
use leg_host::json_socket::JsonSocket;
use leg_host::realtime::LatestReport;
use leg_host::socket::SocketError;
use leg_host::{Domain, TimeMode};
use leg_process::Stop;

use crate::session::{Hooks, Leg, TickRecord};

pub use board::{BUCKETS, Board};
pub use requests::{LegRequest, LegStatus};

/// Why a run cannot be operated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OperateError {
    /// There is no such domain.
    #[error(transparent)]
    Domain(#[from] DomainError),
    /// The socket cannot be bound.
    #[error(transparent)]
    Socket(#[from] SocketError),
}

/// A run with a socket, hooked into its session.
#[derive(Debug)]
pub struct Operated {
    board: Arc<Board>,
    /// Orders that the leg has.
    known: u32,
    stop: Stop,
    _socket: JsonSocket,
}

impl Operated {
    /// Opens the leg's socket in the domain of this name; this process must play
    /// the leg there. `timing` gives the loop's own figures, when it has some.
    ///
    /// # Errors
    /// [`OperateError`].
    pub fn open(
        domain: &str,
        rate_hz: u32,
        pace: TimeMode,
        stop: &Stop,
        timing: Option<LatestReport>,
    ) -> Result<Self, OperateError> {
        let board = Arc::new(Board::default());
        let socket = requests::open(&Domain::join(domain)?, &board, rate_hz, pace, timing)?;
        Ok(Self { board, known: 0, stop: stop.clone(), _socket: socket })
    }
}

impl Hooks for Operated {
    fn wait(&mut self) {
        self.board.wait_while_paused(&self.stop);
    }

    fn ends(&mut self) -> bool {
        self.board.is_ended()
    }

    fn steer(&mut self, leg: &mut Leg<'_>) {
        self.board.steer(leg, &mut self.known);
    }

    fn observe(&mut self, tick: &TickRecord<'_>) {
        self.board.show(tick);
    }
}
