//! The exported C as firmware: compiled by GCC in its default dialect, which fuses products and
//! sums wherever the processor can, and run in the emulator.

use leg_control::actor::{Action, Observation};
use leg_control::policy::{Policy, SHIPPED, TestVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::Path;
use std::process::Command;
use trainer::bridge::c;

/// Starts the self-test and reports its result to the emulator by semihosting.
const START: &str = r#"
#include <stdint.h>
int main(void);
static void start(void)
{
    /* Gives full access to the floating-point unit. */
    *(volatile uint32_t *)0xe000ed88u |= 0xf00000u;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
    static uint32_t report[2];
    report[0] = 0x20026u; /* the application ended, with this status: */
    report[1] = (uint32_t)main();
    register uint32_t operation __asm__("r0") = 0x20; /* SYS_EXIT_EXTENDED */
    register uint32_t *argument __asm__("r1") = report;
    __asm__ volatile("bkpt 0xab" : "+r"(operation) : "r"(argument) : "memory");
    for (;;)
        ;
}
extern char stack_end[];
__attribute__((section(".vectors"), used)) static void *const vectors[2] = {
    stack_end, (void *)start
};
"#;

/// A processor, its options in GCC, and a machine of the emulator with it.
struct Target {
    options: &'static [&'static str],
    machine: &'static str,
    code: u32,
    ram: u32,
}

const TARGETS: [Target; 4] = [
    Target {
        options: &["-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"],
        machine: "mps2-an386",
        code: 0,
        ram: 0x2000_0000,
    },
    Target {
        options: &["-mcpu=cortex-m7", "-mfloat-abi=hard", "-mfpu=fpv5-d16"],
        machine: "mps2-an500",
        code: 0,
        ram: 0x2000_0000,
    },
    Target {
        options: &["-mcpu=cortex-m33", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"],
        machine: "mps2-an505",
        code: 0x1000_0000,
        ram: 0x3800_0000,
    },
    // Its FLT_EVAL_METHOD is 16: it computes in half precision, too.
    Target {
        options: &["-mcpu=cortex-m55", "-mfloat-abi=hard"],
        machine: "mps3-an547",
        code: 0,
        ram: 0x2000_0000,
    },
];

/// Returns the lines of the linker's script.
fn script(target: &Target) -> String {
    format!(
        "SECTIONS {{\n\
         . = {:#x}; .text : {{ KEEP(*(.vectors)) *(.text*) *(.rodata*) }}\n\
         . = {:#x}; .data : {{ *(.data*) *(.bss*) *(COMMON) }}\n\
         stack_end = {:#x};\n}}\n",
        target.code,
        target.ram,
        target.ram + 0x1_0000,
    )
}

/// Builds an image of the self-test.
fn build(folder: &Path, target: &Target, options: &[&str]) {
    std::fs::write(folder.join("link.ld"), script(target)).unwrap();
    let output = Command::new("arm-none-eabi-gcc")
        .args(["-ffreestanding", "-nostdlib", "-mthumb", "-DLEG_ACTOR_SELF_TEST", "-Wall"])
        .args(target.options)
        .args(options)
        .args(["-T", "link.ld", "start.c", "leg_actor.c", "-o", "image", "-lgcc"])
        .current_dir(folder)
        .output()
        .unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{}: {error}", target.machine);
}

/// Runs the image in the emulator and returns its status.
fn run(folder: &Path, target: &Target) -> Option<i32> {
    let output = Command::new("qemu-system-arm")
        .args(["-machine", target.machine, "-display", "none", "-monitor", "none"])
        .args(["-serial", "none", "-nic", "user,restrict=on"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel", "image"])
        .current_dir(folder)
        .output()
        .unwrap();
    output.status.code()
}

/// Returns observations with the controller's actions.
fn vectors(policy: &Policy<'_>, count: usize) -> Vec<TestVector> {
    let mut rng = Pcg64::seed_from_u64(17);
    let mut one = |low: f32, high: f32| match rng.random_range(0..10) {
        0 => rng.random_range(-300.0..300.0),
        1 => 10_f32.powi(rng.random_range(-44..20)),
        _ => rng.random_range(low..high),
    };
    let mut vectors = Vec::new();
    for _ in 0..count {
        let (apex_vx_m_s, apex_y_m) = (one(-11.0, 11.0), one(1.0, 12.5));
        let observation = Observation { apex_vx_m_s, apex_y_m, density_ratio: one(0.0, 1.0) };
        vectors.push(TestVector { observation, action: policy.actor().act(observation) });
    }
    vectors
}

#[test]
fn gcc_in_its_default_dialect_computes_the_controllers_bits_on_every_cortex_m_with_an_fpu() {
    if !requirements::arm_gcc() || !requirements::qemu() {
        return;
    }
    let policy = Policy::parse(SHIPPED).unwrap();
    let source = c::export(&policy, &vectors(&policy, 600), c::PREFIX);
    for target in &TARGETS {
        for options in [&["-O2"][..], &["-Os", "-flto", "-ffp-contract=fast"]] {
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join("start.c"), START).unwrap();
            std::fs::write(folder.path().join("leg_actor.c"), &source).unwrap();
            build(folder.path(), target, options);
            assert_eq!(run(folder.path(), target), Some(0), "{}, {options:?}", target.machine);
        }
    }
}

#[test]
fn the_self_test_on_a_cortex_m_reports_fused_operations() {
    if !requirements::arm_gcc() || !requirements::qemu() {
        return;
    }
    let policy = Policy::parse(SHIPPED).unwrap();
    let source = c::export(&policy, &vectors(&policy, 100), c::PREFIX);
    // Without the barriers, GCC fuses.
    let fused = source.replace("    LEG_ROUND(", "    (void)(");
    assert_ne!(fused, source);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("start.c"), START).unwrap();
    std::fs::write(folder.path().join("leg_actor.c"), fused).unwrap();
    build(folder.path(), &TARGETS[0], &["-O2"]);
    let status = run(folder.path(), &TARGETS[0]);
    assert!(status.is_some_and(|s| (1..=100).contains(&s)), "{status:?}");
    // An action that is off in its last bit is found.
    let mut vectors = vectors(&policy, 3);
    let Action { elongation_speed_m_s: rs, .. } = &mut vectors[1].action;
    *rs = f32::from_bits(rs.to_bits() ^ 1);
    let source = c::export(&policy, &vectors, c::PREFIX);
    std::fs::write(folder.path().join("leg_actor.c"), source).unwrap();
    build(folder.path(), &TARGETS[0], &["-O2"]);
    assert_eq!(run(folder.path(), &TARGETS[0]), Some(2));
}
