//! The controller at the end of the line: its connection, its session, and reconnection.

use std::fmt;
use std::time::{Duration, Instant};

use leg_control::serial::message::{Alarm, Mode, Request, SessionParams, Status};
use leg_control::wire::WIRE_VERSION;
use leg_host::LinkError;
use leg_host::serial::client::{ClientError, IDENTIFY_TIMEOUT, random_u32};
use leg_host::serial::{ByteStream, Client, DeviceIdentity, OpenError};
use leg_process::Stop;

use super::BridgeError;
use super::report::ControllerCounts;

/// First and longest pause between two tries to open the line again.
const BACK_OFF: Duration = Duration::from_millis(10);
const BACK_OFF_MAX: Duration = Duration::from_millis(500);
/// How long to wait for the controller to confirm that it is idle.
const IDLE_TIMEOUT: Duration = Duration::from_millis(300);

/// Opens the line; called again for each reconnection.
pub type Connector = Box<dyn FnMut() -> Result<Box<dyn ByteStream>, OpenError>>;

/// What to do when the line breaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum OnUnplug {
    /// Open it again and continue.
    #[default]
    Reconnect,
    /// End with an error.
    End,
}

/// The parameters of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunParams {
    /// How the control law runs.
    pub law: SessionParams,
    /// What makes a tick.
    pub mode: Mode,
}

/// An event to report while the bridge runs.
#[derive(Clone, Debug)]
pub enum Notice {
    /// The simulator is still missing.
    Waiting(String),
    /// The line broke and is being opened again.
    Unplugged(String),
    /// The line is open again and the run continues.
    Back(Duration),
    /// The controller was reset in the middle of the run.
    Rebooted,
    /// The controller has sent an alarm.
    Alarm(Alarm),
    /// The controller has no policy: every command will be the safe one.
    NoPolicy,
    /// There is no socket for requests in the domain.
    NoControlSocket(String),
    /// The policy of this name was trained for another leg.
    OtherLeg(String),
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Waiting(what) => write!(f, "{what}; still waiting"),
            Self::Unplugged(cause) => {
                write!(f, "warning: {cause} The simulator waits while the line is opened again")
            }
            Self::Back(after) => {
                write!(f, "the line is back after {:.2} s; the run goes on", after.as_secs_f64())
            }
            Self::Rebooted => f.write_str(
                "warning: the controller was reset in the middle of the run; it goes on from its \
                 safe state, without the cascade's integral and the density estimate",
            ),
            Self::Alarm(alarm) => write!(f, "warning: the controller: {alarm}"),
            Self::NoPolicy => f.write_str(
                "warning: the controller has no policy and answers with the safe command; upload one \
                 with `controller policy upload`",
            ),
            Self::NoControlSocket(cause) => {
                write!(f, "warning: no control socket, so no swap and no status: {cause}")
            }
            Self::OtherLeg(policy) => write!(
                f,
                "warning: the policy {policy} was trained for another leg than the simulator \
                 has; it runs all the same, `controller policy upload` replaces it"
            ),
        }
    }
}

/// What receives the notices of the bridge.
pub type NoticeSink = Box<dyn FnMut(&Notice)>;

/// The controller, and how to connect to it.
pub(super) struct Device {
    pub(super) client: Client,
    pub(super) identity: DeviceIdentity,
    pub(super) reconnects: u64,
    pub(super) reboots: u64,
    /// The counts when the run began, or when the controller was reset.
    base: ControllerCounts,
    connect: Connector,
    on_notice: NoticeSink,
    params: RunParams,
    session: u32,
    on_unplug: OnUnplug,
    patience: Duration,
    stop: Stop,
}

