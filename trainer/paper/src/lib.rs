//! The figures of "Learning to stop", computed with this repository's own plant,
//! trainer and controller. Each is drawn beside the authors' data if that is found, and
//! each claim of the paper is tested.
//!
//! A figure is computed in steps. The result of each step is cached on disk under a hash
//! of its inputs, so that an interrupted run resumes and an unchanged figure costs
//! nothing. Results do not depend on the number of threads.
// `println!` and `eprintln!` panic when the output is on a full disk; see `leg_process`.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

mod agents;
mod analysis;
mod claim;
pub mod cli;
mod context;
mod figures;
mod reference;
mod report;

pub use claim::{Claim, Verdict};
pub use context::{Extent, FigureContext, FiguresError};
pub use figures::all;
pub use reference::Reference;
pub use report::report;

/// A figure of the paper, or one beyond it.
pub trait Figure: Sync {
    /// Returns the name of its files, such as `fig03`.
    fn id(&self) -> &'static str;
    /// Returns what it shows, in a few words.
    fn title(&self) -> &'static str;
    /// Returns what the paper reports, in our words: a paragraph.
    fn paper(&self) -> &'static str;
    /// Returns the approximate time that it takes alone on two cores, s. The progress bar
    /// counts in this unit.
    fn cost_s(&self, extent: Extent) -> f64;
    /// Computes and draws it.
    ///
    /// # Errors
    /// [`FiguresError`] if a step cannot be cached, a training diverges, or the authors'
    /// data is damaged.
    fn render(&self, ctx: &FigureContext) -> Result<RenderedFigure, FiguresError>;
}

/// A figure, computed and drawn.
#[derive(Clone, Debug)]
pub struct RenderedFigure {
    /// The charts.
    pub svg: String,
    /// The values that are drawn, one row a point.
    pub csv: String,
    /// The results in words: a paragraph.
    pub measured: String,
    /// The paper's claims, with verdicts.
    pub claims: Vec<Claim>,
}
