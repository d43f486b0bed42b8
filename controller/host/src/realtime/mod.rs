//! Loops in real time: a tick at its instant of the machine's clock.
//!
//! Leg and controller tick by the same monotonic clock, each on its own
//! [`Grid`]: a fixed part of a tick after each multiple of the tick since the
//! clock's zero, the controller half a tick behind the leg. So each has half a tick for its work, and the
//! two need no word with each other to stay in step.
//!
//! A tick: sleep to a little before its instant, spin to it, take the newest
//! message, work, send. The thread of the loop neither allocates nor logs nor
//! takes a lock. What it has to tell goes, one [`Row`] a tick, into a wait-free
//! ring; the [`clerk`] makes histograms, tables and messages of it. (iceoryx2 0.10
//! takes a block of 48 bytes for each message that it sends, and gives it back in
//! the same call: from the thread's own cache, without a lock or a system call.)
//!
//! # When a tick is late
//!
//! - A loop that wakes late works at once. It is not made up for by sleeping
//!   less, nor is the grid ever moved.
//! - Ticks that are slept through altogether are *missed*. Time does not wait:
//!   the leg plays them all at once, under the command in force, and sends only
//!   the newest sample. The controller skips them, and goes by the newest sample.
//! - A tick that ends after the next one's instant has missed its *deadline*;
//!   the next begins at once.
//! - A tick without a new message is *stale*: the leg goes on under the command
//!   in force, the controller continues its own. After ten in a row either takes
//!   its safe command, until the other is heard again.

pub mod clerk;
pub mod cli;
pub mod clock;
pub mod control;
pub mod drive;
mod grid;
mod pacer;
pub mod privileges;
mod report;
mod row;
pub mod serve;
mod tally;
mod watch;

pub use clerk::{Clerk, Listener, Shared};
pub use clock::{Clock, Monotonic};
pub use control::{ControllerTask, Ends, Law, Plain};
pub use drive::{Done, Log, Task, drive, run};
pub use grid::Grid;
pub use pacer::{Pacer, Tick};
pub use privileges::Privileges;
pub use report::{Bar, LoopReport, QuantilesUs, with_unit};
pub use row::{Counters, Row, Word};
pub use serve::{Served, serve};
pub use tally::Tally;
pub use watch::{GaveUp, watch};

#[cfg(test)]
mod tests;
