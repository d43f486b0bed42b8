//! The view in a terminal: keys in, pictures out, the terminal left as it was.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use leg_host::shm::ConnectError;
use leg_process::Stop;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::feed::Feed;
use super::keys::{Action, action};
use super::scene::Scene;
use super::view;
use crate::operate::LegRequest;

/// Between two pictures.
const FRAME: Duration = Duration::from_millis(33);
/// Between two looks at the newest messages: at 1 kHz it misses few.
const LISTEN: Duration = Duration::from_millis(2);

/// Why there is nothing to watch.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WatchError {
    /// The domain cannot be looked at.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// Nobody could see it.
    #[error(
        "the live view needs a terminal, and standard output or input is none; `sim-host run --record FILE` and `sim-host plot` need no terminal"
    )]
    NoTerminal,
    /// The terminal, or the system, refused.
    #[error("the terminal: {0}")]
    Terminal(#[from] io::Error),
}

/// Shows the domain of this name until the user leaves or a signal comes.
///
/// # Errors
/// [`WatchError`].
pub fn run(domain: &str) -> Result<(), WatchError> {
    let mut feed = Feed::begin(domain)?;
    if !(io::stdout().is_terminal() && io::stdin().is_terminal()) {
        return Err(WatchError::NoTerminal);
    }
    let stop = Stop::on_signals()?;
    // A panic restores the terminal too: that is what this sets up.
    let mut terminal = ratatui::try_init()?;
    let shown = show(&mut terminal, &mut feed, domain, &stop);
    let restored = ratatui::try_restore();
    shown?;
    // With the terminal closed there is nothing to restore.
    if stop.is_raised() || listen() == Listened::Gone { Ok(()) } else { Ok(restored?) }
}

fn show(
    terminal: &mut DefaultTerminal,
    feed: &mut Feed,
    domain: &str,
    stop: &Stop,
) -> io::Result<()> {
    let mut scene = Scene::new(domain);
    let mut drawn: Option<Instant> = None;
    while !stop.is_raised() {
        feed.bring(&mut scene);
        if drawn.is_none_or(|drawn| drawn.elapsed() >= FRAME) {
            drawn = Some(Instant::now());
            terminal.draw(|frame| view::draw(frame, &scene))?;
        }
        let listened = listen();
        if listened == Listened::Gone {
            return Ok(());
        }
        if listened == Listened::Key
            && event::poll(Duration::ZERO)?
            && let Event::Key(key) = event::read()?
            && let Some(action) = action(key)
        {
            match action {
                Action::Leave => return Ok(()),
                action => feed.order(request(action, &mut scene)),
            }
        }
    }
    Ok(())
}

/// What a wait for the keyboard came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Listened {
    Nothing,
    Key,
    /// The terminal is closed.
    Gone,
}

/// Waits for a key. A terminal that is closed also sends a hang-up, but under
/// `nohup` nobody hears it, and the library would read from it for ever.
fn listen() -> Listened {
    let input = io::stdin();
    let mut polled = [PollFd::new(&input, PollFlags::IN)];
    let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(LISTEN.subsec_nanos()) };
    // A signal that comes in between is no key.
    let _ = poll(&mut polled, Some(&timeout));
    let found = polled[0].revents();
    if found.intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL) {
        Listened::Gone
    } else if found.contains(PollFlags::IN) {
        Listened::Key
    } else {
        Listened::Nothing
    }
}

/// What an action asks of the leg.
fn request(action: Action, scene: &mut Scene) -> LegRequest {
    match action {
        Action::Leave => LegRequest::Status,
        Action::EndRun => LegRequest::Quit,
        Action::AsPlanned => LegRequest::SetPoint { m_s: None },
        Action::Pause if scene.leg.as_ref().is_some_and(|leg| leg.is_paused) => LegRequest::Resume,
        Action::Pause => LegRequest::Pause,
        Action::Faster(by_m_s) => {
            let ordered_m_s = scene.leg.as_ref().and_then(|leg| leg.ordered_m_s);
            let now_m_s = scene.sample.map_or(0.0, |sample| f64::from(sample.set_point_m_s));
            let m_s = round(ordered_m_s.unwrap_or(now_m_s) + by_m_s);
            // So that a second press counts from the first, however slow the answer is.
            if let Some(leg) = &mut scene.leg {
                leg.ordered_m_s = Some(m_s);
            }
            LegRequest::SetPoint { m_s: Some(m_s) }
        }
    }
}

/// To whole hundredths: ten tenths are 1.
fn round(m_s: f64) -> f64 {
    (100.0 * m_s).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_tenths_are_one() {
        let mut m_s = 0.0;
        (0..10).for_each(|_| m_s = round(m_s + 0.1));
        assert_eq!(m_s, 1.0);
    }
}
