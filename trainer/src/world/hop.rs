//! One hop of a leg with losses or a delay, by the tick plant.

use leg_plant::{
    Action, Apex, EventKind, Flat, Leg, LegCommand, Losses, MAX_FLIGHT_S, MAX_STANCES, Medium,
    TickPlant, Tolerance,
};

/// Time over which a command is held, s: shorter than a stance that carries the body, so that
/// none begins and ends within it.
const HELD_S: f64 = 0.02;

/// Longest hop, s: two of the longest flights of the apex map.
const LONGEST_S: f64 = 2.0 * MAX_FLIGHT_S;

/// A leg with losses in a medium, which acts with a delay.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Body {
    pub(super) leg: Leg,
    pub(super) losses: Losses,
    pub(super) medium: Medium,
    /// Time from an apex until its angle is taken, and from a touchdown until the leg elongates.
    pub(super) delay_s: f64,
    pub(super) tolerance: Tolerance,
}

impl Body {
    /// Whether the apex map, which knows neither losses nor delay, does not suffice.
    pub(super) fn needs_ticks(&self) -> bool {
        self.losses != Losses::NONE || self.delay_s > 0.0
    }

    /// Computes a hop over level ground; returns the next apex, or `None` after a fall. The leg
    /// has the angle `angle_before_rad` until the action is in force.
    ///
    /// Without losses and delay this is the apex map. As there, a hop of more than [`MAX_STANCES`]
    /// stances is a fall, and so is one that takes too long.
    pub(super) fn hop(&self, start: Apex, action: Action, angle_before_rad: f64) -> Option<Apex> {
        self.hop_observed(start, action, angle_before_rad, &mut |_| ())
    }

    /// Computes a hop as [`Self::hop`] does, and passes the plant to `observe` every [`HELD_S`] or
    /// sooner. The plant may pass the next apex, by less than that.
    pub(super) fn hop_observed(
        &self,
        start: Apex,
        action: Action,
        angle_before_rad: f64,
        observe: &mut impl FnMut(&TickPlant),
    ) -> Option<Apex> {
        let start = leg_plant::Body { x_m: 0.0, vx_m_s: start.vx_m_s, y_m: start.y_m, vy_m_s: 0.0 };
        let mut plant =
            TickPlant::new(self.leg, start).with_losses(self.losses).with_tolerance(self.tolerance);
        let rate_m_s = action.elongation_speed_m_s.max(0.0);
        let (mut t_s, mut stances) = (0.0, 0);
        let mut landed_s: Option<f64> = None;
        while t_s < LONGEST_S {
            let waits = t_s < self.delay_s;
            let until_s = if waits { self.delay_s.min(t_s + HELD_S) } else { t_s + HELD_S };
            let dt_s = until_s - t_s;
            let leg_angle_rad = if waits { angle_before_rad } else { action.touchdown_angle_rad };
            let step = |plant: &mut TickPlant, landed_s: Option<f64>| {
                // A ramp that passes 0 at the touchdown or, delayed, after it.
                let since_s = landed_s.map(|landed_s| t_s - landed_s - self.delay_s);
                let command = LegCommand {
                    leg_angle_rad,
                    elongation_m: since_s.map_or(0.0, |since_s| rate_m_s * since_s),
                    elongation_rate_m_s: if since_s.is_some() { rate_m_s } else { 0.0 },
                };
                plant.step(dt_s, command, self.medium, &Flat)
            };
            let before = plant.clone();
            let mut events = step(&mut plant, landed_s);
            let landing = events.iter().find_map(|event| {
                matches!(event.kind, EventKind::Touchdown { .. }).then_some(t_s + event.t_s)
            });
            if landing.is_some() {
                // The elongation does not affect the flight, so the touchdown is the same.
                landed_s = landing;
                plant = before;
                events = step(&mut plant, landed_s);
            }
            observe(&plant);
            for event in events.iter() {
                match event.kind {
                    EventKind::Touchdown { .. } if stances < MAX_STANCES => stances += 1,
                    EventKind::Touchdown { .. } | EventKind::Fall => return None,
                    EventKind::LiftOff => {}
                    EventKind::Apex => {
                        let leg_plant::Body { vx_m_s, y_m, .. } = event.body;
                        return Some(Apex { vx_m_s, y_m });
                    }
                }
            }
            t_s = until_s;
        }
        None
    }
}
