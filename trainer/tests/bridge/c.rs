//! The exported C is compiled and run, and must give the bits of the controller's actor.

use crate::activations::actors;
use leg_control::actor::{Activations, Actor, Observation, ObservationScaling};
use leg_control::policy::{Policy, SHIPPED};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::Path;
use std::process::Command;
use trainer::Layer;
use trainer::bridge::c;
use trainer::bridge::model_card::ModelCard;
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

/// What a warning in any of them would end.
const WARNINGS: [&str; 4] = ["-Wall", "-Wextra", "-Werror", "-pedantic"];

fn gcc(folder: &Path, arguments: &[&str]) {
    compile("gcc", folder, &["-std=c99"], arguments);
}

fn compile(compiler: &str, folder: &Path, options: &[&str], arguments: &[&str]) {
    let output = Command::new(compiler)
        .args(options)
        .args(WARNINGS)
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{options:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Returns options under which compilers fuse products and sums, on a CPU that can.
fn fusing() -> Vec<Vec<&'static str>> {
    let mut all = vec![vec!["-O2"], vec!["-O0"]];
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("fma") {
        all.push(vec!["-O2", "-mfma"]);
        all.push(vec!["-O3", "-march=native", "-ffp-contract=fast"]);
        all.push(vec!["-Os", "-mfma", "-flto"]);
        all.push(vec!["-O2", "-mfma", "-DLEG_NO_ASM"]);
    }
    all
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

/// Compiles the actor with a driver and checks its actions for these observations.
fn agree(policy: &Policy<'_>, observations: &[[f32; 3]], compiler: &str, options: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("leg_actor.c"), c::export(policy, &[], c::PREFIX)).unwrap();
    std::fs::write(folder.path().join("driver.c"), DRIVER).unwrap();
    compile(compiler, folder.path(), options, &["leg_actor.c", "driver.c", "-o", "driver"]);
    std::fs::write(folder.path().join("in"), bytemuck::cast_slice::<_, u8>(observations)).unwrap();
    let output = Command::new(folder.path().join("driver"))
        .stdin(std::fs::File::open(folder.path().join("in")).unwrap())
        .output()
        .unwrap();
    assert!(output.status.success());
    let (actions, _) = output.stdout.as_chunks::<8>();
    assert_eq!(actions.len(), observations.len());
    for (observation, action) in observations.iter().zip(actions) {
        let own = act(policy.actor(), *observation).map(f32::to_le_bytes);
        assert_eq!(*action, *own.as_flattened(), "{options:?}: {observation:?}");
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
    let observations = observations(&mut Pcg64::seed_from_u64(11), 200_000);
    agree(&policy, &observations, "gcc", &["-std=c99", "-O2"]);
}

#[test]
fn no_dialect_or_option_of_gcc_changes_a_bit() {
    if !requirements::gcc() {
        return;
    }
    let policy = Policy::parse(SHIPPED).unwrap();
    let observations = observations(&mut Pcg64::seed_from_u64(12), 20_000);
    for options in fusing() {
        agree(&policy, &observations, "gcc", &options);
    }
}

#[test]
fn no_option_of_clang_changes_a_bit() {
    if !requirements::clang() {
        return;
    }
    let policy = Policy::parse(SHIPPED).unwrap();
    let observations = observations(&mut Pcg64::seed_from_u64(13), 20_000);
    // Clang states none of the parts of -ffast-math but -ffinite-math-only.
    let parts = ["-O3", "-funsafe-math-optimizations", "-ffp-contract=fast"];
    for mut options in fusing().into_iter().chain([parts.to_vec()]) {
        options.retain(|o| *o != "-flto");
        agree(&policy, &observations, "clang", &options);
    }
}

#[test]
fn options_that_change_operations_are_refused_where_gcc_states_them() {
    if !requirements::gcc() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let policy = Policy::parse(SHIPPED).unwrap();
    std::fs::write(folder.path().join("a.c"), c::export(&policy, &[], c::PREFIX)).unwrap();
    let compiled = |options: &[&str]| {
        let mut gcc = Command::new("gcc");
        let output = gcc.args(options).args(["-c", "a.c"]).current_dir(folder.path()).output();
        let error = String::from_utf8(output.unwrap().stderr).unwrap();
        (!error.contains("#error"), error)
    };
    for option in ["-ffast-math", "-Ofast", "-ffinite-math-only"] {
        let (passed, error) = compiled(&[option]);
        assert!(!passed && error.contains("compile without -ff"), "{option}: {error}");
    }
    // Half precision that is computed as such leaves float as it is.
    let (passed, error) = compiled(&["-Wno-builtin-macro-redefined", "-D__FLT_EVAL_METHOD__=16"]);
    assert!(passed, "{error}");
    for method in ["1", "2", "-1", "32"] {
        let method = format!("-D__FLT_EVAL_METHOD__={method}");
        let (passed, _) = compiled(&["-Wno-builtin-macro-redefined", &method]);
        assert!(!passed, "{method}");
    }
}

/// Two actors in one program, called from C++.
const TWO: &str = r#"
extern "C" void left_actor(const float observation[3], float action[2]);
extern "C" void right_actor(const float observation[3], float action[2]);
int main()
{
    const float observation[3] = { 0.5f, 2.0f, 0.3f };
    float left[2], right[2];
    left_actor(observation, left);
    right_actor(observation, right);
    return left[0] == right[0] && left[1] == right[1] ? 0 : 1;
}
"#;

#[test]
fn two_exports_are_linked_into_one_program_of_cpp() {
    if !requirements::gxx() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| {
        let mut trainer = Command::new(env!("CARGO_BIN_EXE_trainer"));
        trainer.args(line.split(' ')).current_dir(folder.path()).output().unwrap()
    };
    for side in ["left", "right"] {
        let output = run(&format!("export --to c --prefix {side} {side}.c"));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    std::fs::write(folder.path().join("two.cpp"), TWO).unwrap();
    gcc(folder.path(), &["-c", "left.c"]);
    // As C++, too.
    compile("g++", folder.path(), &["-std=c++17"], &["-c", "-x", "c++", "right.c"]);
    compile("g++", folder.path(), &[], &["two.cpp", "left.o", "right.o", "-o", "two"]);
    assert!(Command::new(folder.path().join("two")).status().unwrap().success());
    for prefix in ["", "2leg", "Leg", "left_leg_of_it", "a__b", "a-b"] {
        let output = run(&format!("export --to c --prefix={prefix} x.c"));
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains(&format!("--prefix: '{prefix}': a prefix is")), "{error}");
    }
    let output = run("export --to onnx --prefix a x.onnx");
    assert!(String::from_utf8_lossy(&output.stderr).contains("for --to c only"));
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
    let (relu, identity) = (Activations::default(), ObservationScaling::IDENTITY);
    let packed = PackedActor::new(&[layer], relu, identity, packed.action).unwrap();
    let blob =
        blob_with_manifest(&ModelCard::from(&policy).manifest(&packed), &packed.weights).unwrap();
    let policy = Policy::parse(blob.as_slice()).unwrap();
    let strict = ["-std=c99", "-O2"];
    agree(&policy, &observations(&mut Pcg64::seed_from_u64(11), 50_000), "gcc", &strict);
    // Covers every exponent from subnormal to infinite, with 4,000 fractions each.
    let observations: Vec<[f32; 3]> =
        (0..u32::MAX).step_by(2087).map(f32::from_bits).map(|x| [x, -x, 0.0]).collect();
    agree(&policy, &observations, "gcc", &strict);
}

#[test]
fn every_activation_has_the_bits_of_the_controller() {
    if !requirements::gcc() {
        return;
    }
    let observations = observations(&mut Pcg64::seed_from_u64(12), 20_000);
    for (_, blob) in actors() {
        let policy = Policy::parse(blob.as_slice()).unwrap();
        agree(&policy, &observations, "gcc", &["-std=c99", "-O2"]);
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
