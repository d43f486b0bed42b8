//! The figures, one a file: what each claims, measures and draws.

mod beyond;
mod fig03;
mod fig04;
mod fig05;
mod fig06;
mod fig07;
mod fig08;
mod fig09;
mod fig11;
mod fig12;
mod fig13;

use super::Figure;

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
