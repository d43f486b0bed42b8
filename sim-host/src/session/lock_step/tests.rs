use leg_host::memory::{self, Inline};
use leg_host::serve::serve;

use leg_control::wire::{Header, Sample, flags};

use super::*;
use crate::scenario::Settings;
use crate::session::Ending;
use leg_plant::{EventKind, Phase};

/// A law without a policy: the angle mirrors the velocity, the spring gives a little.
fn law(sample: &Sample) -> Command {
    Command {
        header: sample.header,
        leg_angle_rad: std::f32::consts::FRAC_PI_2 + 0.1 * sample.vx_m_s,
        elongation_m: 0.001 * sample.y_m,
        ..Command::default()
    }
}

fn scenario(text: &str) -> Scenario {
    Scenario::from_settings(&Settings::from_toml(text).unwrap()).unwrap()
}

#[test]
fn a_run_has_the_same_hash_over_any_link() {
    let short = scenario("duration_s = 5.0\n[start]\nvx_m_s = 0.3");
    let inline = || run(&short, &mut Inline::new(law), Options::default(), |_| ()).unwrap();
    let one = inline();
    assert_eq!(one.state_hash, inline().state_hash);
    assert_eq!((one.ticks, one.ending), (5000, Ending::Duration));
    assert!(one.touchdowns > 2, "it hopped {} times", one.touchdowns);

    let (mut leg, mut controller) = memory::pair();
    let timeout = Options::default().timeout;
    let threaded = std::thread::scope(|scope| {
        let serving = scope.spawn(move || serve(&mut controller, timeout, law));
        let outcome = run(&short, &mut leg, Options { run_id: 9, timeout }, |_| ());
        assert_eq!(serving.join().unwrap().unwrap(), 5000);
        outcome.unwrap()
    });
    assert_eq!(one.state_hash, threaded.state_hash);

    let other = scenario("duration_s = 5.0\n[start]\nvx_m_s = 0.31");
    let other = run(&other, &mut Inline::new(law), Options::default(), |_| ()).unwrap();
    assert_ne!(one.state_hash, other.state_hash);
}

#[test]
fn the_observer_sees_every_tick_and_every_event() {
    let measured = scenario("duration_s = 3.0\ndensity_ratio = 0.25\ndensity = \"measured\"");
    let (mut ticks, mut touchdowns, mut last) = (0, 0, measured.start);
    let outcome = run(&measured, &mut Inline::new(law), Options::default(), |tick| {
        assert_eq!(tick.seq, ticks);
        assert_eq!(tick.body, last, "each tick begins where the last one ended");
        assert_eq!(tick.sample.y_m, tick.body.y_m as f32);
        assert_eq!(tick.sample.density_ratio, 0.25);
        let contact = tick.sample.is_in_contact();
        assert_eq!(contact, matches!(tick.phase, Phase::Stance { .. }));
        assert_ne!(tick.sample.header.flags & flags::DENSITY_SENSED, 0);
        let down = |e: &&leg_plant::Event| matches!(e.kind, EventKind::Touchdown { .. });
        touchdowns += tick.events.iter().filter(down).count() as u64;
        (ticks, last) = (ticks + 1, tick.after);
    })
    .unwrap();
    assert_eq!((ticks, touchdowns, last), (outcome.ticks, outcome.touchdowns, outcome.body));
}

#[test]
fn ends_at_the_distance_or_where_the_leg_falls() {
    let far = scenario("duration_s = 60.0\ndistance_m = 0.5\n[start]\nvx_m_s = -1.0");
    let outcome = run(&far, &mut Inline::new(law), Options::default(), |_| ()).unwrap();
    assert_eq!(outcome.ending, Ending::Distance);
    assert!(outcome.distance_m <= -0.5 && outcome.distance_m > -0.6);

    let lying = |sample: &Sample| Command { leg_angle_rad: 0.0, ..law(sample) };
    let near = scenario("duration_s = 60.0");
    let outcome = run(&near, &mut Inline::new(lying), Options::default(), |_| ()).unwrap();
    assert_eq!(outcome.ending, Ending::Fall);
    assert_eq!(outcome.report().falls, 1);
}

#[test]
fn rejects_an_answer_to_another_tick_run_or_version() {
    let short = scenario("duration_s = 1.0");
    let options = Options { timeout: Duration::from_millis(5), ..Options::default() };
    for wrong in [
        |header: &mut Header| header.run_id += 1,
        |header: &mut Header| header.seq += 1,
        |header: &mut Header| header.version += 1,
    ] {
        let mut link = Inline::new(|sample: &Sample| {
            let mut command = law(sample);
            if sample.header.seq == 3 {
                wrong(&mut command.header);
            }
            command
        });
        let broken = run(&short, &mut link, options, |_| ());
        assert!(matches!(broken, Err(SessionError::NoAnswer { tick: 3, .. })), "{broken:?}");
    }
}