impl Device {
    /// Opens the line and identifies the controller.
    pub(super) fn find(
        mut connect: Connector,
        on_notice: NoticeSink,
        params: RunParams,
        on_unplug: OnUnplug,
        patience: Duration,
        stop: &Stop,
    ) -> Result<Self, BridgeError> {
        let mut client = Client::new(connect()?, stop);
        let identity = client.identify(IDENTIFY_TIMEOUT)?;
        let base = ControllerCounts::default();
        let (reconnects, reboots) = (0, 0);
        let mut device = Self {
            client,
            identity,
            reconnects,
            reboots,
            base,
            connect,
            on_notice,
            params,
            session: random_u32(),
            on_unplug,
            patience,
            stop: stop.clone(),
        };
        device.check()?;
        Ok(device)
    }

    /// Checks the wire version, and whether the controller has a policy.
    fn check(&mut self) -> Result<(), BridgeError> {
        let theirs = self.identity.wire_version;
        if theirs != WIRE_VERSION {
            return Err(BridgeError::WireVersion { theirs });
        }
        if self.identity.policy.is_none() {
            self.notice(&Notice::NoPolicy);
        }
        Ok(())
    }

    pub(super) fn notice(&mut self, notice: &Notice) {
        (self.on_notice)(notice);
    }

    /// Begins a session; the controller forgets the one before.
    pub(super) fn begin(&mut self) -> Result<(), ClientError> {
        let RunParams { law, mode } = self.params;
        self.client.have_done(&Request::Reset { session: self.session, params: law })?;
        self.base = self.counts()?;
        self.client.have_done(&Request::SetMode(mode))
    }

    fn counts(&mut self) -> Result<ControllerCounts, ClientError> {
        let Status { run, line, device } = self.client.status()?;
        Ok(ControllerCounts { line, run: run.counts, device })
    }

    /// Returns whether the controller is in this session.
    pub(super) fn is_in_our_run(&self, identity: &DeviceIdentity) -> bool {
        identity.session == Some(self.session) && identity.mode == self.params.mode
    }

    /// Begins the session again on a controller that is in another one, or in none.
    pub(super) fn begin_again(
        &mut self,
        still_wanted: impl FnMut() -> Result<(), LinkError>,
    ) -> Result<(), BridgeError> {
        self.reboots += 1;
        self.notice(&Notice::Rebooted);
        match self.begin() {
            Err(cause) => self.recover(cause, still_wanted),
            Ok(()) => Ok(()),
        }
    }

    /// Opens a broken line again and restores the session. Returns any other error.
    pub(super) fn recover(
        &mut self,
        cause: ClientError,
        mut still_wanted: impl FnMut() -> Result<(), LinkError>,
    ) -> Result<(), BridgeError> {
        if !cause.is_unplugged() {
            return Err(cause.into());
        }
        if self.on_unplug == OnUnplug::End {
            return Err(BridgeError::Unplugged(cause));
        }
        self.notice(&Notice::Unplugged(cause.to_string()));
        self.client.close_stream();
        let lost = Instant::now();
        let mut back_off = BACK_OFF;
        let mut last: BridgeError = cause.into();
        loop {
            still_wanted()?;
            if self.stop.is_raised() {
                return Err(ClientError::Stopped.into());
            }
            let left = self.patience.saturating_sub(lost.elapsed());
            if left.is_zero() {
                return Err(BridgeError::NotBack { waited: lost.elapsed(), last: Box::new(last) });
            }
            std::thread::sleep(back_off.min(left));
            back_off = BACK_OFF_MAX.min(back_off * 2);
            // The try before may have opened it without an answer.
            self.client.close_stream();
            match self.try_again(left) {
                Ok(()) => {
                    self.reconnects += 1;
                    self.notice(&Notice::Back(lost.elapsed()));
                    return Ok(());
                }
                Err(
                    error @ (BridgeError::WireVersion { .. }
                    | BridgeError::Client(
                        ClientError::Stopped
                        | ClientError::Refused(_)
                        | ClientError::ProtocolVersion { .. },
                    )),
                ) => return Err(error),
                Err(error) => last = error,
            }
        }
    }

