//! The figures of "Learning to stop", computed anew: each drawn from our own
//! plant, trainer and controller, beside the authors' data where it is at hand,
//! with the paper's claims put to the test.
//!
//! A figure is computed in parts. Each part is kept on disk under a hash of
//! what it was made from, so that a run that was cut goes on where it was, and
//! a figure that has not changed costs nothing. Results do not depend on the
//! number of threads.

mod agents;
mod beyond;
mod body;
mod claim;
mod fig03;
mod fig04;
mod fig05;
mod fig06;
mod fig08;
mod landscape;
mod landscape_sheet;
mod fig07;
mod fig09;
mod fig11;
mod fig12;
mod fig13;
mod flown;
mod learning;
mod one_step;
mod page;
pub mod picture;
mod reference;
mod sensed;
mod workshop;

pub use claim::{Claim, Verdict};
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

/// Every figure, in the order of the paper.
#[must_use]
pub fn all() -> Vec<Box<dyn Figure>> {
    vec![
        Box::new(fig03::Fig03),
        Box::new(fig04::Fig04),
        Box::new(fig05::Fig05),
        Box::new(fig06::Fig06),
        Box::new(fig07::Fig07),
        Box::new(fig08::Fig08),
        Box::new(fig09::FIG09),
        Box::new(fig09::FIG10),
        Box::new(fig11::Fig11),
        Box::new(fig12::Fig12),
        Box::new(fig13::Fig13),
        Box::new(beyond::Beyond),
    ]
}
