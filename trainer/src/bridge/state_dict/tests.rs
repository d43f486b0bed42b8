//! State dicts of several programs.

use super::{StateDictOptions, find};
use leg_control::actor::OutputActivation;

type Shapes<'a> = &'a [(&'a str, &'a [usize])];

/// Returns the layers that are found, and what is ignored.
fn found(tensors: Shapes<'_>, options: StateDictOptions<'_>) -> Result<[String; 2], String> {
    let found = find(tensors, &options).map_err(|e| e.to_string())?;
    Ok([super::names_of(&found.row), found.ignored.join(",")])
}

fn names(tensors: Shapes<'_>, layers: Option<&str>) -> Result<String, String> {
    let layers: Option<Vec<String>> = layers.map(|l| l.split(',').map(String::from).collect());
    let options = StateDictOptions { layers: layers.as_deref(), ..Default::default() };
    found(tensors, options).map(|[layers, _]| layers)
}

#[test]
fn finds_a_sequential_in_numerical_order_of_its_layers() {
    let found =
        names(&[("10.weight", &[2, 6]), ("2.weight", &[6, 5]), ("0.weight", &[5, 3])], None);
    assert_eq!(found.unwrap(), "0,2,10");
    let found = names(
        &[("a.fc_mu.weight", &[2, 6]), ("a.fc1.weight", &[5, 3]), ("a.fc2.weight", &[6, 5])],
        None,
    );
    assert_eq!(found.unwrap(), "a.fc1,a.fc2,a.fc_mu");
}

#[test]
fn takes_the_order_of_square_layers_from_their_numbers_or_asks() {
    let of = |first: &str, second: &str| {
        let (first, second) = (format!("{first}.weight"), format!("{second}.weight"));
        names(
            &[
                ("out.weight", &[2, 9]),
                (&first, &[9, 9]),
                (&second, &[9, 9]),
                ("in.weight", &[9, 3]),
            ],
            None,
        )
    };
    for (first, second) in
        [("fc2", "fc10"), ("hidden", "hidden_2"), ("l1_fc", "l2_fc"), ("mid-1", "mid-2")]
    {
        assert_eq!(of(first, second).unwrap(), format!("in,{first},{second},out"));
        assert_eq!(of(second, first).unwrap(), format!("in,{first},{second},out"));
    }
    for (first, second) in [("alpha", "beta"), ("first", "second"), ("fc1", "hidden2")] {
        let error = of(first, second).unwrap_err();
        assert!(error.starts_with("2 rows of layers could be the actor: in,"), "{error}");
        assert!(error.contains(&format!("in,{second},{first},out")), "{error}");
    }
}

#[test]
fn finds_the_actor_beside_critics_but_asks_beside_its_target() {
    let critic: Shapes<'_> = &[("critic.0.weight", &[9, 5]), ("critic.2.weight", &[1, 9])];
    let actor: Shapes<'_> = &[("actor.mu.0.weight", &[9, 3]), ("actor.mu.2.weight", &[2, 9])];
    let target: Shapes<'_> =
        &[("actor_target.mu.0.weight", &[9, 3]), ("actor_target.mu.2.weight", &[2, 9])];
    let both = [critic, actor].concat();
    assert_eq!(
        found(&both, StateDictOptions::default()).unwrap(),
        ["actor.mu.0,actor.mu.2", "critic.0.weight,critic.2.weight"]
    );
    let all = [critic, actor, target].concat();
    assert_eq!(
        names(&all, None).unwrap_err(),
        "2 rows of layers could be the actor: actor.mu.0,actor.mu.2 or \
         actor_target.mu.0,actor_target.mu.2"
    );
    let chosen = names(&all, Some("actor.mu.0,actor.mu.2"));
    assert_eq!(chosen.unwrap(), "actor.mu.0,actor.mu.2");
}

#[test]
fn layers_of_several_modules_can_be_named() {
    // An SB3 SAC policy has these layers.
    let sac: Shapes<'_> = &[
        ("latent_pi.0.weight", &[7, 3]),
        ("mu.weight", &[2, 7]),
        ("log_std.weight", &[2, 7]),
        ("log_std.bias", &[2]),
    ];
    let error = names(sac, None).unwrap_err();
    assert!(error.contains("log_std (7 to 2), mu (7 to 2), latent_pi.0 (3 to 7)"), "{error}");
    let paths = ["latent_pi.0".to_owned(), "mu".to_owned()];
    let options = StateDictOptions { layers: Some(&paths), ..Default::default() };
    assert_eq!(found(sac, options).unwrap(), ["latent_pi.0,mu", "log_std.weight,log_std.bias"]);
    let error = names(sac, Some("latent_pi.0,nu")).unwrap_err();
    assert!(error.starts_with("layers: no \"nu.weight\" of two dimensions, expected"), "{error}");
    let error = names(sac, Some("mu")).unwrap_err();
    assert!(error.starts_with("layers: mu (7 to 2), expected from 3 to 2"), "{error}");
    assert!(names(&[], None).unwrap_err().contains("it holds no linear layers"));
}

