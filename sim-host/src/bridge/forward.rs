//! Forwards samples to the controller, commands to the simulator, and clients' requests in
//! between.

use std::time::{Duration, Instant};

use leg_control::serial::message::{Alarm, Mode, Reply, Request};
use leg_control::wire::{Command, Sample, flags};
use leg_host::serial::client::REQUEST_TIMEOUT;
use leg_host::serial::{ClientError, DeviceIdentity, Received};
use leg_host::serve::ServeError;
use leg_host::server::socket_in;
use leg_host::shm::ShmController;
use leg_host::{Domain, Link, LinkError};

use super::BridgeError;
use super::device::{Device, Notice};
use super::report::{Report, Times};
use super::request_mux::{ClientRequest, RequestMux};

/// Lock-step: longest wait for an answer on the line before the simulator is checked.
const LINE_WAIT: Duration = Duration::from_millis(20);
/// Live: longest wait on the line before a newer sample is looked for.
const LIVE_WAIT: Duration = Duration::from_micros(200);
/// Shortest and longest wait for the simulator.
const LEG_WAIT: Duration = Duration::from_millis(1);
const LEG_WAIT_MAX: Duration = Duration::from_millis(16);
/// A controller that was reset answers with the safe command. The first safe command is held
/// until the controller has confirmed the session, and later one in so many.
const CHECK_EVERY: u32 = 256;

/// A sample that has not been answered.
#[derive(Clone, Copy, Debug)]
struct InFlight {
    seq: u32,
    sample: Sample,
    /// When it arrived from the simulator.
    arrived: Instant,
    /// How long it took to be sent.
    sending: Duration,
}

/// The request that waits for its reply.
#[derive(Debug)]
enum PendingRequest {
    /// The bridge's own: is the controller still in this session?
    SessionCheck,
    /// A client's.
    Client(ClientRequest),
}

/// Everything between the simulator's link and the line.
pub(super) struct Forwarder {
    device: Device,
    requests: RequestMux,
    mode: Mode,
    timeout: Duration,
    seq: u32,
    in_flight: Option<InFlight>,
    /// A safe command that waits for the session check.
    held_command: Option<Command>,
    safe_in_a_row: u32,
    pending: Option<PendingRequest>,
    /// When something last came from the controller, and when the simulator was last checked.
    last_received: Instant,
    last_peer_check: Instant,
    begun: Instant,
    ticks: u64,
    times: Times,
    shared: u64,
    alarms: u64,
}

impl Forwarder {
    pub(super) fn new(device: Device, requests: RequestMux, mode: Mode, timeout: Duration) -> Self {
        Self {
            device,
            requests,
            mode,
            timeout,
            seq: 0,
            in_flight: None,
            held_command: None,
            safe_in_a_row: 0,
            pending: None,
            last_received: Instant::now(),
            last_peer_check: Instant::now(),
            begun: Instant::now(),
            ticks: 0,
            times: Times::default(),
            shared: 0,
            alarms: 0,
        }
    }

    /// Opens the socket for requests in the folder of the domain, in which this process must
    /// have the controller's role. Without it the run is played all the same, after a warning.
    pub(super) fn listen_in(&mut self, domain: &Domain) {
        if let Err(cause) = self.requests.listen(&socket_in(domain.root())) {
            self.notice(&Notice::NoControlSocket(cause.to_string()));
        }
    }

    pub(super) fn notice(&mut self, notice: &Notice) {
        self.device.notice(notice);
    }

    /// Serves clients' requests while there is no simulator.
    pub(super) fn serve_others(&mut self) -> Result<(), BridgeError> {
        self.send_next_request();
        match self.device.client.listen(Duration::ZERO) {
            Ok(received) => self.handle(received).map(|_| ()),
            Err(cause) => self.recover(cause, || Ok(())),
        }
    }

    /// Forwards until the simulator ends its run, and then closes the sockets for requests.
    pub(super) fn play(&mut self, link: &mut ShmController) -> Result<(), BridgeError> {
        let played = self.forward(link);
        self.stop_listening();
        played
    }

    /// Closes the sockets for requests, before the controller's role is given up.
    pub(super) fn stop_listening(&mut self) {
        self.requests.close();
    }

