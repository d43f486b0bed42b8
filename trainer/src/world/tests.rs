//! What each randomised quantity does, and that it does nothing else.

use super::{Body, World};
use crate::config::{Distribution, Parameter, Randomisation};
use crate::environment::leg;
use leg_plant::{Action, Apex, Hopper, Losses, Medium, Tolerance};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::FRAC_PI_2;

const APEX: Apex = Apex { vx_m_s: 0.4, y_m: 1.9 };
const ACTION: Action = Action { touchdown_angle_rad: 1.62, elongation_speed_m_s: 0.3 };

fn uniform(low: f64, high: f64) -> Distribution {
    Distribution::Uniform { low, high }
}

fn constant(parameter: Parameter, value: f64) -> Randomisation {
    Randomisation::default().with(parameter, uniform(value, value))
}

/// Returns a table with every quantity randomised.
fn everything() -> Randomisation {
    let ranges = [
        (0.8, 1.2),
        (0.7, 1.3),
        (0.9, 1.1),
        (10.0, 100.0),
        (0.5, 2.0),
        (0.5, 0.9),
        (-0.1, 0.1),
        (0.01, 0.05),
        (-0.2, 0.2),
        (-0.1, 0.1),
        (-0.05, 0.05),
        (-0.3, 0.3),
        (-0.15, 0.15),
        (-0.04, 0.04),
    ];
    let pairs = Parameter::ALL.into_iter().zip(ranges);
    pairs.fold(Randomisation::default(), |table, (parameter, (low, high))| {
        table.with(parameter, uniform(low, high))
    })
}

fn draw(randomisation: &Randomisation, episode: u64) -> World {
    World::draw(randomisation, 7, episode, 0.3, Tolerance::GOLDEN)
}

/// Returns the value of each parameter in a world, in the order of [`Parameter::ALL`].
fn values(world: &World) -> [Option<f64>; 14] {
    let (p, human) = (*world.body.leg.parameters(), leg());
    let h = human.parameters();
    let unless = |same: f64, value: f64| (value != same).then_some(value);
    let losses = world.body.losses;
    [
        unless(1.0, p.mass_kg / h.mass_kg),
        unless(1.0, p.stiffness_n_m / h.stiffness_n_m),
        unless(9.81, world.body.medium.gravity_m_s2()),
        unless(0.0, losses.damping_n_s_m()),
        unless(0.0, losses.foot_mass_kg()),
        losses.friction(),
        unless(0.0, world.ground_m.now),
        unless(0.0, world.body.delay_s),
        unless(0.0, world.noise[0].now),
        unless(0.0, world.noise[1].now),
        unless(0.0, world.noise[2].now),
        unless(0.0, world.bias[0]),
        unless(0.0, world.bias[1]),
        unless(0.0, world.bias[2]),
    ]
}

#[test]
fn each_quantity_is_drawn_alone_and_as_among_the_others() {
    let all = everything();
    for (i, parameter) in Parameter::ALL.into_iter().enumerate() {
        for episode in 0..50 {
            let [alone, among] = [&all.only(parameter), &all].map(|t| values(&draw(t, episode)));
            assert!(alone[i].is_some() && alone[i] == among[i], "{parameter:?}: {alone:?}");
            let others = alone.iter().enumerate().filter(|(j, _)| *j != i);
            assert!(others.into_iter().all(|(_, value)| value.is_none()), "{parameter:?}");
        }
    }
}

