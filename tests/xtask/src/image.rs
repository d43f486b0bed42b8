//! What must be true of every image that is flashed.

use anyhow::{Result, ensure};
use harness::board::{BOARDS, Board};

/// Builds the image of each board, and looks for ways to panic in it.
pub(crate) fn run() -> Result<()> {
    for board in BOARDS {
        check(board)?;
        println!("{}: no way to panic", board.name);
    }
    Ok(())
}

/// Fails, naming them, when there are functions in the image by which a program
/// panics: something in the firmware or the controller can reach them.
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
