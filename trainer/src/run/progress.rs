//! Progress output: a bar on a terminal, a line every ten seconds elsewhere.

use super::recent::RecentEpisodes;
use crate::train::Training;
use indicatif::{ProgressBar, ProgressStyle};
use leg_process::stderr;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Steps of the whole bar.
const BAR: f64 = 1000.0;
/// Time between two updates of the bar.
const TEXT_EVERY: Duration = Duration::from_millis(250);
/// Time between two lines.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Prints the progress of a training to the standard error.
pub struct Progress {
    shown: Shown,
    began: Instant,
    /// Completed share of the training when this process began.
    share: f64,
    last: Instant,
    /// Number of updates at `last`.
    updates: u64,
}

enum Shown {
    Bar(ProgressBar),
    Lines,
    Nothing,
}

impl Progress {
    /// Begins the output of this process. `quiet` suppresses it.
    #[must_use]
    pub fn new(training: &Training, quiet: bool) -> Self {
        let shown = if quiet {
            Shown::Nothing
        } else if std::io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {elapsed}{msg}");
            let style = style.expect("a valid template");
            Shown::Bar(ProgressBar::new(BAR as u64).with_style(style))
        } else {
            Shown::Lines
        };
        let now = Instant::now();
        let (share, updates) = (training.share_done(), training.total_updates());
        Self { shown, began: now, share, last: now, updates }
    }

    /// Reports an episode. Prints at most once in each period.
    pub fn report(&mut self, training: &Training, recent: &RecentEpisodes) {
        let every = match self.shown {
            Shown::Bar(_) => TEXT_EVERY,
            Shown::Lines => LINE_EVERY,
            Shown::Nothing => return,
        };
        let since = self.last.elapsed();
        if since < every {
            return;
        }
        let (share, updates) = (training.share_done(), training.total_updates());
        let speed = (updates - self.updates) as f64 / since.as_secs_f64();
        (self.last, self.updates) = (Instant::now(), updates);
        let done = share - self.share;
        let left = if done > 0.0 {
            let left = self.began.elapsed().as_secs_f64() * (1.0 - share) / done;
            format!("{left:.0} s to go")
        } else {
            "? s to go".into()
        };
        let best = training
            .selector()
            .and_then(|s| s.best())
            .map(|(_, score)| format!(", best cost {:.3} at step {}", score.cost, score.steps))
            .unwrap_or_default();
        let text = format!(
            "{left}, reward {:.2}, full {:.0} %, {speed:.0} updates/s{best}",
            recent.reward(),
            100.0 * recent.full()
        );
        match &self.shown {
            Shown::Bar(bar) => {
                bar.set_position((BAR * share) as u64);
                bar.set_message(format!(", {text}"));
            }
            Shown::Lines => {
                stderr::print_line(format_args!(
                    "step {}, {:.0} %, {text}",
                    training.total_steps(),
                    100.0 * share
                ));
            }
            Shown::Nothing => {}
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Shown::Bar(bar) = &self.shown {
            bar.finish_and_clear();
        }
    }
}