#[test]
fn quantities_episodes_and_seeds_are_independent() {
    let table = Parameter::ALL
        .into_iter()
        .filter(|p| ![Parameter::Mass, Parameter::Stiffness].contains(p))
        .fold(Randomisation::default(), |table, p| table.with(p, uniform(0.1, 1.0)));
    let rows: Vec<Vec<f64>> = (0..2000)
        .map(|episode| values(&draw(&table, episode)).into_iter().flatten().collect())
        .collect();
    let n = rows.len() as f64;
    let mean = |f: &dyn Fn(&[f64]) -> f64| rows.iter().map(|row| f(row)).sum::<f64>() / n;
    for i in 0..rows[0].len() {
        for j in 0..i {
            // Gravity is in units of its own.
            let centred = |k: usize| mean(&|row| row[k]);
            let (a, b) = (centred(i), centred(j));
            let [ab, aa, bb] = [
                mean(&|row| (row[i] - a) * (row[j] - b)),
                mean(&|row| (row[i] - a).powi(2)),
                mean(&|row| (row[j] - b).powi(2)),
            ];
            assert!((ab / (aa * bb).sqrt()).abs() < 0.1, "{i} {j}");
        }
    }
    let other = World::draw(&table, 8, 0, 0.3, Tolerance::GOLDEN);
    assert!(values(&other) != values(&draw(&table, 0)));
    assert_eq!(values(&draw(&table, 5)), values(&draw(&table, 5)));
}

#[test]
fn distributions_have_their_declared_moments() {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut moments = |distribution: Distribution| {
        let values: Vec<f64> = (0..40_000).map(|_| distribution.draw(&mut rng)).collect();
        let [low, high] = distribution.range();
        assert!(values.iter().all(|x| (low..=high).contains(x)), "{distribution:?}");
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let squares = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
        (mean, (squares / values.len() as f64).sqrt())
    };
    let near = |(mean, deviation): (f64, f64), expected: (f64, f64)| {
        assert!((mean - expected.0).abs() < 0.02 * expected.1, "{mean} {expected:?}");
        assert!((deviation / expected.1 - 1.0).abs() < 0.02, "{deviation} {expected:?}");
    };
    near(moments(uniform(0.8, 1.2)), (1.0, 0.4 / 12_f64.sqrt()));
    // Of ln x uniform from ln 1 to ln 100: mean 99 / ln 100, mean square 9999 / (2 ln 100).
    let ln = 100_f64.ln();
    let mean = 99.0 / ln;
    let deviation = (9999.0 / (2.0 * ln) - mean * mean).sqrt();
    near(moments(Distribution::LogUniform { low: 1.0, high: 100.0 }), (mean, deviation));
    let normal = |low, high| Distribution::Normal { mean: 2.0, deviation: 0.5, low, high };
    near(moments(normal(-10.0, 10.0)), (2.0, 0.5));
    // Clipped at its mean: half of the draws are there, the rest is half a bell.
    let half = 0.5 * (2.0 * std::f64::consts::PI).sqrt().recip();
    near(moments(normal(2.0, 10.0)), (2.0 + half, (0.125 - half * half).sqrt()));
    assert_eq!(moments(uniform(3.0, 3.0)), (3.0, 0.0));
}

#[test]
fn without_losses_a_stepped_hop_is_that_of_the_apex_map() {
    let mut rng = Pcg64::seed_from_u64(2);
    let (mut hops, mut falls) = (0, 0);
    for _ in 0..1000 {
        let medium = Medium::AIR.with_density_ratio(rng.random_range(0.0..=1.0)).unwrap();
        let start = Apex { vx_m_s: rng.random_range(-3.0..3.0), y_m: rng.random_range(1.0..4.0) };
        let action = Action {
            touchdown_angle_rad: FRAC_PI_2 + rng.random_range(-0.5..0.5),
            elongation_speed_m_s: rng.random_range(0.0..2.0),
        };
        let tolerance = Tolerance::GOLDEN;
        let body = Body { leg: leg(), losses: Losses::NONE, medium, delay_s: 0.0, tolerance };
        let stepped = body.hop(start, action, action.touchdown_angle_rad);
        match (Hopper::new(&leg(), medium).hop(start, action).outcome.next(), stepped) {
            (Some(map), Some(stepped)) => {
                hops += 1;
                let apart = (map.vx_m_s - stepped.vx_m_s).abs().max((map.y_m - stepped.y_m).abs());
                assert!(apart < 1e-8, "{start:?} {action:?}: {map:?} {stepped:?}");
            }
            (None, None) => falls += 1,
            (map, stepped) => panic!("{start:?} {action:?} {medium:?}: {map:?} {stepped:?}"),
        }
    }
    assert!(hops > 500 && falls > 50, "{hops} {falls}");
}

