//! The exported C is compiled and run, and must give the bits of the controller's actor.

use leg_control::actor::{Actor, Observation, ObservationScaling};
use leg_control::policy::{Policy, SHIPPED};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::Path;
use std::process::Command;
use trainer::bridge::c;
use trainer::bridge::model_card::ModelCard;
use trainer::net::mlp::Layer;
use trainer::policy::{PackedActor, blob_with_manifest};

/// A program that reads observations and writes actions, both as their bits.
const DRIVER: &str = r"
#include <stdio.h>
void leg_actor(const float observation[3], float action[2]);
int main(void)
{
    float observation[3], action[2];
    while (fread(observation, sizeof observation, 1, stdin) == 1) {
        leg_actor(observation, action);
        if (fwrite(action, sizeof action, 1, stdout) != 1)
            return 1;
    }
    return 0;
}
";

fn gcc(folder: &Path, arguments: &[&str]) {
    let strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"];
    let output =
        Command::new("gcc").args(strict).args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Draws observations within the trained range and far outside: huge, tiny, subnormal, zeros of
/// both signs, infinities and NaN.
fn observations(rng: &mut Pcg64, count: usize) -> Vec<[f32; 3]> {
    let special = [
        0.0,
        -0.0,
        f32::from_bits(1),
        -f32::from_bits(0x7f_ffff),
        f32::MIN_POSITIVE,
        1e-30,
        -1e-10,
        1e10,
        -3e38,
        f32::MAX,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    let mut one = |low: f32, high: f32| match rng.random_range(0..20) {
        0 => special[rng.random_range(0..special.len())],
        1 => f32::from_bits(rng.random()),
        2 => rng.random_range(-300.0..300.0),
        _ => rng.random_range(low..high),
    };
    (0..count).map(|_| [one(-11.0, 11.0), one(1.0, 12.5), one(0.0, 1.0)]).collect()
}

fn agree(policy: &Policy<'_>, count: usize, optimisation: &str) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("leg_actor.c"), c::export(policy, &[])).unwrap();
    std::fs::write(folder.path().join("driver.c"), DRIVER).unwrap();
    gcc(folder.path(), &[optimisation, "leg_actor.c", "driver.c", "-o", "driver"]);
    let observations = observations(&mut Pcg64::seed_from_u64(11), count);
    std::fs::write(folder.path().join("in"), bytemuck::cast_slice::<_, u8>(&observations)).unwrap();
    let output = Command::new(folder.path().join("driver"))
        .stdin(std::fs::File::open(folder.path().join("in")).unwrap())
        .output()
        .unwrap();
    assert!(output.status.success());
    let (actions, _) = output.stdout.as_chunks::<8>();
    assert_eq!(actions.len(), count);
    for (observation, action) in observations.iter().zip(actions) {
        let [vx, y, rho] = *observation;
        let own = act(policy.actor(), [vx, y, rho]).map(f32::to_le_bytes);
        assert_eq!(*action, *own.as_flattened(), "{observation:?}");
    }
}

fn act(actor: &Actor<'_>, [vx, y, rho]: [f32; 3]) -> [f32; 2] {
    let action = actor.act(Observation { apex_vx_m_s: vx, apex_y_m: y, density_ratio: rho });
    [action.touchdown_angle_rad, action.elongation_speed_m_s]
}

#[test]
fn the_exported_c_computes_the_controllers_bits() {
    if !requirements::gcc() {
        return;
    }
    let policy = Policy::parse(SHIPPED).unwrap();
    agree(&policy, 200_000, "-O2");
    agree(&policy, 20_000, "-O0");
}

/// Uses one layer that passes an observation's numbers to tanh, so that every branch of tanh is
/// covered.
#[test]
fn the_exported_tanh_equals_libms_on_every_branch() {
    if !requirements::gcc() {
        return;
    }
    let policy = Policy::parse(SHIPPED).unwrap();
    let mut packed = PackedActor::from(&policy);
    let weights = vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let layer = Layer { inputs: 3, weights, bias: vec![0.0; 2] };
    packed.action.scale = [1.0; 2];
    packed.action.offset = [0.0; 2];
    (packed.action.low, packed.action.high) = ([0.0; 2], [1.0; 2]);
    let packed = PackedActor::new(&[layer], ObservationScaling::IDENTITY, packed.action).unwrap();
    let blob =
        blob_with_manifest(&ModelCard::from(&policy).manifest(&packed), &packed.weights).unwrap();
    let policy = Policy::parse(blob.as_slice()).unwrap();
    agree(&policy, 50_000, "-O2");
    // Covers every exponent from subnormal to infinite, with 4,000 fractions each.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("leg_actor.c"), c::export(&policy, &[])).unwrap();
    std::fs::write(folder.path().join("driver.c"), DRIVER).unwrap();
    gcc(folder.path(), &["-O2", "leg_actor.c", "driver.c", "-o", "driver"]);
    let observations: Vec<[f32; 3]> =
        (0..u32::MAX).step_by(2087).map(f32::from_bits).map(|x| [x, -x, 0.0]).collect();
    std::fs::write(folder.path().join("in"), bytemuck::cast_slice::<_, u8>(&observations)).unwrap();
    let output = Command::new(folder.path().join("driver"))
        .stdin(std::fs::File::open(folder.path().join("in")).unwrap())
        .output()
        .unwrap();
    let (actions, _) = output.stdout.as_chunks::<8>();
    assert_eq!(actions.len(), observations.len());
    for (observation, action) in observations.iter().zip(actions) {
        let own = act(policy.actor(), *observation).map(f32::to_le_bytes);
        assert_eq!(*action, *own.as_flattened(), "{observation:?}");
    }
}

#[test]
fn the_c_self_test_passes_and_fails_after_a_change() {
    if !requirements::gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_trainer"))
        .args(["export", "--to", "c", "leg_actor.c"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let status = || {
        gcc(folder.path(), &["-O2", "-DLEG_ACTOR_SELF_TEST", "leg_actor.c", "-o", "self_test"]);
        Command::new(folder.path().join("self_test")).status().unwrap().code()
    };
    assert_eq!(status(), Some(0));
    // Changes one bias slightly.
    let path = folder.path().join("leg_actor.c");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replacen("float sum = bias[j];", "float sum = bias[j] + 1e-5f;", 1))
        .unwrap();
    assert_eq!(status(), Some(1));
}
