//! Learning curves: from the logs of trainings to a picture.
//!
//! [`log`] reads what a training wrote, [`smooth`] turns the runs of a group into
//! one curve with its spread, [`picture`] draws the curves.

pub mod log;
pub mod picture;
pub mod smooth;

/// What the curves are drawn over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum By {
    /// Environment steps
    Steps,
    /// Episodes
    Episodes,
}

impl By {
    /// Its unit, as a word.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Steps => "steps",
            Self::Episodes => "episodes",
        }
    }
}

/// Where the curves' zero lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Zero {
    /// Where the training begins
    Start,
    /// Where its last stage begins: what came before lies to the left of zero
    LastStage,
}

/// A count with its thousands set apart, such as 12,000.
#[must_use]
pub fn grouped(count: f64) -> String {
    let digits = format!("{:.0}", count.abs());
    let mut text = String::from(if count <= -0.5 { "-" } else { "" });
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::grouped;

    #[test]
    fn thousands_are_set_apart() {
        let counts = [0.0, -0.0, 7.0, 999.0, 1_000.0, -15_000.0, 1_234_567.0];
        let texts = ["0", "0", "7", "999", "1,000", "-15,000", "1,234,567"];
        assert_eq!(counts.map(grouped), texts);
    }
}
