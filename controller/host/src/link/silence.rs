//! Waiting for a message of a peer that lives, and reporting when it sends nothing.

use std::fmt;
use std::time::{Duration, Instant};

use super::{Link, LinkError, Role};

/// A silence of this length is reported.
const REPORT_AFTER: Duration = Duration::from_secs(1);

/// The silence of a connected peer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Silence {
    /// The silence so far.
    Lasts {
        /// Role of the peer.
        role: Role,
        /// Its length so far.
        time: Duration,
        /// Length at which the wait ends.
        timeout: Option<Duration>,
    },
    /// The silence is over.
    Over {
        /// Role of the peer.
        role: Role,
        /// Its length.
        time: Duration,
    },
}

impl fmt::Display for Silence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lasts { role, time, timeout } => {
                let s = time.as_secs_f64();
                write!(
                    f,
                    "the {role} is alive but has sent nothing for {s:.0} s; is it stopped? "
                )?;
                match timeout {
                    Some(timeout) => {
                        write!(f, "The run waits for up to {} s", timeout.as_secs_f64())
                    }
                    None => f.write_str("Still waiting"),
                }
            }
            Self::Over { role, time } => {
                write!(f, "the {role} sends again after {:.2} s", time.as_secs_f64())
            }
        }
    }
}

/// Receives the next message; `None` when none has arrived for `timeout`. `on_silence`
/// receives the beginning and the end of a silence that `timeout` permits.
///
/// # Errors
/// As [`Link::receive`].
pub fn receive_reporting_silence<L: Link>(
    link: &mut L,
    role: Role,
    timeout: Option<Duration>,
    mut on_silence: impl FnMut(&Silence),
) -> Result<Option<L::Receives>, LinkError> {
    let wait = timeout.unwrap_or(REPORT_AFTER).min(REPORT_AFTER);
    // The clock is read when the first wait is over: most messages arrive at once.
    if let Some(message) = link.receive(wait)? {
        return Ok(Some(message));
    }
    let since = Instant::now();
    if timeout.is_none_or(|timeout| timeout > wait) {
        on_silence(&Silence::Lasts { role, time: wait, timeout });
    }
    loop {
        let waited = wait + since.elapsed();
        let left = timeout.map_or(REPORT_AFTER, |timeout| timeout.saturating_sub(waited));
        if left.is_zero() {
            return Ok(None);
        }
        if let Some(message) = link.receive(left.min(REPORT_AFTER))? {
            on_silence(&Silence::Over { role, time: wait + since.elapsed() });
            return Ok(Some(message));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory;
    use leg_control::wire::Sample;

    #[test]
    fn a_silence_is_reported_when_it_begins_and_when_it_ends() {
        let (mut leg, mut controller) = memory::pair();
        let timeout = Duration::from_secs(30);
        let mut seen = Vec::new();
        let received = std::thread::scope(|scope| {
            scope.spawn(move || {
                std::thread::sleep(REPORT_AFTER * 3 / 2);
                leg.send(&Sample::default()).unwrap();
                leg
            });
            receive_reporting_silence(&mut controller, Role::Leg, Some(timeout), |s| seen.push(*s))
        });
        assert!(received.unwrap().is_some());
        let texts: Vec<_> = seen.iter().map(ToString::to_string).collect();
        assert_eq!(texts.len(), 2, "{texts:?}");
        assert!(texts[0].ends_with("for 1 s; is it stopped? The run waits for up to 30 s"));
        assert!(texts[1].starts_with("the simulator sends again after "), "{texts:?}");
    }

    #[test]
    fn a_short_timeout_ends_the_wait_without_a_report() {
        let (_leg, mut controller) = memory::pair();
        let short = Some(Duration::from_millis(5));
        let received =
            receive_reporting_silence(&mut controller, Role::Leg, short, |s| panic!("{s}"));
        assert_eq!(received.unwrap().map(|sample| sample.header), None);
    }
}
