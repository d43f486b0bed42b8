//! Samples to the controller, commands to the simulator, and others' requests
//! in between.

use std::time::{Duration, Instant};

use leg_control::serial::message::{Alarm, Mode, Reply, Request};
use leg_control::wire::{Command, Sample, flags};
use leg_host::serial::client::REQUEST_PATIENCE;
use leg_host::serial::{ClientError, DeviceIdentity, Heard};
use leg_host::serve::ServeError;
use leg_host::shm::ShmController;
use leg_host::{Link, LinkError};

use super::BridgeError;
use super::report::{Report, Times};
use super::share::{Asked, Share};
use super::target::{Notice, Target};

/// Lock-step: longest wait at the line while an answer is due. After so long
/// without one it is time to look whether the simulator still lives.
const LINE_WAIT: Duration = Duration::from_millis(20);
/// Live: longest wait at the line before looking for a newer sample.
const LIVE_WAIT: Duration = Duration::from_micros(200);
/// Waits for the simulator: the first, and the longest, when it does something else.
const LEG_WAIT: Duration = Duration::from_millis(1);
const LEG_WAIT_MAX: Duration = Duration::from_millis(16);
/// A controller that was reset answers by the safe command: the first one is
/// held until it has said that it is in our run, and then one in so many.
const CHECK_EVERY: u32 = 256;

/// A sample on its way.
#[derive(Clone, Copy, Debug)]
struct Asking {
    seq: u32,
    sample: Sample,
    /// When it came from the simulator.
    came: Instant,
    /// How long it took to be sent.
    sending: Duration,
}

/// The client whose request the line is busy with.
#[derive(Debug)]
enum Errand {
    /// Ours: is the controller in our run?
    Check,
    /// Somebody else's.
    Other(Asked),
}

/// Everything between the simulator's link and the line.
pub(super) struct Forwarder {
    target: Target,
    share: Option<Share>,
    mode: Mode,
    timeout: Duration,
    seq: u32,
    asking: Option<Asking>,
    /// A safe command that waits for the check.
    held: Option<Command>,
    safe_in_a_row: u32,
    errand: Option<Errand>,
    /// When the controller was last heard, and the simulator last looked for.
    last_life: Instant,
    last_look: Instant,
    begun: Instant,
    ticks: u64,
    times: Times,
    shared: u64,
    alarms: u64,
}

impl Forwarder {
    pub(super) fn new(target: Target, share: Option<Share>, mode: Mode, timeout: Duration) -> Self {
        Self {
            target,
            share,
            mode,
            timeout,
            seq: 0,
            asking: None,
            held: None,
            safe_in_a_row: 0,
            errand: None,
            last_life: Instant::now(),
            last_look: Instant::now(),
            begun: Instant::now(),
            ticks: 0,
            times: Times::default(),
            shared: 0,
            alarms: 0,
        }
    }

    pub(super) fn notice(&mut self, notice: &Notice) {
        self.target.notice(notice);
    }

    /// While there is no simulator yet: others' requests, and what else comes.
    pub(super) fn serve_others(&mut self) -> Result<(), BridgeError> {
        self.run_errands();
        match self.target.client.listen(Duration::ZERO) {
            Ok(heard) => self.note(heard).map(|_| ()),
            Err(cause) => self.recover(cause, || Ok(())),
        }
    }

    /// Until the simulator says that its run is over.
    pub(super) fn play(&mut self, link: &mut ShmController) -> Result<(), BridgeError> {
        self.begun = Instant::now();
        (self.last_life, self.last_look) = (self.begun, self.begun);
        self.compare_legs(link);
        let (mut leg_wait, mut leg_life) = (LEG_WAIT, self.begun);
        loop {
            if self.asking.is_none() || self.mode == Mode::Live {
                // Live, the line does not wait for the leg.
                let wait = if self.mode == Mode::Live { Duration::ZERO } else { leg_wait };
                if let Some(sample) = link.receive(wait).map_err(|cause| self.broken(cause))? {
                    let came = Instant::now();
                    (leg_wait, leg_life) = (LEG_WAIT, came);
                    if sample.ends_the_run() {
                        return Ok(());
                    }
                    self.ask(&sample, came);
                } else if self.asking.is_none() {
                    let is_busy = self.errand.is_some();
                    leg_wait = if is_busy { LEG_WAIT } else { LEG_WAIT_MAX.min(leg_wait * 2) };
                    self.look_at_peer(link)?;
                    if leg_life.elapsed() >= self.timeout {
                        let waited_s = self.timeout.as_secs_f64();
                        return Err(ServeError::Silent { ticks: self.ticks, waited_s }.into());
                    }
                }
            }
            self.attend_to_line(link)?;
        }
    }

