//! Trainings with domain randomisation, and its configuration.

use trainer::Isa;
use trainer::config::{Config, Distribution, Length, Parameter, Randomisation};
use trainer::preset::Preset;
use trainer::train::{EpisodeRecord, Training};
use trainer::trained::TrainedPolicy;

const SETTINGS: [&str; 5] = [
    r#"randomisation.mass={ kind = "uniform", low = 0.8, high = 1.2 }"#,
    r#"randomisation.damping_n_s_m={ kind = "log-uniform", low = 1, high = 50 }"#,
    r#"randomisation.gravity={ kind = "normal", mean = 1, deviation = 0.02, low = 0.95, high = 1.05 }"#,
    r#"randomisation.noise_y_m={ kind = "uniform", low = -0.05, high = 0.05 }"#,
    "randomisation.share=0.75",
];

fn randomised(config: &Config) -> Config {
    SETTINGS.iter().fold(config.clone(), |config, setting| config.with(setting).unwrap())
}

fn short() -> Config {
    let mut config = Preset::Robust.config();
    config.stages[0].length = Length::Steps(1200);
    config.learning.random_steps = 300;
    config.selection.evaluations = 2;
    config.selection.starts = 40;
    config.gains = Preset::Air.config().gains;
    config
}

fn train(config: &Config, isa: Isa) -> (Vec<EpisodeRecord>, Vec<u8>) {
    let mut training = Training::new(config.clone(), 3, isa);
    let mut log = Vec::new();
    while let Some(record) = training.episode().unwrap() {
        log.push(record);
    }
    (log, TrainedPolicy::new(&training).blob().unwrap().as_slice().to_vec())
}

#[test]
fn the_same_seed_gives_the_same_policy_in_randomised_worlds_too() {
    let config = randomised(&short());
    config.check().unwrap();
    let first = train(&config, Isa::best());
    assert!(first == train(&config, Isa::Baseline));
    let policy = leg_control::policy::Policy::parse(&first.1).unwrap();
    let manifest = policy.manifest();
    assert_eq!(toml::from_str::<Config>(manifest.provenance.config).unwrap(), config);
    assert_eq!(manifest.media.gravity_m_s2, [0.95_f32 * 9.81, 1.05 * 9.81]);
}

#[test]
fn each_quantity_changes_the_training_and_none_of_them_changes_nothing() {
    let mut base = short();
    base.stages[0].length = Length::Steps(600);
    base.selection.evaluations = 0;
    let exact = train(&base, Isa::best()).0;
    let with = |randomisation: Randomisation| {
        let config = Config { randomisation: Some(randomisation), ..base.clone() };
        config.check().unwrap();
        train(&config, Isa::best()).0
    };
    assert!(with(Randomisation::default()) == exact);
    for parameter in Parameter::ALL {
        let distribution = Distribution::Uniform { low: 0.1, high: 0.9 };
        let table = Randomisation::default().with(parameter, distribution);
        assert!(with(table) != exact, "{parameter:?}");
    }
}