    fn forward(&mut self, link: &mut ShmController) -> Result<(), BridgeError> {
        self.begun = Instant::now();
        (self.last_received, self.last_peer_check) = (self.begun, self.begun);
        self.compare_legs(link);
        let (mut leg_wait, mut leg_received) = (LEG_WAIT, self.begun);
        loop {
            if self.in_flight.is_none() || self.mode == Mode::Live {
                // Live, the line does not wait for the leg.
                let wait = if self.mode == Mode::Live { Duration::ZERO } else { leg_wait };
                if let Some(sample) = link.receive(wait).map_err(|cause| self.broken(cause))? {
                    let arrived = Instant::now();
                    (leg_wait, leg_received) = (LEG_WAIT, arrived);
                    if sample.ends_the_run() {
                        return Ok(());
                    }
                    self.send_sample(&sample, arrived);
                } else if self.in_flight.is_none() {
                    let is_busy = self.pending.is_some();
                    leg_wait = if is_busy { LEG_WAIT } else { LEG_WAIT_MAX.min(leg_wait * 2) };
                    self.check_peer(link)?;
                    if leg_received.elapsed() >= self.timeout {
                        let waited_s = self.timeout.as_secs_f64();
                        return Err(ServeError::Silent { ticks: self.ticks, waited_s }.into());
                    }
                }
            }
            self.poll_line(link)?;
        }
    }

    /// Warns if the policy was trained for another leg; that is allowed.
    fn compare_legs(&mut self, link: &ShmController) {
        if let (Some(policy), Some(played)) =
            (&self.device.identity.policy, link.peer().and_then(|leg| leg.leg))
            && policy.leg != played
        {
            let name = policy.name.clone();
            self.notice(&Notice::OtherLeg(name));
        }
    }

    /// Checks now and then, off the control path, that the simulator lives.
    fn check_peer(&mut self, link: &ShmController) -> Result<(), BridgeError> {
        if self.last_peer_check.elapsed() >= LINE_WAIT {
            self.last_peer_check = Instant::now();
            link.check_peer().map_err(|cause| self.broken(cause))?;
        }
        Ok(())
    }

    fn broken(&self, cause: LinkError) -> BridgeError {
        ServeError::Link { ticks: self.ticks, cause }.into()
    }

    /// Sends a sample; in live mode it replaces one that is unanswered.
    fn send_sample(&mut self, sample: &Sample, arrived: Instant) {
        if self.in_flight.is_none() {
            self.last_received = arrived;
        }
        self.seq = self.seq.wrapping_add(1);
        let (seq, sample) = (self.seq, *sample);
        self.device.client.post_sample(seq, &sample);
        self.in_flight = Some(InFlight { seq, sample, arrived, sending: arrived.elapsed() });
    }

    /// Polls the line once and handles what arrived.
    fn poll_line(&mut self, link: &mut ShmController) -> Result<(), BridgeError> {
        let wait = match (self.in_flight, self.mode) {
            (_, Mode::Live) => LIVE_WAIT,
            (None, _) => Duration::ZERO,
            (Some(_), _) => LINE_WAIT,
        };
        self.send_next_request();
        let received = match self.device.client.listen(wait) {
            Ok(received) => received,
            Err(cause) => return self.recover(cause, || link.check_peer()),
        };
        if received == Received::Nothing {
            return self.check_timeouts(link);
        }
        self.last_received = Instant::now();
        match self.handle(received)? {
            Handled::Command(command) => self.deliver(link, &command),
            Handled::Reset => {
                self.device.begin_again(|| link.check_peer())?;
                // Under a new number, so that a late answer is not taken for this one's.
                self.seq = self.seq.wrapping_add(1);
                if let Some(in_flight) = &mut self.in_flight {
                    in_flight.seq = self.seq;
                }
                self.resend();
                Ok(())
            }
            Handled::Other => Ok(()),
        }
    }

    /// Checks the time-outs after nothing has arrived.
    fn check_timeouts(&mut self, link: &ShmController) -> Result<(), BridgeError> {
        let waited = self.last_received.elapsed();
        if self.in_flight.is_some() && waited >= LINE_WAIT {
            self.check_peer(link)?;
            if waited >= self.timeout {
                let waited_s = waited.as_secs_f64();
                let others = self.device.client.other_users();
                return Err(BridgeError::NoAnswer { ticks: self.ticks, waited_s, others });
            }
        }
        Ok(())
    }

    /// Drops a request that is overdue: its client has given up, too.
    fn drop_overdue_request(&mut self) {
        if let Some(age) = self.device.client.request_age()
            && age >= REQUEST_TIMEOUT
        {
            self.device.client.drop_request();
            self.pending = None;
        }
    }

    /// Sends the next request, if none waits for its reply.
    fn send_next_request(&mut self) {
        self.drop_overdue_request();
        if self.pending.is_some() {
            return;
        }
        if self.held_command.is_some() {
            self.pending = Some(PendingRequest::SessionCheck);
            self.device.client.post_request(&Request::Identify);
        } else if let Some(next) = self.requests.next()
            && let Some(request) = next.request()
        {
            self.device.client.post_request(&request);
            self.shared += 1;
            self.pending = Some(PendingRequest::Client(next));
        }
    }

