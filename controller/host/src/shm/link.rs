//! One end of a link between two processes.

use std::fmt::Display;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{LogLevel, NodeName, SignalHandlingMode, ipc, set_log_level_from_env_or};
use leg_control::wire::{Command, Sample};
use leg_process::Stop;

use super::error::{ConnectError, MissingPeer, disagreement, failed};
use super::payload::{Message, Payload};
use super::peer_monitor::{MonitorCore, PeerEvent, PeerMonitor, await_rejection, port_name};
use super::service::{config, retry, service};
use crate::discovery::{Domain, Presence, RoleLock, RoleLockError, Whereabouts, presence_in};
use crate::link::{Link, LinkError, Peer, SessionParams, TimeMode, Waiter};

/// Interval between two checks for a peer that has not connected yet.
const CHECK_INTERVAL: Duration = Duration::from_millis(1);

/// Interval between two searches for the peer in other domains.
const LOOK_INTERVAL: Duration = Duration::from_millis(500);

/// One end of a link between two processes.
// The ports must be dropped before the core, which holds what they depend on.
#[derive(Debug)]
pub struct ShmLink<Out: Message, In: Message> {
    publisher: Publisher<ipc::Service, Payload<Out>, ()>,
    subscriber: Subscriber<ipc::Service, Payload<In>, ()>,
    core: Arc<MonitorCore<Out, In>>,
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
        Self::connect_while(domain, params, timeout, stop, |_| true)
    }

    /// As [`ShmLink::connect`]. Calls `keep_waiting` every millisecond during the
    /// wait and gives up when it returns false.
    ///
    /// # Errors
    /// As [`ShmLink::connect`].
    pub fn connect_while(
        domain: &Arc<Domain>,
        params: SessionParams,
        timeout: Duration,
        stop: &Stop,
        keep_waiting: impl FnMut(&MissingPeer) -> bool,
    ) -> Result<Self, ConnectError> {
        let mut link = Self::open(domain, params, stop)?;
        link.wait_for_peer(Some(timeout), keep_waiting)?;
        Ok(link)
    }

    /// Acquires this end's role in `domain` and creates its ports. The peer need not
    /// be present.
    ///
    /// # Errors
    /// Returns [`ConnectError`] when the role is taken, a peer is present that
    /// disagrees on `params`, or the transport fails.
    pub fn open(
        domain: &Arc<Domain>,
        params: SessionParams,
        stop: &Stop,
    ) -> Result<Self, ConnectError> {
        let role = RoleLock::acquire(domain, Out::SENDER, params).map_err(|error| match error {
            RoleLockError::Taken(pid) => {
                ConnectError::RoleTaken { role: Out::SENDER, pid, domain: domain.name().to_owned() }
            }
            RoleLockError::Io(cause) => failed(domain, "acquire the role", &cause),
        })?;
        // Before opening a service: the record gives a clearer reason than its attributes.
        Self::check_agreement(domain, &role, params)?;

        let _creation = domain.lock_creation()?;
        // iceoryx2 would also log each error that it returns.
        set_log_level_from_env_or(LogLevel::Fatal);
        let node_name =
            NodeName::new(Out::SENDER.as_str()).map_err(|e| failed(domain, "name the node", &e))?;
        let config = config(domain).map_err(|cause| failed(domain, "name the services", &cause))?;
        let node = retry(|| {
            NodeBuilder::new()
                .config(&config)
                .name(&node_name)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<ipc::Service>()
        })
        .map_err(|cause| failed(domain, "start iceoryx2", &cause))?;
        // A predecessor in this role may have been killed with its ports open.
        node.try_cleanup_dead_nodes();

        let outgoing = service::<Out>(&node, domain, params)?;
        let incoming = service::<In>(&node, domain, params)?;
        let name = port_name(Out::SENDER, role.tenure())
            .map_err(|cause| failed(domain, "name the ports", &cause))?;
        let subscriber =
            retry(|| incoming.subscriber_builder().name(&name).buffer_size(1).create())
                .map_err(|cause| failed(domain, "subscribe", &cause))?;
        let publisher = retry(|| {
            let created = outgoing.publisher_builder().name(&name).create();
            if let Err(PublisherCreateError::ExceedsMaxSupportedPublishers) = created {
                node.try_cleanup_dead_nodes();
            }
            created
        })
        .map_err(|cause| failed(domain, "publish", &cause))?;
        domain.reserve()?;

        Ok(Self {
            publisher,
            subscriber,
            core: Arc::new(MonitorCore::new((outgoing, incoming), node, role, params, domain)),
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
        let SessionParams { rate_hz, gravity_m_s2, time_mode, .. } = self.core.params();
        let mut missing = MissingPeer {
            peer: In::SENDER,
            domain: self.core.domain().name().to_owned(),
            waited: Duration::ZERO,
            rate_hz,
            gravity_m_s2,
            time_mode,
            whereabouts: Whereabouts::default(),
        };
        let mut looked = Duration::ZERO;
        loop {
            match self.update_peer()? {
                Some(PeerEvent::Connected(peer)) => return Ok(peer),
                Some(PeerEvent::Rejected(cause)) => {
                    self.core.await_rejection();
                    return Err(cause);
                }
                Some(PeerEvent::Lost(_)) | None => (),
            }
            if let Some(peer) = self.core.peer() {
                return Ok(peer);
            }
            if self.stop.is_raised() {
                return Err(ConnectError::Stopped(In::SENDER));
            }
            missing.waited = start.elapsed();
            let left =
                timeout.map_or(CHECK_INTERVAL, |timeout| timeout.saturating_sub(missing.waited));
            if left.is_zero() || missing.waited >= looked + LOOK_INTERVAL {
                missing.whereabouts = Whereabouts::of(In::SENDER, self.core.domain().root());
                looked = missing.waited;
            }
            if left.is_zero() || !keep_waiting(&missing) {
                return Err(ConnectError::PeerMissing(Box::new(missing)));
            }
            std::thread::sleep(CHECK_INTERVAL.min(left));
        }
    }

    /// Returns an error if the peer is present and its session parameters disagree.
    fn check_agreement(
        domain: &Arc<Domain>,
        role: &RoleLock,
        ours: SessionParams,
    ) -> Result<(), ConnectError> {
        let presence = presence_in(domain.root(), In::SENDER)
            .map_err(|cause| failed(domain, "check for the peer", &cause))?;
        if let Presence::Alive(Some(record)) = presence
            && let Some(error) = disagreement(In::SENDER, record.params, ours)
        {
            role.publish_rejection(record.tenure)
                .map_err(|cause| failed(domain, "write the role's record", &cause))?;
            await_rejection(domain, In::SENDER, role.tenure(), record.tenure);
            return Err(error);
        }
        Ok(())
    }

    /// Returns a monitor of the peer, for use on another thread.
    #[must_use]
    pub fn monitor(&self) -> PeerMonitor<Out, In> {
        PeerMonitor(Arc::clone(&self.core))
    }

    /// Returns the connected peer.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.core.peer()
    }

    /// Returns the [`fingerprint`](leg_control::leg::LegModel::fingerprint) of the leg
    /// that the connected peer simulates or has a policy for; `None` if it does not
    /// specify one.
    #[must_use]
    pub fn peer_leg(&self) -> Option<u32> {
        self.core.peer().and_then(|peer| peer.leg)
    }

    fn update_peer(&self) -> Result<Option<PeerEvent>, ConnectError> {
        // iceoryx2 maps a publisher only when its queue is accessed. Access it now: whatever a
        // peer sends before it is mapped would be lost if it left before the first receive.
        self.core.update(|| self.subscriber.has_samples().is_ok())
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
        if self.core.peer().is_some() {
            self.update_peer().map_err(|cause| transport("check the peer", &cause))?;
        }
        self.core.lost().map_or(Ok(()), Err)
    }

    fn poll(&self) -> Result<Option<In>, LinkError> {
        match self.subscriber.receive() {
            // Discard messages of a process that is not the connected peer.
            Ok(message) => {
                Ok(message.filter(|message| self.core.accepts(message.origin())).map(|m| m.0))
            }
            // A peer that dies while it connects causes an error here.
            Err(_) if self.is_real_time => Ok(None),
            Err(cause) => {
                self.check_peer()?;
                Err(transport("receive", &cause))
            }
        }
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
        match self.publisher.send_copy(Payload(*message)) {
            Ok(_) => Ok(()),
            // Treated as lost on the way: the next message follows in a tick.
            Err(_) if self.is_real_time => Ok(()),
            Err(cause) => {
                self.check_peer()?;
                Err(transport("send", &cause))
            }
        }
    }

    fn receive(&mut self, timeout: Duration) -> Result<Option<In>, LinkError> {
        if timeout.is_zero() {
            return self.poll();
        }
        self.waiter.wait_for(
            timeout,
            || self.poll(),
            || match self.check_peer() {
                // The last message of the peer counts, even if the peer is gone by now.
                Err(LinkError::PeerLeft { .. } | LinkError::PeerReplaced { .. })
                    if self.subscriber.has_samples() == Ok(true) =>
                {
                    Ok(())
                }
                result => result,
            },
        )
    }
}

fn transport(action: &'static str, cause: &dyn Display) -> LinkError {
    LinkError::Transport { action, cause: cause.to_string() }
}
