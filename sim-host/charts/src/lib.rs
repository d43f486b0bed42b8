#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod axis;
mod canvas;
pub mod color;
mod legend;
mod mark;
mod panel;
mod sheet;
mod units;

pub use axis::{Axis, grouped, number, percent};
pub use canvas::DrawError;
pub use color::Color;
pub use mark::{Mark, Point, steps};
pub use panel::Panel;
pub use sheet::Sheet;
