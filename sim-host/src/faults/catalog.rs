//! The table of all kinds of fault, with the help text.

use std::fmt::Write as _;

/// A kind of fault, by the name that users type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the table describes each kind")]
pub enum FaultKind {
    Drop,
    Delay,
    Jitter,
    Duplicate,
    Reorder,
    Corrupt,
    Freeze,
    Noise,
    Bias,
    Stuck,
    Nan,
    Dead,
    Switch,
    Lag,
    Saturate,
    Bandwidth,
    DeadTime,
    Backlash,
    Mass,
    Stiffness,
    Drag,
    Gravity,
    Damping,
    FootMass,
    Friction,
    DriveForce,
    Ground,
    Medium,
}

/// Description of a kind for the help text, and its keys.
pub(super) struct KindInfo {
    kind: FaultKind,
    name: &'static str,
    value: &'static str,
    pub(super) keys: &'static [&'static str],
    acts: &'static str,
    about: &'static str,
}

const LINK: &str = "messages";
const SENSOR: &str = "samples";
const ACTUATOR: &str = "commands";
const WORLD: &str = "the leg, the ground and the medium";

const TABLE: [KindInfo; 28] = [
    KindInfo {
        kind: FaultKind::Drop,
        name: "drop",
        value: "share, 0 to 1",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "share of the messages that is lost",
    },
    KindInfo {
        kind: FaultKind::Delay,
        name: "delay",
        value: "ticks, 0 to 1000",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "delay of every message",
    },
    KindInfo {
        kind: FaultKind::Jitter,
        name: "jitter",
        value: "ticks, 0 to 1000",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "largest random delay of a message, drawn for each",
    },
    KindInfo {
        kind: FaultKind::Duplicate,
        name: "duplicate",
        value: "share, 0 to 1",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "share that arrives a second time a tick later, in place of that tick's message",
    },
    KindInfo {
        kind: FaultKind::Reorder,
        name: "reorder",
        value: "share, 0 to 1",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "share that arrives two ticks late, after the next message",
    },
    KindInfo {
        kind: FaultKind::Corrupt,
        name: "corrupt",
        value: "share, 0 to 1",
        keys: &["bits", "direction", "from", "until"],
        acts: LINK,
        about: "share that has bits inverted; bits= sets how many (1 to 64, default 1)",
    },
    KindInfo {
        kind: FaultKind::Freeze,
        name: "freeze",
        value: "ticks, 1 to 1000000",
        keys: &["as", "chance", "direction", "from", "until"],
        acts: LINK,
        about: "duration in which the last message repeats (as=last, the default) or none arrives (as=nothing); chance= is the probability that a tick starts a freeze (0 to 1, default 0.001)",
    },
    KindInfo {
        kind: FaultKind::Noise,
        name: "noise",
        value: "unit of the field, 0 to 100",
        keys: &["as", "correlation", "field", "from", "until"],
        acts: SENSOR,
        about: "standard deviation of normal noise; as=uniform: largest deviation of uniform noise; correlation= is the time over which normal noise keeps 37 % of itself (0 to 10 s, default 0); with field=contact, the share of inverted readings",
    },
    KindInfo {
        kind: FaultKind::Bias,
        name: "bias",
        value: "unit of the field, -100 to 100",
        keys: &["field", "from", "until"],
        acts: SENSOR,
        about: "constant added to the reading; field= is required",
    },
    KindInfo {
        kind: FaultKind::Stuck,
        name: "stuck",
        value: "ticks, 1 to 1000000",
        keys: &["chance", "field", "from", "until"],
        acts: SENSOR,
        about: "duration in which the reading does not change; chance= is the probability that a tick starts it (0 to 1, default 0.001)",
    },
    KindInfo {
        kind: FaultKind::Nan,
        name: "nan",
        value: "share, 0 to 1",
        keys: &["field", "from", "until"],
        acts: SENSOR,
        about: "share of the samples whose reading is NaN",
    },
    KindInfo {
        kind: FaultKind::Dead,
        name: "dead",
        value: "a field",
        keys: &["at", "until"],
        acts: SENSOR,
        about: "samples no longer have this reading, as of a sensor that is dead; at= and until= are times (5s)",
    },
    KindInfo {
        kind: FaultKind::Switch,
        name: "switch",
        value: "closed or open",
        keys: &["at", "until"],
        acts: SENSOR,
        about: "the contact switch sticks; at= and until= are times (5s)",
    },
    KindInfo {
        kind: FaultKind::Lag,
        name: "lag",
        value: "s, 0 to 10",
        keys: &["from", "until"],
        acts: ACTUATOR,
        about: "time constant with which angle and elongation follow the command",
    },
    KindInfo {
        kind: FaultKind::Saturate,
        name: "saturate",
        value: "rad, rad/s or m/s, 0 to 1000",
        keys: &["field", "from", "until"],
        acts: ACTUATOR,
        about: "limit of field=angle (rad from the vertical), angle-rate (rad/s) or elongation-rate (m/s); field= is required",
    },
    KindInfo {
        kind: FaultKind::Bandwidth,
        name: "bandwidth",
        value: "Hz, 0.1 to 1000",
        keys: &["from", "until"],
        acts: ACTUATOR,
        about: "frequency up to which angle and elongation follow the command, as a critically damped second-order lag with 3 dB less amplitude there",
    },
    KindInfo {
        kind: FaultKind::DeadTime,
        name: "dead-time",
        value: "ms, 0 to 1000",
        keys: &["from", "until"],
        acts: ACTUATOR,
        about: "time after which angle and elongation react to a command, rounded up to whole ticks; a command does not count as late by it",
    },
    KindInfo {
        kind: FaultKind::Backlash,
        name: "backlash",
        value: "rad or m, 0 to 1",
        keys: &["field", "from", "until"],
        acts: ACTUATOR,
        about: "gap that the drive of field=angle (the default, rad) or elongation (m) crosses before the leg follows it",
    },
    KindInfo {
        kind: FaultKind::Mass,
        name: "mass",
        value: "factor, 0.1 to 10",
        keys: &[],
        acts: WORLD,
        about: "mass of the leg over the mass that the controller is configured for",
    },
    KindInfo {
        kind: FaultKind::Stiffness,
        name: "stiffness",
        value: "factor, 0.1 to 10",
        keys: &[],
        acts: WORLD,
        about: "stiffness of the spring over the stiffness that the controller is configured for",
    },
    KindInfo {
        kind: FaultKind::Drag,
        name: "drag",
        value: "factor, 0 to 10",
        keys: &[],
        acts: WORLD,
        about: "drag coefficients over those that the controller is configured for",
    },
    KindInfo {
        kind: FaultKind::Gravity,
        name: "gravity",
        value: "factor, 0.5 to 2",
        keys: &[],
        acts: WORLD,
        about: "gravity over the one that the controller is configured for",
    },
    KindInfo {
        kind: FaultKind::Damping,
        name: "damping",
        value: "N s/m, 0 to 1000",
        keys: &[],
        acts: WORLD,
        about: "damping of the spring along the leg; the controller is configured for none",
    },
    KindInfo {
        kind: FaultKind::FootMass,
        name: "foot-mass",
        value: "kg, 0 or 0.001 to 10",
        keys: &[],
        acts: WORLD,
        about: "mass of the foot, whose momentum is lost at touchdown and taken from the body at lift-off",
    },
    KindInfo {
        kind: FaultKind::Friction,
        name: "friction",
        value: "coefficient, 0.05 to 2",
        keys: &[],
        acts: WORLD,
        about: "largest horizontal force of the ground over the vertical one, beyond which the foot slips; one without foot-mass then loses its load at once",
    },
    KindInfo {
        kind: FaultKind::DriveForce,
        name: "drive-force",
        value: "N, 0 to 100000",
        keys: &[],
        acts: WORLD,
        about: "force of the spring above which the drive of the elongation stands still",
    },
    KindInfo {
        kind: FaultKind::Ground,
        name: "ground",
        value: "steps, slope, sine or rough",
        keys: &["grade", "height", "length"],
        acts: WORLD,
        about: "uneven ground; height= is the largest difference in height (0 to 10 m, default 0.05), length= the length of a wave or step (0.01 to 1000 m, default 1); a slope has grade= instead (-1 to 1, default 0.05)",
    },
    KindInfo {
        kind: FaultKind::Medium,
        name: "medium",
        value: "density ratio, 0 to 2",
        keys: &["at", "until"],
        acts: WORLD,
        about: "sudden change to this density; at= and until= are a time (5s) or a place (12m)",
    },
];

