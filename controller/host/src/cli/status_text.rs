//! The status of a controller, in words and as JSON.

use std::fmt;
use std::time::UNIX_EPOCH;

use serde_json::{Value, json};

use crate::TimeMode;
use crate::serial::{DeviceIdentity, PolicyIdentity};
use crate::status::Status;
use leg_control::serial::PROTOCOL_VERSION;
use leg_control::serial::message::{self, Activity, RunTick, Slot, SlotReport};

/// Returns the status of a board as JSON, and in words.
pub(super) fn board(
    identity: &DeviceIdentity,
    message::Status { run, line, device }: &message::Status,
    slots: &[SlotReport<'_>; 2],
) -> (Value, String) {
    let all = || Slot::ALL.into_iter().zip(slots);
    let mut json = identity_json(identity);
    json["gravity_m_s2"] = digits(identity.gravity_m_s2).into();
    json["activity"] = json!(run.activity);
    json["last"] = json!(run.last);
    json["pending"] = run.pending.map(|slot| slot.to_string()).into();
    json["ticks"] = (run.counts.ticks - run.counts.missed).into();
    json["apexes"] = run.apexes.into();
    json["swaps"] = run.counts.swaps.into();
    json["rejected"] = json!(run.rejected);
    json["counts"] = json!(run.counts);
    json["line"] = json!(line);
    json["device"] = json!(device);
    json["slots"] = all().map(|(slot, report)| slot_json(slot, report)).collect();
    let activity = match run.activity {
        Activity::Waiting => "waits for samples",
        Activity::Safe => "in its safe state",
        Activity::Running => "runs",
    };
    let last = run.last.map_or_else(|| "none".to_owned(), |at| Tick(at).to_string());
    let r = &run.rejected;
    let mut text = format!(
        "{}\nstate     {activity}\nticks     {}, missed {}; the last {last}; apexes {}\n\
         rejected  {}, of these missing {}, stale {}; safe state entered {} times\n\
         line      {} frames, {} damaged, {} bytes lost; stack {} of {} bytes",
        identity_text(identity),
        run.counts.ticks,
        run.counts.missed,
        run.apexes,
        r.ticks,
        r.missing,
        r.stale,
        r.safe_entered,
        line.frames,
        line.crc_errors + line.malformed + line.oversize + line.version,
        device.lost_bytes,
        device.stack_used,
        device.stack_size,
    );
    for (slot, report) in all() {
        text.push('\n');
        text.push_str(&slot_text(slot, report));
    }
    if let Some(slot) = run.pending {
        text.push_str("\nnext      slot ");
        text.push_str(&slot.to_string());
        text.push_str(", at the next apex");
    }
    (json, text)
}

/// A tick in words.
pub(super) struct Tick(pub(super) RunTick);

impl fmt::Display for Tick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "tick {} of run {}", self.0.seq, self.0.run_id)
    }
}

/// The status of a process, in lines.
pub(super) struct Table<'a>(pub(super) &'a Status);

