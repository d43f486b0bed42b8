//! The control loop in lock-step: a command for every sample, until the leg ends its run.

use std::fmt;
use std::time::{Duration, Instant};

use super::link::Role;
use super::link::{ControllerLink, LinkError};
use leg_control::wire::{Command, Sample};

/// Why the control loop ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The link broke, or the leg is gone.
    #[error("after {ticks} ticks: {cause}")]
    Link {
        /// Samples answered until then.
        ticks: u64,
        /// The cause.
        cause: LinkError,
    },
    /// The leg lives but sends nothing.
    #[error(
        "after {ticks} ticks: the {role} lives but has sent nothing for {waited_s} s; is it stopped?",
        role = Role::Leg
    )]
    Silent {
        /// Samples answered until then.
        ticks: u64,
        /// Time waited, s.
        waited_s: f64,
    },
}

/// A silence of this length is reported.
const REPORT_AFTER: Duration = Duration::from_secs(1);

/// Answers every sample by `law`, until a sample
/// [ends the run](Sample::ends_the_run). Returns the number of samples answered.
///
/// # Errors
/// [`ServeError`] when the leg leaves before that, or is silent for `timeout`.
pub fn serve(
    link: &mut impl ControllerLink,
    timeout: Duration,
    law: impl FnMut(&Sample) -> Command,
) -> Result<u64, ServeError> {
    serve_reporting_silence(link, Some(timeout), law, |_| ())
}

/// As [`serve`]; without a `timeout`, waits for a silent leg as long as it lives. `on_silence`
/// receives the beginning and the end of a silence.
///
/// # Errors
/// As [`serve`].
pub fn serve_reporting_silence(
    link: &mut impl ControllerLink,
    timeout: Option<Duration>,
    mut law: impl FnMut(&Sample) -> Command,
    mut on_silence: impl FnMut(&Silence),
) -> Result<u64, ServeError> {
    let mut ticks = 0;
    loop {
        let sample = match next(link, timeout, ticks > 0, &mut on_silence) {
            Ok(Some(sample)) => sample,
            Ok(None) => {
                let waited_s = timeout.unwrap_or_default().as_secs_f64();
                return Err(ServeError::Silent { ticks, waited_s });
            }
            Err(cause) => return Err(ServeError::Link { ticks, cause }),
        };
        if sample.ends_the_run() {
            return Ok(ticks);
        }
        let command = law(&sample);
        link.send(&command).map_err(|cause| ServeError::Link { ticks, cause })?;
        ticks += 1;
    }
}

/// A silence of a leg that lives, in the middle of its run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Silence {
    /// The silence so far.
    Lasts(Duration),
    /// The silence is over; its length.
    Over(Duration),
}

impl fmt::Display for Silence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let role = Role::Leg;
        match self {
            Self::Lasts(time) => write!(
                f,
                "the {role} lives but has sent nothing for {:.0} s; is it stopped? Still waiting",
                time.as_secs_f64()
            ),
            Self::Over(time) => {
                write!(f, "the {role} goes on, after {:.2} s", time.as_secs_f64())
            }
        }
    }
}

/// Returns the next sample; `None` when none has arrived for `timeout`.
fn next(
    link: &mut impl ControllerLink,
    timeout: Option<Duration>,
    is_in_run: bool,
    on_silence: &mut impl FnMut(&Silence),
) -> Result<Option<Sample>, LinkError> {
    let wait = timeout.unwrap_or(REPORT_AFTER).min(REPORT_AFTER);
    // The clock is read when the first wait is over: most samples arrive at once.
    if let Some(sample) = link.receive(wait)? {
        return Ok(Some(sample));
    }
    let since = Instant::now();
    if is_in_run && timeout.is_none_or(|timeout| timeout > wait) {
        on_silence(&Silence::Lasts(wait));
    }
    loop {
        let waited = wait + since.elapsed();
        let left = timeout.map_or(REPORT_AFTER, |timeout| timeout.saturating_sub(waited));
        if left.is_zero() {
            return Ok(None);
        }
        if let Some(sample) = link.receive(left.min(REPORT_AFTER))? {
            if is_in_run {
                on_silence(&Silence::Over(wait + since.elapsed()));
            }
            return Ok(Some(sample));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::link::Link;
    use super::super::memory;
    use super::*;
    use leg_control::wire::{Header, flags};

    fn sample(seq: u64, flags: u16) -> Sample {
        Sample { header: Header { flags, seq, ..Header::default() }, ..Sample::default() }
    }

    fn echo(sample: &Sample) -> Command {
        Command { header: sample.header, ..Command::default() }
    }

    #[test]
    fn answers_until_the_end_is_announced() {
        let (mut leg, mut controller) = memory::pair();
        let timeout = Duration::from_secs(10);
        let served = std::thread::scope(|scope| {
            let serving = scope.spawn(move || serve(&mut controller, timeout, echo));
            for seq in 0..10 {
                leg.send(&sample(seq, 0)).unwrap();
                assert_eq!(leg.receive(timeout).unwrap().unwrap().header.seq, seq);
            }
            leg.send(&sample(10, flags::END)).unwrap();
            serving.join().unwrap()
        });
        assert_eq!(served.unwrap(), 10);
    }

    #[test]
    fn a_leg_that_leaves_or_falls_silent_is_an_error() {
        let (leg, mut controller) = memory::pair();
        let silent = serve(&mut controller, Duration::from_millis(5), echo);
        assert!(matches!(silent, Err(ServeError::Silent { ticks: 0, .. })));
        drop(leg);
        let left = serve(&mut controller, Duration::from_secs(10), echo);
        assert!(matches!(left, Err(ServeError::Link { cause: LinkError::PeerLeft { .. }, .. })));
    }
}
