//! The faults that there are, as one table: what is known, and what help says.

use std::fmt::Write as _;

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each has its row in the table, with its meaning")]
pub enum Kind {
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
    Lag,
    Saturate,
    Mass,
    Stiffness,
    Ground,
    Medium,
}

/// What is said of a kind.
pub(super) struct Row {
    kind: Kind,
    name: &'static str,
    value: &'static str,
    pub(super) keys: &'static [&'static str],
    acts: &'static str,
    about: &'static str,
}

const LINK: &str = "messages";
const SENSOR: &str = "samples";
const ACTUATOR: &str = "commands";
const WORLD: &str = "the leg's world";

const TABLE: [Row; 17] = [
    Row {
        kind: Kind::Drop,
        name: "drop",
        value: "share, 0 to 1",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "lost",
    },
    Row {
        kind: Kind::Delay,
        name: "delay",
        value: "ticks, 0 to 1000",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "arrive so much later",
    },
    Row {
        kind: Kind::Jitter,
        name: "jitter",
        value: "ticks, 0 to 1000",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "arrive up to so much later, each by a time of its own",
    },
    Row {
        kind: Kind::Duplicate,
        name: "duplicate",
        value: "share, 0 to 1",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "arrive again a tick later, in place of the one then",
    },
    Row {
        kind: Kind::Reorder,
        name: "reorder",
        value: "share, 0 to 1",
        keys: &["direction", "from", "until"],
        acts: LINK,
        about: "are overtaken: arrive two ticks later, after the next",
    },
    Row {
        kind: Kind::Corrupt,
        name: "corrupt",
        value: "share, 0 to 1",
        keys: &["bits", "direction", "from", "until"],
        acts: LINK,
        about: "have bits turned over anywhere (bits=1 to 64, default 1)",
    },
    Row {
        kind: Kind::Freeze,
        name: "freeze",
        value: "ticks, 1 to 1000000",
        keys: &["as", "chance", "direction", "from", "until"],
        acts: LINK,
        about: "for so long only the last one again (as=last) or none (as=nothing); begins at a tick by chance= (0 to 1, default 0.001)",
    },
    Row {
        kind: Kind::Noise,
        name: "noise",
        value: "m/s or m, 0 to 100",
        keys: &["field", "from", "until"],
        acts: SENSOR,
        about: "normal noise of this standard deviation; of field=contact the share turned over",
    },
    Row {
        kind: Kind::Bias,
        name: "bias",
        value: "m/s or m, -100 to 100",
        keys: &["field", "from", "until"],
        acts: SENSOR,
        about: "reads so much too high; field= must be said",
    },
    Row {
        kind: Kind::Stuck,
        name: "stuck",
        value: "ticks, 1 to 1000000",
        keys: &["chance", "field", "from", "until"],
        acts: SENSOR,
        about: "reads the same for so long; begins at a tick by chance= (0 to 1, default 0.001)",
    },
    Row {
        kind: Kind::Nan,
        name: "nan",
        value: "share, 0 to 1",
        keys: &["field", "from", "until"],
        acts: SENSOR,
        about: "reads no number",
    },
    Row {
        kind: Kind::Lag,
        name: "lag",
        value: "s, 0 to 10",
        keys: &["from", "until"],
        acts: ACTUATOR,
        about: "angle and elongation follow with this time constant",
    },
    Row {
        kind: Kind::Saturate,
        name: "saturate",
        value: "rad, rad/s or m/s, 0 to 1000",
        keys: &["field", "from", "until"],
        acts: ACTUATOR,
        about: "most of field=angle (rad from the vertical), angle-rate (rad/s) or elongation-rate (m/s)",
    },
    Row {
        kind: Kind::Mass,
        name: "mass",
        value: "factor, 0.1 to 10",
        keys: &[],
        acts: WORLD,
        about: "the leg weighs so many times what the controller is told",
    },
    Row {
        kind: Kind::Stiffness,
        name: "stiffness",
        value: "factor, 0.1 to 10",
        keys: &[],
        acts: WORLD,
        about: "its spring is so many times as stiff",
    },
    Row {
        kind: Kind::Ground,
        name: "ground",
        value: "steps, slope, sine or rough",
        keys: &["grade", "height", "length"],
        acts: WORLD,
        about: "uneven: height= of the highest over the lowest (0 to 10 m, default 0.05), length= of a wave or step (0.01 to 1000 m, default 1); slope: grade= (-1 to 1, default 0.05)",
    },
    Row {
        kind: Kind::Medium,
        name: "medium",
        value: "density ratio, 0 to 2",
        keys: &["at", "until"],
        acts: WORLD,
        about: "all at once this density, at= and until= a time (5s) or a place (12m)",
    },
];

impl Kind {
    pub(super) fn named(name: &str) -> Option<Self> {
        TABLE.iter().find(|row| row.name == name).map(|row| row.kind)
    }

    pub(super) fn row(self) -> &'static Row {
        // The table has a row for each, in the order of the variants; a test holds that.
        &TABLE[self as usize]
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// What is counted of it.
    #[must_use]
    pub fn counted(self) -> &'static str {
        match self {
            Self::Mass | Self::Stiffness | Self::Medium | Self::Freeze => "ticks",
            Self::Ground => "touchdowns above or below 0",
            Self::Noise | Self::Bias | Self::Stuck | Self::Nan => "samples",
            Self::Lag | Self::Saturate => "commands",
            _ => "messages",
        }
    }
}

/// The names of all kinds.
pub(super) fn names() -> String {
    TABLE.map(|row| row.name).join(", ")
}

/// The table, for people.
#[must_use]
pub fn help() -> String {
    let mut text = String::from(
        "Faults: --fault kind=value[,key=value…], as often as wanted, or in a scenario file\n\
         [[fault]] with the same names. They act in the order in which they are said.\n\n",
    );
    let mut last = "";
    for row in &TABLE {
        if row.acts != last {
            last = row.acts;
            let _ = writeln!(text, "on {last}");
        }
        let _ = writeln!(text, "  {:<10} {:<29} {}", row.name, row.value, row.about);
        if !row.keys.is_empty() {
            let _ = writeln!(text, "  {:<10} {:<29} keys: {}", "", "", row.keys.join(", "));
        }
    }
    text.push_str(
        "\nkeys\n\
         \x20 direction  samples, commands or both (default)\n\
         \x20 field      vx, y, vy, leg-length, density (if it is told), contact (noise and stuck), all\n\
         \x20            (default: the first four)\n\
         \x20 from, until  time since the start at which it begins and ends, s (5 or 5s)\n",
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_its_row() {
        for (i, row) in TABLE.iter().enumerate() {
            assert_eq!(row.kind as usize, i, "{}", row.name);
            assert_eq!(Kind::named(row.name), Some(row.kind));
            assert!(help().contains(row.name));
        }
    }
}
