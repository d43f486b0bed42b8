//! JSON requests to the leg, and its status.

use std::sync::Arc;

use leg_control::guard::Limits;
use leg_host::json_socket::JsonSocket;
use leg_host::realtime::{LatestReport, LoopReport};
use leg_host::socket::SocketError;
use leg_host::{Domain, Role, TimeMode};
use serde::{Deserialize, Serialize};

use super::board::{Board, Seen};

/// A request to the leg. Each is answered by [`LegStatus`], or refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LegRequest {
    /// How it goes.
    Status,
    /// Another set-point than the scenario's, from the next tick on.
    SetPoint {
        /// The speed, m/s; none gives the word back to the scenario.
        m_s: Option<f64>,
    },
    /// Wait, in lock-step.
    Pause,
    /// Go on.
    Resume,
    /// End the run in good order.
    Quit,
}

/// How a leg is doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LegStatus {
    /// Its process.
    pub pid: u32,
    /// Ticks a second.
    pub rate_hz: u32,
    /// What sets the time.
    pub pace: TimeMode,
    /// Whether it waits because it was told to.
    pub is_paused: bool,
    /// The set-point by hand, m/s.
    pub ordered_m_s: Option<f64>,
    /// Number of the run.
    pub run_id: u32,
    /// The last tick played.
    pub seq: u64,
    /// Its time, s.
    pub t_s: f64,
    /// Place of the mass, m.
    pub x_m: f64,
    /// True density of the medium over that of water.
    pub density_ratio: f64,
    /// Ticks played.
    pub ticks: u64,
    /// Times that the foot came down.
    pub hops: u64,
    /// Falls.
    pub falls: u64,
    /// Ticks under a safe command.
    pub safe_ticks: u64,
    /// Ticks without a new command.
    pub held_ticks: u64,
    /// Samples rejected by the controller, by its last command.
    pub rejected: u32,
    /// Commands by how long they took; see [`super::BUCKETS`].
    pub round_trips: Vec<u32>,
    /// In real time: the loop's own figures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<LoopReport>,
}

/// Opens the leg's socket in `domain`, over what is on `board`. `timing` gives
/// the loop's own figures, when it has some.
///
/// # Errors
/// [`SocketError`].
pub(super) fn open(
    domain: &Arc<Domain>,
    board: &Arc<Board>,
    rate_hz: u32,
    pace: TimeMode,
    timing: Option<LatestReport>,
) -> Result<JsonSocket, SocketError> {
    let board = Arc::clone(board);
    JsonSocket::open(domain, Role::Leg, move |request: LegRequest| {
        obey(&board, pace, &request)?;
        Ok(status(&board, rate_hz, pace, timing.as_ref().map(LatestReport::get)))
    })
}

fn obey(board: &Board, pace: TimeMode, request: &LegRequest) -> Result<(), String> {
    match request {
        LegRequest::Status => (),
        LegRequest::SetPoint { m_s: None } => board.order(None),
        LegRequest::SetPoint { m_s: Some(m_s) } => {
            let limit = f64::from(Limits::default().max_speed_m_s);
            if m_s.is_nan() || m_s.abs() > limit {
                return Err(format!("set-point {m_s} m/s: it must be from {} to {limit}", -limit));
            }
            board.order(Some(*m_s));
        }
        LegRequest::Pause if pace == TimeMode::RealTime => {
            return Err("a run in real time cannot be paused: its time does not wait".to_owned());
        }
        LegRequest::Pause => board.pause(true),
        LegRequest::Resume => board.pause(false),
        LegRequest::Quit => board.end(),
    }
    Ok(())
}

fn status(board: &Board, rate_hz: u32, pace: TimeMode, timing: Option<LoopReport>) -> LegStatus {
    let Seen {
        run_id,
        seq,
        t_s,
        x_m,
        density_ratio,
        ticks,
        hops,
        falls,
        safe_ticks,
        held_ticks,
        rejected,
        round_trips,
    } = board.seen();
    LegStatus {
        pid: std::process::id(),
        rate_hz,
        pace,
        is_paused: board.is_paused(),
        ordered_m_s: board.ordered(),
        run_id,
        seq,
        t_s,
        x_m,
        density_ratio,
        ticks,
        hops,
        falls,
        safe_ticks,
        held_ticks,
        rejected,
        round_trips,
        timing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_checked_and_kept() {
        let board = Board::default();
        let order =
            |m_s| obey(&board, TimeMode::LockStep, &LegRequest::SetPoint { m_s: Some(m_s) });
        for bad in [50.5, f64::NAN, f64::NEG_INFINITY] {
            let refused = order(bad).unwrap_err();
            assert!(refused.contains("-50 to 50") && refused.contains(&bad.to_string()));
        }
        assert_eq!(board.ordered(), None);
        order(-1.5).unwrap();
        assert_eq!(board.ordered(), Some(-1.5));
        obey(&board, TimeMode::LockStep, &LegRequest::SetPoint { m_s: None }).unwrap();
        assert_eq!(board.ordered(), None);
        assert!(
            obey(&board, TimeMode::RealTime, &LegRequest::Pause).unwrap_err().contains("real time")
        );
        obey(&board, TimeMode::LockStep, &LegRequest::Pause).unwrap();
        assert!(status(&board, 1000, TimeMode::LockStep, None).is_paused);
        obey(&board, TimeMode::LockStep, &LegRequest::Resume).unwrap();
        obey(&board, TimeMode::LockStep, &LegRequest::Quit).unwrap();
        assert!(board.is_ended() && !board.is_paused());
    }

    #[test]
    fn requests_are_lines_of_json() {
        let read = |text: &str| serde_json::from_str::<LegRequest>(text);
        let request = read(r#"{"request":"set-point","m_s":0.5}"#).unwrap();
        assert_eq!(request, LegRequest::SetPoint { m_s: Some(0.5) });
        assert_eq!(read(r#"{"request":"pause"}"#).unwrap(), LegRequest::Pause);
        assert!(read(r#"{"request":"jump"}"#).is_err());
    }
}
