//! What a call costs: instructions, estimated cycles, opcodes.

use super::cost;
use super::disassembly::Disassembly;
use super::trace::Call;
use anyhow::{Context, Result};
use std::collections::BTreeMap;
use std::fmt;

/// The costs of one call, from its first instruction to its return.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Profile {
    /// Executed instructions, including those of callees.
    pub(super) instructions: u64,
    /// Cycles, estimated by the table in [`cost`].
    pub(super) cycles: u64,
    /// Executions and cycles of each opcode.
    opcodes: BTreeMap<String, (u64, u64)>,
}

impl Profile {
    /// Computes the costs of a call in the disassembled image.
    pub(super) fn of(call: &Call, image: &Disassembly) -> Result<Self> {
        let path = &call.addresses;
        let at = |i: usize| path.get(i).and_then(|&address| image.at(address));
        let mut profile = Self::default();
        for (i, &address) in path.iter().enumerate() {
            let instruction = at(i).with_context(|| {
                format!("{}: nothing at {address:#x} in the disassembly", call.function)
            })?;
            // The last one returns.
            let jumps = path.get(i + 1) != Some(&(address + instruction.length));
            let previous = i.checked_sub(1).and_then(at);
            let cycles = u64::from(cost::cycles(previous, instruction, at(i + 1), jumps));
            let opcode = profile.opcodes.entry(instruction.mnemonic.clone()).or_default();
            *opcode = (opcode.0 + 1, opcode.1 + cycles);
            profile.instructions += 1;
            profile.cycles += cycles;
        }
        Ok(profile)
    }
}

/// Prints the histogram of opcodes, the most frequent first.
impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rows: Vec<_> = self.opcodes.iter().collect();
        rows.sort_by_key(|(_, (count, _))| std::cmp::Reverse(*count));
        writeln!(f, "{:<12} {:>8} {:>8}", "opcode", "executed", "cycles")?;
        for (opcode, (count, cycles)) in rows {
            writeln!(f, "{opcode:<12} {count:>8} {cycles:>8}")?;
        }
        write!(f, "{:<12} {:>8} {:>8}", "in all", self.instructions, self.cycles)
    }
}
