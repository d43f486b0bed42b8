//! Starts, rewards and episodes.

use super::{Environment, Start, draw_start, leg_model};
use crate::config::MediumDraw;
use crate::preset::Preset;
use leg_control::leg::LegModel;
use leg_plant::{Action, Apex};
use rand::SeedableRng;
use rand_pcg::Pcg64;

#[test]
fn rewards_equal_those_of_the_published_data() {
    let reward = Preset::Air.config().reward;
    let action = Action { touchdown_angle_rad: 1.5, elongation_speed_m_s: 1.0 };
    let at = |vx_m_s, y_m| reward.of(action, Some(Apex { vx_m_s, y_m }), 0.0);
    assert_eq!(at(1.0, 2.0), 2_f64.log10());
    assert_eq!(at(-1.0, 2.0), at(1.0, 2.0));
    // The published data reward a last apex below 1 m, and no fall.
    assert_eq!(at(1.0, 0.5), 2_f64.log10());
    assert_eq!(reward.of(action, None, 0.0), 0.0);
    let robust = Preset::Robust.config().reward;
    let low = Some(Apex { vx_m_s: 1.0, y_m: 0.999 });
    assert_eq!(robust.of(action, low, 1.0), -0.5);
    let apex = Some(Apex { vx_m_s: 1e-9, y_m: 1.4 });
    assert!((robust.of(action, apex, 0.0) - (2.0 - 0.2 - 0.25)).abs() < 1e-12);
    assert!((robust.of(action, apex, 1.0) - (2.0 - 0.25)).abs() < 1e-12);
}

#[test]
fn density_ratios_and_starts_have_the_documented_distributions() {
    let mut rng = Pcg64::seed_from_u64(3);
    let mut of = |medium: MediumDraw| -> Vec<f64> {
        (0..20_000).map(|i| medium.density_ratio(i, &mut rng)).collect()
    };
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    // E|N| is sqrt(2 / pi).
    assert!((mean(&of(MediumDraw::Water)) - 0.9202).abs() < 0.002);
    assert!((mean(&of(MediumDraw::Land)) - 0.0798).abs() < 0.002);
    assert_eq!(of(MediumDraw::WaterAndAir)[..4], [1.0, 0.0, 1.0, 0.0]);
    let mixed = of(MediumDraw::Mixed { air: 0.2, thin: 0.15, thin_to: 0.1, water: 0.1 });
    let share = |f: &dyn Fn(f64) -> bool| {
        mixed.iter().filter(|&&x| f(x)).count() as f64 / mixed.len() as f64
    };
    assert!((share(&|x| x == 0.0) - 0.2).abs() < 0.01);
    assert!((share(&|x| x == 1.0) - 0.1).abs() < 0.01);
    assert!((share(&|x| x > 0.0 && x < 0.1) - 0.205).abs() < 0.012);
    let starts: Vec<_> = (0..20_000).map(|_| draw_start(3.0, &mut rng)).collect();
    let squares: Vec<f64> = starts.iter().map(|s| s.vx_m_s.powi(2)).collect();
    assert!((mean(&squares) - 9.0).abs() < 0.4);
    assert!(starts.iter().all(|s| s.y_m >= 1.001));
}

#[test]
fn an_episode_with_a_leg_far_back_ends_in_a_fall() {
    let config = Preset::Robust.config();
    let mut rng = Pcg64::seed_from_u64(1);
    let start = Start::draw(&config, &MediumDraw::Water, 0, &mut rng);
    let mut environment = Environment::new(&config, start);
    assert!(environment.observation().iter().all(|x| x.is_finite()));
    let outcome = environment.step([-1.0, 0.0]);
    assert!(outcome.reward.is_finite());
    // A leg far behind the body does not catch its fall.
    let ended = (0..50).any(|_| environment.step([-1.0, -1.0]).ended);
    assert!(ended);
}

#[test]
fn a_biased_episode_hides_velocity_and_rewards_the_wanted_speed() {
    let config = Preset::Robust.config();
    let mut rng = Pcg64::seed_from_u64(1);
    let apex = Apex { vx_m_s: 0.5, y_m: 1.5 };
    let mut biased = 0;
    for _ in 0..1000 {
        let start = Start { apex, density_ratio: 0.9 };
        let plain = Environment::new(&config, start);
        let mut environment = plain.clone().with_random_bias(&mut rng);
        let Some(bias) = environment.bias else { continue };
        biased += 1;
        let strength = bias.wanted_m_s.abs() * 0.9;
        assert!((0.3..1.2).contains(&strength), "{strength}");
        let ahead = bias.offset_m_s - bias.wanted_m_s;
        assert!((ahead - bias.wanted_m_s.signum() * 3.0 * strength).abs() < 1e-12);
        let shown = environment.observation()[0] / config.network.observation_scale[0];
        assert!((f64::from(shown) - (0.5 - bias.offset_m_s)).abs() < 1e-5);
        let outcome = environment.act([1.5, 1.0]);
        let missing = (environment.apex().vx_m_s - bias.wanted_m_s).abs();
        let stopping = (1.0 + 1.0 / missing).log10().min(2.0);
        assert!((outcome.reward - stopping).abs() < 1e-6, "{outcome:?} {stopping}");
    }
    assert!((430..570).contains(&biased), "{biased}");
    let thin = Start { apex, density_ratio: 0.6 };
    let mut biased =
        (0..100).map(|_| Environment::new(&config, thin).with_random_bias(&mut rng).is_biased());
    assert!(biased.all(|biased| !biased));
}

#[test]
fn the_density_range_covers_all_stages() {
    for (preset, range) in [
        (Preset::Water, [0.7, 1.0]),
        (Preset::Air, [0.0, 0.3]),
        (Preset::WaterToAir, [0.0, 1.0]),
        (Preset::Universal, [0.0, 1.0]),
        (Preset::Robust, [0.0, 1.0]),
        (Preset::Field, [0.0, 1.0]),
    ] {
        assert_eq!(preset.config().density_range(), range, "{preset:?}");
    }
    let thin = MediumDraw::Mixed { air: 0.5, thin: 0.5, thin_to: 0.1, water: 0.0 };
    assert_eq!(thin.density_range(), [0.0, 0.1]);
}

#[test]
fn the_policy_file_states_the_leg_and_gravity_of_the_environment() {
    assert_eq!(leg_model(), LegModel::HUMAN);
    assert_eq!(Preset::Robust.config().gravity_range_m_s2(), [9.81; 2]);
}

#[test]
fn a_biased_episode_stays_exact_in_a_randomised_training() {
    let mass = r#"randomisation.mass={ kind = "uniform", low = 1.1, high = 1.2 }"#;
    let config = Preset::Robust.config().with(mass).unwrap();
    let start = Start { apex: Apex { vx_m_s: 0.5, y_m: 1.5 }, density_ratio: 0.9 };
    let mut rng = Pcg64::seed_from_u64(1);
    let biased = (0..100).filter(|&episode| {
        let environment = Environment::new(&config, start)
            .with_random_bias(&mut rng)
            .with_random_world(1, episode);
        assert!(environment.is_biased() != environment.is_randomised(), "{episode}");
        environment.is_biased()
    });
    assert!((20..80).contains(&biased.count()));
}
