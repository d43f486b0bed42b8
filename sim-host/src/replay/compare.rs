//! Compares two commands, or two estimates, field by field.

use leg_control::wire::{Command, Header};
use serde::Serialize;

use crate::record::schema::Estimate;

/// A field in which two commands, or two estimates, differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Tick of the sample that both answer.
    pub tick: u64,
    /// Name of the field on the wire or in the recording.
    pub field: &'static str,
    /// Value and bits in the recording.
    pub recorded: Value,
    /// Value and bits in the replay.
    pub replayed: Value,
}

/// The value of a field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Value {
    /// The value in decimal.
    pub value: String,
    /// The bits in hexadecimal.
    pub bits: String,
}

impl From<f32> for Value {
    fn from(value: f32) -> Self {
        Self { value: value.to_string(), bits: format!("{:08x}", value.to_bits()) }
    }
}

impl From<u32> for Value {
    fn from(value: u32) -> Self {
        Self { value: value.to_string(), bits: format!("{value:08x}") }
    }
}

impl From<u64> for Value {
    fn from(value: u64) -> Self {
        Self { value: value.to_string(), bits: format!("{value:016x}") }
    }
}

/// Returns the first field whose bits differ.
#[must_use]
pub fn difference(recorded: &Command, replayed: &Command) -> Option<Difference> {
    first_difference(recorded.header.seq, fields(recorded), fields(replayed))
}

/// Returns the first field of two estimates at a tick whose bits differ.
pub(super) fn estimate_difference(recorded: &Estimate, replayed: &Estimate) -> Option<Difference> {
    first_difference(recorded.seq, estimate_fields(recorded), estimate_fields(replayed))
}

fn first_difference<const N: usize>(
    tick: u64,
    recorded: [(&'static str, Field); N],
    replayed: [(&'static str, Field); N],
) -> Option<Difference> {
    recorded
        .into_iter()
        .zip(replayed)
        .find(|((_, recorded), (_, replayed))| recorded.bits() != replayed.bits())
        .map(|((field, recorded), (_, replayed))| Difference {
            tick,
            field,
            recorded: recorded.value(),
            replayed: replayed.value(),
        })
}

#[derive(Clone, Copy)]
enum Field {
    F32(f32),
    U32(u32),
    U64(u64),
}

impl Field {
    fn bits(self) -> u64 {
        match self {
            Self::F32(value) => value.to_bits().into(),
            Self::U32(value) => value.into(),
            Self::U64(value) => value,
        }
    }

    fn value(self) -> Value {
        match self {
            Self::F32(value) => value.into(),
            Self::U32(value) => value.into(),
            Self::U64(value) => value.into(),
        }
    }
}

fn fields(command: &Command) -> [(&'static str, Field); 15] {
    use Field::{F32, U32, U64};
    // Destructured, so that the compiler reports a new field.
    let Command {
        header: Header { version, flags, run_id, seq, t_ns },
        leg_angle_rad,
        elongation_m,
        elongation_rate_m_s,
        apex_vx_m_s,
        apex_y_m,
        density_ratio,
        velocity_offset_m_s,
        apexes,
        rejected,
        set_points_refused,
    } = *command;
    [
        ("version", U32(version.into())),
        ("flags", U32(flags.into())),
        ("run_id", U32(run_id)),
        ("seq", U64(seq)),
        ("t_ns", U64(t_ns)),
        ("leg_angle_rad", F32(leg_angle_rad)),
        ("elongation_m", F32(elongation_m)),
        ("elongation_rate_m_s", F32(elongation_rate_m_s)),
        ("apex_vx_m_s", F32(apex_vx_m_s)),
        ("apex_y_m", F32(apex_y_m)),
        ("density_ratio", F32(density_ratio)),
        ("velocity_offset_m_s", F32(velocity_offset_m_s)),
        ("apexes", U32(apexes)),
        ("rejected", U32(rejected)),
        ("set_points_refused", U32(set_points_refused)),
    ]
}

fn estimate_fields(estimate: &Estimate) -> [(&'static str, Field); 12] {
    use Field::{F32, U32, U64};
    let Estimate {
        seq,
        t_ns,
        in_stance,
        vx_m_s,
        y_m,
        vy_m_s,
        density_ratio,
        vx_variance_m2_s2,
        y_variance_m2,
        vy_variance_m2_s2,
        density_variance,
        innovation,
    } = *estimate;
    [
        ("seq", U64(seq)),
        ("t_ns", U64(t_ns)),
        ("in_stance", U32(in_stance.into())),
        ("vx_m_s", F32(vx_m_s)),
        ("y_m", F32(y_m)),
        ("vy_m_s", F32(vy_m_s)),
        ("density_ratio", F32(density_ratio)),
        ("vx_variance_m2_s2", F32(vx_variance_m2_s2)),
        ("y_variance_m2", F32(y_variance_m2)),
        ("vy_variance_m2_s2", F32(vy_variance_m2_s2)),
        ("density_variance", F32(density_variance)),
        ("innovation", F32(innovation)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn returns_the_first_field_that_differs_in_a_bit() {
        let command = Command { elongation_m: 0.25, ..Command::default() };
        assert_eq!(difference(&command, &command), None);
        let negative = Command { apex_y_m: -0.0, ..command };
        let found = difference(&command, &negative).unwrap();
        assert_eq!((found.field, &*found.replayed.bits), ("apex_y_m", "80000000"));
        let next = f32::from_bits(0.25_f32.to_bits() + 1);
        let both = Command { elongation_m: next, apexes: 1, ..negative };
        let found = difference(&command, &both).unwrap();
        assert_eq!(found.field, "elongation_m");
        assert_eq!((&*found.recorded.bits, &*found.replayed.bits), ("3e800000", "3e800001"));
        let nan = Command { elongation_m: f32::from_bits(0x7fc0_0001), ..command };
        assert_eq!(difference(&nan, &nan), None, "equal NaNs have equal bits");
    }
}