impl FaultKind {
    pub(super) fn named(name: &str) -> Option<Self> {
        TABLE.iter().find(|row| row.name == name).map(|row| row.kind)
    }

    pub(super) fn info(self) -> &'static KindInfo {
        // The table lists the kinds in the order of the variants, as a test checks.
        &TABLE[self as usize]
    }

    /// Returns the name that users type.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.info().name
    }

    /// Returns the noun for the things that [`FaultCount`](super::FaultCount) counts.
    #[must_use]
    pub fn counted(self) -> &'static str {
        match self {
            Self::Mass
            | Self::Stiffness
            | Self::Drag
            | Self::Gravity
            | Self::Damping
            | Self::FootMass
            | Self::Friction
            | Self::DriveForce
            | Self::Medium
            | Self::Freeze => "ticks",
            Self::Ground => "touchdowns above or below 0",
            Self::Noise | Self::Bias | Self::Stuck | Self::Nan | Self::Dead | Self::Switch => {
                "samples"
            }
            Self::Lag | Self::Saturate | Self::Bandwidth | Self::DeadTime | Self::Backlash => {
                "commands"
            }
            _ => "messages",
        }
    }
}

/// Lists the names of all kinds.
pub(super) fn names() -> String {
    TABLE.map(|row| row.name).join(", ")
}

