//! The boards of the firmware: machine in the emulator, chip at the probe, images.

use std::path::PathBuf;

use anyhow::{Context, Result};
use object::{Object, ObjectSymbol, SymbolKind};

use crate::firmware::Build;

/// A board of `controller/firmware`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Feature of the firmware, and the name that the board reports.
    pub name: &'static str,
    /// Machine of `qemu-system-arm` with this processor and these peripherals.
    pub machine: &'static str,
    /// Options without which the emulator prints warnings for this machine.
    pub(crate) peripherals: &'static [&'static str],
    /// Name of the chip in probe-rs; `None` for a board that exists only in the emulator.
    pub chip: Option<&'static str>,
}

/// An isolated network for the machines with an Ethernet controller.
const ETHERNET: &[&str] = &["-nic", "user,restrict=on"];

/// Every board; the first is the default in the emulator.
pub const BOARDS: [Board; 3] = [
    Board { name: "mps2-an386", machine: "mps2-an386", peripherals: ETHERNET, chip: None },
    Board { name: "mps2-an500", machine: "mps2-an500", peripherals: ETHERNET, chip: None },
    Board {
        name: "stm32f405",
        machine: "netduinoplus2",
        peripherals: &[],
        chip: Some("STM32F405RGTx"),
    },
];

impl Board {
    /// Returns the board with this name.
    ///
    /// # Errors
    /// Returns a message with all names.
    pub fn named(name: &str) -> Result<Self, String> {
        BOARDS.into_iter().find(|board| board.name == name).ok_or_else(|| {
            let names = BOARDS.map(|board| board.name).join(", ");
            format!("no board `{name}`; the boards are {names} (see controller/firmware/README.md to add one)")
        })
    }

    /// Builds the firmware for this board and returns the image.
    ///
    /// # Errors
    /// Fails if cargo fails.
    pub fn build(self) -> Result<Image> {
        self.build_with("")
    }

    /// Builds the firmware for this board with more of its features, separated by commas.
    ///
    /// # Errors
    /// Fails if cargo fails.
    pub fn build_with(self, features: &str) -> Result<Image> {
        let all = format!("{},{features}", self.name);
        let all = all.trim_end_matches(',');
        let build =
            Build { name: all, features: all, programs: &["firmware"], flags: None, policy: None };
        let path = build.run()?.join("firmware");
        Ok(Image { board: self, path })
    }
}

/// A firmware image: an ELF file.
#[derive(Clone, Debug)]
pub struct Image {
    /// Board that it was built for.
    pub board: Board,
    /// Path of the file.
    pub path: PathBuf,
}

impl Image {
    /// Returns the address of a symbol, such as `__slot_a`.
    ///
    /// # Errors
    /// Fails if the file cannot be read or has no such symbol.
    pub fn symbol(&self, name: &str) -> Result<u64> {
        self.with_elf(|elf| {
            let symbol = elf.symbols().find(|symbol| symbol.name() == Ok(name));
            Ok(symbol
                .with_context(|| format!("{} has no symbol {name}", self.path.display()))?
                .address())
        })
    }

    /// Returns the mangled names of the functions that panic; empty if the image cannot panic.
    ///
    /// Every panic goes through `core::panicking::panic_fmt`, which is never inlined; the
    /// other names tell the kind of panic.
    ///
    /// # Errors
    /// Fails if the file cannot be read or its symbols are stripped.
    pub fn ways_to_panic(&self) -> Result<Vec<String>> {
        const MARKS: [&str; 5] =
            ["panic", "unwrap_failed", "expect_failed", "index_fail", "error_fail"];
        // A stripped image would pass without this check.
        self.symbol("HardFault")?;
        self.with_elf(|elf| {
            let functions = elf.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text);
            let mut names: Vec<String> = functions
                .filter_map(|symbol| symbol.name().ok())
                .filter(|name| MARKS.iter().any(|mark| name.contains(mark)))
                .map(str::to_owned)
                .collect();
            names.sort();
            Ok(names)
        })
    }

    fn with_elf<R>(&self, read: impl FnOnce(&object::File<'_>) -> Result<R>) -> Result<R> {
        let bytes = std::fs::read(&self.path)
            .with_context(|| format!("cannot read {}", self.path.display()))?;
        let elf = object::File::parse(&*bytes)
            .with_context(|| format!("{} is no ELF file", self.path.display()))?;
        read(&elf)
    }
}
