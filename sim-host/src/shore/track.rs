//! The data of a run for the table and the picture.

use serde::Serialize;

/// A point of the mass's path, m.
pub type Point = (f64, f64);

/// Position of foot and mass at one time, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegPose {
    /// Position of the foot.
    pub foot: Point,
    /// Position of the mass.
    pub mass: Point,
}

/// What the controller knew of an apex when it decided on its action.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Decision {
    /// Horizontal velocity, m/s.
    pub vx_m_s: f64,
    /// Height, m.
    pub y_m: f64,
    /// Density ratio of the medium.
    pub density_ratio: f64,
}

/// An apex of the run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ApexMark {
    /// Time since the start, s.
    pub t_s: f64,
    /// Horizontal position, m.
    pub x_m: f64,
    /// Height, m.
    pub y_m: f64,
    /// Horizontal velocity, m/s.
    pub vx_m_s: f64,
    /// Set-point, m/s.
    pub set_point_m_s: f64,
    /// Density ratio of the medium.
    pub density_ratio: f64,
    /// The controller's decision for this apex; none while it has not been received.
    pub decision: Option<Decision>,
}

impl ApexMark {
    /// Returns the absolute error of the velocity against the set-point, m/s.
    #[must_use]
    pub fn error_m_s(&self) -> f64 {
        (self.vx_m_s - self.set_point_m_s).abs()
    }

    /// Returns the errors of what the controller knew: velocity, m/s, height, m, and density
    /// ratio.
    #[must_use]
    pub fn estimate_errors(&self) -> Option<[f64; 3]> {
        let decision = self.decision?;
        Some([
            decision.vx_m_s - self.vx_m_s,
            decision.y_m - self.y_m,
            decision.density_ratio - self.density_ratio,
        ])
    }
}

/// The path and the events of a run.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// Path of the mass.
    pub path: Vec<Point>,
    /// Horizontal velocity along the path: place, m, and velocity, m/s.
    pub velocity: Vec<Point>,
    /// Pose at each touchdown.
    pub touchdowns: Vec<LegPose>,
    /// Pose at each lift-off.
    pub liftoffs: Vec<LegPose>,
    /// All apexes.
    pub apexes: Vec<ApexMark>,
    /// Where the leg fell, if it did.
    pub fall: Option<Point>,
}
