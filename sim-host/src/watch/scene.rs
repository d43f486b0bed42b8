//! What is to be seen: the leg as it stands, where it has been, and its hops.

use std::collections::VecDeque;
use std::f64::consts::FRAC_PI_2;
use std::time::{Duration, Instant};

use leg_control::wire::{Command, Sample};
use leg_host::desk::requests;
use leg_host::shm::Participants;

use crate::operate::LegStatus;

/// Hops that are kept.
const HOPS: usize = 60;
/// Points of the path, at most.
const TRAIL: usize = 400;
/// The path is drawn for so long, s.
const TRAIL_S: f64 = 2.5;
/// What is said stays so long.
const SAID: Duration = Duration::from_secs(4);

/// An apex, as the controller saw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hop {
    /// Its number in the run.
    pub number: u32,
    /// Horizontal velocity, m/s.
    pub vx_m_s: f64,
    /// The velocity asked for, m/s.
    pub set_point_m_s: f64,
    /// The density ratio that the controller went by.
    pub density_ratio: f64,
}

/// All that is to be seen.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The domain that is watched.
    pub domain: String,
    /// Who plays there.
    pub players: Participants,
    /// The newest sample.
    pub sample: Option<Sample>,
    /// The newest command.
    pub command: Option<Command>,
    /// Place of the mass, m: as the leg's desk tells it and, in between, by its
    /// velocity. (A sample does not say it.)
    pub x_m: f64,
    /// Where the mass was: time, place, height.
    pub trail: VecDeque<(f64, f64, f64)>,
    /// The last hops.
    pub hops: VecDeque<Hop>,
    /// What the leg's desk says.
    pub leg: Option<LegStatus>,
    /// What the controller's desk says.
    pub controller: Option<requests::Status>,
    /// Simulated seconds in a second.
    pub speed: Option<f64>,
    said: Option<(Instant, String)>,
    measured: Option<(Instant, u64)>,
}

impl Scene {
    /// Nothing to be seen yet.
    #[must_use]
    pub fn new(domain: &str) -> Self {
        Self { domain: domain.to_owned(), ..Self::default() }
    }

    /// Takes in a sample.
    pub fn take_sample(&mut self, sample: &Sample) {
        if sample.ends_the_run() {
            return;
        }
        let t_s = seconds(sample.header.t_ns);
        if let Some(last) = self.sample {
            let last_s = seconds(last.header.t_ns);
            if last.header.run_id != sample.header.run_id || t_s < last_s {
                self.begin_anew();
            } else {
                self.x_m += f64::from(sample.vx_m_s) * (t_s - last_s);
            }
        }
        // Points that lie closer cannot be told apart.
        if self.trail.back().is_none_or(|last| t_s - last.0 >= TRAIL_S / TRAIL as f64) {
            self.trail.push_back((t_s, self.x_m, sample.y_m.into()));
        }
        while self.trail.front().is_some_and(|p| p.0 < t_s - TRAIL_S) {
            self.trail.pop_front();
        }
        self.sample = Some(*sample);
    }

    /// Takes in a command.
    pub fn take_command(&mut self, command: &Command) {
        let told = self.hops.back().map_or(0, |hop| hop.number);
        if command.apexes != told && command.apexes > 0 {
            if command.apexes < told {
                self.hops.clear();
            }
            self.hops.push_back(Hop {
                number: command.apexes,
                vx_m_s: command.apex_vx_m_s.into(),
                set_point_m_s: self.sample.map_or(0.0, |sample| sample.set_point_m_s.into()),
                density_ratio: command.density_ratio.into(),
            });
            if self.hops.len() > HOPS {
                self.hops.pop_front();
            }
        }
        self.command = Some(*command);
    }

    /// Takes in what the leg's desk says, or that it says nothing.
    pub fn take_leg(&mut self, status: Option<LegStatus>, now: Instant) {
        if let (Some(status), Some(sample)) = (&status, &self.sample)
            && status.run_id == sample.header.run_id
        {
            let ahead_s = seconds(sample.header.t_ns) - status.t_s;
            let x_m = status.x_m + f64::from(sample.vx_m_s) * ahead_s;
            // The path that was guessed is set right as a whole.
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

    /// Says something to the user, for a while.
    pub fn say(&mut self, what: String) {
        self.said = Some((Instant::now(), what));
    }

    /// What is said now.
    #[must_use]
    pub fn said(&self) -> Option<&str> {
        self.said.as_ref().filter(|(when, _)| when.elapsed() < SAID).map(|(_, what)| what.as_str())
    }

    /// Forgets the run, as when nobody plays any more.
    pub fn clear(&mut self) {
        self.begin_anew();
        (self.sample, self.command, self.leg, self.controller) = (None, None, None, None);
        (self.speed, self.measured) = (None, None);
    }

    fn begin_anew(&mut self) {
        self.trail.clear();
        self.hops.clear();
        self.x_m = 0.0;
    }

    /// Foot and mass, m, while there is a leg.
    #[must_use]
    pub fn leg(&self) -> Option<[(f64, f64); 2]> {
        let sample = self.sample?;
        let y_m = f64::from(sample.y_m);
        let length_m = f64::from(sample.leg_length_m);
        let angle_rad = self.command.map_or(FRAC_PI_2, |command| command.leg_angle_rad.into());
        let mass = (self.x_m, y_m);
        let foot = if sample.is_in_contact() {
            // On the ground; on which side, the angle tells.
            let reach_m = (length_m * length_m - y_m * y_m).max(0.0).sqrt();
            (self.x_m - reach_m.copysign(angle_rad.cos()), 0.0)
        } else {
            (self.x_m - length_m * angle_rad.cos(), y_m - length_m * angle_rad.sin())
        };
        Some([foot, mass])
    }

    /// Density over that of water: the true one where the leg tells it, else
    /// the controller's.
    #[must_use]
    pub fn density_ratio(&self) -> Option<f64> {
        let told = self.leg.as_ref().map(|leg| leg.density_ratio);
        told.or_else(|| self.command.map(|command| command.density_ratio.into()))
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
        let flags = if contact { leg_control::wire::flags::IN_CONTACT } else { 0 };
        let t_ns = 1_000_000 * t_ms;
        let header = Header { run_id, flags, seq: t_ms, t_ns, ..Header::default() };
        Sample { header, vx_m_s: 2.0, y_m: 0.8, leg_length_m: 1.0, ..Sample::default() }
    }

    #[test]
    fn the_leg_stands_where_sample_and_command_say() {
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
        // Another run begins at its own place, without a trail.
        scene.take_sample(&sample(2, 0, false));
        assert_eq!((scene.x_m, scene.trail.len()), (0.0, 1));
    }

    #[test]
    fn each_apex_is_a_hop_also_when_some_are_missed() {
        let mut scene = Scene::new("d");
        scene.take_sample(&sample(1, 0, false));
        let apex = |apexes| Command { apexes, apex_vx_m_s: apexes as f32, ..Command::default() };
        for apexes in [0, 1, 1, 1, 2, 5, 5] {
            scene.take_command(&apex(apexes));
        }
        let numbers: Vec<_> = scene.hops.iter().map(|hop| hop.number).collect();
        assert_eq!(numbers, [1, 2, 5]);
        scene.take_command(&apex(1));
        assert_eq!(scene.hops.len(), 1, "a controller that began anew");
        (2..200).for_each(|n| scene.take_command(&apex(n)));
        assert_eq!((scene.hops.len(), scene.hops.back().unwrap().number), (HOPS, 199));
    }
}