/// Returns the table as help text.
#[must_use]
pub fn help() -> String {
    let mut text = String::from(
        "Usage: --fault KIND=VALUE[,KEY=VALUE...]; repeat it for several faults. In a scenario file,\n\
         write one [[fault]] table per fault with the same names. Faults of sensors\n\
         act on a sample before it is sent, those of messages on its way; otherwise they act in\n\
         the order given.\n\n",
    );
    let mut last = "";
    for row in &TABLE {
        if row.acts != last {
            last = row.acts;
            let _ = writeln!(text, "Faults of {last}:");
        }
        let mut lines = wrap(row.about, ABOUT_WIDTH);
        if !row.keys.is_empty() {
            lines.push(format!("keys: {}", row.keys.join(", ")));
        }
        for (i, line) in lines.iter().enumerate() {
            let (name, value) = if i == 0 { (row.name, row.value) } else { ("", "") };
            let _ = writeln!(text, "  {name:<11} {value:<28} {line}");
        }
    }
    text.push_str(
        "\nkeys\n\
         \x20 direction    samples, commands or both (default)\n\
         \x20 field        vx, y, vy (m/s and m), leg-length, height (m), leg-angle, pitch (rad),\n\
         \x20              pitch-rate (rad/s), acceleration (m/s2), velocity (m/s), pressure (Pa; its\n\
         \x20              values may be 10000 times as large), density or contact (noise, stuck and\n\
         \x20              dead only), each if the run has that sensor; or all (default: the first\n\
         \x20              four)\n\
         \x20 from, until  time at which the fault begins and ends, s from the start (5 or 5s)\n",
    );
    text
}

/// Width of the description column of the help text, characters.
const ABOUT_WIDTH: usize = 57;

/// Breaks a text between words into lines of at most `width` characters.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().expect("there is a first line");
        if line.is_empty() {
            line.push_str(word);
        } else if line.len() + 1 + word.len() <= width {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_is_in_the_table_in_its_order() {
        for (i, row) in TABLE.iter().enumerate() {
            assert_eq!(row.kind as usize, i, "{}", row.name);
            assert_eq!(FaultKind::named(row.name), Some(row.kind));
            assert!(help().contains(row.name));
        }
        assert!(help().lines().all(|line| line.len() <= 100), "{}", help());
    }
}