/// An actor in the module `net.pi`, with other tensors beside it.
fn beside(more: Shapes<'_>) -> Vec<super::Named<'_>> {
    let actor: Shapes<'_> = &[
        ("net.pi.0.weight", &[9, 3]),
        ("net.pi.0.bias", &[9]),
        ("net.pi.2.weight", &[2, 9]),
        ("net.pi.2.bias", &[2]),
    ];
    [actor, more].concat()
}

#[test]
fn refuses_by_name_a_tensor_that_could_change_the_actions() {
    let cases: [(&str, &[usize], &str); 12] = [
        ("net.pi.1.weight", &[9], "perhaps a normalisation"),
        ("net.pi.1.running_var", &[9], "batch normalisation; fold it"),
        ("net.pi.1.num_batches_tracked", &[], "batch normalisation; fold it"),
        ("net.rnn.weight_ih_l0", &[36, 9], "a recurrent layer"),
        ("net.pi.0.weight_g", &[9, 1], "weight normalisation"),
        ("obs_rms.running_mean", &[3], "perhaps a scaling of the observation"),
        ("net.obs_rms.var", &[3], "perhaps a scaling of the observation"),
        ("normalizer._std", &[3], "perhaps a scaling of the observation"),
        ("std", &[3], "perhaps a scaling of the observation"),
        ("action_bias", &[1, 2], "a scaling of the actions, not in a pair"),
        ("encoder.0.weight", &[3, 3], "perhaps another layer"),
        ("net.pi.value_norm.weight", &[9], "perhaps a normalisation"),
    ];
    for (name, shape, kind) in cases {
        let tensors = [(name, shape)];
        let all = beside(&tensors);
        let error = find(&all, &StateDictOptions::default()).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{name:?} {shape:?}")), "{error}");
        assert!(error.contains(kind) && error.contains("net.pi.0,net.pi.2"), "{error}");
        // The user says that it does not count; a module stands for all in it.
        for ignored in [name, name.rsplit_once('.').map_or(name, |(module, _)| module)] {
            let ignored = [ignored.to_owned()];
            let options = StateDictOptions { ignored: &ignored, ..Default::default() };
            assert_eq!(found(&all, options).unwrap()[1], name);
        }
        let part = [name[..name.len() - 1].to_owned()];
        let options = StateDictOptions { ignored: &part, ..Default::default() };
        assert!(find(&all, &options).is_err());
    }
}

#[test]
fn ignores_other_networks_and_names_them() {
    for name in [
        "critic.1.weight",
        "q1.0.bias",
        "net.vf.norm.weight",
        "value_net.weight",
        "target_net.pi.1.weight",
        "qf2.fc.weight",
        "optimizer.step",
    ] {
        let tensors: [(&str, &[usize]); 1] = [(name, &[9])];
        let all = beside(&tensors);
        assert_eq!(found(&all, StateDictOptions::default()).unwrap()[1], name);
    }
}

#[test]
fn asks_about_the_output_of_an_actor_with_a_fixed_deviation() {
    for name in ["log_std", "net.pi.logstd", "actor_logstd", "std", "a2c_network.sigma"] {
        let tensors: [(&str, &[usize]); 1] = [(name, &[1, 2])];
        let all = beside(&tensors);
        let error = find(&all, &StateDictOptions::default()).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{name:?}: a standard deviation")), "{error}");
        let options =
            StateDictOptions { output: Some(OutputActivation::Tanh), ..Default::default() };
        assert_eq!(found(&all, options).unwrap()[1], name);
    }
}

#[test]
fn applies_the_scale_and_bias_nearest_to_the_actor() {
    let pairs: Shapes<'_> = &[
        ("action_scale", &[2]),
        ("action_bias", &[2]),
        ("net.action_scale", &[1, 2]),
        ("net.action_bias", &[1, 2]),
    ];
    let of = |tensors| find(&beside(tensors), &StateDictOptions::default());
    let near = ["net.action_scale".to_owned(), "net.action_bias".to_owned()];
    assert_eq!(of(&pairs[2..]).unwrap().scale_and_bias, Some(near));
    let far = ["action_scale".to_owned(), "action_bias".to_owned()];
    assert_eq!(of(&pairs[..2]).unwrap().scale_and_bias, Some(far));
    // Those that are not applied could be meant.
    assert!(
        of(pairs).unwrap_err().to_string().starts_with("\"action_scale\" [2], \"action_bias\"")
    );
}
