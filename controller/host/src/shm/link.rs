//! One end of a link between two processes.

use std::fmt::Display;
use std::sync::Arc;
use std::time::{Duration, Instant};

use leg_control::wire::{Command, Sample};
use leg_process::Stop;

use super::error::{ConnectError, MissingPeer};
use super::payload::{Message, Payload};
use super::peer_monitor::{PeerEvent, PeerMonitor};
use super::service::Ports;
use crate::discovery::{Domain, Whereabouts};
use crate::link::{Link, LinkError, Peer, SessionParams, TimeMode, Waiter};

/// Interval between two checks for a peer that has not connected yet.
const CHECK_INTERVAL: Duration = Duration::from_millis(1);

/// Interval between two searches for the peer in other domains.
const LOOK_INTERVAL: Duration = Duration::from_millis(500);

/// One end of a link between two processes.
// The ports are dropped before the monitor, which then sends the peer that this end has left.
#[derive(Debug)]
pub struct ShmLink<Out: Message, In: Message> {
    /// The ports of the session; `None` before the first one.
    ports: Option<Ports<Out, In>>,
    monitor: Arc<PeerMonitor<Out, In>>,
    /// In real time the link does not wait for a failing port; it skips the message.
    is_real_time: bool,
    stop: Stop,
    waiter: Waiter,
}

/// The leg's end of a link between two processes.
pub type ShmLeg = ShmLink<Sample, Command>;
/// The controller's end of a link between two processes.
pub type ShmController = ShmLink<Command, Sample>;

impl<Out: Message, In: Message> ShmLink<Out, In> {
    /// Acquires this end's role in `domain` and waits for the peer, at most for
    /// `timeout`.
    ///
    /// # Errors
    /// Returns [`ConnectError`] when the role is taken, the peer does not connect or
    /// disagrees on `params`, or the transport fails.
    pub fn connect(
        domain: &Arc<Domain>,
        params: SessionParams,
        timeout: Duration,
        stop: &Stop,
    ) -> Result<Self, ConnectError> {
        let mut link = Self::open(domain, params, stop)?;
        link.wait_for_peer(Some(timeout), |_| true)?;
        Ok(link)
    }

    /// Acquires this end's role in `domain`. The peer need not be present.
    ///
    /// # Errors
    /// Returns [`ConnectError`] when the role is taken or the system fails.
    pub fn open(
        domain: &Arc<Domain>,
        params: SessionParams,
        stop: &Stop,
    ) -> Result<Self, ConnectError> {
        Ok(Self {
            ports: None,
            monitor: Arc::new(PeerMonitor::open(domain, params)?),
            is_real_time: params.time_mode == Some(TimeMode::RealTime),
            stop: stop.clone(),
            waiter: Waiter::new(),
        })
    }

    /// Waits for a peer, at most for `timeout`: the first one, or another after one
    /// was lost. Calls `keep_waiting` every millisecond during the wait and gives up
    /// when it returns false.
    ///
    /// # Errors
    /// Returns [`ConnectError`] when no peer connects or one disagrees on the session
    /// parameters, when this process was asked to stop, or when the transport fails.
    /// The link stays usable for another wait.
    pub fn wait_for_peer(
        &mut self,
        timeout: Option<Duration>,
        mut keep_waiting: impl FnMut(&MissingPeer) -> bool,
    ) -> Result<Peer, ConnectError> {
        let start = Instant::now();
        let mut missing = MissingPeer {
            peer: In::SENDER,
            domain: self.monitor.domain().name().to_owned(),
            waited: Duration::ZERO,
            params: self.monitor.params(),
            failure: None,
            whereabouts: Whereabouts::default(),
        };
        let mut looked = Duration::ZERO;
        loop {
            match self.monitor.update()? {
                Some(PeerEvent::Connected(peer)) => return Ok(peer),
                Some(PeerEvent::Rejected(cause)) => return Err(cause),
                Some(PeerEvent::Failed(cause)) => missing.failure = Some(cause.to_string()),
                Some(PeerEvent::Lost(_)) | None => (),
            }
            if let Some(peer) = self.monitor.peer() {
                return Ok(peer);
            }
            if self.stop.is_raised() {
                return Err(ConnectError::Stopped(In::SENDER));
            }
            missing.waited = start.elapsed();
            let left =
                timeout.map_or(CHECK_INTERVAL, |timeout| timeout.saturating_sub(missing.waited));
            if left.is_zero() || missing.waited >= looked + LOOK_INTERVAL {
                missing.whereabouts = Whereabouts::of(In::SENDER, self.monitor.domain().root());
                if self.monitor.is_rejecting() {
                    missing.whereabouts.silent = None;
                }
                looked = missing.waited;
            }
            if left.is_zero() || !keep_waiting(&missing) {
                return Err(ConnectError::PeerMissing(Box::new(missing)));
            }
            std::thread::sleep(CHECK_INTERVAL.min(left));
        }
    }

