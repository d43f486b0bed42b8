//! The data shown: the leg, its recent path, and its hops.

use std::collections::VecDeque;
use std::f64::consts::FRAC_PI_2;
use std::time::{Duration, Instant};

use leg_control::wire::{Command, Sample, flags};
use leg_host::shm::Participants;
use leg_host::status;

use crate::operate::LegStatus;

/// Number of hops kept.
const MAX_HOPS: usize = 60;
/// Most points of the path.
const MAX_TRAIL: usize = 400;
/// Duration of the path shown, s.
const TRAIL_S: f64 = 2.5;
/// Time for which a message is shown.
const MESSAGE_TIME: Duration = Duration::from_secs(4);

/// An apex as the controller found it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hop {
    /// Number of the apex in the run.
    pub number: u32,
    /// Horizontal velocity, m/s.
    pub vx_m_s: f64,
    /// Set-point, m/s.
    pub set_point_m_s: f64,
    /// Density ratio that the actor received.
    pub density_ratio: f64,
}

/// All data shown.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The domain watched.
    pub domain: String,
    /// The processes present in it.
    pub players: Participants,
    /// The newest sample.
    pub sample: Option<Sample>,
    /// The newest command.
    pub command: Option<Command>,
    /// Horizontal position of the mass, m: from the leg's status and, in between,
    /// integrated from the velocity, because a sample does not contain it.
    pub x_m: f64,
    /// Recent path of the mass: time in s, position and height in m.
    pub trail: VecDeque<(f64, f64, f64)>,
    /// The last hops.
    pub hops: VecDeque<Hop>,
    /// Status of the leg, if it answers.
    pub leg: Option<LegStatus>,
    /// Status of the controller, if it answers.
    pub controller: Option<status::Status>,
    /// Simulated time per wall time.
    pub speed: Option<f64>,
    /// Whether the data of a run was discarded since the last [`Self::take_cleared`].
    is_cleared: bool,
    message: Option<(Instant, String)>,
    measured: Option<(Instant, u64)>,
}

impl Scene {
    /// Creates an empty scene.
    #[must_use]
    pub fn new(domain: &str) -> Self {
        Self { domain: domain.to_owned(), ..Self::default() }
    }

    /// Adds a sample.
    pub fn take_sample(&mut self, sample: &Sample) {
        if sample.ends_the_run() {
            return;
        }
        let t_s = seconds(sample.header.t_ns);
        if let Some(last) = self.sample {
            let last_s = seconds(last.header.t_ns);
            if last.header.run_id != sample.header.run_id || t_s < last_s {
                self.reset_path();
            } else {
                // 0 where it is not sensed: the path then follows the status of the leg.
                self.x_m += f64::from(sample.vx_m_s) * (t_s - last_s);
            }
        }
        // Closer points could not be distinguished.
        let is_due =
            self.trail.back().is_none_or(|last| t_s - last.0 >= TRAIL_S / MAX_TRAIL as f64);
        if is_due && let Some(y_m) = height_m(sample) {
            self.trail.push_back((t_s, self.x_m, y_m));
        }
        while self.trail.front().is_some_and(|p| p.0 < t_s - TRAIL_S) {
            self.trail.pop_front();
        }
        self.sample = Some(*sample);
    }

    /// Adds a command.
    pub fn take_command(&mut self, command: &Command) {
        let last = self.hops.back().map_or(0, |hop| hop.number);
        if command.apexes != last && command.apexes > 0 {
            if command.apexes < last {
                self.hops.clear();
            }
            self.hops.push_back(Hop {
                number: command.apexes,
                vx_m_s: command.apex_vx_m_s.into(),
                set_point_m_s: self.sample.map_or(0.0, |sample| sample.set_point_m_s.into()),
                density_ratio: command.density_ratio.into(),
            });
            if self.hops.len() > MAX_HOPS {
                self.hops.pop_front();
            }
        }
        self.command = Some(*command);
    }

    /// Sets the status of the leg; `None` if it did not answer.
    pub fn take_leg(&mut self, status: Option<LegStatus>, now: Instant) {
        if let (Some(status), Some(sample)) = (&status, &self.sample)
            && status.run_id == sample.header.run_id
        {
            let ahead_s = seconds(sample.header.t_ns) - status.t_s;
            let x_m = status.x_m + f64::from(sample.vx_m_s) * ahead_s;
            // The integrated path is corrected as a whole.
            let shift_m = x_m - self.x_m;
            self.trail.iter_mut().for_each(|point| point.1 += shift_m);
            self.x_m = x_m;
        }
        self.speed = match (&status, self.measured) {
            (Some(status), Some((then, ticks))) if status.ticks >= ticks => {
                let wall_s = (now - then).as_secs_f64();
                let sim_s = (status.ticks - ticks) as f64 / f64::from(status.rate_hz);
                (wall_s > 0.0).then(|| sim_s / wall_s)
            }
            _ => None,
        };
        self.measured = status.as_ref().map(|status| (now, status.ticks));
        self.leg = status;
    }

    /// Shows a message to the user for some seconds.
    pub fn show_message(&mut self, text: String) {
        self.message = Some((Instant::now(), text));
    }

    /// Returns the message to show now.
    #[must_use]
    pub fn message(&self) -> Option<&str> {
        let message = self.message.as_ref().filter(|(when, _)| when.elapsed() < MESSAGE_TIME);
        message.map(|(_, text)| text.as_str())
    }

    /// Discards the data of the run.
    pub fn clear(&mut self) {
        self.reset_path();
        (self.sample, self.command, self.leg, self.controller) = (None, None, None, None);
        (self.speed, self.measured) = (None, None);
        self.is_cleared = true;
    }

