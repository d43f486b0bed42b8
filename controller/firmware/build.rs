//! Tells the linker where everything lies on the board.

use std::{env, fs, path::PathBuf};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let is_mps2 = env::var_os("CARGO_FEATURE_MPS2").is_some();
    let map = if is_mps2 { "memory/mps2.x" } else { "memory/stm32f405.x" };
    // Never a `memory.x` in the package's root: the linker would take it first.
    fs::copy(map, out.join("memory.x")).expect("OUT_DIR can be written to");
    if is_mps2 {
        // The interrupts of `board/mps2.rs`; the other boards' crates bring theirs.
        fs::write(out.join("device.x"), "").expect("OUT_DIR can be written to");
    }
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rerun-if-changed=memory");
}
