//! Quantities that change during a run: the medium's density and the set-point.

use serde::{Deserialize, Serialize};

/// A quantity over x: linear between its points, constant beyond them.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Profile(Vec<[f64; 2]>);

impl Profile {
    /// Creates a profile through `points`, each an x in m and a value.
    ///
    /// # Errors
    /// A message if there is no point, a number is not finite, or x does not
    /// increase.
    pub fn new(points: Vec<[f64; 2]>) -> Result<Self, String> {
        if points.is_empty() {
            return Err("it must have at least one point [x, value]".to_owned());
        }
        if let Some(point) = points.iter().find(|point| !point.iter().all(|n| n.is_finite())) {
            return Err(format!("{point:?} must be two finite numbers"));
        }
        if let Some(pair) = points.windows(2).find(|pair| pair[0][0] >= pair[1][0]) {
            return Err(format!("x must increase, but {} follows {}", pair[1][0], pair[0][0]));
        }
        Ok(Self(points))
    }

    /// Creates a profile with the same value everywhere.
    #[must_use]
    pub fn constant(value: f64) -> Self {
        Self(vec![[0.0, value]])
    }

    /// Returns the value at `x`.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        let after = self.0.partition_point(|point| point[0] <= x);
        match (after.checked_sub(1).and_then(|i| self.0.get(i)), self.0.get(after)) {
            (Some([x0, v0]), Some([x1, v1])) => v0 + (v1 - v0) * ((x - x0) / (x1 - x0)),
            (Some([_, value]), None) | (None, Some([_, value])) => *value,
            (None, None) => unreachable!("a profile has at least one point"),
        }
    }

    /// Returns the lowest and the highest value.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        self.0.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [_, value]| {
            [low.min(*value), high.max(*value)]
        })
    }

    /// Returns the points.
    #[must_use]
    pub fn points(&self) -> &[[f64; 2]] {
        &self.0
    }
}

/// A change of the set-point at a time or a place. Exactly one of the two is given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetPointStep {
    /// Time of the change, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_t_s: Option<f64>,
    /// Place of the change, m; it takes effect when the leg first passes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_x_m: Option<f64>,
    /// The new set-point, m/s.
    pub m_s: f64,
}

/// The set-points of a run.
///
/// Each step takes effect once, in order, when the run reaches its time or place.
/// A leg that moves back over a place does not undo the step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetPoints {
    /// Set-point at the start, m/s.
    pub start_m_s: f64,
    /// Later changes.
    pub steps: Vec<SetPointStep>,
}

/// Position of a run in its [`SetPoints`].
#[derive(Clone, Debug)]
pub struct SetPointCursor<'a> {
    steps: &'a [SetPointStep],
    now_m_s: f64,
    start_x_m: f64,
}

impl SetPoints {
    /// Returns the cursor for a run that starts at `x_m`.
    #[must_use]
    pub fn begin(&self, x_m: f64) -> SetPointCursor<'_> {
        SetPointCursor { steps: &self.steps, now_m_s: self.start_m_s, start_x_m: x_m }
    }
}

impl SetPointCursor<'_> {
    /// Advances to a time and place and returns the set-point, m/s.
    pub fn at(&mut self, t_s: f64, x_m: f64) -> f64 {
        while let Some((step, rest)) = self.steps.split_first() {
            let reached = match (step.from_t_s, step.from_x_m) {
                (Some(from), _) => t_s >= from,
                // Passed in the direction away from the start.
                (None, Some(from)) if from >= self.start_x_m => x_m >= from,
                (None, Some(from)) => x_m <= from,
                (None, None) => true,
            };
            if !reached {
                break;
            }
            self.now_m_s = step.m_s;
            self.steps = rest;
        }
        self.now_m_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_is_linear_between_its_points() {
        let shore = Profile::new(vec![[15.0, 1.0], [30.0, 0.0]]).unwrap();
        for (x, want) in [(-1e9, 1.0), (15.0, 1.0), (22.5, 0.5), (30.0, 0.0), (1e9, 0.0)] {
            assert_eq!(shore.at(x), want, "at {x}");
        }
        assert_eq!(shore.range(), [0.0, 1.0]);
        assert_eq!(Profile::constant(0.3).at(-7.0), 0.3);
    }

    #[test]
    fn rejects_a_profile_without_increasing_finite_points() {
        assert!(Profile::new(vec![]).is_err());
        assert!(Profile::new(vec![[0.0, f64::NAN]]).is_err());
        assert!(Profile::new(vec![[1.0, 0.0], [1.0, 1.0]]).is_err());
    }

    #[test]
    fn set_points_change_once_at_their_time_or_place() {
        let by_place = |x, m_s| SetPointStep { from_t_s: None, from_x_m: Some(x), m_s };
        let by_time = |t, m_s| SetPointStep { from_t_s: Some(t), from_x_m: None, m_s };
        let points =
            SetPoints { start_m_s: 0.5, steps: vec![by_place(30.0, 1.0), by_time(9.0, -1.0)] };
        let mut cursor = points.begin(0.0);
        assert_eq!(cursor.at(0.0, 0.0), 0.5);
        assert_eq!(cursor.at(1.0, 30.5), 1.0);
        assert_eq!(cursor.at(2.0, 29.0), 1.0, "swinging back changes nothing");
        assert_eq!(cursor.at(9.0, 29.0), -1.0);

        let backwards = SetPoints { start_m_s: -0.5, steps: vec![by_place(-3.0, 0.0)] };
        let mut cursor = backwards.begin(0.0);
        assert_eq!(cursor.at(0.0, 0.0), -0.5);
        assert_eq!(cursor.at(1.0, -3.5), 0.0);
    }
}
