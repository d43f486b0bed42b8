//! Collects the data for the view.

use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::time::{Duration, Instant};

use leg_host::Role;
use leg_host::cli::target::process_status;
use leg_host::json_socket;
use leg_host::shm::{ConnectError, Observer, Participants};
use leg_host::status::Status;

use super::scene::Scene;
use crate::operate::{LegRequest, LegStatus};

/// Time between two checks which processes are present.
const PRESENCE_INTERVAL: Duration = Duration::from_millis(25);
/// Time between two status requests.
const STATUS_INTERVAL: Duration = Duration::from_millis(100);
/// Time for which joining may fail, while leg and controller create their services.
const REPORT_AFTER: Duration = Duration::from_secs(1);
/// Time between two later tries to join.
const RETRY_INTERVAL: Duration = Duration::from_millis(500);
/// Longest wait for an answer.
const TIMEOUT: Duration = Duration::from_millis(500);

/// An answer from leg or controller; `None` if there was none.
#[derive(Debug)]
enum Answer {
    Leg(Option<Box<LegStatus>>),
    Controller(Option<Box<Status>>),
    Refused(String),
}

/// Passes samples, commands and status answers to a scene.
#[derive(Debug)]
pub(super) struct Feed {
    domain: String,
    observer: Option<Observer>,
    /// Since when joining has failed, and when it was tried last.
    failing: Option<(Instant, Instant)>,
    checked: Option<Instant>,
    /// To a thread that ends with this value, as soon as it has its last answer: a process
    /// that is stopped gives it none for a while.
    requests: Sender<LegRequest>,
    answers: Receiver<Answer>,
}

impl Feed {
    /// Creates a feed of `domain`, in which no process need be present yet.
    ///
    /// # Errors
    /// If the name is invalid.
    pub(super) fn begin(domain: &str) -> Result<Self, ConnectError> {
        Participants::of(domain)?;
        let (requests, request_receiver) = mpsc::channel();
        let (answer_sender, answers) = mpsc::channel();
        let name = domain.to_owned();
        // Without the thread the view shows no status.
        let _ = std::thread::Builder::new()
            .name("requests".to_owned())
            .spawn(move || exchange_requests(&name, &request_receiver, &answer_sender));
        let domain = domain.to_owned();
        Ok(Self { domain, observer: None, failing: None, checked: None, requests, answers })
    }

    /// Sends a request to the leg; its answer arrives with a later update.
    pub(super) fn send(&self, request: LegRequest) {
        let _ = self.requests.send(request);
    }

    /// Updates the scene. This takes some microseconds, and more after a process has
    /// started or stopped.
    pub(super) fn update(&mut self, scene: &mut Scene) {
        if self.checked.is_none_or(|checked| checked.elapsed() >= PRESENCE_INTERVAL) {
            self.checked = Some(Instant::now());
            self.check_presence(scene);
        }
        if let Some(observer) = &self.observer {
            if let Some(sample) = observer.sample() {
                scene.take_sample(&sample);
            }
            if let Some(command) = observer.command() {
                scene.take_command(&command);
            }
        }
        while let Ok(answer) = self.answers.try_recv() {
            match answer {
                Answer::Leg(status) => scene.take_leg(status.map(|s| *s), Instant::now()),
                Answer::Controller(status) => scene.controller = status.map(|s| *s),
                Answer::Refused(why) => scene.show_message(why),
            }
        }
    }

    /// Joins and leaves the domain with the processes in it, so that the view does
    /// not keep a domain alive.
    fn check_presence(&mut self, scene: &mut Scene) {
        let players = Participants::of(&self.domain).unwrap_or_default();
        let before = std::mem::replace(&mut scene.players, players);
        if self.observer.as_ref().is_some_and(Observer::is_over) {
            self.observer = None;
        }
        if !players.any() {
            self.observer = None;
            if before.any() {
                scene.clear();
            }
        } else if self.observer.is_none() {
            self.join(scene);
        }
    }
}

impl Feed {
    /// Tries to join the domain, whose services may not exist yet. Shows the reason when it
    /// has failed for a while, for example because there are too many observers.
    fn join(&mut self, scene: &mut Scene) {
        let now = Instant::now();
        let (since, tried) = *self.failing.get_or_insert((now, now));
        let is_settled = now - since >= REPORT_AFTER;
        if is_settled && now - tried < RETRY_INTERVAL {
            return;
        }
        match Observer::join(&self.domain) {
            Ok(observer) => (self.observer, self.failing) = (Some(observer), None),
            Err(error) => {
                self.failing = Some((since, now));
                if is_settled {
                    scene.show_message(error.to_string());
                }
            }
        }
    }
}

/// Requests the status of both processes periodically and sends the user's
/// requests, until the feed is dropped.
fn exchange_requests(domain: &str, requests: &Receiver<LegRequest>, answers: &Sender<Answer>) {
    loop {
        let leg = match requests.try_recv() {
            Ok(request) => request_leg(domain, &request, answers),
            Err(TryRecvError::Empty) => request_leg(domain, &LegRequest::Status, answers),
            Err(TryRecvError::Disconnected) => return,
        };
        let status = process_status(domain);
        let _ = answers.send(Answer::Leg(leg));
        let _ = answers.send(Answer::Controller(status.ok().map(Box::new)));
        // A request of the user does not wait for the next status request.
        match requests.recv_timeout(STATUS_INTERVAL) {
            Ok(request) => drop(request_leg(domain, &request, answers)),
            Err(mpsc::RecvTimeoutError::Timeout) => (),
            Err(mpsc::RecvTimeoutError::Disconnected) => return,
        }
    }
}

fn request_leg(
    domain: &str,
    request: &LegRequest,
    answers: &Sender<Answer>,
) -> Option<Box<LegStatus>> {
    match json_socket::ask(domain, Role::Leg, request, TIMEOUT) {
        Ok(status) => Some(Box::new(status)),
        Err(error) => {
            if *request != LegRequest::Status {
                let _ = answers.send(Answer::Refused(error.to_string()));
            }
            None
        }
    }
}
