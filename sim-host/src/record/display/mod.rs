//! Messages for viewers, beside those of [`schema`](super::schema): the leg as Foxglove and
//! Rerun draw it, at the rate of a display, and what happens in the run as text.
//!
//! Foxglove draws the scene. Rerun does not know that message, but draws clouds of points.

pub(super) mod log;
mod shapes;
mod topic;

use std::ops::Range;

use foxglove::messages::log::Level;
use foxglove::messages::{FrameTransform, SceneUpdate};
use leg_control::wire::flags;
use leg_plant::{Ground, Phase};

use super::pipe::FrameBuffer;
use super::schema::Config;
use super::tap::{Known, TickCopy};
use crate::faults::Terrain;
use crate::scenario::{Profile, Scenario, Settings};
use log::{CONTROLLER, LEG, RUN};
use shapes::{
    Place, Rgba, WORLD, entity, line, points, sphere, surface, timestamp, upright, vector,
};
pub(super) use topic::DisplayTopic;

const BODY: &str = "body";
const FOOT: &str = "foot";

const FLIGHT_COLOR: Rgba = [60, 110, 190, 255];
const STANCE_COLOR: Rgba = [230, 130, 30, 255];
const SAFE_COLOR: Rgba = [200, 40, 40, 255];
const GROUND_COLOR: Rgba = [150, 125, 90, 255];
const WATER_COLOR: Rgba = [70, 140, 220, 90];

const BODY_DIAMETER_M: f64 = 0.3;
const FOOT_DIAMETER_M: f64 = 0.08;
const LEG_THICKNESS_M: f64 = 0.04;
/// Points along the leg in its cloud.
const LEG_POINTS: u32 = 12;
/// Ground that is drawn around the leg, and what must be left of it, m.
const SPAN_M: f64 = 20.0;
const MARGIN_M: f64 = 5.0;
/// Distance between two places of the ground, m: of level and of uneven ground.
const LEVEL_STEP_M: f64 = 0.5;
const UNEVEN_STEP_M: f64 = 0.05;
/// Height at which the surface of water is drawn, m; of another medium by its density. In the
/// model the medium has no surface.
const SURFACE_M: f64 = 2.5;

/// Adds the messages for viewers.
#[derive(Debug)]
pub(super) struct Display {
    /// Ticks from one picture to the next.
    every: u64,
    rest_length_m: f64,
    max_elongation_m: f64,
    terrain: Option<Terrain>,
    density: Profile,
    faults: Vec<String>,
    /// The ground that is drawn, from x to x, m.
    drawn: Option<Range<f64>>,
    /// Run id, and whether the safe command was in force, at the last tick.
    last: Option<(u32, bool)>,
    /// Run id of the last picture, and its number in that run.
    picture: Option<(u32, u64)>,
}

impl Display {
    /// Creates a display of a run at `rate_hz` pictures per second of simulated time, at most
    /// one for each tick. `None` for a rate of 0, and for a scenario that is not valid.
    pub(super) fn of(config: &Config, rate_hz: u32) -> Option<Self> {
        let every = config.rate_hz.checked_div(rate_hz)?.max(1);
        let settings = Settings::from_toml(&config.scenario_toml).ok()?;
        let scenario = Scenario::from_settings(&settings).ok()?;
        let parameters = scenario.leg.parameters();
        Some(Self {
            every: every.into(),
            rest_length_m: parameters.rest_length_m,
            max_elongation_m: parameters.max_elongation_m,
            terrain: scenario.faults.terrain(),
            density: scenario.density.clone(),
            faults: settings.faults.iter().map(ToString::to_string).collect(),
            drawn: None,
            last: None,
            picture: None,
        })
    }

    /// Draws the ground anew with the next picture, in a medium of this density.
    pub(super) fn redraw(&mut self, density_ratio: f64) {
        self.density = Profile::constant(density_ratio);
        (self.drawn, self.picture) = (None, None);
    }

    /// Adds the start of the run and its faults to the log.
    pub(super) fn begin(&self, config: &Config, frames: &mut FrameBuffer) {
        let Config { time_mode, rate_hz, started_unix_ns, .. } = config;
        let text = format!("starts in {time_mode} at {rate_hz} Hz");
        log::add(frames, *started_unix_ns, Level::Info, RUN, text);
        for fault in &self.faults {
            log::add(frames, *started_unix_ns, Level::Warning, RUN, format!("fault {fault}"));
        }
    }

    /// Adds a picture of the leg, if it is time for one, and what has changed to the log.
    pub(super) fn tick(&mut self, tick: &TickCopy, time_ns: u64, frames: &mut FrameBuffer) {
        let is_safe = tick.command.header.flags & flags::SAFE != 0;
        let run_id = tick.sample.header.run_id;
        let before = self.last.replace((run_id, is_safe));
        if before.is_some_and(|(run, _)| run != run_id) {
            let text = "is put back to its start".to_owned();
            log::add(frames, time_ns, Level::Warning, LEG, text);
        }
        // At a start it is in its safe state until its first decision.
        let level = before.map_or(Level::Info, |_| Level::Warning);
        match (before.is_some_and(|(_, was_safe)| was_safe), is_safe) {
            (false, true) => {
                log::add(frames, time_ns, level, CONTROLLER, "is in its safe state".to_owned());
            }
            (true, false) => {
                log::add(
                    frames,
                    time_ns,
                    Level::Info,
                    CONTROLLER,
                    "leaves its safe state".to_owned(),
                );
            }
            _ => (),
        }
        if tick.known == Known::Nothing {
            return;
        }
        // An observer may have missed the very tick.
        let picture = (run_id, tick.seq / self.every);
        if self.picture.replace(picture) != Some(picture) {
            self.leg(tick, is_safe, time_ns, frames);
            self.ground(tick.body.x_m, time_ns, frames);
        }
    }

