//! Flash and RAM that the sections of an image occupy.

use super::budgets::Measured;
use anyhow::{Context, Result};
use object::{Object, ObjectSection, SectionFlags, elf};
use std::path::Path;

/// Start address of RAM on a Cortex-M.
const RAM: u64 = 0x2000_0000;

/// Returns the bytes of flash (code, constants, initial values of variables) and of RAM
/// (variables without the stack).
pub(super) fn of(image: &Path) -> Result<[Measured; 2]> {
    let bytes = std::fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
    let elf = object::File::parse(&*bytes)
        .with_context(|| format!("{} is no ELF file", image.display()))?;
    let (mut flash, mut ram) = (0, 0);
    for section in elf.sections() {
        let SectionFlags::Elf { sh_flags, .. } = section.flags() else { continue };
        if !sh_flags.contains(elf::SHF_ALLOC) {
            continue;
        }
        if section.file_range().is_some() {
            flash += section.size();
        }
        if section.address() >= RAM {
            ram += section.size();
        }
    }
    let bytes = |metric: &str, value| Measured { metric: metric.to_owned(), unit: "bytes", value };
    Ok([bytes("flash without weights", flash), bytes("static RAM", ram)])
}
