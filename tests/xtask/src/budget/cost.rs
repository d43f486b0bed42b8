//! Cycles of a Cortex-M4F, estimated from the instructions that it executes.
//!
//! QEMU counts instructions exactly and knows nothing of cycles. This is the
//! table by which kernels are compared here, after Arm's *Cortex-M4 Technical
//! Reference Manual*, sections 3.3 and 7.2 (flash without wait states):
//!
//! | instruction | cycles |
//! |---|---|
//! | load or store of one register | 2; 1 straight after another of its kind |
//! | of N registers: VLDM, VSTM, LDM, STM, PUSH, POP, LDRD, STRD | 1 + N |
//! | VMLA, VMLS, VNMLA, VNMLS, fused ones | 3 |
//! | VDIV, VSQRT | 14 |
//! | other floating-point ones | 1; 2 when the next one uses the result, but not as a VMLA's addend |
//! | a branch that is taken (a POP or load of the PC: on top of the above) | 3 |
//! | anything else | 1 |

use super::disassembly::Instruction;
use std::collections::BTreeSet;

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Load or store of one register.
    Single,
    /// Load or store of that many.
    Multiple(u32),
    /// A product added to its destination.
    MultiplyAccumulate,
    /// Division or square root.
    Divide,
    /// Any other floating-point instruction.
    Float,
    /// Any other instruction.
    Other,
}

/// Returns the cycles of `instruction`, executed after `previous` and before `next`. With
/// `jumps`, the next executed instruction does not follow it in memory.
pub(super) fn cycles(
    previous: Option<&Instruction>,
    instruction: &Instruction,
    next: Option<&Instruction>,
    jumps: bool,
) -> u32 {
    let own = match kind(instruction) {
        Kind::Single if previous.is_some_and(|p| kind(p) == Kind::Single) => 1,
        Kind::Single => 2,
        Kind::Multiple(registers) => 1 + registers,
        Kind::MultiplyAccumulate => 3,
        Kind::Divide => 14,
        Kind::Float => 1 + u32::from(next.is_some_and(|n| uses_result(instruction, n))),
        Kind::Other => 1,
    };
    match (jumps, kind(instruction)) {
        (true, Kind::Single | Kind::Multiple(_)) => own + 3,
        (true, _) => 3,
        (false, _) => own,
    }
}

fn kind(instruction: &Instruction) -> Kind {
    // Prefixes, because suffixes for type and condition vary: `vldmia`, `popne`, `stmdb`.
    let name = instruction.mnemonic.split('.').next().unwrap_or_default();
    let starts = |names: &[&str]| names.iter().any(|n| name.starts_with(n));
    if starts(&["vldm", "vstm", "ldm", "stm", "push", "pop", "vpush", "vpop"]) {
        Kind::Multiple(registers_of(list(&instruction.operands)).len() as u32)
    } else if starts(&["ldrd", "strd"]) || (starts(&["vldr", "vstr"]) && is_double(instruction)) {
        Kind::Multiple(2)
    } else if starts(&["ldr", "str", "vldr", "vstr"]) {
        Kind::Single
    } else if starts(&["vmla", "vmls", "vnmla", "vnmls", "vfma", "vfms", "vfnma", "vfnms"]) {
        Kind::MultiplyAccumulate
    } else if starts(&["vdiv", "vsqrt"]) {
        Kind::Divide
    } else if name.starts_with('v') {
        Kind::Float
    } else {
        Kind::Other
    }
}

fn is_double(instruction: &Instruction) -> bool {
    instruction.operands.starts_with('d')
}

/// Returns the register list of `r0!, {s0-s9}` or of `{r4, lr}`.
fn list(operands: &str) -> &str {
    operands.split_once('{').map_or("", |(_, list)| list)
}

/// Returns whether `next` reads the result of `instruction`.
fn uses_result(instruction: &Instruction, next: &Instruction) -> bool {
    let result = match instruction.mnemonic.split('.').next().unwrap_or_default() {
        // Their result is in the flags, which VMRS reads.
        "vcmp" | "vcmpe" => return next.mnemonic == "vmrs",
        _ => registers_of(instruction.operands.split(',').next().unwrap_or_default()),
    };
    // The first operand is the destination, except where there is nothing but sources.
    let name = next.mnemonic.as_str();
    let only_sources = ["vstr", "vstm", "vpush", "vcmp", "str", "stm", "push", "cmp", "tst"];
    let sources = if only_sources.iter().any(|n| name.starts_with(n)) {
        next.operands.as_str()
    } else {
        next.operands.split_once(',').map_or("", |(_, sources)| sources)
    };
    !result.is_disjoint(&registers_of(sources))
}

