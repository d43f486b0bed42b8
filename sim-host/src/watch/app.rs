//! Runs the view in a terminal: reads keys, draws frames, restores the terminal.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use leg_host::shm::ConnectError;
use leg_process::Stop;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event};
use ratatui::widgets::Clear;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::feed::Feed;
use super::keys::{Action, action};
use super::scene::Scene;
use super::view;
use crate::operate::LegRequest;

/// Time between two frames.
const FRAME_INTERVAL: Duration = Duration::from_millis(33);
/// Time between two polls of the newest messages; at 1 kHz few are missed.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// Why the view cannot be shown.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WatchError {
    /// The domain's name is invalid, or its services cannot be opened.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// Standard input or output is not a terminal.
    #[error("the live view needs a terminal, but standard input or output is not one")]
    NoTerminal,
    /// The terminal cannot place text.
    #[error(
        "the live view draws over the screen, which the terminal `{0}` (TERM) cannot; use another \
         terminal, such as TERM=xterm-256color where it is one"
    )]
    PlainTerminal(String),
    /// Reading from or drawing to the terminal failed.
    #[error("the terminal failed: {0}")]
    Terminal(#[from] io::Error),
}

/// Values of TERM for terminals that print line by line.
const PLAIN_TERMINALS: [&str; 2] = ["dumb", "unknown"];

/// Shows `domain` until the user leaves or a signal arrives.
///
/// # Errors
/// [`WatchError`].
pub fn run(domain: &str) -> Result<(), WatchError> {
    let mut feed = Feed::begin(domain)?;
    if !(io::stdout().is_terminal() && io::stdin().is_terminal()) {
        return Err(WatchError::NoTerminal);
    }
    // Without TERM a terminal may still be able to, as crossterm writes the usual sequences.
    if let Ok(term) = std::env::var("TERM")
        && PLAIN_TERMINALS.contains(&term.as_str())
    {
        return Err(WatchError::PlainTerminal(term));
    }
    let stop = Stop::on_signals()?;
    // Also installs a panic hook that restores the terminal.
    let mut terminal = ratatui::try_init()?;
    let shown = show(&mut terminal, &mut feed, domain, &stop);
    let restored = ratatui::try_restore();
    shown?;
    // A closed terminal cannot be restored.
    if stop.is_raised() || wait_for_key() == Input::Closed { Ok(()) } else { Ok(restored?) }
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
        feed.update(&mut scene);
        if drawn.is_none_or(|drawn| drawn.elapsed() >= FRAME_INTERVAL) {
            drawn = Some(Instant::now());
            // After a run all is drawn anew. (`terminal.clear` would ask the terminal for its
            // cursor, which not every one answers.)
            if scene.take_cleared() {
                terminal.draw(|frame| frame.render_widget(Clear, frame.area()))?;
            }
            terminal.draw(|frame| view::draw(frame, &scene))?;
        }
        let input = wait_for_key();
        if input == Input::Closed {
            return Ok(());
        }
        if input == Input::Key
            && event::poll(Duration::ZERO)?
            && let Event::Key(key) = event::read()?
            && let Some(action) = action(key)
        {
            match action {
                Action::Leave => return Ok(()),
                action => feed.send(request(action, &mut scene)),
            }
        }
    }
    Ok(())
}

/// Result of waiting for a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Input {
    None,
    Key,
    /// The terminal is closed.
    Closed,
}

/// Waits for a key. A closed terminal also sends SIGHUP, but under `nohup` that is
/// ignored, and crossterm would then read from the terminal for ever.
fn wait_for_key() -> Input {
    let stdin = io::stdin();
    let mut polled = [PollFd::new(&stdin, PollFlags::IN)];
    let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(POLL_INTERVAL.subsec_nanos()) };
    // An interruption by a signal counts as no key.
    let _ = poll(&mut polled, Some(&timeout));
    let found = polled[0].revents();
    if found.intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL) {
        Input::Closed
    } else if found.contains(PollFlags::IN) {
        Input::Key
    } else {
        Input::None
    }
}

/// Returns the request to the leg for an action.
fn request(action: Action, scene: &mut Scene) -> LegRequest {
    match action {
        Action::Leave => LegRequest::Status,
        Action::EndRun => LegRequest::Quit,
        Action::ResetSetPoint => LegRequest::SetPoint { m_s: None },
        Action::Pause if scene.leg.as_ref().is_some_and(|leg| leg.is_paused) => LegRequest::Resume,
        Action::Pause => LegRequest::Pause,
        Action::ChangeSetPoint(by_m_s) => {
            let ordered_m_s = scene.leg.as_ref().and_then(|leg| leg.ordered_m_s);
            let now_m_s = scene.sample.map_or(0.0, |sample| f64::from(sample.set_point_m_s));
            let m_s = round(ordered_m_s.unwrap_or(now_m_s) + by_m_s);
            // Stored at once, so that a second press before the answer adds to the first.
            if let Some(leg) = &mut scene.leg {
                leg.ordered_m_s = Some(m_s);
            }
            LegRequest::SetPoint { m_s: Some(m_s) }
        }
    }
}

/// Rounds to hundredths, so that ten steps of 0.1 give 1.
fn round(m_s: f64) -> f64 {
    (100.0 * m_s).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_steps_of_a_tenth_give_one() {
        let mut m_s = 0.0;
        (0..10).for_each(|_| m_s = round(m_s + 0.1));
        assert_eq!(m_s, 1.0);
    }
}