    /// Returns whether the data of a run was discarded since the last call.
    pub fn take_cleared(&mut self) -> bool {
        std::mem::take(&mut self.is_cleared)
    }

    fn reset_path(&mut self) {
        self.trail.clear();
        self.hops.clear();
        self.x_m = 0.0;
    }

    /// Returns the positions of foot and mass, m, if there is a leg whose height is known: it
    /// is sensed, or the foot stands and the angle of the leg is sensed.
    #[must_use]
    pub fn leg(&self) -> Option<[(f64, f64); 2]> {
        let sample = self.sample?;
        let y_m = height_m(&sample)?;
        let length_m = f64::from(sample.leg_length_m);
        let angle_rad = self.command.map_or(FRAC_PI_2, |command| command.leg_angle_rad.into());
        let mass = (self.x_m, y_m);
        let foot = if sample.is_in_contact() {
            // On the ground, on the side that the commanded angle gives.
            let reach_m = (length_m * length_m - y_m * y_m).max(0.0).sqrt();
            (self.x_m - reach_m.copysign(angle_rad.cos()), 0.0)
        } else {
            (self.x_m - length_m * angle_rad.cos(), y_m - length_m * angle_rad.sin())
        };
        Some([foot, mass])
    }

    /// Returns the density over that of water: the true one if the leg answers, else
    /// the one that the controller uses.
    #[must_use]
    pub fn density_ratio(&self) -> Option<f64> {
        let true_ratio = self.leg.as_ref().map(|leg| leg.density_ratio);
        true_ratio.or_else(|| self.command.map(|command| command.density_ratio.into()))
    }
}

/// Returns the height of the mass above the ground, m, if a sample tells it.
fn height_m(sample: &Sample) -> Option<f64> {
    let has = |flags| sample.header.flags & flags == flags;
    if has(flags::Y_SENSED) {
        Some(sample.y_m.into())
    } else if sample.is_in_contact() && has(flags::LEG_LENGTH_SENSED | flags::LEG_ANGLE_SENSED) {
        Some(f64::from(sample.leg_length_m) * f64::from(sample.sensors.leg_angle_rad).sin())
    } else {
        None
    }
}

fn seconds(t_ns: u64) -> f64 {
    1e-9 * t_ns as f64
}

#[cfg(test)]
mod tests {
    use leg_control::wire::Header;

    use super::*;

    fn sample(run_id: u32, t_ms: u64, contact: bool) -> Sample {
        let flags = flags::STATE_SENSED | if contact { flags::IN_CONTACT } else { 0 };
        let t_ns = 1_000_000 * t_ms;
        let header = Header { run_id, flags, seq: t_ms, t_ns, ..Header::default() };
        Sample { header, vx_m_s: 2.0, y_m: 0.8, leg_length_m: 1.0, ..Sample::default() }
    }

    #[test]
    fn places_foot_and_mass_by_sample_and_command() {
        let mut scene = Scene::new("d");
        assert_eq!(scene.leg(), None);
        scene.take_sample(&sample(1, 0, true));
        scene.take_sample(&sample(1, 500, true));
        let ahead = Command { leg_angle_rad: 2.0, ..Command::default() };
        scene.take_command(&ahead);
        let [foot, mass] = scene.leg().unwrap();
        assert_eq!(mass.0, 1.0);
        assert!((foot.0 - 1.6).abs() < 1e-6 && foot.1 == 0.0, "ahead of the mass: {foot:?}");
        scene.take_sample(&sample(1, 600, false));
        let [foot, mass] = scene.leg().unwrap();
        assert!((mass.0 - 1.2).abs() < 1e-6);
        let length = (foot.0 - mass.0).hypot(foot.1 - mass.1);
        assert!((length - 1.0).abs() < 1e-6 && foot.0 > mass.0, "{foot:?}");
        // Another run starts at its own position without a trail.
        scene.take_sample(&sample(2, 0, false));
        assert_eq!((scene.x_m, scene.trail.len()), (0.0, 1));
    }

    #[test]
    fn a_leg_whose_height_is_not_sensed_is_placed_only_in_stance() {
        let mut scene = Scene::new("d");
        let mut blind = sample(1, 0, false);
        (blind.y_m, blind.vx_m_s, blind.sensors.leg_angle_rad) = (0.0, 0.0, 1.5);
        blind.header.flags = flags::LEG_LENGTH_SENSED | flags::LEG_ANGLE_SENSED;
        scene.take_sample(&blind);
        assert_eq!((scene.leg(), scene.trail.len()), (None, 0));
        blind.header.flags |= flags::IN_CONTACT;
        scene.take_sample(&blind);
        let [_, mass] = scene.leg().unwrap();
        assert!((mass.1 - 1.5_f64.sin()).abs() < 1e-6, "{mass:?}");
    }

    #[test]
    fn adds_a_hop_per_apex_seen() {
        let mut scene = Scene::new("d");
        scene.take_sample(&sample(1, 0, false));
        let apex = |apexes| Command { apexes, apex_vx_m_s: apexes as f32, ..Command::default() };
        for apexes in [0, 1, 1, 1, 2, 5, 5] {
            scene.take_command(&apex(apexes));
        }
        let numbers: Vec<_> = scene.hops.iter().map(|hop| hop.number).collect();
        assert_eq!(numbers, [1, 2, 5]);
        scene.take_command(&apex(1));
        assert_eq!(scene.hops.len(), 1, "a controller that restarted");
        (2..200).for_each(|n| scene.take_command(&apex(n)));
        assert_eq!((scene.hops.len(), scene.hops.back().unwrap().number), (MAX_HOPS, 199));
    }
}