    fn try_again(&mut self, left: Duration) -> Result<(), BridgeError> {
        let stream = (self.connect)()?;
        self.client.replace_stream(stream);
        self.identity = self.client.identify(left.min(IDENTIFY_TIMEOUT))?;
        if !self.is_in_our_run(&self.identity) {
            self.check()?;
            self.begin()?;
            self.reboots += 1;
            self.notice(&Notice::Rebooted);
        }
        Ok(())
    }

    /// Ends the session: returns the controller's counts of this run, and leaves it idle.
    pub(super) fn finish(&mut self) -> Result<ControllerCounts, ClientError> {
        let mut counts = self.counts()?;
        self.identity = self.client.identify(IDENTIFY_TIMEOUT)?;
        self.client.have_done(&Request::SetMode(Mode::Idle))?;
        // The counts of line and board run from power-up.
        let base = &self.base;
        for (count, before) in [
            (&mut counts.line.frames, base.line.frames),
            (&mut counts.line.crc_errors, base.line.crc_errors),
            (&mut counts.line.malformed, base.line.malformed),
            (&mut counts.line.oversize, base.line.oversize),
            (&mut counts.line.version, base.line.version),
            (&mut counts.line.unknown, base.line.unknown),
            (&mut counts.line.resyncs, base.line.resyncs),
            (&mut counts.device.unsent, base.device.unsent),
            (&mut counts.device.lost_bytes, base.device.lost_bytes),
        ] {
            *count = count.saturating_sub(before);
        }
        Ok(counts)
    }

    /// Sets the controller idle after a failure, if it still answers, so that the leg is
    /// left in the safe command.
    pub(super) fn leave(&mut self) {
        self.client.disregard_stop();
        let _ = self.client.request(&Request::SetMode(Mode::Idle), IDLE_TIMEOUT);
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;

    use leg_control::serial::frame::{MAX_FRAME, Receiver, decode, encode};
    use leg_control::serial::message::{Identity, Reply, ToController, ToHost};
    use leg_host::serial::stream::over_unix;

    use super::*;

    /// Answers the first request by the identity of a node of another wire version.
    fn identify_as(wire_version: u16, mut stream: Box<dyn ByteStream>) {
        let identity = Identity {
            wire_version,
            board: "b",
            firmware: "f",
            session: None,
            mode: Mode::Idle,
            rate_hz: 1_000,
            gravity_m_s2: 9.81,
            policy: None,
        };
        let (mut receiver, mut bytes) = (Receiver::new(), [0; 64]);
        loop {
            let count = stream.read(&mut bytes, Duration::from_millis(50)).unwrap();
            for &byte in &bytes[..count] {
                if let Some(Ok(payload)) = receiver.push(byte)
                    && let Ok(ToController::Request { id, .. }) = decode(payload)
                {
                    let reply = ToHost::Reply { id, reply: Reply::Identity(identity) };
                    return stream.write_all(encode(&reply, &mut [0; MAX_FRAME]).unwrap()).unwrap();
                }
            }
        }
    }

    #[test]
    fn refuses_a_controller_of_another_wire_version_by_both_versions() {
        for theirs in [WIRE_VERSION - 1, WIRE_VERSION + 1] {
            let (here, there) = UnixStream::pair().unwrap();
            let mut here = Some(here);
            let connect: Connector = Box::new(move || Ok(over_unix(here.take().unwrap()).unwrap()));
            let there = over_unix(there).unwrap();
            let node = std::thread::spawn(move || identify_as(theirs, there));
            let params = RunParams { law: SessionParams::default(), mode: Mode::LockStep };
            let (stop, patience) = (Stop::default(), Duration::ZERO);
            let found =
                Device::find(connect, Box::new(|_| ()), params, OnUnplug::End, patience, &stop);
            let refused = found.err().expect("an error").to_string();
            node.join().unwrap();
            let expected = format!("uses wire version {theirs}, this program {WIRE_VERSION}");
            assert!(refused.contains(&expected), "{refused}");
        }
    }
}
