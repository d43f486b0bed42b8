//! Keyboard commands of the live view.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

/// A command by key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Action {
    /// Leave the view; the run continues.
    Leave,
    /// End the run.
    EndRun,
    /// Pause or resume the run.
    Pause,
    /// Change the set-point by this value, m/s.
    ChangeSetPoint(f64),
    /// Return to the scenario's set-point.
    ResetSetPoint,
}

/// The help line.
pub(super) const HELP: &str =
    "arrows: set-point (s: the scenario's)  space: pause  q: leave  Q: end the run";

/// Returns the action of a key, if it has one.
#[must_use]
pub(super) fn action(key: KeyEvent) -> Option<Action> {
    if key.kind == KeyEventKind::Release {
        return None;
    }
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    match key.code {
        KeyCode::Char('c' | 'd') if control => Some(Action::Leave),
        KeyCode::Char('q') | KeyCode::Esc => Some(Action::Leave),
        KeyCode::Char('Q') => Some(Action::EndRun),
        KeyCode::Char(' ') => Some(Action::Pause),
        KeyCode::Char('s') => Some(Action::ResetSetPoint),
        KeyCode::Up | KeyCode::Right => Some(Action::ChangeSetPoint(0.1)),
        KeyCode::Down | KeyCode::Left => Some(Action::ChangeSetPoint(-0.1)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lower_case_q_leaves_and_upper_case_q_ends_the_run() {
        let press = |code, modifiers| action(KeyEvent::new(code, modifiers));
        assert_eq!(press(KeyCode::Char('q'), KeyModifiers::NONE), Some(Action::Leave));
        assert_eq!(press(KeyCode::Char('Q'), KeyModifiers::SHIFT), Some(Action::EndRun));
        assert_eq!(press(KeyCode::Char('c'), KeyModifiers::CONTROL), Some(Action::Leave));
        assert_eq!(press(KeyCode::Char('c'), KeyModifiers::NONE), None);
        assert_eq!(press(KeyCode::Up, KeyModifiers::NONE), Some(Action::ChangeSetPoint(0.1)));
        let release =
            KeyEvent::new_with_kind(KeyCode::Char('q'), KeyModifiers::NONE, KeyEventKind::Release);
        assert_eq!(action(release), None);
    }
}
