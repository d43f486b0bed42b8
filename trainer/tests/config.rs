//! Printing, reading and checking configurations.

use clap::ValueEnum;
use trainer::config::{Config, ReadError};
use trainer::preset::Preset;

fn presets() -> impl Iterator<Item = Config> {
    Preset::value_variants().iter().map(|preset| preset.config())
}

#[test]
fn a_printed_configuration_reads_back_and_has_a_comment_at_every_key() {
    for config in presets() {
        config.check().unwrap();
        let text = config.to_commented_toml();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), config, "{text}");
        assert_eq!(toml::from_str::<Config>(&config.to_toml()).unwrap(), config);
        let lines: Vec<&str> = text.lines().collect();
        let mut keys = 0;
        for pair in lines.windows(2) {
            if !pair[1].is_empty() && !pair[1].starts_with('#') {
                keys += 1;
                assert!(pair[0].starts_with("# "), "{} has no comment in {text}", pair[1]);
            }
        }
        assert!(keys > 40, "{keys}");
    }
}

#[test]
fn refuses_a_parameter_with_its_key_value_and_limit() {
    let robust = Preset::Robust.config();
    for (setting, message) in [
        ("learning.batch=33", "learning.batch is 33, but must be 32 or 64"),
        ("learning.discount=1", "learning.discount is 1, but must be from 0 to below 1"),
        ("learning.discount=nan", "learning.discount is NaN"),
        ("learning.steps_per_update=0", "learning.steps_per_update is 0, but must be whole"),
        ("learning.max_gradient_norm=-inf", "learning.max_gradient_norm is -inf"),
        ("learning.replay_capacity=40", "learning.replay_capacity is 40, but must be at least"),
        ("network.observation_scale=[1, inf, 1]", "network.observation_scale[1] is inf"),
        ("network.action_scale=[0, 1]", "network.action_scale[0] is 0, but must be above 0"),
        ("network.action_low=[0.5, 3]", "action_high[1] is 3 to 2, but must be low to high"),
        ("network.action_high=[4, 2]", "but must be low to high, within 0 to pi rad"),
        (
            "network.action_offset=[1.5707964, 9]",
            "network.output_bound is 1, but must be such that",
        ),
        ("network.observation_offset=[1, 2.5, 0.5]", "network.symmetric_actor is true, but must"),
        ("episode.retry_share=2", "episode.retry_share is 2, but must be from 0 to 1"),
        ("episode.led_from=[0.9, 0.5]", "episode.led_from is [0.9, 0.5], but must be above 0"),
        ("episode.led_from=[0, 0.5]", "episode.led_from is [0, 0.5], but must be above 0"),
        ("reward.cap=nan", "reward.cap is NaN, but must be above 0, or inf"),
        ("reward.fall=inf", "reward.fall is inf"),
        ("reward.elongation=-0.1", "reward.elongation is -0.1, but must be from 0 to 1000"),
        ("reward.height_m=1", "reward.height_m is 1, but must be above 1, at most 100"),
        ("exploration.deviation=[0.4, 0.1]", "exploration.deviation is [0.4, 0.1]"),
        ("exploration.deviation=[0, 0.1]", "exploration.deviation[0] is 0, but must be above 0"),
        ("episode.max_steps=0", "episode.max_steps is 0"),
        ("episode.spread=inf", "episode.spread is inf"),
        ("episode.low_share=0.95", "episode.low_share + episode.uniform_share is "),
        ("stages=[]", "stages is 0, but must be 1 to 16 of them"),
        ("stages.0.length.steps=0", "stages[0].length.steps is 0, but must be whole"),
        ("stages.0.medium.air=0.9", "stages.medium.air + thin + water is 1.2"),
        ("stages.0.medium.thin_to=2", "stages[0].medium.thin_to is 2, but must be from 0 to 1"),
        ("selection.starts=0", "selection.evaluations is 60, but must be 0, unless"),
        ("selection.starts=2000000", "selection.starts is 2000000"),
        ("preset=", "preset is \"\", but must be 1 to 64 bytes"),
    ] {
        let error = robust.with(setting).unwrap().check().unwrap_err().to_string();
        assert!(error.contains(message), "{setting}: {error}");
    }
    let mut gains = Preset::Air.config();
    gains.gains[0].limit_m_s = 101.0;
    assert!(gains.check().unwrap_err().to_string().starts_with("gains[0].limit_m_s is 101,"));
    gains.gains[0].limit_m_s = 1.0;
    gains.gains.push(gains.gains[0]);
    assert!(gains.check().unwrap_err().to_string().contains("but must be ascending"));
    let mut noise = Preset::Air.config();
    noise = noise.with("exploration.decay=1").unwrap();
    assert!(noise.check().unwrap_err().to_string().starts_with("exploration.decay is 1,"));
}

#[test]
fn sets_a_parameter_by_its_key() {
    let robust = Preset::Robust.config();
    let changed = robust.with("learning.batch=32").unwrap();
    assert_eq!(changed.learning.batch, 32);
    assert_eq!(robust.with("network.critic = joint-50").unwrap().preset, "robust");
    assert_eq!(robust.difference(&robust), None);
    assert_eq!(
        robust.difference(&changed).unwrap(),
        "learning.batch is 64 in one and 32 in the other"
    );
    for (setting, message) in [
        ("learning.batch", "expected KEY=VALUE"),
        ("learning.bach=32", "learning.bach=32: no key bach here"),
        ("learning.batch=many", "string \"many\", expected a whole number from 0"),
        ("stages.7.length.steps=1", "no key 7 here"),
        ("network.critic=joint-70", "joint-70"),
    ] {
        let error = robust.with(setting).unwrap_err().to_string();
        assert!(error.contains(message), "{setting}: {error}");
    }
}

#[test]
fn refuses_a_file_with_its_name_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.toml");
    let good = Preset::WaterToAir.config().to_commented_toml();
    for (from, to, message) in [
        ("discount", "discuont", "unknown field `discuont`"),
        ("attraction", "atraction", "unknown field `atraction`"),
        ("discount = 0.6", "discount = \"0.6\"", "string \"0.6\", expected f32"),
        ("discount = 0.6", "", "missing field `discount`"),
        ("discount = 0.6", "discount = 1.5", "learning.discount is 1.5, but must be from 0"),
        ("max_steps = 5", "max_steps = -5", "invalid value: integer `-5`"),
    ] {
        let text = good.replacen(from, to, usize::MAX);
        std::fs::write(&path, text).unwrap();
        let error = Config::read(&path).unwrap_err().to_string();
        assert!(error.starts_with(&path.display().to_string()), "{error}");
        assert!(error.contains(message), "{to}: {error}");
    }
    let missing = Config::read(&folder.path().join("none.toml")).unwrap_err();
    assert!(matches!(missing, ReadError::Read { .. }));
}
