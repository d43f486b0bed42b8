//! The linker's part: the memory of the board that is chosen.

use std::path::PathBuf;
use std::{env, fs};

/// A board's feature, and its memory.
const BOARDS: [(&str, &str); 3] = [
    ("MPS2_AN386", "memory/mps2.x"),
    ("MPS2_AN500", "memory/mps2.x"),
    ("STM32F405", "memory/stm32f405.x"),
];

fn main() {
    let chosen: Vec<_> = BOARDS
        .into_iter()
        .filter(|(feature, _)| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some())
        .collect();
    let [(board, memory)] = chosen[..] else {
        panic!(
            "choose one board: cargo build --release --no-default-features --features BOARD, \
             of mps2-an386, mps2-an500, stm32f405 (chosen: {})",
            chosen.len()
        );
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    fs::copy(memory, out.join("memory.x")).expect("the memory of the board");
    if board.starts_with("MPS2") {
        // Its interrupts are in the board's own table.
        fs::write(out.join("device.x"), "").expect("a file for the linker");
    }
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // Sections where the memory has them, not where pages would begin.
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rerun-if-changed=memory");
}