    fn leg(&self, tick: &TickCopy, is_safe: bool, time_ns: u64, frames: &mut FrameBuffer) {
        let [body, foot] = self.body_and_foot(tick);
        let transform = |parent: &str, child: &str, place| FrameTransform {
            timestamp: timestamp(time_ns),
            parent_frame_id: parent.to_owned(),
            child_frame_id: child.to_owned(),
            translation: Some(vector(place)),
            rotation: Some(upright()),
        };
        let from_body = [foot[0] - body[0], foot[1] - body[1]];
        for transform in [transform(WORLD, BODY, body), transform(BODY, FOOT, from_body)] {
            frames.add_display(DisplayTopic::Transforms, time_ns, &transform);
        }
        let color = match tick.phase {
            _ if is_safe => SAFE_COLOR,
            Phase::Stance { .. } => STANCE_COLOR,
            Phase::Flight | Phase::Fallen => FLIGHT_COLOR,
        };
        let mut leg = entity(LEG, time_ns);
        leg.spheres =
            vec![sphere(body, BODY_DIAMETER_M, color), sphere(foot, FOOT_DIAMETER_M, color)];
        leg.lines = vec![line(&[body, foot], LEG_THICKNESS_M, color)];
        let scene = SceneUpdate { entities: vec![leg], ..SceneUpdate::default() };
        frames.add_display(DisplayTopic::Scene, time_ns, &scene);
        let along = |i: u32| {
            let share = f64::from(i) / f64::from(LEG_POINTS - 1);
            let place = [0, 1].map(|axis| body[axis] + share * from_body[axis]);
            (place, color)
        };
        let cloud: Vec<_> = (0..LEG_POINTS).map(along).collect();
        frames.add_display(DisplayTopic::LegPoints, time_ns, &points(&cloud, time_ns));
    }

    /// Returns the places of mass and foot. In flight the foot is where the command holds it.
    fn body_and_foot(&self, tick: &TickCopy) -> [Place; 2] {
        let body = [tick.body.x_m, tick.body.y_m];
        if let Phase::Stance { foot_x_m, foot_y_m } = tick.phase {
            return [body, [foot_x_m, foot_y_m]];
        }
        let elongation_m = f64::from(tick.command.elongation_m).clamp(0.0, self.max_elongation_m);
        let length_m = self.rest_length_m + elongation_m;
        let (sin, cos) = libm::sincos(tick.command.leg_angle_rad.into());
        [body, [body[0] - length_m * cos, body[1] - length_m * sin]]
    }

    /// Adds ground and water around the leg where too little of them is drawn.
    fn ground(&mut self, x_m: f64, time_ns: u64, frames: &mut FrameBuffer) {
        let is_enough = |drawn: &Range<f64>| {
            drawn.contains(&(x_m - MARGIN_M)) && drawn.contains(&(x_m + MARGIN_M))
        };
        if self.drawn.as_ref().is_some_and(is_enough) {
            return;
        }
        let step_m = if self.terrain.is_some() { UNEVEN_STEP_M } else { LEVEL_STEP_M };
        // At multiples of the step, so that the same ground is drawn the same way.
        let first = ((x_m - SPAN_M) / step_m).floor();
        let count = (2.0 * SPAN_M / step_m).ceil() as u32;
        let at = |i: u32| step_m * (first + f64::from(i));
        self.drawn = Some(at(0)..at(count));
        let over = |height: &dyn Fn(f64) -> f64| -> Vec<Place> {
            (0..=count).map(at).map(|x_m| [x_m, height(x_m)]).collect()
        };
        let ground = over(&|x_m| self.terrain.map_or(0.0, |terrain| terrain.height_m(x_m)));
        let water = over(&|x_m| SURFACE_M * self.density.at(x_m));
        let has_water = water.iter().any(|[_, height_m]| *height_m > 0.0);
        let mut entities = vec![entity("ground", time_ns)];
        entities[0].triangles = vec![surface(&ground, GROUND_COLOR)];
        let mut cloud: Vec<_> = ground.iter().map(|place| (*place, GROUND_COLOR)).collect();
        if has_water {
            let mut surface_of_water = entity("water", time_ns);
            surface_of_water.triangles = vec![surface(&water, WATER_COLOR)];
            entities.push(surface_of_water);
            cloud.extend(water.iter().map(|place| (*place, WATER_COLOR)));
        }
        let scene = SceneUpdate { entities, ..SceneUpdate::default() };
        frames.add_display(DisplayTopic::Scene, time_ns, &scene);
        frames.add_display(DisplayTopic::GroundPoints, time_ns, &points(&cloud, time_ns));
    }
}
