//! What the user can do about an error: the command-line options of `controller` and
//! `sim-host` that help.
//!
//! The errors of the library name values and limits and no options, because a library
//! does not know the command line of its program.

use std::fmt::Display;

use leg_control::guard::SAFE_AFTER_NS;

use crate::discovery::DomainError;
use crate::json_socket::AskError;
use crate::law::STALE_LIMIT_MS;
use crate::link::{LinkError, Role, SessionParams, TimeMode};
use crate::reconnect::LinkEvent;
use crate::serial::ClientError;
use crate::serve::ServeError;
use crate::shm::{ConnectError, MissingPeer, Parameter, PeerEvent};

/// Joins a message and a hint, if there is one. After a question the hint is a sentence.
#[must_use]
pub fn with_hint(message: impl Display, hint: Option<String>) -> String {
    let message = message.to_string();
    let Some(hint) = hint else { return message };
    if !message.ends_with('?') {
        return format!("{message}; {hint}");
    }
    let mut rest = hint.chars();
    let first = rest.next().map(|first| first.to_uppercase().to_string()).unwrap_or_default();
    format!("{message} {first}{}", rest.as_str())
}

/// Returns the command that starts a process in `role`.
#[must_use]
pub fn start_command(role: Role) -> &'static str {
    match role {
        Role::Leg => "sim-host run",
        Role::Controller => "controller --policy FILE",
    }
}

/// Returns the hint on a peer that has not connected.
#[must_use]
pub fn missing_peer(missing: &MissingPeer) -> String {
    let MissingPeer { peer, domain, params, .. } = missing;
    let SessionParams { rate_hz, gravity_m_s2, time_mode, stale_limit_ns, .. } = *params;
    let real_time = if time_mode == Some(TimeMode::RealTime) { " --real-time" } else { "" };
    let stale_limit = if stale_limit_ns == SAFE_AFTER_NS {
        String::new()
    } else {
        format!(" --stale-limit {}", stale_limit_ns as f64 / 1e6)
    };
    format!(
        "start one with `{} --domain {domain} --rate {rate_hz} --gravity \
         {gravity_m_s2}{stale_limit}{real_time}`",
        start_command(*peer)
    )
}

/// Returns the hint on an error of connecting.
#[must_use]
pub fn connect_error(error: &ConnectError) -> Option<String> {
    match error {
        ConnectError::PeerMissing(missing) => {
            Some(format!("{}; --timeout sets how long to wait", missing_peer(missing)))
        }
        ConnectError::RoleTaken { .. } => {
            Some("end it, or choose another --domain for both sides".to_owned())
        }
        ConnectError::Disagreement { parameter, .. } => match parameter {
            Parameter::SessionVersion | Parameter::WireVersion => None,
            Parameter::Rate => Some("give both the same --rate".to_owned()),
            Parameter::Gravity => Some("give both the same --gravity".to_owned()),
            Parameter::TimeMode => Some("give --real-time to both sides, or to neither".to_owned()),
            Parameter::StaleLimit => Some("give both the same --stale-limit".to_owned()),
            Parameter::Estimator => Some(
                "give both the same --estimator and --estimator-noise, or the simulator none"
                    .to_owned(),
            ),
            Parameter::Channels => Some(
                "choose an --estimator that needs no more, or --sensors that have them".to_owned(),
            ),
        },
        ConnectError::Domain(error) => domain_error(error),
        _ => None,
    }
}

/// Returns the option of a setting of the control law.
#[must_use]
pub fn law_option(key: &str) -> &'static str {
    match key {
        STALE_LIMIT_MS => "--stale-limit",
        _ => "--estimator-noise",
    }
}

/// Returns the hint on an error of joining a domain.
#[must_use]
pub fn domain_error(error: &DomainError) -> Option<String> {
    matches!(error, DomainError::Busy { .. })
        .then(|| "end that process, or use another --domain".to_owned())
}

/// Returns the hint on an error of an established link.
#[must_use]
pub fn link_error(error: &LinkError) -> Option<String> {
    match error {
        LinkError::PeerDied { role, .. } => {
            Some(format!("start it again with `{}`", start_command(*role)))
        }
        LinkError::ReconnectTimeout { cause, .. } => {
            let timeout = "--timeout sets how long to wait";
            Some(match link_error(cause) {
                Some(hint) => format!("{hint}; {timeout}"),
                None => timeout.to_owned(),
            })
        }
        _ => None,
    }
}

/// Returns the hint on an error of the control loop in lock-step.
#[must_use]
pub fn serve_error(error: &ServeError) -> Option<String> {
    match error {
        ServeError::Link { cause, .. } => link_error(cause),
        ServeError::Silent { .. } => Some("--timeout sets how long to wait".to_owned()),
    }
}