    /// Handles what arrived; returns a command if it can be forwarded.
    fn handle(&mut self, received: Received) -> Result<Handled, BridgeError> {
        match received {
            Received::Nothing => Ok(Handled::Other),
            Received::Alarm(alarm) => {
                if let Alarm::Crash(_) = alarm {
                    return Err(ClientError::Alarm(alarm).into());
                }
                self.alarms += 1;
                self.notice(&Notice::Alarm(alarm));
                // Sent after a power-up: the next command must be checked.
                self.safe_in_a_row = 0;
                Ok(Handled::Other)
            }
            Received::Command { again: true, .. } if self.mode != Mode::Live => Ok(Handled::Other),
            Received::Command { command, .. } => Ok(self.accept(command)),
            Received::Reply => Ok(self.finish_request()),
        }
    }

    /// Returns a command to forward, or holds it until the session is checked.
    fn accept(&mut self, command: Command) -> Handled {
        if command.header.flags & flags::SAFE == 0 {
            (self.safe_in_a_row, self.held_command) = (0, None);
            return Handled::Command(command);
        }
        let nth = self.safe_in_a_row;
        self.safe_in_a_row = (nth + 1) % CHECK_EVERY;
        if nth == 0 || self.held_command.is_some() {
            self.held_command = Some(command);
            return Handled::Other;
        }
        Handled::Command(command)
    }

    /// Its reply has come.
    fn finish_request(&mut self) -> Handled {
        let reply = self.device.client.reply();
        match (self.pending.take(), reply) {
            (Some(PendingRequest::Client(request)), Some(reply)) => {
                request.answer(reply);
                Handled::Other
            }
            (Some(PendingRequest::SessionCheck), Some(Reply::Identity(identity))) => {
                let identity = DeviceIdentity::from(&identity);
                match self.held_command.take() {
                    _ if !self.device.is_in_our_run(&identity) => Handled::Reset,
                    Some(command) => Handled::Command(command),
                    None => Handled::Other,
                }
            }
            _ => Handled::Other,
        }
    }

    /// Sends a command to the simulator.
    fn deliver(&mut self, link: &mut ShmController, command: &Command) -> Result<(), BridgeError> {
        let arrived = Instant::now();
        link.send(command).map_err(|cause| self.broken(cause))?;
        let given = Instant::now();
        let answered = |in_flight: &mut InFlight| in_flight.sample.header.seq == command.header.seq;
        if let Some(in_flight) = self.in_flight.take_if(answered) {
            self.times.record(given - in_flight.arrived, in_flight.sending + (given - arrived));
            self.ticks += 1;
        }
        Ok(())
    }

    /// Recovers from a broken line, and sends the unanswered sample again.
    fn recover(
        &mut self,
        cause: ClientError,
        mut still_wanted: impl FnMut() -> Result<(), LinkError>,
    ) -> Result<(), BridgeError> {
        if let Some(PendingRequest::Client(request)) = self.pending.take() {
            request.hang_up();
        }
        self.device.recover(cause, &mut still_wanted)?;
        self.last_received = Instant::now();
        self.resend();
        Ok(())
    }

    /// Sends the unanswered sample under the same number: a controller that has answered it
    /// repeats its answer.
    fn resend(&mut self) {
        (self.held_command, self.safe_in_a_row) = (None, 0);
        if let Some(InFlight { seq, sample, .. }) = self.in_flight {
            self.device.client.post_sample(seq, &sample);
        }
    }

    /// Waits for the reply to the pending request.
    fn drain_request(&mut self) -> Result<(), BridgeError> {
        while self.pending.is_some() {
            let received = self.device.client.listen(LINE_WAIT)?;
            self.handle(received)?;
            self.drop_overdue_request();
        }
        Ok(())
    }

    /// Ends the run; returns the report with the counts of both sides.
    pub(super) fn finish(&mut self) -> Result<Report, BridgeError> {
        let wall = self.begun.elapsed();
        self.drain_request()?;
        let counts = self.device.finish()?;
        let line = self.device.client.line_counts();
        Ok(Report {
            board: self.device.identity.board.clone(),
            firmware: self.device.identity.firmware.clone(),
            policy: self.device.identity.policy.as_ref().map(|policy| policy.name.clone()),
            mode: self.mode.to_string(),
            ticks: self.ticks,
            ticks_per_s: self.ticks as f64 / wall.as_secs_f64(),
            round_trip_us: self.times.round_trips_us(),
            own_share_us: self.times.own_shares_us(),
            sent: *self.device.client.counts(),
            received: *line,
            reconnects: self.device.reconnects,
            reboots: self.device.reboots,
            alarms: self.alarms,
            shared_requests: self.shared,
            controller: counts,
        })
    }

    /// Leaves the controller idle, after a failure.
    pub(super) fn leave(&mut self) {
        self.device.leave();
    }
}

/// The result of handling what arrived.
enum Handled {
    /// A command to forward.
    Command(Command),
    /// The controller is no longer in this session.
    Reset,
    /// Nothing for the simulator.
    Other,
}
