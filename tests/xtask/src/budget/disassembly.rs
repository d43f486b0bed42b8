//! The instructions of an image, read from the output of `objdump -d`.

use anyhow::{Context, Result, ensure};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Comes with Debian's `binutils-arm-none-eabi`.
const OBJDUMP: &str = "arm-none-eabi-objdump";

/// An instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Instruction {
    /// Mnemonic such as `vmla.f32`, without the suffix for the width of the encoding.
    pub(super) mnemonic: String,
    /// Operands such as `s0, [r1, #4]`, without comments.
    pub(super) operands: String,
    /// Length in bytes: 2 or 4.
    pub(super) length: u32,
}

/// The code of an image.
pub(super) struct Disassembly {
    instructions: BTreeMap<u32, Instruction>,
    functions: BTreeMap<u32, String>,
}

impl Disassembly {
    /// Disassembles an ELF image for Arm.
    pub(super) fn of(image: &Path) -> Result<Self> {
        let output = Command::new(OBJDUMP).arg("-dC").arg(image).output().with_context(|| {
            format!(
                "cannot start `{OBJDUMP}`: install it with `apt install binutils-arm-none-eabi`"
            )
        })?;
        ensure!(
            output.status.success(),
            "`{OBJDUMP} -d {}`: {}",
            image.display(),
            String::from_utf8_lossy(&output.stderr).trim()
        );
        let text = String::from_utf8_lossy(&output.stdout);
        Ok(Self {
            instructions: text.lines().filter_map(parse).collect(),
            functions: text.lines().filter_map(label).collect(),
        })
    }

    /// Returns the instruction at an address.
    pub(super) fn at(&self, address: u32) -> Option<&Instruction> {
        self.instructions.get(&address)
    }

    /// Returns the functions whose names start with a prefix: addresses, and names without
    /// the prefix.
    pub(super) fn functions(&self, prefix: &str) -> BTreeMap<u32, String> {
        let without = |(&address, name): (&u32, &String)| {
            name.strip_prefix(prefix).map(|rest| (address, rest.to_owned()))
        };
        self.functions.iter().filter_map(without).collect()
    }
}

/// Parses a line such as `    10ee:\t466f      \tmov\tr7, sp`; `None` for any other.
fn parse(line: &str) -> Option<(u32, Instruction)> {
    let (address, rest) = line.split_once(":\t")?;
    let address = u32::from_str_radix(address.trim(), 16).ok()?;
    let mut columns = rest.split('\t');
    let digits = columns.next()?.bytes().filter(u8::is_ascii_hexdigit).count();
    let mnemonic = columns.next()?.trim();
    let mnemonic = mnemonic.strip_suffix(".w").or(mnemonic.strip_suffix(".n")).unwrap_or(mnemonic);
    let operands = columns.next().unwrap_or_default();
    let operands = operands.split(['@', ';', '<']).next().unwrap_or_default().trim();
    let length = digits as u32 / 2;
    Some((
        address,
        Instruction { mnemonic: mnemonic.to_owned(), operands: operands.to_owned(), length },
    ))
}

/// Parses a line such as `000010f8 <bench::main::h01234567890abcde>:` into the address
/// and the last part of the name; `None` for any other.
fn label(line: &str) -> Option<(u32, String)> {
    let (address, path) = line.strip_suffix(">:")?.split_once(" <")?;
    let is_hash = |part: &&str| part.len() == 17 && part.starts_with('h');
    let name = path.rsplit("::").find(|part| !is_hash(part))?;
    Some((u32::from_str_radix(address, 16).ok()?, name.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_lines_of_objdump() {
        let instruction = |mnemonic: &str, operands: &str, length| Instruction {
            mnemonic: mnemonic.to_owned(),
            operands: operands.to_owned(),
            length,
        };
        for (line, expected) in [
            ("    10ee:\t466f      \tmov\tr7, sp", Some((0x10ee, instruction("mov", "r7, sp", 2)))),
            (
                "    1116:\ted9f 1a46 \tvldr\ts2, [pc, #280]\t@ 1230 <_ZN+0x130>",
                Some((0x1116, instruction("vldr", "s2, [pc, #280]", 4))),
            ),
            (
                "    10f0:\tf000 f9c4 \tbl\t147c <_ZN10controller>",
                Some((0x10f0, instruction("bl", "147c", 4))),
            ),
            (
                "    112e:\td47c      \tblt.n\t122a <x>",
                Some((0x112e, instruction("blt", "122a", 2))),
            ),
            ("    1132:\tbf00      \tnop", Some((0x1132, instruction("nop", "", 2)))),
            ("000010f8 <main>:", None),
            ("", None),
        ] {
            assert_eq!(parse(line), expected, "{line}");
        }
        for line in ["000010f8 <main>:", "000010f8 <a::b::main::h0123456789abcdef>:"] {
            assert_eq!(label(line), Some((0x10f8, "main".to_owned())), "{line}");
        }
        assert_eq!(label("    1132:\tbf00      \tnop"), None);
    }
}
