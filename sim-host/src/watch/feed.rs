//! What the view goes by, from where it comes.

use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use leg_host::Role;
use leg_host::desk::{self, AskError, requests};
use leg_host::shm::{ConnectError, Observer, Participants};

use super::scene::Scene;
use crate::operate::{LegRequest, LegStatus};

/// Between two looks who plays.
const LOOK: Duration = Duration::from_millis(25);
/// Between two questions at the desks.
const ASK: Duration = Duration::from_millis(100);
/// For an answer.
const PATIENCE: Duration = Duration::from_millis(500);

/// What comes from the desks.
#[derive(Debug)]
enum News {
    Leg(Option<Box<LegStatus>>),
    Controller(Option<Box<requests::Status>>),
    Refused(String),
}

/// Brings samples, commands and answers to a scene.
#[derive(Debug)]
pub(super) struct Feed {
    domain: String,
    observer: Option<Observer>,
    looked: Option<Instant>,
    orders: Option<Sender<LegRequest>>,
    news: Receiver<News>,
    asker: Option<JoinHandle<()>>,
}

impl Feed {
    /// Of the domain of this name, where perhaps nobody plays yet.
    ///
    /// # Errors
    /// When the name is unfit.
    pub(super) fn begin(domain: &str) -> Result<Self, ConnectError> {
        Participants::of(domain)?;
        let (orders, inbox) = mpsc::channel();
        let (outbox, news) = mpsc::channel();
        let name = domain.to_owned();
        let asker = std::thread::Builder::new()
            .name("ask".to_owned())
            .spawn(move || ask(&name, &inbox, &outbox))
            .ok();
        let domain = domain.to_owned();
        Ok(Self { domain, observer: None, looked: None, orders: Some(orders), news, asker })
    }

    /// Passes an order to the leg; what comes of it is said later.
    pub(super) fn order(&self, request: LegRequest) {
        if let Some(orders) = &self.orders {
            let _ = orders.send(request);
        }
    }

    /// Brings what there is. Takes some microseconds, and more when somebody
    /// has come or gone.
    pub(super) fn bring(&mut self, scene: &mut Scene) {
        if self.looked.is_none_or(|looked| looked.elapsed() >= LOOK) {
            self.looked = Some(Instant::now());
            self.look(scene);
        }
        if let Some(observer) = &self.observer {
            if let Some(sample) = observer.sample() {
                scene.take_sample(&sample);
            }
            if let Some(command) = observer.command() {
                scene.take_command(&command);
            }
        }
        while let Ok(news) = self.news.try_recv() {
            match news {
                News::Leg(status) => scene.take_leg(status.map(|s| *s), Instant::now()),
                News::Controller(status) => scene.controller = status.map(|s| *s),
                News::Refused(why) => scene.say(why),
            }
        }
    }

    /// Comes and goes with the players: who watches must not be the one for
    /// whose sake a domain stays.
    fn look(&mut self, scene: &mut Scene) {
        let players = Participants::of(&self.domain).unwrap_or_default();
        scene.players = players;
        if !players.any() {
            if self.observer.take().is_some() {
                scene.clear();
            }
        } else if self.observer.is_none() {
            // The first of them may not have made the services yet: the next look tells.
            self.observer = Observer::join(&self.domain).ok();
        }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(asker) = self.asker.take() {
            let _ = asker.join();
        }
    }
}

/// Asks both desks now and then, and passes orders on, until nobody orders any more.
fn ask(domain: &str, orders: &Receiver<LegRequest>, news: &Sender<News>) {
    loop {
        let leg = match orders.try_recv() {
            Ok(order) => ask_leg(domain, &order, news),
            Err(TryRecvError::Empty) => ask_leg(domain, &LegRequest::Status, news),
            Err(TryRecvError::Disconnected) => return,
        };
        let status: Result<requests::Status, AskError> =
            desk::ask(domain, Role::Controller, &requests::Request::Status, PATIENCE);
        let _ = news.send(News::Leg(leg));
        let _ = news.send(News::Controller(status.ok().map(Box::new)));
        // An order does not wait for the next question.
        match orders.recv_timeout(ASK) {
            Ok(order) => drop(ask_leg(domain, &order, news)),
            Err(mpsc::RecvTimeoutError::Timeout) => (),
            Err(mpsc::RecvTimeoutError::Disconnected) => return,
        }
    }
}

fn ask_leg(domain: &str, request: &LegRequest, news: &Sender<News>) -> Option<Box<LegStatus>> {
    match desk::ask(domain, Role::Leg, request, PATIENCE) {
        Ok(status) => Some(Box::new(status)),
        Err(error) => {
            if *request != LegRequest::Status {
                let _ = news.send(News::Refused(error.to_string()));
            }
            None
        }
    }
}
