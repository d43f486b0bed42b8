use leg_control::config::Config;
use leg_control::policy::{Policy, SHIPPED};
use leg_control::wire_controller::WireController;
use leg_host::memory::Inline;

use super::*;
use crate::scenario::{Scenario, Settings};
use crate::session::lock_step::{self, Options};
use crate::session::{Outcome, stepped};
use leg_plant::EventKind;

fn scenario(toml: &str) -> Scenario {
    Scenario::from_settings(&Settings::from_toml(toml).unwrap()).unwrap()
}

fn refusal(fault: &str) -> String {
    let setting = match fault.parse::<FaultSetting>() {
        Ok(setting) => setting,
        Err(refused) => return refused.to_string(),
    };
    let settings = Settings { faults: vec![setting], ..Settings::default() };
    let refused = Scenario::from_settings(&settings).expect_err(fault);
    assert_eq!(refused.key, "fault");
    refused.to_string()
}

fn with_policy<R>(play: impl FnOnce(WireController<'_>) -> R) -> R {
    let blob: leg_process::policy_file::AlignedBytes = SHIPPED.into();
    let policy = Policy::parse(blob.as_slice()).unwrap();
    play(WireController::new(policy, Config::at_rate(1000).unwrap()))
}

fn play(scenario: &Scenario) -> Outcome {
    with_policy(|mut controller| {
        stepped::run(scenario, |s| controller.tick(s), Options::default(), |_| ()).unwrap()
    })
}

const SHORT: &str = "duration_s = 6.0\nset_point_m_s = 0.3\n";

#[test]
fn file_and_command_line_give_the_same_setting() {
    let pairs = [
        ("drop=0.1", "drop = 0.1"),
        ("delay=3,direction=commands", "delay = 3\ndirection = \"commands\""),
        (
            "noise=0.05,field=vx,from=1,until=2.5s",
            "noise = 0.05\nfield = \"vx\"\nfrom = 1\nuntil = \"2.5s\"",
        ),
        ("ground=rough,height=0.05", "ground = \"rough\"\nheight = 0.05"),
        ("medium=0.0,at=5s", "medium = \"0.0\"\nat = \"5s\""),
    ];
    for (flag, table) in pairs {
        let from_file = Settings::from_toml(&format!("[[fault]]\n{table}")).unwrap();
        let from_flag = flag.parse::<FaultSetting>().unwrap();
        let [from_file] = from_file.faults.try_into().unwrap();
        assert_eq!(from_flag, from_file, "{flag}");
        // A recording keeps the settings as TOML.
        let settings = Settings { faults: vec![from_flag], ..Settings::default() };
        let again = Settings::from_toml(&toml::to_string(&settings).unwrap()).unwrap();
        assert_eq!(again, settings);
    }
    let unknown = Settings::from_toml("[[fault]]\ndorp = 0.1").unwrap_err().to_string();
    assert!(
        unknown.contains("`dorp` is not a kind of fault; the kinds are drop, delay"),
        "{unknown}"
    );
    let both = Settings::from_toml("[[fault]]\ndrop = 0.1").unwrap();
    let flags = Settings { faults: vec!["mass=2".parse().unwrap()], ..Settings::default() };
    let all: Vec<String> = flags.over(both).faults.iter().map(ToString::to_string).collect();
    assert_eq!(all, ["drop=0.1", "mass=2"], "a flag adds to a file");
}

#[test]
fn an_invalid_fault_is_refused_with_the_valid_values() {
    for (fault, parts) in [
        ("drp=1", ["`drp` is not a kind of fault", "drop, delay, jitter"]),
        ("drop", ["`drop` is not key=value", "drop, delay, jitter"]),
        ("drop=2", ["drop is 2", "from 0 to 1"]),
        ("drop=NaN", ["drop is NaN", "from 0 to 1"]),
        ("drop=0.1,field=vx", ["`drop` has no key `field`", "direction, from, until"]),
        ("drop=0.1,direction=up", ["direction is up", "samples, commands or both"]),
        ("drop=0.1,delay=3", ["two faults", "of its own"]),
        ("drop=0.1,from=1,from=2", ["`from`", "twice"]),
        ("drop=0.1,from=5,until=4", ["until must be later", "from"]),
        ("delay=1.5", ["delay is 1.5", "a whole number from 0 to 1000"]),
        ("corrupt=1,bits=0", ["bits is 0", "from 1 to 64"]),
        ("freeze=5,as=mode", ["as is mode", "last or nothing"]),
        ("noise=0.1,field=density", ["field is density", "no density sensor"]),
        ("noise=2,field=contact", ["noise is 2", "from 0 to 1"]),
        ("noise=1,as=pink", ["as is pink", "normal or uniform"]),
        ("noise=1,correlation=11", ["correlation is 11", "from 0 to 10"]),
        ("noise=1,as=uniform,correlation=0.1", ["uniform noise", "no correlation"]),
        ("noise=0.1,field=contact,as=uniform", ["contact reading", "neither as nor"]),
        ("bias=1", ["needs field=", "unit"]),
        ("nan=0.1,field=contact", ["field is contact", "only noise, stuck and dead"]),
        ("noise=1,field=up", ["field is up", "vx, y, vy, leg-length, leg-angle, acceleration"]),
        (
            "noise=1,field=pitch",
            ["field is pitch; this run has no such sensor", "pitch-rate above"],
        ),
        ("bias=1,field=acceleration", ["no such sensor", "accelerometer-rate above 0 adds it"]),
        ("dead=all", ["dead is all", "density, contact"]),
        ("dead=pressure", ["dead is pressure", "pressure-rate above 0 adds it"]),
        ("dead=vx,at=5h", ["at is 5h", "a number"]),
        ("dead=vx,at=5,until=4", ["until must be later than at", "dead=vx"]),
        ("switch=half", ["switch is half", "closed or open"]),
        ("saturate=1", ["field is missing", "angle, angle-rate or elongation-rate"]),
        ("bandwidth=0", ["bandwidth is 0", "from 0.1 to 1000"]),
        ("dead-time=-1", ["dead-time is -1", "from 0 to 1000"]),
        ("backlash=2", ["backlash is 2", "from 0 to 1"]),
        ("backlash=0.1,field=knee", ["field is knee", "angle or elongation"]),
        ("mass=0", ["mass is 0", "from 0.1 to 10"]),
        ("drag=-1", ["drag is -1", "from 0 to 10"]),
        ("gravity=3", ["gravity is 3", "from 0.5 to 2"]),
        ("damping=1001", ["damping is 1001", "from 0 to 1000"]),
        ("foot-mass=0.0001", ["foot-mass is 0.0001", "0 or a number from 0.001 to 10"]),
        ("foot-mass=NaN", ["foot-mass is NaN", "0 or a number from 0.001 to 10"]),
        ("drive-force=1e6", ["drive-force is 1e6", "from 0 to 100000"]),
        ("friction=0", ["friction is 0", "from 0.05 to 2"]),
        ("friction=0.5,from=2", ["`friction` has no key `from`", "its keys are: none"]),
        ("ground=hills", ["ground is hills", "steps, slope, sine or rough"]),
        ("ground=slope,height=1", ["ground=slope", "has no height"]),
        ("medium=3", ["medium is 3", "from 0 to 2"]),
        ("medium=1,at=5h", ["at is 5h", "a number"]),
    ] {
        let message = refusal(fault);
        assert!(parts.iter().all(|part| message.contains(part)), "{fault}: {message}");
    }
    for (kind, values) in [
        ("ground", ["\"rough\"", "\"sine\""]),
        ("gravity", ["0.8", "1.2"]),
        ("damping", ["50", "60.0"]),
        ("foot-mass", ["1", "2"]),
        ("friction", ["1", "2"]),
        ("drive-force", ["1", "2"]),
    ] {
        let two = values.map(|value| format!("[[fault]]\n{kind} = {value}\n")).concat();
        let refused = Scenario::from_settings(&Settings::from_toml(&two).unwrap()).unwrap_err();
        let what = format!("a run can have only one {kind} fault");
        assert!(refused.to_string().contains(&what), "{refused}");
    }
}

#[test]
fn a_run_without_faults_is_unchanged_and_faults_depend_on_the_seed() {
    let plain = scenario(SHORT);
    let inline = with_policy(|mut controller| {
        let mut link = Inline::new(|sample| controller.tick(Some(sample)));
        lock_step::run(&plain, &mut link, Options::default(), |_| ()).unwrap()
    });
    assert_eq!(play(&plain).state_hash, inline.state_hash);
    assert!(inline.report().faults.is_empty());
    let never = scenario(&format!("{SHORT}[[fault]]\ndrop = 1.0\nfrom = 50"));
    let outcome = play(&never);
    assert_eq!(outcome.state_hash, inline.state_hash);
    assert_eq!(outcome.faults[0].to_string(), "fault drop=1,from=50: never fired");

    let seeded = |seed: u64, fault: &str| {
        play(&scenario(&format!("seed = {seed}\n{SHORT}[[fault]]\n{fault}"))).state_hash
    };
    for fault in [
        "drop = 0.2",
        "jitter = 4",
        "duplicate = 0.1",
        "reorder = 0.1",
        "corrupt = 0.01",
        "freeze = 5\nchance = 0.01",
        "noise = 0.01",
        "stuck = 4\nchance = 0.01",
        "nan = 0.02",
        "ground = \"rough\"",
        "ground = \"steps\"",
    ] {
        assert_eq!(seeded(1, fault), seeded(1, fault), "{fault}");
        assert_ne!(seeded(1, fault), seeded(2, fault), "{fault}");
        assert_ne!(seeded(1, fault), inline.state_hash, "{fault}");
    }
}

#[test]
fn faults_reach_the_readings_of_an_inertial_sensor() {
    let imu = |fault: &str| {
        let run = scenario(&format!("{SHORT}sensors = \"underwater\"\n[[fault]]\n{fault}"));
        let mut readings = Vec::new();
        let outcome = with_policy(|mut controller| {
            let law = |sample: Option<&_>| controller.tick(sample);
            stepped::run(&run, law, Options::default(), |tick| {
                readings.push(*tick.sample);
            })
        })
        .unwrap();
        (readings, outcome.faults[0].touched)
    };
    let untouched = imu("noise = 0.0\nfield = \"pitch\"\nfrom = 50").0;
    for fault in ["leg-angle", "acceleration", "pitch", "pitch-rate", "pressure"] {
        let noise = imu(&format!("noise = 0.5\nfield = \"{fault}\""));
        assert!(noise.1 > 200 && noise.0 != untouched, "{fault}: {}", noise.1);
        let dead = imu(&format!("dead = \"{fault}\"\nat = 5"));
        assert_eq!(dead.1, 1000, "{fault}");
        assert_eq!(dead.0[..5000], untouched[..5000], "{fault}");
        assert!(dead.0[5000..].iter().zip(&untouched[5000..]).any(|(dead, old)| dead != old));
    }
    let pressure = "[[fault]]\nbias = 20000\nfield = \"pressure\"";
    scenario(&format!("sensors = \"underwater\"\n{pressure}"));
    let refused =
        Settings::from_toml("sensors = \"imu\"\n[[fault]]\nnan = 0.1\nfield = \"acceleration\"");
    let refused = Scenario::from_settings(&refused.unwrap()).unwrap_err().to_string();
    assert!(refused.contains("never NaN; dead=acceleration takes it away"), "{refused}");
}

#[test]
fn each_fault_has_its_own_count() {
    let toml = format!(
        "{SHORT}[[fault]]\ndelay = 2\ndirection = \"commands\"\nfrom = 1\nuntil = 2\n\
         [[fault]]\nmass = 1.1\n[[fault]]\nmedium = 0.2\nat = 3\nuntil = 4\n\
         [[fault]]\nground = \"slope\"\n[[fault]]\nbias = 0.1\nfield = \"y\"\n"
    );
    let outcome = play(&scenario(&toml));
    let counts: Vec<u64> = outcome.faults.iter().map(|row| row.touched).collect();
    assert_eq!(counts[..3], [1000, 6000, 1000]);
    assert_eq!(counts[3], outcome.touchdowns, "the slope is nowhere level but at 0");
    assert_eq!(counts[4], 6000);
    assert_eq!(outcome.report().faults, outcome.faults);
}

#[test]
fn a_leg_fault_changes_the_simulated_leg_and_not_the_controllers_model() {
    let configured = scenario("");
    let played = scenario(
        "[[fault]]\nmass = 1.5\n[[fault]]\nstiffness = 0.5\n[[fault]]\ndrag = 1.5\n\
         [[fault]]\ngravity = 0.8",
    );
    assert_eq!(played.leg_model(), configured.leg_model());
    assert_eq!(played.session_params(), configured.session_params());
    let (leg, model) = (*played.played_leg().parameters(), *configured.leg.parameters());
    assert_eq!((leg.mass_kg, leg.stiffness_n_m), (120.0, 10_000.0));
    assert_eq!((leg.drag_x, leg.drag_y), (1.5 * model.drag_x, 1.5 * model.drag_y));
    assert_eq!(played.medium_at(0.0).gravity_m_s2(), 0.8 * configured.gravity_m_s2);
    assert_eq!(played.controller_gravity_m_s2(), configured.controller_gravity_m_s2());
    let fall = |scenario: &Scenario| {
        let mut after_s = f64::INFINITY;
        with_policy(|mut controller| {
            let law = |sample: Option<&_>| controller.tick(sample);
            let _ = stepped::run(scenario, law, Options::default(), |tick| {
                if tick.phase != leg_plant::Phase::Flight {
                    after_s = after_s.min(tick.t_s);
                }
            });
        });
        after_s
    };
    let slow = fall(&scenario(&format!("{SHORT}[[fault]]\ngravity = 0.64")));
    let ratio = slow / fall(&scenario(SHORT));
    assert!((ratio - 1.25).abs() < 0.01, "a fall under 0.64 g lasts {ratio} times as long");
    assert_eq!(configured.played_leg(), configured.leg);
}

#[test]
fn losses_act_on_the_simulated_leg_alone_and_at_rest_change_no_bit() {
    let plain = scenario(SHORT);
    let with = |faults: &str| scenario(&format!("{SHORT}{faults}"));
    let at_rest = with("[[fault]]\ndamping = 0\n[[fault]]\nfoot-mass = 0\n[[fault]]\nfriction = 2");
    assert_eq!(play(&at_rest).state_hash, play(&plain).state_hash);
    let lossy =
        with("[[fault]]\ndamping = 50\n[[fault]]\nfoot-mass = 2\n[[fault]]\nfriction = 0.6");
    assert_eq!(lossy.session_params(), plain.session_params());
    let plant = lossy.plant();
    let losses = plant.losses();
    assert_eq!((losses.damping_n_s_m(), losses.foot_mass_kg()), (50.0, 2.0));
    assert_eq!(losses.friction(), Some(0.6));
    let outcome = play(&lossy);
    assert_eq!(outcome.faults.iter().map(|row| row.touched).collect::<Vec<_>>(), [6000; 3]);
    assert_eq!(outcome.state_hash, play(&lossy).state_hash);
    // In water the leg leans more than on land.
    let in_water = play(&with("medium = \"water\"")).state_hash;
    for one in ["damping = 50", "foot-mass = 2", "friction = 0.1", "drive-force = 100"] {
        let hash = play(&with(&format!("medium = \"water\"\n[[fault]]\n{one}"))).state_hash;
        assert_ne!(hash, in_water, "{one}");
    }
}

#[test]
fn the_leg_follows_the_ground_and_the_medium_of_its_place() {
    let uneven = scenario(&format!(
        "{SHORT}[start]\nx_m = 1.0\n[[fault]]\nground = \"slope\"\ngrade = 0.1\n\
         [[fault]]\nmedium = 0.5\nat = \"1.2m\"\n"
    ));
    assert_eq!(uneven.start.y_m, 2.1, "the start height counts from the ground");
    let mut touchdowns = 0;
    with_policy(|mut controller| {
        let law = |sample: Option<&_>| controller.tick(sample);
        stepped::run(&uneven, law, Options::default(), |tick| {
            let above_m = tick.body.y_m - 0.1 * tick.body.x_m;
            assert_eq!(tick.sample.y_m, above_m as f32);
            let density_ratio = if tick.body.x_m >= 1.2 { 0.5 } else { 0.0 };
            assert_eq!(tick.medium.density_ratio(), density_ratio);
            for event in tick.events.iter() {
                if let EventKind::Touchdown { foot_x_m, foot_y_m } = event.kind {
                    assert!((foot_y_m - 0.1 * foot_x_m).abs() < 1e-9);
                    touchdowns += 1;
                }
            }
        })
        .unwrap()
    });
    assert!(touchdowns > 2, "{touchdowns}");
}

/// Regression: observers, and so recordings, had the samples from before the faults.
#[test]
fn observers_see_the_samples_that_the_controller_receives() {
    let faults = ["noise = 0.05", "bias = 0.1\nfield = \"y\"", "stuck = 20\nfield = \"vy\""];
    let faults = faults.map(|fault| format!("[[fault]]\n{fault}\n")).concat();
    let run = scenario(&format!("{SHORT}{faults}"));
    let (mut received, mut seen, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    with_policy(|mut controller| {
        let law = |sample: Option<&leg_control::wire::Sample>| {
            received.extend(sample.copied());
            controller.tick(sample)
        };
        stepped::run(&run, law, Options::default(), |tick| {
            seen.push(*tick.sample);
            errors.push(f64::from(tick.sample.vx_m_s) - tick.body.vx_m_s);
        })
    })
    .unwrap();
    assert!(seen == received && seen.len() == 6000, "{}", seen.len());
    let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    assert!((0.047..0.053).contains(&deviation), "{deviation}");
}
