//! The control loop in lock-step: a command for every sample, until the leg
//! says that its run is over.

use std::time::Duration;

use super::card::Role;
use super::link::{ControllerLink, LinkError};
use crate::wire::{Command, Sample, flags};

/// Why the control loop ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The link is broken, or the leg gone.
    #[error("after {ticks} ticks: {cause}")]
    Link {
        /// Samples answered until then.
        ticks: u64,
        /// What happened.
        cause: LinkError,
    },
    /// The leg is there, but sends nothing.
    #[error(
        "after {ticks} ticks: the {role} lives but has sent nothing for {waited_s} s; is it stopped? --timeout sets the patience",
        role = Role::Leg
    )]
    Silent {
        /// Samples answered until then.
        ticks: u64,
        /// How long, s.
        waited_s: f64,
    },
}

/// Answers every sample by `law`, until a sample with [`flags::END`]. Returns
/// how many it answered.
///
/// # Errors
/// [`ServeError`] when the leg goes without that, or is silent for `timeout`.
pub fn serve(
    link: &mut impl ControllerLink,
    timeout: Duration,
    mut law: impl FnMut(&Sample) -> Command,
) -> Result<u64, ServeError> {
    let mut ticks = 0;
    loop {
        let sample = match link.receive(timeout) {
            Ok(Some(sample)) => sample,
            Ok(None) => return Err(ServeError::Silent { ticks, waited_s: timeout.as_secs_f64() }),
            Err(cause) => return Err(ServeError::Link { ticks, cause }),
        };
        if sample.header.flags & flags::END != 0 {
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
    use crate::wire::Header;

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
