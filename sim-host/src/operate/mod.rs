//! A run operated from another process: its status, another set-point, pause, end.
//!
//! The leg answers in JSON over a socket, from a thread of its own; neither the loop nor
//! that thread waits for the other.

mod requests;
mod shared;

use leg_host::discovery::DomainError;
use leg_host::json_socket::JsonSocket;
use leg_host::realtime::LatestReport;
use leg_host::socket::SocketError;
use leg_host::{Domain, TimeMode};
use leg_process::Stop;

use crate::session::{Hooks, Leg, TickRecord};

pub use requests::{LegRequest, LegStatus};
pub use shared::BUCKETS;
use shared::LoopSide;

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
    side: LoopSide,
    stop: Stop,
    _socket: JsonSocket,
}

impl Operated {
    /// Opens the leg's socket in the domain of this name; this process must have the
    /// leg's role there. `timing` gives the statistics of a real-time loop.
    ///
    /// # Errors
    /// [`OperateError`] when the domain cannot be joined or the socket not be bound.
    pub fn open(
        domain: &str,
        rate_hz: u32,
        time_mode: TimeMode,
        stop: &Stop,
        timing: Option<LatestReport>,
    ) -> Result<Self, OperateError> {
        let (side, other) = shared::pair();
        let socket = requests::open(&Domain::join(domain)?, other, rate_hz, time_mode, timing)?;
        Ok(Self { side, stop: stop.clone(), _socket: socket })
    }
}

impl Hooks for Operated {
    fn wait(&mut self) {
        self.side.wait_while_paused(&self.stop);
    }

    fn ends(&mut self) -> bool {
        self.side.is_ended()
    }

    fn steer(&mut self, leg: &mut Leg<'_>) {
        self.side.steer(leg);
    }

    fn observe(&mut self, tick: &TickRecord<'_>) {
        self.side.publish(tick);
    }
}