/// Returns the registers that operands name; ranges are expanded, doubles become their two
/// singles.
fn registers_of(operands: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for name in operands.split([',', ' ', '{', '}', '[', ']', '!']) {
        let (first, last) = name.split_once('-').unwrap_or((name, name));
        let (Some((bank, from)), Some((_, to))) = (numbered(first), numbered(last)) else {
            if ["lr", "pc", "sp", "ip", "fp", "sl", "r9"].contains(&name) {
                found.insert(name.to_owned());
            }
            continue;
        };
        for n in from..=to {
            if bank == 'd' {
                found.extend([format!("s{}", 2 * n), format!("s{}", 2 * n + 1)]);
            } else {
                found.insert(format!("{bank}{n}"));
            }
        }
    }
    found
}

/// Parses `s12` into ('s', 12).
fn numbered(name: &str) -> Option<(char, u32)> {
    let bank = name.chars().next().filter(|c| "rsd".contains(*c))?;
    Some((bank, name.get(1..)?.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instruction(text: &str) -> Instruction {
        let (mnemonic, operands) = text.split_once(' ').unwrap_or((text, ""));
        Instruction { mnemonic: mnemonic.to_owned(), operands: operands.to_owned(), length: 4 }
    }

    /// Returns the cycles of the middle one of three; `->` before the last marks a jump.
    fn of(previous: &str, middle: &str, next: &str) -> u32 {
        let jumps = next.starts_with("->");
        let next = instruction(next.trim_start_matches("->"));
        cycles(Some(&instruction(previous)), &instruction(middle), Some(&next), jumps)
    }

    #[test]
    fn loads_and_stores_cost_by_registers_and_pairing() {
        assert_eq!(of("nop", "ldr r0, [r1]", "nop"), 2);
        assert_eq!(of("ldr r2, [r1]", "vldr s0, [r1, #4]", "nop"), 1);
        assert_eq!(of("vstr s2, [r1]", "vstr s3, [r1, #4]", "nop"), 1);
        assert_eq!(of("vldmia r1!, {s0-s3}", "vldr s4, [r1]", "nop"), 2);
        assert_eq!(of("nop", "ldrd r0, r1, [sp]", "nop"), 3);
        assert_eq!(of("nop", "vldr d8, [sp]", "nop"), 3);
        assert_eq!(of("nop", "vldmia r1!, {s0-s9}", "nop"), 11);
        assert_eq!(of("nop", "vpush {d8-d15}", "nop"), 17);
        assert_eq!(of("nop", "push {r4, r5, r6, r7, lr}", "nop"), 6);
        assert_eq!(of("nop", "stmia r0!, {r1, r2}", "nop"), 3);
        assert_eq!(of("nop", "pop {r4, pc}", "->nop"), 6);
    }

    #[test]
    fn floating_point_costs_by_kind_and_use_of_the_result() {
        assert_eq!(of("nop", "vmla.f32 s0, s1, s2", "vadd.f32 s3, s0, s0"), 3);
        assert_eq!(of("nop", "vnmls.f32 s0, s1, s2", "nop"), 3);
        assert_eq!(of("nop", "vdiv.f32 s0, s1, s2", "nop"), 14);
        assert_eq!(of("nop", "vadd.f32 s0, s1, s2", "vadd.f32 s0, s3, s4"), 1);
        assert_eq!(of("nop", "vmul.f32 s0, s1, s2", "vadd.f32 s3, s3, s0"), 2);
        assert_eq!(of("nop", "vadd.f32 s0, s0, s2", "vmla.f32 s0, s3, s4"), 1);
        assert_eq!(of("nop", "vadd.f32 s0, s0, s2", "vmla.f32 s1, s0, s4"), 2);
        assert_eq!(of("nop", "vadd.f32 s0, s0, s2", "vstr s0, [r0]"), 2);
        assert_eq!(of("nop", "vadd.f32 s3, s0, s2", "vstmia r0!, {s0-s9}"), 2);
        assert_eq!(of("nop", "vcmp.f32 s0, #0.0", "vmrs APSR_nzcv, fpscr"), 2);
        assert_eq!(of("nop", "vmov r0, s0", "bic r0, r0, r1"), 2);
        assert_eq!(of("nop", "vmov s0, r0", "bic r0, r0, r1"), 1);
    }

    #[test]
    fn taken_branches_cost_three_cycles() {
        assert_eq!(of("nop", "bne 10ee", "->nop"), 3);
        assert_eq!(of("nop", "bne 10ee", "nop"), 1);
        assert_eq!(of("nop", "bx lr", "->nop"), 3);
        assert_eq!(of("ldr r0, [r1]", "adds r0, #1", "nop"), 1);
    }
}