#[test]
fn a_printed_table_reads_back_with_a_comment_at_every_key() {
    let config = randomised(&Preset::Robust.config());
    let text = config.to_commented_toml();
    assert_eq!(toml::from_str::<Config>(&text).unwrap(), config, "{text}");
    for line in [
        "# Factor of the dry mass, of an episode: from 0.1 to 10\n[randomisation.mass]\n",
        "# Lowest value [N s/m]: from 0 to 1000\nlow = 1.0\n",
        "# Standard deviation before clipping: above 0, at most 1000000\ndeviation = 0.02\n",
        "# Share of episodes that are randomised: from 0 to 1\nshare = 0.75\n",
        "# randomisation.delay_s: Time after an apex",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    assert!(!text.contains("# randomisation.mass"), "{text}");
    // Without the table, every quantity is named, and the files of before have the same bits.
    let without = Preset::Robust.config();
    for parameter in Parameter::ALL {
        let line = format!("# randomisation.{}: ", parameter.key());
        assert!(without.to_commented_toml().contains(&line), "{line}");
    }
    assert!(!without.to_toml().contains("randomisation"));
    assert_eq!(without.difference(&config).unwrap(), "randomisation is missing in one",);
}

#[test]
fn refuses_a_distribution_with_its_key_value_and_limit() {
    let robust = Preset::Robust.config();
    for (setting, message) in [
        (
            r#"mass={ kind = "uniform", low = 0, high = 1 }"#,
            "randomisation.mass.low is 0, but must be from 0.1 to 10",
        ),
        (
            r#"mass={ kind = "uniform", low = 1.2, high = 0.8 }"#,
            "randomisation.mass.low to high is 1.2 to 0.8, but must be low to high",
        ),
        (r#"mass={ kind = "uniform", low = nan, high = 1 }"#, "randomisation.mass.low is NaN"),
        (
            r#"foot_mass_kg={ kind = "uniform", low = 0, high = 11 }"#,
            "randomisation.foot_mass_kg.high is 11, but must be from 0 to 10",
        ),
        (
            r#"friction={ kind = "uniform", low = 0, high = 1 }"#,
            "randomisation.friction.low is 0, but must be from 0.05 to 2",
        ),
        (
            r#"delay_s={ kind = "uniform", low = -0.1, high = 1 }"#,
            "randomisation.delay_s.low is -0.1, but must be from 0 to 1",
        ),
        (
            r#"damping_n_s_m={ kind = "log-uniform", low = 0, high = 1 }"#,
            "randomisation.damping_n_s_m.low is 0, but must be above 0 for a log-uniform",
        ),
        (
            r#"ground_m={ kind = "normal", mean = 0, deviation = 0, low = -1, high = 1 }"#,
            "randomisation.ground_m.deviation is 0, but must be above 0",
        ),
        (
            r#"bias_y_m={ kind = "normal", mean = 99, deviation = 1, low = -1, high = 1 }"#,
            "randomisation.bias_y_m.mean is 99, but must be from -10 to 10",
        ),
        ("share=2", "randomisation.share is 2, but must be from 0 to 1"),
    ] {
        let changed = robust.with(&format!("randomisation.{setting}")).unwrap();
        let error = changed.check().unwrap_err().to_string();
        assert!(error.contains(message), "{setting}: {error}");
        let error = changed.randomisation.unwrap().check().unwrap_err().to_string();
        assert!(error.contains(message), "{setting}: {error}");
    }
    for (setting, message) in [
        ("weight=1", "no key weight here"),
        (r#"mass={ kind = "triangular", low = 1, high = 1 }"#, "triangular"),
        (r#"mass={ kind = "uniform", low = 1 }"#, "missing field `high`"),
        (r#"mass={ kind = "uniform", low = 1, high = 1, mean = 1 }"#, "unknown field `mean`"),
        ("mass=1.2", "expected"),
    ] {
        let error = robust.with(&format!("randomisation.{setting}")).unwrap_err().to_string();
        assert!(error.contains(message), "{setting}: {error}");
    }
}

#[test]
fn reads_a_table_alone_or_out_of_a_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.toml");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Randomisation::read(&path).map_err(|error| error.to_string())
    };
    let config = randomised(&Preset::Robust.config());
    let table = config.randomisation.clone().unwrap();
    assert_eq!(read(&config.to_commented_toml()).unwrap(), table);
    let alone = "[randomisation]\nmass = { kind = \"uniform\", low = 0.8, high = 1.2 }\n";
    let mass = Randomisation::default()
        .with(Parameter::Mass, Distribution::Uniform { low: 0.8, high: 1.2 });
    assert_eq!(read(alone).unwrap(), mass);
    for (text, message) in [
        (Preset::Robust.config().to_toml(), "it has no table [randomisation]"),
        (alone.replace("0.8", "0.01"), "randomisation.mass.low is 0.01, but must be from 0.1"),
        (alone.replace("mass", "mas"), "unknown field `mas`"),
        (format!("{alone}[other]\n"), "unknown field `other`"),
    ] {
        let error = read(&text).unwrap_err();
        assert!(error.starts_with(&path.display().to_string()), "{error}");
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn refuses_what_is_no_distribution_in_the_words_of_the_configuration() {
    for value in ["1", "'uniform'"] {
        let error = short().with(&format!("randomisation.mass={value}")).unwrap_err().to_string();
        assert!(error.contains("expected a distribution, such as { kind = "), "{error}");
    }
}
