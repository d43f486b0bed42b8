//! A live view of a running leg, in a terminal.
//!
//! It hears samples and commands as an observer, asks both desks how it goes,
//! and never waits for any of them: `feed` brings what there is, `scene`
//! keeps what is to be seen of it, `view` draws that. Processes may come and
//! go meanwhile.

mod app;
mod feed;
mod keys;
mod scene;
mod view;

pub use app::{WatchError, run};
pub use scene::{Hop, Scene};
pub use view::draw;