/// Returns the hint on an error of a request to a running process.
#[must_use]
pub fn ask_error(error: &AskError) -> Option<String> {
    match error {
        AskError::Domain(cause) => domain_error(cause),
        AskError::Nobody { role, domain, .. } => Some(format!(
            "start one with `{} --domain {domain}`, or name another --domain",
            start_command(*role)
        )),
        _ => None,
    }
}

/// Returns the hint on an error of a request over a serial line.
#[must_use]
pub fn client_error(error: &ClientError) -> Option<String> {
    matches!(
        error,
        ClientError::Silent { is_serial_port: true, .. }
            | ClientError::Noise { is_serial_port: true, .. }
    )
    .then(|| "--baud sets the baud rate".to_owned())
}

/// Returns the message about an event of a reconnecting link, with its hint.
#[must_use]
pub fn link_event(event: &LinkEvent) -> String {
    let hint = match event {
        LinkEvent::Lost { cause, .. } => link_error(cause),
        LinkEvent::Rejected(error) => connect_error(error),
        _ => None,
    };
    with_hint(event, hint)
}

/// Returns the message about an event of the peer of a real-time loop, with its hint.
/// `None` for a new connection: the loop's statistics thread reports the first message.
#[must_use]
pub fn peer_event(event: &PeerEvent) -> Option<String> {
    match event {
        PeerEvent::Connected(_) => None,
        // The statistics thread reports whether its run was over.
        PeerEvent::Lost(LinkError::PeerLeft { role, pid }) => {
            Some(format!("the {role} (process {pid}) has left"))
        }
        PeerEvent::Lost(error) => Some(with_hint(error, link_error(error))),
        PeerEvent::Rejected(error) | PeerEvent::Failed(error) => {
            Some(with_hint(error, connect_error(error)))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::discovery::Whereabouts;

    #[test]
    fn the_hint_on_a_missing_peer_is_the_command_with_the_parameters_it_needs() {
        let missing = MissingPeer {
            peer: Role::Controller,
            domain: "d".to_owned(),
            waited: Duration::from_secs(1),
            params: SessionParams::at(500),
            failure: None,
            whereabouts: Whereabouts::default(),
        };
        let command =
            "start one with `controller --policy FILE --domain d --rate 500 --gravity 9.81";
        assert_eq!(missing_peer(&missing), format!("{command}`"));
        let params = missing.params.with_time_mode(TimeMode::RealTime);
        let missing = MissingPeer { params, ..missing };
        assert_eq!(missing_peer(&missing), format!("{command} --real-time`"));
        let hint = connect_error(&ConnectError::PeerMissing(Box::new(missing))).unwrap();
        assert!(hint.ends_with("; --timeout sets how long to wait"), "{hint}");
    }

    #[test]
    fn each_disagreement_names_the_option_that_must_be_equal() {
        let (peer, theirs, ours) = (Role::Leg, "1".to_owned(), "2".to_owned());
        for (parameter, option) in [
            (Parameter::Rate, "--rate"),
            (Parameter::Gravity, "--gravity"),
            (Parameter::TimeMode, "--real-time"),
        ] {
            let (theirs, ours) = (theirs.clone(), ours.clone());
            let error = ConnectError::Disagreement { peer, parameter, theirs, ours };
            assert!(connect_error(&error).unwrap().contains(option), "{error}");
        }
    }

    #[test]
    fn a_request_without_an_answer_gets_the_option_that_changes_that() {
        let nobody = AskError::Nobody {
            role: Role::Controller,
            domain: "d".to_owned(),
            whereabouts: Whereabouts::default(),
        };
        let hint = ask_error(&nobody).unwrap();
        assert!(hint.contains("`controller --policy FILE --domain d`"), "{hint}");
        for is_serial_port in [true, false] {
            let (waited, others) = (Duration::from_secs(1), Vec::new);
            for error in [
                ClientError::Silent { waited, others: others(), is_serial_port },
                ClientError::Noise { waited, others: others(), is_serial_port, bad: 2 },
            ] {
                let hint = client_error(&error);
                let message = with_hint(&error, hint);
                assert_eq!(message.contains("? --baud sets the"), is_serial_port, "{message}");
                assert_eq!(message.contains("baud rate right"), is_serial_port, "{message}");
            }
        }
    }

    #[test]
    fn a_hint_is_the_end_of_a_sentence_or_a_sentence_after_a_question() {
        let hint = || Some("end it".to_owned());
        assert_eq!(with_hint("it runs", hint()), "it runs; end it");
        assert_eq!(with_hint("does it run?", hint()), "does it run? End it");
        assert_eq!(with_hint("does it run?", None), "does it run?");
    }

    #[test]
    fn a_peer_that_does_not_return_gets_the_hints_on_its_death_and_on_the_timeout() {
        let cause = Box::new(LinkError::PeerDied { role: Role::Controller, pid: 7 });
        let hint = link_error(&LinkError::ReconnectTimeout { cause, waited_ms: 1000 }).unwrap();
        assert_eq!(
            hint,
            "start it again with `controller --policy FILE`; --timeout sets how long to wait"
        );
    }
}