impl fmt::Display for Table<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = self.0;
        let time_mode =
            if s.time_mode == TimeMode::RealTime { "in real time" } else { "in lock-step" };
        writeln!(
            f,
            "controller  process {}, {} Hz {time_mode}, {} m/s2",
            s.pid, s.rate_hz, s.gravity_m_s2
        )?;
        let activity = match s.activity {
            Activity::Waiting => "waits for a leg",
            Activity::Safe => "in its safe state",
            Activity::Running => "runs",
        };
        let peer = s.peer.pid.map_or_else(String::new, |pid| format!(", process {pid}"));
        writeln!(
            f,
            "state       {activity}{peer}; {} legs have connected, {} of them are gone",
            s.peer.connections, s.peer.losses
        )?;
        let p = &s.policy;
        writeln!(f, "policy      {} ({}), from {}", p.name, p.crc32, p.file)?;
        writeln!(f, "            {}", p.provenance)?;
        let ago_s = UNIX_EPOCH.elapsed().unwrap_or_default().as_secs_f64() - s.since_unix_s;
        write!(f, "in force    for {ago_s:.1} s")?;
        match s.since {
            Some(at) => writeln!(f, ", since {}; swaps {}", Tick(at), s.swaps)?,
            None => writeln!(f, ", in no tick yet; swaps {}", s.swaps)?,
        }
        if let Some(next) = &s.pending {
            writeln!(f, "next        {} ({}), at the next apex", next.name, next.crc32)?;
        }
        if let Some(last) = s.last {
            let ticks = s.ticks;
            writeln!(f, "ticks       {ticks}, the last {}; apexes {}", Tick(last), s.apexes)?;
        }
        let r = &s.rejected;
        writeln!(
            f,
            "rejected    {}, of these missing {}, stale {}; safe state entered {} times",
            r.ticks, r.missing, r.stale, r.safe_entered
        )?;
        if let Some(set_point_m_s) = s.set_point_m_s {
            writeln!(f, "set-point   {set_point_m_s} m/s, in place of that of the samples")?;
        }
        if let Some(report) = &s.timing {
            writeln!(f, "loop        {}", report.line())?;
        }
        Ok(())
    }
}

/// Returns a checksum as eight hexadecimal digits.
pub(super) fn hex(value: u32) -> String {
    format!("{value:08x}")
}

/// Returns the number with the fewest digits that is this float.
pub(super) fn digits(value: f32) -> Option<f64> {
    value.to_string().parse().ok()
}

/// Returns the identity of a controller as JSON.
pub(super) fn identity_json(identity: &DeviceIdentity) -> Value {
    let policy = identity.policy.as_ref().map(|PolicyIdentity { slot, name, crc32, leg }| {
        json!({ "slot": slot.to_string(), "name": name, "crc32": hex(*crc32), "leg": hex(*leg) })
    });
    json!({
        "board": identity.board,
        "firmware": identity.firmware,
        "protocol_version": PROTOCOL_VERSION,
        "wire_version": identity.wire_version,
        "session": identity.session,
        "mode": identity.mode.to_string(),
        "rate_hz": identity.rate_hz,
        "gravity_m_s2": digits(identity.gravity_m_s2),
        "policy": policy,
    })
}

/// Returns the identity of a controller in words.
pub(super) fn identity_text(identity: &DeviceIdentity) -> String {
    let policy = identity.policy.as_ref().map_or_else(
        || "none; the leg stays in the safe command".into(),
        |PolicyIdentity { slot, name, crc32, .. }| {
            format!("{name} ({}) in slot {}", hex(*crc32), slot)
        },
    );
    let session = identity.session.map_or_else(|| "none since power-up".into(), hex);
    format!(
        "board     {}, firmware {} (protocol {PROTOCOL_VERSION}, messages {})\n\
         policy    {policy}\n\
         run       {}, {} Hz, {} m/s2; session {session}",
        identity.board,
        identity.firmware,
        identity.wire_version,
        identity.mode,
        identity.rate_hz,
        identity.gravity_m_s2,
    )
}

/// Returns the content of a slot as JSON.
pub(super) fn slot_json(name: Slot, slot: &SlotReport<'_>) -> Value {
    let mut json = json!({
        "slot": name.to_string(),
        "sequence": slot.sequence,
        "running": slot.running,
    });
    match slot.content {
        Ok((policy, crc32)) => {
            json["name"] = policy.into();
            json["crc32"] = hex(crc32).into();
        }
        Err(fault) => json["fault"] = fault.to_string().into(),
    }
    json
}

/// Returns the content of a slot in words.
pub(super) fn slot_text(name: Slot, slot: &SlotReport<'_>) -> String {
    let content = match slot.content {
        Ok((policy, crc32)) => format!("{policy} ({})", hex(crc32)),
        Err(fault) => fault.to_string(),
    };
    let runs = if slot.running { ", runs" } else { "" };
    format!("slot {}    {content}, sequence {}{runs}", name, slot.sequence)
}
