//! The columns of a log: their names, and what their cells may hold.

use std::fmt::Write as _;

/// A column of a log; its cells are empty where nothing was sensed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Column {
    /// Time of the reading.
    Time,
    /// Set-point.
    SetPoint,
    /// Horizontal velocity, as a state channel.
    Vx,
    /// Height, as a state channel.
    Y,
    /// Vertical velocity, as a state channel.
    Vy,
    /// Contact reading.
    Contact,
    /// Length of the leg.
    LegLength,
    /// Angle of the leg.
    LegAngle,
    /// Specific force along the body's x axis.
    ForceX,
    /// Specific force along the body's y axis.
    ForceY,
    /// Sum of the specific force along the body's x axis.
    ImpulseX,
    /// Sum of the specific force along the body's y axis.
    ImpulseY,
    /// Orientation of the body.
    Pitch,
    /// Rate of the orientation.
    PitchRate,
    /// Horizontal velocity of a slow sensor.
    VelocityX,
    /// Vertical velocity of a slow sensor.
    VelocityY,
    /// Age of these velocities.
    VelocityAge,
    /// Height of a slow sensor.
    Height,
    /// Age of this height.
    HeightAge,
    /// Pressure.
    Pressure,
    /// Age of the pressure.
    PressureAge,
    /// Density ratio, where it is measured.
    Density,
    /// Angle at which the leg is held in flight.
    HeldAngle,
    /// Elongation of the spring.
    Elongation,
    /// True horizontal velocity.
    TrueVx,
    /// True height.
    TrueY,
    /// True vertical velocity.
    TrueVy,
    /// True density ratio.
    TrueDensity,
    /// Whether the foot truly is on the ground.
    TrueContact,
}

/// What a cell may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    /// A time, s, to the nanosecond.
    Time,
    /// A number that the law takes in 32 bits.
    Single,
    /// A number in 64 bits.
    Double,
    /// Yes or no.
    Truth,
    /// A time from the reading to that of the row.
    Age,
}

/// Name, content and description of each column, in the order of [`Column`].
const TABLE: [(Column, &str, Content, &str); 29] = {
    use Content::{Age, Double, Single, Time, Truth};
    [
        (Column::Time, "time_s", Time, "time of the readings, s; it rises (required)"),
        (Column::SetPoint, "set_point_m_s", Single, "velocity set-point, m/s; holds on"),
        (Column::Vx, "vx_m_s", Single, "horizontal velocity, m/s, read at every tick"),
        (Column::Y, "y_m", Single, "height of the mass above the ground, m, read at every tick"),
        (Column::Vy, "vy_m_s", Single, "vertical velocity, m/s, up, read at every tick"),
        (Column::Contact, "contact", Truth, "foot on the ground: 1 or 0, true or false"),
        (Column::LegLength, "leg_length_m", Single, "length from foot to mass, m"),
        (
            Column::LegAngle,
            "leg_angle_rad",
            Single,
            "angle of the leg from the body's +x axis, rad",
        ),
        (
            Column::ForceX,
            "specific_force_x_m_s2",
            Double,
            "accelerometer along the body's x axis (forward), m/s2",
        ),
        (
            Column::ForceY,
            "specific_force_y_m_s2",
            Double,
            "the same along its y axis (up): +9.81 at rest",
        ),
        (
            Column::ImpulseX,
            "specific_impulse_x_m_s",
            Double,
            "sum of the specific force along x since any instant, m/s",
        ),
        (Column::ImpulseY, "specific_impulse_y_m_s", Double, "the same along y"),
        (
            Column::Pitch,
            "pitch_rad",
            Single,
            "orientation, rad, positive where the body leans back",
        ),
        (Column::PitchRate, "pitch_rate_rad_s", Single, "its rate, by a gyroscope, rad/s"),
        (
            Column::VelocityX,
            "velocity_x_m_s",
            Single,
            "horizontal velocity of a slow sensor, such as a Doppler log, m/s",
        ),
        (Column::VelocityY, "velocity_y_m_s", Single, "its vertical velocity, m/s"),
        (Column::VelocityAge, "velocity_age_s", Age, "age of these at time_s, s (0)"),
        (Column::Height, "height_m", Single, "height of a slow sensor, such as an echo sounder, m"),
        (Column::HeightAge, "height_age_s", Age, "its age at time_s, s (0)"),
        (Column::Pressure, "pressure_pa", Single, "pressure of the fluid, Pa"),
        (Column::PressureAge, "pressure_age_s", Age, "its age at time_s, s (0)"),
        (Column::Density, "density_ratio", Single, "density over that of water, if it is measured"),
        (
            Column::HeldAngle,
            "held_angle_rad",
            Single,
            "angle from +x at which the leg is held in flight, rad, if another controller moves it",
        ),
        (
            Column::Elongation,
            "elongation_m",
            Single,
            "extension of the spring's rest length, m, as measured or as another controller asks",
        ),
        (Column::TrueVx, "true_vx_m_s", Double, "true horizontal velocity, m/s, to compare with"),
        (Column::TrueY, "true_y_m", Double, "true height above the ground, m"),
        (Column::TrueVy, "true_vy_m_s", Double, "true vertical velocity, m/s"),
        (Column::TrueDensity, "true_density_ratio", Double, "true density ratio"),
        (Column::TrueContact, "true_contact", Truth, "true contact: 1 or 0"),
    ]
};

/// Number of columns.
pub(super) const COLUMNS: usize = TABLE.len();

impl Column {
    /// Returns all columns.
    pub fn all() -> impl Iterator<Item = Self> {
        TABLE.into_iter().map(|row| row.0)
    }

    /// Returns the column of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        TABLE.into_iter().find(|row| row.1 == name).map(|row| row.0)
    }

    /// Returns the name.
    #[must_use]
    pub fn name(self) -> &'static str {
        TABLE[self as usize].1
    }

    pub(super) fn content(self) -> Content {
        TABLE[self as usize].2
    }
}

/// Returns the columns as a list for `--help`.
#[must_use]
pub fn help() -> String {
    let mut text = String::new();
    for (_, name, _, about) in TABLE {
        let _ = writeln!(text, "  {name:<23} {about}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_of_the_table_stands_in_the_place_of_its_column_and_has_a_name_of_its_own() {
        for (i, column) in Column::all().enumerate() {
            assert_eq!(column as usize, i, "{}", column.name());
            assert_eq!(Column::named(column.name()), Some(column));
        }
        assert_eq!(Column::named("vx"), None);
        assert_eq!(help().lines().count(), COLUMNS);
    }
}
