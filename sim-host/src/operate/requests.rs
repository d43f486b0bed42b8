//! JSON requests to the leg, and its status.

use std::sync::Arc;

use leg_control::guard::Limits;
use leg_host::json_socket::JsonSocket;
use leg_host::realtime::{LatestReport, LoopReport};
use leg_host::socket::SocketError;
use leg_host::{Domain, Role, TimeMode};
use serde::{Deserialize, Serialize};

use super::shared::{RunProgress, RunSettings, SocketSide};

/// A request to the leg. Each is answered by [`LegStatus`], or refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LegRequest {
    /// Requests the status.
    Status,
    /// Sets another set-point than the scenario's, from the next tick on.
    SetPoint {
        /// The speed, m/s; none returns to the scenario's.
        m_s: Option<f64>,
    },
    /// Pauses a run in lock-step.
    Pause,
    /// Resumes a paused run.
    Resume,
    /// Ends the run.
    Quit,
}

/// The status of a running leg.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LegStatus {
    /// Process id.
    pub pid: u32,
    /// Ticks a second.
    pub rate_hz: u32,
    /// Lock-step or real time.
    pub time_mode: TimeMode,
    /// Whether the run is paused.
    pub is_paused: bool,
    /// The set-point that replaces the scenario's, m/s.
    pub ordered_m_s: Option<f64>,
    /// Run id.
    pub run_id: u32,
    /// Sequence number of the last tick.
    pub seq: u64,
    /// Its time, s.
    pub t_s: f64,
    /// Horizontal position of the mass, m.
    pub x_m: f64,
    /// True density of the medium over that of water.
    pub density_ratio: f64,
    /// Ticks played.
    pub ticks: u64,
    /// Touchdowns.
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
    /// In real time: the statistics of the loop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<LoopReport>,
}

/// Opens the leg's socket in `domain`. `timing` gives the statistics of a real-time loop.
///
/// # Errors
/// [`SocketError`] when the socket cannot be bound.
pub(super) fn open(
    domain: &Arc<Domain>,
    mut side: SocketSide,
    rate_hz: u32,
    time_mode: TimeMode,
    timing: Option<LatestReport>,
) -> Result<JsonSocket, SocketError> {
    JsonSocket::open(domain, Role::Leg, move |request: LegRequest| {
        apply(&mut side, time_mode, &request)?;
        let report = timing.as_ref().map(LatestReport::get);
        Ok(status(side.settings(), side.progress(), rate_hz, time_mode, report))
    })
}

/// Changes the settings as requested, or returns why not.
fn apply(side: &mut SocketSide, time_mode: TimeMode, request: &LegRequest) -> Result<(), String> {
    let now = side.settings();
    let new = match *request {
        LegRequest::Status => return Ok(()),
        LegRequest::SetPoint { m_s } => {
            let limit = f64::from(Limits::default().max_speed_m_s);
            if let Some(m_s) = m_s
                && (m_s.is_nan() || m_s.abs() > limit)
            {
                return Err(format!("set-point {m_s} m/s: it must be from {} to {limit}", -limit));
            }
            RunSettings { set_point_m_s: m_s, ..now }
        }
        LegRequest::Pause if time_mode == TimeMode::RealTime => {
            return Err("a run in real time cannot be paused: its time does not wait".to_owned());
        }
        LegRequest::Pause => RunSettings { is_paused: true, ..now },
        LegRequest::Resume => RunSettings { is_paused: false, ..now },
        LegRequest::Quit => RunSettings { is_ended: true, ..now },
    };
    side.set(new);
    Ok(())
}

fn status(
    settings: RunSettings,
    progress: RunProgress,
    rate_hz: u32,
    time_mode: TimeMode,
    timing: Option<LoopReport>,
) -> LegStatus {
    let RunProgress {
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
    } = progress;
    LegStatus {
        pid: std::process::id(),
        rate_hz,
        time_mode,
        is_paused: settings.is_paused,
        ordered_m_s: settings.set_point_m_s,
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
        round_trips: round_trips.to_vec(),
        timing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operate::shared;

    #[test]
    fn requests_are_checked_and_change_the_settings() {
        let (mut loop_side, mut side) = shared::pair();
        let mut request = |time_mode, request: LegRequest| {
            apply(&mut side, time_mode, &request).map(|()| side.settings())
        };
        let set_point = |m_s| LegRequest::SetPoint { m_s };
        for bad in [50.5, f64::NAN, f64::NEG_INFINITY] {
            let refused = request(TimeMode::LockStep, set_point(Some(bad))).unwrap_err();
            assert!(refused.contains("-50 to 50") && refused.contains(&bad.to_string()));
        }
        let settings = request(TimeMode::LockStep, set_point(Some(-1.5))).unwrap();
        assert_eq!(settings.set_point_m_s, Some(-1.5));
        let settings = request(TimeMode::LockStep, set_point(None)).unwrap();
        assert_eq!(settings.set_point_m_s, None);
        let refused = request(TimeMode::RealTime, LegRequest::Pause).unwrap_err();
        assert!(refused.contains("real time"));
        assert!(request(TimeMode::LockStep, LegRequest::Pause).unwrap().is_paused);
        assert!(!request(TimeMode::LockStep, LegRequest::Resume).unwrap().is_paused);
        assert!(!loop_side.is_ended());
        request(TimeMode::LockStep, LegRequest::Quit).unwrap();
        assert!(loop_side.is_ended());
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
