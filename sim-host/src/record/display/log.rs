//! What happens in a run, as text.

use foxglove::messages::Log;
use foxglove::messages::log::Level;

use super::shapes::timestamp;
use super::topic::DisplayTopic;
use crate::record::pipe::FrameBuffer;
use crate::record::schema::{Apex, End, OBSERVED_END, Policy, SetPoint};

/// Whose entries they are.
pub(super) const RUN: &str = "run";
pub(super) const LEG: &str = "leg";
pub(super) const CONTROLLER: &str = "controller";

/// Adds an entry to the log.
pub(super) fn add(
    frames: &mut FrameBuffer,
    time_ns: u64,
    level: Level,
    name: &str,
    message: String,
) {
    let (timestamp, name) = (timestamp(time_ns), name.to_owned());
    let entry = Log { timestamp, level: level.into(), message, name, ..Log::default() };
    frames.add_display(DisplayTopic::Log, time_ns, &entry);
}

/// Adds a decision of the controller, or that it made none, to the log.
pub(in crate::record) fn apex(apex: &Apex, time_ns: u64, frames: &mut FrameBuffer) {
    let Apex { x_m, y_m, vx_m_s, set_point_m_s, .. } = apex;
    let seen = format!("apex at {x_m:.2} m, {y_m:.3} m high, {vx_m_s:.3} m/s");
    if !apex.answered {
        let text = format!("{seen}: no decision");
        return add(frames, time_ns, Level::Warning, CONTROLLER, text);
    }
    let text = format!(
        "{seen}: decides for {set_point_m_s} m/s with an offset of {:.3} m/s, density {:.3}",
        apex.velocity_offset_m_s, apex.density_estimate
    );
    add(frames, time_ns, Level::Info, CONTROLLER, text);
}

/// Adds a fall to the log.
pub(in crate::record) fn fall(time_ns: u64, frames: &mut FrameBuffer) {
    add(frames, time_ns, Level::Error, LEG, "falls".to_owned());
}

/// Adds a policy to the log.
pub(in crate::record) fn policy(policy: &Policy, time_ns: u64, frames: &mut FrameBuffer) {
    let text = format!("receives the policy {} ({:08x})", policy.name, policy.crc32);
    add(frames, time_ns, Level::Info, CONTROLLER, text);
}

/// Adds the set-point of a request to the log.
pub(in crate::record) fn set_point(set_point: SetPoint, time_ns: u64, frames: &mut FrameBuffer) {
    let text = if set_point.is_set {
        format!("receives the set-point {} m/s", set_point.set_point_m_s)
    } else {
        "takes the set-point of the samples again".to_owned()
    };
    add(frames, time_ns, Level::Info, CONTROLLER, text);
}

/// Adds the end of the run to the log.
pub(in crate::record) fn end(end: &End, time_ns: u64, frames: &mut FrameBuffer) {
    let is_good = ["duration", "distance", "stopped", OBSERVED_END].contains(&&*end.ending);
    let level = if is_good { Level::Info } else { Level::Error };
    add(frames, time_ns, level, RUN, format!("ends after {} ticks: {}", end.ticks, end.ending));
}
