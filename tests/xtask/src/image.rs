//! `cargo xtask image`: checks that no firmware image contains a panic.

use anyhow::{Result, ensure};
use harness::board::{BOARDS, Board};

/// Builds the image of each board and searches it for functions that panic.
pub(crate) fn run() -> Result<()> {
    for board in BOARDS {
        check(board)?;
        println!("{}: cannot panic", board.name);
    }
    Ok(())
}

/// Fails if the image contains functions that panic, and names them: the firmware or the
/// control law can reach them.
fn check(board: Board) -> Result<()> {
    let image = board.build()?;
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
