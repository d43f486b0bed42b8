//! The control loop in lock-step: a command for every sample, until the leg ends its run.

use std::time::Duration;

use super::link::{ControllerLink, LinkError, Role, Silence, receive_reporting_silence};
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
        "after {ticks} ticks: the {role} is alive but has sent nothing for {waited_s} s; is it stopped?",
        role = Role::Leg
    )]
    Silent {
        /// Samples answered until then.
        ticks: u64,
        /// Time waited, s.
        waited_s: f64,
    },
}

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
        let report = |silence: &Silence| {
            if ticks > 0 {
                on_silence(silence);
            }
        };
        let sample = match receive_reporting_silence(link, Role::Leg, timeout, report) {
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
