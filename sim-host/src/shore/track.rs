//! What a run leaves behind, as far as a table and a picture want it.

use serde::Serialize;

/// A point of the mass's path, m.
pub type Point = (f64, f64);

/// The leg at a moment: from its foot to its mass, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegPose {
    /// Where the foot is.
    pub foot: Point,
    /// Where the mass is.
    pub mass: Point,
}

/// An apex of the run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ApexMark {
    /// Time since the start, s.
    pub t_s: f64,
    /// Place, m.
    pub x_m: f64,
    /// Height, m.
    pub y_m: f64,
    /// Horizontal velocity, m/s.
    pub vx_m_s: f64,
    /// The velocity asked for, m/s.
    pub set_point_m_s: f64,
    /// The medium's density ratio.
    pub density_ratio: f64,
    /// The density ratio that the controller went by.
    pub density_estimate: f64,
}

impl ApexMark {
    /// How far the velocity is from the set-point, m/s.
    #[must_use]
    pub fn error_m_s(&self) -> f64 {
        (self.vx_m_s - self.set_point_m_s).abs()
    }

    /// How far the density estimate is from the truth.
    #[must_use]
    pub fn density_error(&self) -> f64 {
        (self.density_estimate - self.density_ratio).abs()
    }
}

/// The course of a run.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// The mass's path.
    pub path: Vec<Point>,
    /// The leg at each touchdown.
    pub touchdowns: Vec<LegPose>,
    /// The leg at each lift-off.
    pub liftoffs: Vec<LegPose>,
    /// Every apex.
    pub apexes: Vec<ApexMark>,
    /// Where the leg fell, if it did.
    pub fall: Option<Point>,
}