/// Returns the height over the upright leg of the apex after a drop on the spot on land.
fn height_after_a_drop_m(randomisation: &Randomisation) -> f64 {
    let mut world = World::draw(randomisation, 1, 0, 0.0, Tolerance::GOLDEN);
    let upright = Action { touchdown_angle_rad: FRAC_PI_2, elongation_speed_m_s: 0.0 };
    world.hop(Apex { vx_m_s: 0.0, y_m: 2.0 }, upright).unwrap().y_m - 1.0
}

#[test]
fn losses_cost_their_energy() {
    let lossless = height_after_a_drop_m(&Randomisation::default());
    assert!((lossless - 1.0).abs() < 1e-8);
    // The body, 88 kg with the added mass, takes the resting foot up: v' = 88 / 90 v.
    let foot = height_after_a_drop_m(&constant(Parameter::FootMass, 2.0));
    assert!((foot - (88.0_f64 / 90.0).powi(2)).abs() < 1e-8, "{foot}");
    let [little, much] =
        [20.0, 200.0].map(|c| height_after_a_drop_m(&constant(Parameter::Damping, c)));
    assert!(much < little - 0.05 && little < 1.0 - 0.01, "{little} {much}");
    assert_eq!(height_after_a_drop_m(&constant(Parameter::FootMass, 0.0005)), lossless);
}

#[test]
fn a_slippery_foot_does_not_carry_a_slanted_leg() {
    let slanted = Action { touchdown_angle_rad: 1.2, elongation_speed_m_s: 0.0 };
    let hop = |mu: f64| {
        World::draw(&constant(Parameter::Friction, mu), 1, 0, 0.0, Tolerance::GOLDEN)
            .hop(Apex { vx_m_s: -1.0, y_m: 2.0 }, slanted)
    };
    // The leg leans by cot 1.2 = 0.39.
    let held = Hopper::new(&leg(), Medium::AIR).hop(Apex { vx_m_s: -1.0, y_m: 2.0 }, slanted);
    let firm = hop(2.0).unwrap();
    assert!((firm.vx_m_s - held.outcome.next().unwrap().vx_m_s).abs() < 1e-8);
    assert_eq!(hop(0.2), None);
}

#[test]
fn the_ground_lifts_a_hop_and_is_not_shown() {
    let mut level = World::exact(0.3, Tolerance::GOLDEN);
    let mut raised = draw(&constant(Parameter::Ground, 0.1), 0);
    let lower = Apex { y_m: APEX.y_m - 0.1, ..APEX };
    let next = level.hop(lower, ACTION).unwrap();
    let lifted = raised.hop(APEX, ACTION).unwrap();
    assert_eq!(lifted, Apex { y_m: next.y_m + 0.1, ..next });
    assert_eq!(raised.show(APEX), [APEX.vx_m_s, APEX.y_m, 0.3]);
    // Each hop has ground of its own.
    let mut uneven = draw(&Randomisation::default().with(Parameter::Ground, uniform(0.0, 0.1)), 0);
    let heights = [0; 3].map(|_| {
        let now = uneven.ground_m.now;
        uneven.hop(APEX, ACTION);
        now
    });
    assert!(heights[0] != heights[1] && heights[1] != heights[2], "{heights:?}");
}

