//! What the user can do about an error: the command-line options that help.

use std::path::Path;

use leg_host::LinkError;
use leg_host::cli::hint::{
    self, ask_error, client_error, connect_error, domain_error, link_error, serve_error,
};
use leg_host::discovery::DomainError;
use leg_host::json_socket::AskError;
use leg_host::shm::ConnectError;
use leg_process::stderr;

use crate::bridge::BridgeError;
use crate::record::RecordError;
use crate::record::read::ReadError;
use crate::session::SessionError;
use crate::session::two_processes::PlayError;

/// Formats an error with its causes and, if there is one, the hint.
pub(super) fn with_hint(error: &anyhow::Error) -> String {
    hint::with_hint(leg_process::chain(error.as_ref()), hint_on(error))
}

fn hint_on(error: &anyhow::Error) -> Option<String> {
    if let Some(error) = error.downcast_ref::<PlayError>() {
        return match error {
            PlayError::Connect(cause) => connect_error(cause),
            PlayError::Session(cause) => session_error(cause),
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref::<BridgeError>() {
        return match error {
            BridgeError::Connect(cause) => connect_error(cause),
            BridgeError::Client(cause) => client_error(cause),
            BridgeError::Link(cause) => link_error(cause),
            BridgeError::Simulator(cause) => serve_error(cause),
            BridgeError::NoAnswer { .. } | BridgeError::NotBack { .. } => {
                Some("--timeout sets how long to wait".to_owned())
            }
            BridgeError::Unplugged(_) => {
                Some("--on-unplug reconnect waits for the line".to_owned())
            }
            BridgeError::RequestMux(_) => Some("--share names the socket".to_owned()),
            _ => None,
        };
    }
    if let Some(RecordError::BrokeOff { file, is_complete: false, .. }) = error.downcast_ref() {
        return Some(recover(file));
    }
    None.or_else(|| error.downcast_ref::<ConnectError>().and_then(connect_error))
        .or_else(|| error.downcast_ref::<DomainError>().and_then(domain_error))
        .or_else(|| error.downcast_ref::<LinkError>().and_then(link_error))
        .or_else(|| error.downcast_ref::<SessionError>().and_then(session_error))
        .or_else(|| error.downcast_ref::<AskError>().and_then(ask_error))
}

fn session_error(error: &SessionError) -> Option<String> {
    match error {
        SessionError::Link { cause, .. } => link_error(cause),
        SessionError::NoAnswer { .. } => Some("--timeout changes the time to wait".to_owned()),
    }
}

/// Returns what completes a file that was cut off.
fn recover(file: &Path) -> String {
    let output = if file.extension().is_some_and(|end| end == "part") { "" } else { " -o OUTPUT" };
    format!("`sim-host recover {}{output}` makes a complete recording of it", file.display())
}

/// Prints the warnings about a recording, and what to do about one that was cut off.
pub(super) fn print_warnings<'a>(
    recording: &Path,
    warnings: impl IntoIterator<Item = &'a String>,
    is_complete: bool,
) {
    for warning in warnings {
        stderr::print_line(format_args!("sim-host: warning: {warning}"));
    }
    if !is_complete {
        stderr::print_line(format_args!("sim-host: {}", recover(recording)));
    }
}

/// Returns what to do about a file that is not a recording.
pub(super) fn read_error(error: &ReadError) -> Option<String> {
    match error {
        ReadError::NotOurs { .. } => Some("`sim-host run --record FILE` makes one".to_owned()),
        _ => None,
    }
}
