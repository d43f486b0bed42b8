//! The parameters of the leg that a policy was trained for.

use crate::checksum::crc32;
use serde::{Deserialize, Serialize};

/// Parameters of the spring leg (SLIP in a fluid), SI units, f32.
///
/// Source of the default values: table 1 and the published code of "Learning
/// to stop", doi 10.5281/zenodo.4607469.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LegModel {
    /// Dry mass, kg.
    pub mass_kg: f32,
    /// Added mass of the fluid that moves along, kg; the same in every medium.
    pub added_mass_kg: f32,
    /// Spring stiffness, N/m.
    pub stiffness_n_m: f32,
    /// Displaced volume, m3.
    pub volume_m3: f32,
    /// Rest length of the unextended leg, m.
    pub rest_length_m: f32,
    /// Largest elongation of the rest length, m.
    pub max_elongation_m: f32,
    /// Projected area against horizontal motion, m2.
    pub area_x_m2: f32,
    /// Projected area against vertical motion, m2.
    pub area_y_m2: f32,
    /// Horizontal drag coefficient.
    pub drag_x: f32,
    /// Vertical drag coefficient.
    pub drag_y: f32,
}

/// Density of the reference fluid (ratio 1), kg/m3.
pub const WATER_DENSITY_KG_M3: f32 = 1000.0;

/// Largest value of any parameter, in SI units: no product of two overflows f32.
pub const MAX_PARAMETER: f32 = 1e9;

/// Returns whether every value is from `least` to `most`; a NaN never is. Not inlined, to
/// save flash.
#[inline(never)]
pub(crate) fn all_within(values: &[f32], least: f32, most: f32) -> bool {
    values.iter().all(|&x| least <= x && x <= most)
}

impl LegModel {
    /// The human-size leg of the paper.
    pub const HUMAN: Self = Self {
        mass_kg: 80.0,
        added_mass_kg: 8.0,
        stiffness_n_m: 20_000.0,
        volume_m3: 0.0624,
        rest_length_m: 1.0,
        max_elongation_m: 0.2,
        area_x_m2: 0.1925,
        area_y_m2: 0.105,
        drag_x: 1.05,
        drag_y: 1.05,
    };

    /// Returns every parameter, in the order of declaration.
    #[must_use]
    pub const fn parameters(&self) -> [f32; 10] {
        [
            self.mass_kg,
            self.added_mass_kg,
            self.stiffness_n_m,
            self.volume_m3,
            self.rest_length_m,
            self.max_elongation_m,
            self.area_x_m2,
            self.area_y_m2,
            self.drag_x,
            self.drag_y,
        ]
    }

    /// Returns the leg of these parameters, in the order of declaration.
    #[must_use]
    pub const fn from_parameters(parameters: [f32; 10]) -> Self {
        let [
            mass_kg,
            added_mass_kg,
            stiffness_n_m,
            volume_m3,
            rest_length_m,
            max_elongation_m,
            area_x_m2,
            area_y_m2,
            drag_x,
            drag_y,
        ] = parameters;
        Self {
            mass_kg,
            added_mass_kg,
            stiffness_n_m,
            volume_m3,
            rest_length_m,
            max_elongation_m,
            area_x_m2,
            area_y_m2,
            drag_x,
            drag_y,
        }
    }

    /// Returns an identity of the leg: the CRC-32 over the bits of every parameter (f32,
    /// little-endian), in the order of declaration.
    #[must_use]
    pub fn fingerprint(&self) -> u32 {
        let bits = self.parameters().map(|parameter| parameter.to_bits().to_le());
        crc32(bytemuck::bytes_of(&bits))
    }

    /// Returns whether every parameter is from 0 to [`MAX_PARAMETER`], and those that the
    /// control law divides by (mass, volume, rest length) are above 0.
    #[must_use]
    pub fn is_physical(&self) -> bool {
        all_within(&self.parameters(), 0.0, MAX_PARAMETER)
            && self.mass_kg > 0.0
            && self.volume_m3 > 0.0
            && self.rest_length_m > 0.0
    }

    /// Returns the density ratio at which the leg, free of contact and of drag,
    /// accelerates vertically by `ay_m_s2` under gravity `gravity_m_s2`.
    ///
    /// From `ay = -(m - 1000 rho V) g / (m + M)`, which holds at an apex, where
    /// the vertical drag is zero. Not clamped to any range.
    #[must_use]
    pub fn density_ratio_at(&self, ay_m_s2: f32, gravity_m_s2: f32) -> f32 {
        let moving_mass_kg = self.mass_kg + self.added_mass_kg;
        (self.mass_kg + ay_m_s2 * moving_mass_kg / gravity_m_s2)
            / (WATER_DENSITY_KG_M3 * self.volume_m3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn returns_the_density_for_the_acceleration_at_an_apex() {
        let leg = LegModel::HUMAN;
        for rho in [0.0_f32, 0.3, 1.0] {
            let ay = -(80.0 - 1000.0 * rho * 0.0624) * 9.81 / 88.0;
            assert!((leg.density_ratio_at(ay, 9.81) - rho).abs() < 1e-6);
        }
    }

    #[test]
    fn refuses_a_leg_without_mass_or_with_a_nan() {
        assert!(LegModel::HUMAN.is_physical());
        assert!(!LegModel { mass_kg: 0.0, ..LegModel::HUMAN }.is_physical());
        assert!(!LegModel { drag_x: f32::NAN, ..LegModel::HUMAN }.is_physical());
    }
}
