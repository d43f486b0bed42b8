//! The boards that the firmware knows, as the host sees them.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};
use object::{Object, ObjectSymbol, SymbolKind};

use crate::root;

/// A board, by the name of its feature in `controller/firmware`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// The feature of the firmware, and what the board calls itself.
    pub name: &'static str,
    /// The machine of `qemu-system-arm` that has this processor and these peripherals.
    pub machine: &'static str,
    /// What the machine wants besides, so that it does not complain.
    pub(crate) peripherals: &'static [&'static str],
    /// The chip, as probe-rs calls it; none for a board that only the emulator has.
    pub chip: Option<&'static str>,
}

/// A network that leads nowhere, for the boards that have a socket for it.
const ETHERNET: &[&str] = &["-nic", "user,restrict=on"];

/// Every board, the one that is emulated by default first.
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
    /// The board of that name.
    ///
    /// # Errors
    /// A message with the names there are.
    pub fn named(name: &str) -> Result<Self, String> {
        BOARDS.into_iter().find(|board| board.name == name).ok_or_else(|| {
            let names = BOARDS.map(|board| board.name).join(", ");
            format!("no board `{name}`: there are {names}; a new one is a file in controller/firmware/src/board")
        })
    }

    /// Builds the firmware for this board; the image.
    ///
    /// # Errors
    /// When it does not build.
    pub fn build(self) -> Result<Image> {
        self.build_with("")
    }

    /// As [`Self::build`], with features of the firmware beside the board's,
    /// separated by commas.
    ///
    /// # Errors
    /// When it does not build.
    pub fn build_with(self, features: &str) -> Result<Image> {
        // A folder each: changing boards does not build anew.
        let target = root().join("target/firmware").join(self.name).join(features);
        let status = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--release", "--no-default-features", "--features"])
            .arg(format!("{},{features}", self.name))
            .arg("--target-dir")
            .arg(&target)
            // The folder of the firmware has the target and the link arguments.
            .current_dir(root().join("controller/firmware"))
            .env_remove("CARGO_TARGET_DIR")
            .env_remove("RUSTFLAGS")
            .status()
            .context("cannot start cargo")?;
        if !status.success() {
            bail!("the firmware for {} does not build ({status})", self.name);
        }
        let path = target.join("thumbv7em-none-eabihf/release/firmware");
        Ok(Image { board: self, path })
    }
}

/// A firmware image: an ELF file.
#[derive(Clone, Debug)]
pub struct Image {
    /// For this board.
    pub board: Board,
    /// Where it is.
    pub path: PathBuf,
}

impl Image {
    /// The address of a symbol, such as `__slot_a`.
    ///
    /// # Errors
    /// When the file cannot be read or has no such symbol.
    pub fn symbol(&self, name: &str) -> Result<u64> {
        self.with_elf(|elf| {
            let symbol = elf.symbols().find(|symbol| symbol.name() == Ok(name));
            Ok(symbol
                .with_context(|| format!("{} has no symbol {name}", self.path.display()))?
                .address())
        })
    }

    /// The functions in it by which a program panics, by their mangled names;
    /// empty when it cannot panic.
    ///
    /// Every panic goes through `core::panicking::panic_fmt`, which is never
    /// inlined; the names of the others say what kind of panic it is.
    ///
    /// # Errors
    /// When the file cannot be read or its symbols are stripped.
    pub fn ways_to_panic(&self) -> Result<Vec<String>> {
        const MARKS: [&str; 5] =
            ["panic", "unwrap_failed", "expect_failed", "index_fail", "error_fail"];
        // Without its symbols any image would pass.
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