    /// A policy may well be tried on a leg that it was not trained for.
    fn compare_legs(&mut self, link: &ShmController) {
        if let (Some(policy), Some(played)) = (&self.target.who.policy, link.peer_leg())
            && policy.leg != played
        {
            let name = policy.name.clone();
            self.notice(&Notice::OtherLeg(name));
        }
    }

    /// Off the control path, and now and then: whether the simulator lives.
    fn look_at_peer(&mut self, link: &ShmController) -> Result<(), BridgeError> {
        if self.last_look.elapsed() >= LINE_WAIT {
            self.last_look = Instant::now();
            link.check_peer().map_err(|cause| self.broken(cause))?;
        }
        Ok(())
    }

    fn broken(&self, cause: LinkError) -> BridgeError {
        ServeError::Link { ticks: self.ticks, cause }.into()
    }

    /// Sends a sample, in place of one that is unanswered (live).
    fn ask(&mut self, sample: &Sample, came: Instant) {
        if self.asking.is_none() {
            self.last_life = came;
        }
        self.seq = self.seq.wrapping_add(1);
        let (seq, sample) = (self.seq, *sample);
        self.target.client.post_sample(seq, &sample);
        self.asking = Some(Asking { seq, sample, came, sending: came.elapsed() });
    }

    /// One look at the line, and what comes of it.
    fn attend_to_line(&mut self, link: &mut ShmController) -> Result<(), BridgeError> {
        let wait = match (self.asking, self.mode) {
            (_, Mode::Live) => LIVE_WAIT,
            (None, _) => Duration::ZERO,
            (Some(_), _) => LINE_WAIT,
        };
        self.run_errands();
        let heard = match self.target.client.listen(wait) {
            Ok(heard) => heard,
            Err(cause) => return self.recover(cause, || link.check_peer()),
        };
        if heard == Heard::Nothing {
            return self.look_around(link);
        }
        self.last_life = Instant::now();
        match self.note(heard)? {
            Noted::Command(command) => self.give(link, &command),
            Noted::Reset => {
                self.target.begin_again(|| link.check_peer())?;
                // Under a new number: a late answer of before is not one to this.
                self.seq = self.seq.wrapping_add(1);
                if let Some(asking) = &mut self.asking {
                    asking.seq = self.seq;
                }
                self.ask_again();
                Ok(())
            }
            Noted::Other => Ok(()),
        }
    }

    /// Nothing came: is anybody gone?
    fn look_around(&mut self, link: &ShmController) -> Result<(), BridgeError> {
        let waited = self.last_life.elapsed();
        if self.asking.is_some() && waited >= LINE_WAIT {
            self.look_at_peer(link)?;
            if waited >= self.timeout {
                let waited_s = waited.as_secs_f64();
                return Err(BridgeError::NoAnswer { ticks: self.ticks, waited_s });
            }
        }
        Ok(())
    }

    /// After so long its caller has given up, too; a check is made anew.
    fn give_up_errand(&mut self) {
        if let Some(age) = self.target.client.request_age()
            && age >= REQUEST_PATIENCE
        {
            self.target.client.drop_request();
            self.errand = None;
        }
    }

    /// Starts the next errand, if the line is free for it.
    fn run_errands(&mut self) {
        self.give_up_errand();
        if self.errand.is_some() {
            return;
        }
        if self.held.is_some() {
            self.errand = Some(Errand::Check);
            self.target.client.post_request(&Request::Identify);
        } else if let Some(asked) = self.share.as_ref().and_then(Share::next)
            && let Some(request) = asked.request()
        {
            self.target.client.post_request(&request);
            self.shared += 1;
            self.errand = Some(Errand::Other(asked));
        }
    }

    /// Makes of what came a command to hand on, if it is one and to be trusted.
    fn note(&mut self, heard: Heard) -> Result<Noted, BridgeError> {
        match heard {
            Heard::Nothing => Ok(Noted::Other),
            Heard::Alarm(alarm) => {
                if let Alarm::Crash(_) = alarm {
                    return Err(ClientError::Alarm(alarm).into());
                }
                self.alarms += 1;
                self.notice(&Notice::Alarm(alarm));
                // Said after a power-up: the next command is to be checked.
                self.safe_in_a_row = 0;
                Ok(Noted::Other)
            }
            Heard::Command { again: true, .. } if self.mode != Mode::Live => Ok(Noted::Other),
            Heard::Command { command, .. } => Ok(self.judge(command)),
            Heard::Reply => Ok(self.close_errand()),
        }
    }

