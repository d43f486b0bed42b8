//! What the keys do.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

/// What a key asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Action {
    /// Leave; the run goes on.
    Leave,
    /// End the run.
    EndRun,
    /// Pause, or go on.
    Pause,
    /// Change the set-point by so much, m/s.
    Faster(f64),
    /// The scenario's own set-point again.
    AsPlanned,
}

/// What is said of the keys.
pub(super) const HELP: &str =
    "arrows: set-point  s: scenario's own  space: pause  q: leave  Q: end the run";

/// What a key asks for, if anything.
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
        KeyCode::Char('s') => Some(Action::AsPlanned),
        KeyCode::Up | KeyCode::Right => Some(Action::Faster(0.1)),
        KeyCode::Down | KeyCode::Left => Some(Action::Faster(-0.1)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_q_leaves_and_a_great_one_ends_the_run() {
        let press = |code, modifiers| action(KeyEvent::new(code, modifiers));
        assert_eq!(press(KeyCode::Char('q'), KeyModifiers::NONE), Some(Action::Leave));
        assert_eq!(press(KeyCode::Char('Q'), KeyModifiers::SHIFT), Some(Action::EndRun));
        assert_eq!(press(KeyCode::Char('c'), KeyModifiers::CONTROL), Some(Action::Leave));
        assert_eq!(press(KeyCode::Char('c'), KeyModifiers::NONE), None);
        assert_eq!(press(KeyCode::Up, KeyModifiers::NONE), Some(Action::Faster(0.1)));
        let release =
            KeyEvent::new_with_kind(KeyCode::Char('q'), KeyModifiers::NONE, KeyEventKind::Release);
        assert_eq!(action(release), None);
    }
}
