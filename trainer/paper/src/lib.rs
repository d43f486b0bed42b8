//! The figures of "Learning to stop", computed anew: each drawn from our own
//! plant, trainer and controller, beside the authors' data where it is at hand,
//! with the paper's claims put to the test.
//!
//! A figure is computed in parts. Each part is kept on disk under a hash of
//! what it was made from, so that a run that was cut goes on where it was, and
//! a figure that has not changed costs nothing. Results do not depend on the
//! number of threads.

mod agents;
mod claim;
pub mod cli;
mod each;
mod page;
pub mod picture;
mod reference;
mod study;
mod workshop;

pub use claim::{Claim, Verdict};
pub use each::all;
pub use page::page;
pub use reference::Reference;
pub use workshop::{Extent, FiguresError, Workshop};

/// One figure of the paper, or one beyond it.
pub trait Figure: Sync {
    /// Its file name, such as `fig03`.
    fn id(&self) -> &'static str;
    /// What it shows, in a few words.
    fn title(&self) -> &'static str;
    /// What the paper says of it, in our words: a paragraph.
    fn paper(&self) -> &'static str;
    /// Seconds that it takes alone on two cores, roughly: the progress bar's unit.
    fn cost_s(&self, extent: Extent) -> f64;
    /// Computes and draws it.
    ///
    /// # Errors
    /// [`FiguresError`], when a part cannot be kept or the picture not laid out.
    fn make(&self, shop: &Workshop) -> Result<Made, FiguresError>;
}

/// A figure that is done.
#[derive(Clone, Debug)]
pub struct Made {
    /// The picture.
    pub svg: String,
    /// What it is drawn from, a row a point.
    pub csv: String,
    /// What came out, in a paragraph.
    pub measured: String,
    /// The paper's claims, put to the test.
    pub claims: Vec<Claim>,
}