#[test]
fn a_late_action_leaves_the_angle_before_and_elongates_late() {
    let at_once = World::exact(0.3, Tolerance::GOLDEN);
    let still = Action { elongation_speed_m_s: 0.0, ..ACTION };
    let other = Action { touchdown_angle_rad: 1.5, elongation_speed_m_s: 0.0 };
    let near = |a: Option<Apex>, b: Option<Apex>| {
        let (a, b) = (a.unwrap(), b.unwrap());
        (a.vx_m_s - b.vx_m_s).abs().max((a.y_m - b.y_m).abs()) < 1e-8
    };
    let hop = |action| at_once.clone().hop(APEX, action);
    let late = |delay_s: f64, before: Action, action: Action| {
        let mut world = draw(&constant(Parameter::Delay, delay_s), 0);
        world.in_force = Some(before);
        world.hop(APEX, action)
    };
    // From 1.9 m the leg falls for some 0.6 s before it touches down.
    assert!(near(late(0.1, other, still), hop(still)));
    assert!(near(late(0.9, other, still), hop(other)));
    assert!(!near(hop(other), hop(still)));
    // A leg that elongates after the stance has ended does not elongate.
    assert!(near(late(0.9, ACTION, ACTION), hop(still)));
    let gained = |delay_s| late(delay_s, ACTION, ACTION).unwrap().y_m;
    let [most, less] = [hop(ACTION).unwrap().y_m, gained(0.05)];
    assert!((gained(1e-9) - most).abs() < 1e-6);
    assert!((less - most).abs() > 1e-3, "{less} {most}");
    // The first action of an episode is in force from the start.
    let mut first = draw(&constant(Parameter::Delay, 0.9), 0);
    assert!(near(first.hop(APEX, still), hop(still)));
}

#[test]
fn noise_is_new_at_each_apex_and_bias_stays() {
    let table = Randomisation::default()
        .with(Parameter::NoiseVx, uniform(-0.2, 0.2))
        .with(Parameter::BiasY, uniform(0.05, 0.1))
        .with(Parameter::BiasDensity, uniform(-0.9, -0.9));
    let mut world = draw(&table, 0);
    let exact = World::exact(0.3, Tolerance::GOLDEN).hop(APEX, ACTION);
    let mut shown = Vec::new();
    for _ in 0..4 {
        shown.push(world.show(APEX));
        assert_eq!(world.show(APEX), world.show(APEX));
        assert_eq!(world.hop(APEX, ACTION), exact);
    }
    assert!(shown.windows(2).all(|w| w[0][0] != w[1][0] && w[0][1] == w[1][1]), "{shown:?}");
    assert!(shown.iter().all(|s| (s[0] - APEX.vx_m_s).abs() <= 0.2), "{shown:?}");
    assert!((0.05..=0.1).contains(&(shown[0][1] - APEX.y_m)), "{shown:?}");
    assert!(shown.iter().all(|s| s[2] == 0.0), "{shown:?}");
}

#[test]
fn a_share_of_the_episodes_is_randomised() {
    let table = Randomisation { share: 0.25, ..constant(Parameter::Mass, 1.1) };
    let randomised =
        (0..4000).filter(|&episode| values(&draw(&table, episode))[0].is_some()).count();
    assert!((900..1100).contains(&randomised), "{randomised}");
    let says = |episode| draw(&table, episode).is_randomised();
    assert_eq!((0..4000).filter(|&episode| says(episode)).count(), randomised);
    assert!(!draw(&Randomisation::default(), 0).is_randomised());
    let none = Randomisation { share: 0.0, ..everything() };
    assert!((0..100).all(|episode| values(&draw(&none, episode)).iter().all(Option::is_none)));
}

#[test]
fn the_path_of_a_hop_leads_to_its_next_apex() {
    for table in [Randomisation::default(), everything()] {
        let mut world = draw(&table, 3);
        let mut start = APEX;
        for hop in 0..3 {
            let path = world.path(start, ACTION);
            assert_eq!(path, world.path(start, ACTION), "it changes nothing");
            let ground_m = path[0].ground_m;
            assert_eq!((path[0].x_m, path[0].y_m), (0.0, start.y_m));
            let feet: Vec<_> = path.iter().filter_map(|point| point.foot).collect();
            assert!(!feet.is_empty() && feet.iter().all(|foot| foot[1] == ground_m), "{feet:?}");
            let Some(next) = world.hop(start, ACTION) else {
                assert!(hop > 0, "a fall at once");
                break;
            };
            // The last point lies up to 20 ms after the apex.
            let last = path[path.len() - 1];
            assert!((0.0..0.003).contains(&(next.y_m - last.y_m)), "{last:?} {next:?}");
            start = next;
        }
    }
}
