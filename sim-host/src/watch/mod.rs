//! A live view of a running leg, in a terminal or in Foxglove.
//!
//! It receives samples and commands as an observer, requests the status of leg and
//! controller, and never makes them wait: `feed` collects the data, `scene` keeps
//! what is shown, `view` draws it, `foxglove` serves it, and
//! `recording` records it. The processes may start and stop
//! meanwhile.

mod app;
mod feed;
mod foxglove;
mod keys;
mod recording;
mod scene;
mod view;

pub use app::{WatchError, run};
pub use foxglove::{ServeError, serve};
pub use recording::{Assumed, Observation, ObserveError, ObserveOptions, record};
pub use scene::{Hop, Scene};
pub use view::draw;
