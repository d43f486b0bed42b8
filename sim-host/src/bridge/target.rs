//! The controller at the end of the line: found, begun with, and found again.

use std::fmt;
use std::time::{Duration, Instant};

use leg_control::serial::message::{Alarm, Mode, Request, Status};
use leg_control::wire::WIRE_VERSION;
use leg_host::LinkError;
use leg_host::serial::client::{ClientError, HELLO_PATIENCE, random_u32};
use leg_host::serial::{ByteStream, Client, DeviceIdentity, OpenError};
use leg_process::Stop;

use super::BridgeError;
use super::report::ControllerCounts;

/// Between two tries to open the line again: the first, and the longest.
const BACK_OFF: Duration = Duration::from_millis(10);
const BACK_OFF_MAX: Duration = Duration::from_millis(500);
/// How long a controller that is left may take to say that it stands idle.
const FAREWELL: Duration = Duration::from_millis(300);

/// What opens the line, as often as it takes.
pub type Dial = Box<dyn FnMut() -> Result<Box<dyn ByteStream>, OpenError>>;

/// What to do when the line breaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum OnUnplug {
    /// Open it again, and go on.
    #[default]
    Reconnect,
    /// End, with an error.
    End,
}

/// On what terms the controller is to run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunTerms {
    /// Ticks a second, Hz.
    pub rate_hz: u32,
    /// Gravity, m/s2.
    pub gravity_m_s2: f32,
    /// How ticks come about.
    pub mode: Mode,
}

/// Something worth a word while the bridge goes on.
#[derive(Clone, Debug)]
pub enum Notice {
    /// The simulator is still missing.
    Waiting(String),
    /// The line broke, and is being opened again.
    Unplugged(String),
    /// It is open again, and the run goes on where it was.
    Back(Duration),
    /// The controller had been reset: it began anew in the middle of the run.
    Rebooted,
    /// It says that something is wrong.
    Alarm(Alarm),
    /// It has no policy: every command will be the safe one.
    NoPolicy,
    /// Its policy, of this name, was trained for another leg.
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
                 safe state, without what it had learnt",
            ),
            Self::Alarm(alarm) => write!(f, "warning: the controller: {alarm}"),
            Self::NoPolicy => f.write_str(
                "warning: the controller has no policy and answers by the safe command; bring one \
                 by `controller policy upload`",
            ),
            Self::OtherLeg(policy) => write!(
                f,
                "warning: the policy {policy} was trained for another leg than the simulator \
                 plays; it runs all the same, `controller policy upload` brings another"
            ),
        }
    }
}

/// What receives the notices of the bridge.
pub type Tell = Box<dyn FnMut(&Notice)>;

/// The controller, and how to reach it.
pub(super) struct Target {
    pub(super) client: Client,
    pub(super) who: DeviceIdentity,
    pub(super) reconnects: u64,
    pub(super) reboots: u64,
    /// Of the line when the run began, or the controller began anew.
    base: ControllerCounts,
    dial: Dial,
    tell: Tell,
    terms: RunTerms,
    session: u32,
    on_unplug: OnUnplug,
    patience: Duration,
    stop: Stop,
}

impl Target {
    /// Opens the line, and finds out who is there.
    pub(super) fn find(
        mut dial: Dial,
        tell: Tell,
        terms: RunTerms,
        on_unplug: OnUnplug,
        patience: Duration,
        stop: &Stop,
    ) -> Result<Self, BridgeError> {
        let mut client = Client::new(dial()?, stop);
        let who = client.identify(HELLO_PATIENCE)?;
        let base = ControllerCounts::default();
        let (reconnects, reboots) = (0, 0);
        let mut target = Self {
            client,
            who,
            reconnects,
            reboots,
            base,
            dial,
            tell,
            terms,
            session: random_u32(),
            on_unplug,
            patience,
            stop: stop.clone(),
        };
        target.check()?;
        Ok(target)
    }

    /// Whether its messages are ours, and whether it has a policy.
    fn check(&mut self) -> Result<(), BridgeError> {
        let theirs = self.who.wire_version;
        if theirs != WIRE_VERSION {
            return Err(BridgeError::WireVersion { theirs });
        }
        if self.who.policy.is_none() {
            self.notice(&Notice::NoPolicy);
        }
        Ok(())
    }

    pub(super) fn notice(&mut self, notice: &Notice) {
        (self.tell)(notice);
    }

    /// Begins a run. Whatever the controller did before is forgotten.
    pub(super) fn begin(&mut self) -> Result<(), ClientError> {
        let RunTerms { rate_hz, gravity_m_s2, mode } = self.terms;
        let session = self.session;
        self.client.have_done(&Request::Reset { session, rate_hz, gravity_m_s2 })?;
        self.base = self.counts()?;
        self.client.have_done(&Request::SetMode(mode))
    }

    fn counts(&mut self) -> Result<ControllerCounts, ClientError> {
        let Status { run, line, device } = self.client.status()?;
        Ok(ControllerCounts { line, run: run.counts, device })
    }

    /// Whether `who` is in our run.
    pub(super) fn is_in_our_run(&self, who: &DeviceIdentity) -> bool {
        who.session == Some(self.session) && who.mode == self.terms.mode
    }

    /// After it was found to be in another run, or in none.
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

    /// After the line broke: opens it again and sees to it that the run is on,
    /// or says that there is nothing to be done. Any other error is passed on.
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
        let stream = (self.dial)()?;
        self.client.replace_stream(stream);
        self.who = self.client.identify(left.min(HELLO_PATIENCE))?;
        if !self.is_in_our_run(&self.who) {
            self.check()?;
            self.begin()?;
            self.reboots += 1;
            self.notice(&Notice::Rebooted);
        }
        Ok(())
    }

    /// The controller's own figures, of this run, and who it is by now; then it
    /// stands idle.
    pub(super) fn finish(&mut self) -> Result<ControllerCounts, ClientError> {
        let mut figures = self.counts()?;
        self.who = self.client.identify(HELLO_PATIENCE)?;
        self.client.have_done(&Request::SetMode(Mode::Idle))?;
        // Those of the line and the board count from power-up.
        let base = &self.base;
        for (count, before) in [
            (&mut figures.line.frames, base.line.frames),
            (&mut figures.line.crc_errors, base.line.crc_errors),
            (&mut figures.line.malformed, base.line.malformed),
            (&mut figures.line.oversize, base.line.oversize),
            (&mut figures.line.version, base.line.version),
            (&mut figures.line.unknown, base.line.unknown),
            (&mut figures.line.resyncs, base.line.resyncs),
            (&mut figures.device.unsent, base.device.unsent),
            (&mut figures.device.lost_bytes, base.device.lost_bytes),
        ] {
            *count = count.saturating_sub(before);
        }
        Ok(figures)
    }

    /// After a failure: has it stand idle if it still hears, so that the leg is
    /// left in the safe command.
    pub(super) fn leave(&mut self) {
        self.client.disregard_stop();
        let _ = self.client.request(&Request::SetMode(Mode::Idle), FAREWELL);
    }
}