    /// Returns a monitor of the peer, for use on another thread.
    #[must_use]
    pub fn monitor(&self) -> Arc<PeerMonitor<Out, In>> {
        Arc::clone(&self.monitor)
    }

    /// Returns the connected peer.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.monitor.peer()
    }

    /// Checks that a peer is connected: the last one, or another since that was lost.
    /// Reads files, so it does not belong on the control path.
    ///
    /// # Errors
    /// Returns [`LinkError`] when no peer is connected or this process was asked to
    /// stop.
    pub fn check_peer(&self) -> Result<(), LinkError> {
        if self.stop.is_raised() {
            return Err(LinkError::Stopped);
        }
        if self.monitor.peer().is_some() {
            self.monitor.update().map_err(|cause| transport("check the peer", &cause))?;
        }
        self.monitor.lost().map_or(Ok(()), Err)
    }

    fn poll(&self) -> Result<Option<In>, LinkError> {
        let Some(ports) = &self.ports else { return Ok(None) };
        match ports.subscriber.receive() {
            Ok(message) => Ok(message.map(|message| message.0)),
            Err(_) if self.is_real_time => Ok(None),
            Err(cause) => {
                self.check_peer()?;
                Err(transport("receive", &cause))
            }
        }
    }

    fn has_messages(&self) -> bool {
        self.ports.as_ref().is_some_and(|ports| ports.subscriber.has_samples() == Ok(true))
    }
}

impl<Out: Message, In: Message> Link for ShmLink<Out, In> {
    type Sends = Out;
    type Receives = In;

    fn send(&mut self, message: &Out) -> Result<(), LinkError> {
        // Checked here, because a peer that always replies at once leaves no idle moment. (A
        // real-time loop checks by itself, and still has to send that its run is over.)
        if !self.is_real_time && self.stop.is_raised() {
            return Err(LinkError::Stopped);
        }
        self.monitor.take_ports(&mut self.ports);
        let Some(ports) = &self.ports else { return Ok(()) };
        match ports.publisher.send_copy(Payload(*message)) {
            Ok(_) => {
                if let Some(wake) = &ports.wake {
                    wake.send();
                }
                Ok(())
            }
            // Treated as lost on the way: the next message follows in a tick.
            Err(_) if self.is_real_time => Ok(()),
            Err(cause) => {
                self.check_peer()?;
                Err(transport("send", &cause))
            }
        }
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        self.monitor.take_ports(&mut self.ports);
        if timeout.is_zero() {
            return self.poll();
        }
        let wake = self.ports.as_ref().and_then(|ports| ports.wake.as_ref());
        let block = wake.map(|wake| |timeout| wake.wait(timeout));
        self.waiter.wait_for(
            timeout,
            block.as_ref().map(|block| block as &dyn Fn(Duration)),
            || self.poll(),
            || match self.check_peer() {
                // The last message of the peer counts, even if the peer is gone by now.
                Err(LinkError::PeerLeft { .. }) if self.has_messages() => Ok(()),
                result => result,
            },
        )
    }
}

fn transport(action: &'static str, cause: &dyn Display) -> LinkError {
    LinkError::Transport { action, cause: cause.to_string() }
}