    /// Whether a command can be handed on, or is first to be checked.
    fn judge(&mut self, command: Command) -> Noted {
        if command.header.flags & flags::SAFE == 0 {
            (self.safe_in_a_row, self.held) = (0, None);
            return Noted::Command(command);
        }
        let nth = self.safe_in_a_row;
        self.safe_in_a_row = (nth + 1) % CHECK_EVERY;
        if nth == 0 || self.held.is_some() {
            self.held = Some(command);
            return Noted::Other;
        }
        Noted::Command(command)
    }

    /// Its reply has come.
    fn close_errand(&mut self) -> Noted {
        let reply = self.target.client.reply();
        match (self.errand.take(), reply) {
            (Some(Errand::Other(asked)), Some(reply)) => {
                asked.answer(reply);
                Noted::Other
            }
            (Some(Errand::Check), Some(Reply::Identity(identity))) => {
                let who = DeviceIdentity::from(&identity);
                match self.held.take() {
                    _ if !self.target.is_in_our_run(&who) => Noted::Reset,
                    Some(command) => Noted::Command(command),
                    None => Noted::Other,
                }
            }
            _ => Noted::Other,
        }
    }

    /// Hands a command to the simulator.
    fn give(&mut self, link: &mut ShmController, command: &Command) -> Result<(), BridgeError> {
        let came = Instant::now();
        link.send(command).map_err(|cause| self.broken(cause))?;
        let given = Instant::now();
        let answered = |asking: &mut Asking| asking.sample.header.seq == command.header.seq;
        if let Some(asking) = self.asking.take_if(answered) {
            self.times.record(given - asking.came, asking.sending + (given - came));
            self.ticks += 1;
        }
        Ok(())
    }

    /// The line broke, or worse. When it is back, what was asked is asked again.
    fn recover(
        &mut self,
        cause: ClientError,
        mut still_wanted: impl FnMut() -> Result<(), LinkError>,
    ) -> Result<(), BridgeError> {
        if let Some(Errand::Other(asked)) = self.errand.take() {
            asked.hang_up();
        }
        self.target.recover(cause, &mut still_wanted)?;
        self.last_life = Instant::now();
        self.ask_again();
        Ok(())
    }

    /// The same seq again: a controller that has answered it gives the same answer.
    fn ask_again(&mut self) {
        (self.held, self.safe_in_a_row) = (None, 0);
        if let Some(Asking { seq, sample, .. }) = self.asking {
            self.target.client.post_sample(seq, &sample);
        }
    }

    /// Lets the request that is under way come to its end.
    fn finish_errand(&mut self) -> Result<(), BridgeError> {
        while self.errand.is_some() {
            let heard = self.target.client.listen(LINE_WAIT)?;
            self.note(heard)?;
            self.give_up_errand();
        }
        Ok(())
    }

    /// After the run: the figures of both sides.
    pub(super) fn finish(&mut self) -> Result<Report, BridgeError> {
        let wall = self.begun.elapsed();
        self.finish_errand()?;
        let figures = self.target.finish()?;
        let line = self.target.client.line_counts();
        Ok(Report {
            board: self.target.who.board.clone(),
            firmware: self.target.who.firmware.clone(),
            policy: self.target.who.policy.as_ref().map(|policy| policy.name.clone()),
            mode: self.mode.to_string(),
            ticks: self.ticks,
            ticks_per_s: self.ticks as f64 / wall.as_secs_f64(),
            round_trip_us: self.times.round_trips_us(),
            own_share_us: self.times.own_shares_us(),
            sent: *self.target.client.counts(),
            received: *line,
            reconnects: self.target.reconnects,
            reboots: self.target.reboots,
            alarms: self.alarms,
            shared_requests: self.shared,
            controller: figures,
        })
    }

    /// After a failure.
    pub(super) fn leave(&mut self) {
        self.target.leave();
    }
}

/// What came of what was heard.
enum Noted {
    /// A command to hand on.
    Command(Command),
    /// The controller is not in our run any more.
    Reset,
    /// Nothing for the simulator.
    Other,
}
