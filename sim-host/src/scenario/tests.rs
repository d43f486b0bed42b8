use super::*;

fn error(text: &str) -> String {
    let settings = Settings::from_toml(text).expect("well-formed");
    Scenario::from_settings(&settings).expect_err(text).to_string()
}

#[test]
fn the_shore_scenario_has_its_documented_values() {
    let shore = Scenario::shore();
    for (x_m, ratio) in [(-5.0, 1.0), (14.9, 1.0), (22.5, 0.5), (30.1, 0.0)] {
        assert_eq!(shore.medium_at(x_m).density_ratio(), ratio);
    }
    let mut set_point = shore.set_points.begin(0.0);
    assert_eq!((set_point.at(0.0, 0.0), set_point.at(60.0, 30.0)), (0.5, 1.0));
    assert_eq!(shore.density_sense, DensitySense::Estimated);
    assert_eq!((shore.start.x_m, shore.start.vx_m_s, shore.start.vy_m_s), (0.0, 0.0, 0.0));
    assert_eq!(shore.ticks(), 180_000);
}

#[test]
fn an_empty_file_gives_the_default_scenario() {
    let plain = Scenario::from_settings(&Settings::default()).unwrap();
    assert_eq!((plain.rate_hz, plain.duration_s, plain.leg), (1000, 60.0, Leg::human()));
    assert_eq!(plain.start, Body { x_m: 0.0, vx_m_s: 0.0, y_m: 2.0, vy_m_s: 0.0 });
}

#[test]
fn rejects_values_out_of_range_with_name_value_and_limit() {
    for (text, parts) in [
        ("rate_hz = 10", ["rate_hz", "10", "50"]),
        ("duration_s = 0.0", ["duration_s", "0", "above 0"]),
        ("duration_s = nan", ["duration_s", "NaN", "86400"]),
        ("distance_m = -1.0", ["distance_m", "-1", "above 0"]),
        ("gravity_m_s2 = 0.0", ["gravity_m_s2", "0", "above 0"]),
        ("density_ratio = -0.1", ["density_ratio", "-0.1", "from 0 to 2"]),
        ("density_ratio = 0.0\ndensity_profile = [[0.0, 1.0]]", ["density_profile", "both", "one"]),
        ("density_profile = [[0.0, 1.0], [1.0, 3.0]]", ["density_profile", "3", "from 0 to 2"]),
        ("density_profile = []", ["density_profile", "at least one", "point"]),
        ("set_point_m_s = 99.0", ["set_point_m_s", "99", "50"]),
        ("set_point_steps = [{ m_s = 1.0 }]", ["set_point_steps", "1", "either"]),
        (
            "set_point_steps = [{ from_t_s = -1.0, m_s = 1.0 }]",
            ["set_point_steps: from_t_s", "-1", "from 0"],
        ),
        ("[start]\ny_m = 0.0", ["start.y_m", "0", "above 0"]),
        ("[start]\nvx_m_s = 51.0", ["start.vx_m_s", "51", "50"]),
        (
            "[start]\ny_m = 99.0\ny_spread_m = 1.5",
            ["start.y_m: 99", "start.y_spread_m 1.5", "at most 100"],
        ),
        (
            "[start]\nvx_m_s = -49.0\nvx_spread_m_s = 2.0",
            ["start.vx_m_s: -49", "start.vx_spread_m_s 2", "at most 50"],
        ),
        ("[start]\ny_spread_m = -1.0", ["start.y_spread_m", "-1", "from 0"]),
    ] {
        let message = error(text);
        for part in parts {
            assert!(message.contains(part), "`{part}` in `{message}` of `{text}`");
        }
    }
}

#[test]
fn accepts_a_leg_by_its_parameters() {
    let mut parameters = *Leg::human().parameters();
    parameters.stiffness_n_m = 30_000.0;
    let text = toml::to_string(&parameters).unwrap();
    let settings = Settings::from_toml(&format!("[leg_parameters]\n{text}")).unwrap();
    let scenario = Scenario::from_settings(&settings).unwrap();
    assert_eq!(scenario.leg.parameters().stiffness_n_m, 30_000.0);

    let bad = text.replace("mass_kg = 80.0", "mass_kg = -80.0");
    let message = error(&format!("[leg_parameters]\n{bad}"));
    assert!(message.contains("mass_kg") && message.contains("-80"), "{message}");
    let message = error(&format!("leg = \"crab\"\n[leg_parameters]\n{text}"));
    assert!(message.contains("one of the two"), "{message}");
}

#[test]
fn terms_contain_gravity_and_leg() {
    let moon = Scenario::from_settings(&Settings::from_toml("medium = \"moon\"").unwrap()).unwrap();
    assert_eq!(moon.leg_model(), LegModel::HUMAN, "the same parameters on both sides");
    assert_eq!(
        moon.session_params(),
        SessionParams::at(1000).with_gravity(1.62).with_leg(&LegModel::HUMAN)
    );
    assert_ne!(
        Scenario { leg: Leg::crab(), ..moon.clone() }.session_params().leg,
        moon.session_params().leg
    );
}

#[test]
fn options_override_the_file() {
    let file = Settings::from_toml(include_str!("../../scenarios/shore.toml")).unwrap();
    let options = Settings {
        medium: Some(MediumPreset::Moon),
        duration_s: Some(5.0),
        set_point_m_s: Some(1.5),
        ..Settings::default()
    };
    let scenario = Scenario::from_settings(&options.over(file)).unwrap();
    assert_eq!(scenario.medium_at(0.0), Medium::MOON, "a medium replaces the profile");
    assert_eq!((scenario.duration_s, scenario.distance_m), (5.0, Some(50.0)));
    assert_eq!(scenario.set_points, SetPoints { start_m_s: 1.5, steps: vec![] });
}

#[test]
fn the_seed_changes_the_start_within_its_spread() {
    let start = |seed| {
        let settings = Settings {
            seed: Some(seed),
            start: StartSettings {
                vx_spread_m_s: Some(0.5),
                y_spread_m: Some(0.2),
                ..StartSettings::default()
            },
            ..Settings::default()
        };
        Scenario::from_settings(&settings).unwrap().start
    };
    assert_eq!(start(1), start(1));
    assert_ne!(start(1), start(2));
    for seed in 0..100 {
        let Body { vx_m_s, y_m, .. } = start(seed);
        assert!(vx_m_s.abs() <= 0.5 && (2.0..=2.2).contains(&y_m), "{vx_m_s} {y_m}");
    }
}

#[test]
fn accepts_the_former_name_of_a_measured_density() {
    let settings = Settings::from_toml("density = \"told\"").unwrap();
    assert_eq!(settings.density, Some(DensitySense::Measured));
}
