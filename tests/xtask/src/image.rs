//! `cargo xtask image`: checks that no firmware image contains a panic.

use anyhow::{Result, ensure};
use harness::board::{BOARDS, Board};

/// Builds the image of each board and searches it for functions that panic.
pub(crate) fn run() -> Result<()> {
    for board in BOARDS {
        for features in ["", "estimator"] {
            check(board, features)?;
        }
        println!("{}: cannot panic, with the estimator or without", board.name);
    }
    Ok(())
}

/// Fails if the image contains functions that panic, and names them: the firmware or the
/// control law can reach them.
fn check(board: Board, features: &str) -> Result<()> {
    let image = board.build_with(features)?;
    let ways = image.ways_to_panic()?;
    ensure!(
        ways.is_empty(),
        "the image for {} can panic, by\n  {}\nfind what calls them: arm-none-eabi-objdump -dC {}",
        board.name,
        ways.join("\n  "),
        image.path.display()
    );
    Ok(())
}
