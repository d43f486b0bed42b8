//! The figures, one a file: what each claims, measures and draws.

mod beyond;
mod fig03_training_reward;
mod fig04_episode_steps;
mod fig05_landscape_stop;
mod fig06_landscape_speed;
mod fig07_apex_states;
mod fig08_one_step_stop;
mod fig09_10_set_point;
mod fig11_basin;
mod fig12_top_speed;
mod fig13_gaits;

use super::Figure;

/// Returns every figure, in the order of the paper.
#[must_use]
pub fn all() -> Vec<Box<dyn Figure>> {
    vec![
        Box::new(fig03_training_reward::Fig03),
        Box::new(fig04_episode_steps::Fig04),
        Box::new(fig05_landscape_stop::Fig05),
        Box::new(fig06_landscape_speed::Fig06),
        Box::new(fig07_apex_states::Fig07),
        Box::new(fig08_one_step_stop::Fig08),
        Box::new(fig09_10_set_point::FIG09),
        Box::new(fig09_10_set_point::FIG10),
        Box::new(fig11_basin::Fig11),
        Box::new(fig12_top_speed::Fig12),
        Box::new(fig13_gaits::Fig13),
        Box::new(beyond::Beyond),
    ]
}
