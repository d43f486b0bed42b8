//! A short evaluation of an imported policy, so that one that falls is seen at once.

use crate::evaluate::hopper;
use crate::evaluate::survival::{HOPS, draw_starts, survival};
use leg_control::actor::Actor;
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// Starts at each density ratio.
const STARTS: usize = 200;
/// Density ratios, with their names.
const MEDIA: [(f64, &str); 3] =
    [(0.0, "on land"), (0.5, "at density ratio 0.5"), (1.0, "in water")];
/// Seed of the starts.
const SEED: u64 = 1;
/// Share of the starts below which an actor counts as one that falls.
const FALLS_BELOW: f64 = 0.5;

/// Returns a line with the share of starts from which the leg keeps hopping in each medium.
pub(super) fn line(actor: &Actor<'_>) -> String {
    let starts = draw_starts(STARTS, &mut Pcg64::seed_from_u64(SEED));
    let shares =
        MEDIA.map(|(rho, name)| (survival(actor, &hopper(rho), rho, &starts).survive30, name));
    let each = shares.map(|(share, name)| format!("{:.1} % {name}", 100.0 * share));
    let text = format!(
        "Evaluated: keeps hopping for {HOPS} hops from {} of {STARTS} starts",
        each.join(", ")
    );
    let falls: Vec<&str> =
        shares.iter().filter(|(share, _)| *share < FALLS_BELOW).map(|&(_, name)| name).collect();
    if falls.is_empty() {
        return text;
    }
    format!("{text}; it falls {}, where no gains help", falls.join(", "))
}
