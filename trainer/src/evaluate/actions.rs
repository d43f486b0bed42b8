//! The actor for many observations at once, with the bits of the controller's.
//!
//! A lane holds one observation. Each sum begins with the bias and adds the products in ascending
//! order of the inputs, each rounded before its sum, as the controller's kernels do.

#![allow(
    clippy::inline_always,
    reason = "code that is inlined is compiled for the instruction set"
)]

use super::{observation, to_plant};
use crate::world::Shown;
use leg_control::actor::{Activation, Actor, INPUTS, OUTPUTS, PANEL_ROWS};
use leg_plant::Action;
use leg_simd::{Isa, Kernel, Simd, Vector, dispatch};

/// Largest number of lanes.
const LANES: usize = 16;

/// One number of each observation.
type Row = [f32; LANES];

/// Returns the actor's action for each observation.
///
/// # Panics
/// If this CPU does not have `isa`.
pub(super) fn act_all(isa: Isa, actor: &Actor<'_>, shown: &[Shown]) -> Vec<Action> {
    let widest = actor.widths().iter().map(|&width| usize::from(width)).max().unwrap_or(0);
    let mut layers = [vec![[0.0; LANES]; widest], vec![[0.0; LANES]; widest]];
    let mut actions = Vec::with_capacity(shown.len());
    for shown in shown.chunks(LANES) {
        for (lane, &shown) in shown.iter().enumerate() {
            let scaled = actor.scaled(observation(shown, 0.0));
            for (row, x) in layers[0].iter_mut().zip(scaled) {
                row[lane] = x;
            }
        }
        let sums = dispatch(isa, Network { actor, layers: &mut layers });
        let of_lane = |lane: usize| actor.action(sums.map(|row| row[lane]));
        actions.extend((0..shown.len()).map(|lane| to_plant(of_lane(lane))));
    }
    actions
}

/// The network of an actor, whose first layer holds the inputs; the output is that of the last.
struct Network<'a, 'b> {
    actor: &'a Actor<'b>,
    layers: &'a mut [Vec<Row>; 2],
}

impl Kernel for Network<'_, '_> {
    type Output = [Row; OUTPUTS];

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> [Row; OUTPUTS] {
        let activation = self.actor.activations().hidden;
        let mut rest = self.actor.weights();
        let (mut inputs, widths) = (INPUTS, &self.actor.widths()[1..]);
        let [a, b] = self.layers;
        let (mut from, mut to) = (a, b);
        for (i, &width) in widths.iter().enumerate() {
            let outputs = usize::from(width);
            let (weights, others) = rest.split_at((inputs + 1) * outputs);
            let is_last = i + 1 == widths.len();
            layer(simd, weights, &from[..inputs], &mut to[..outputs], activation, is_last);
            (rest, inputs) = (others, outputs);
            (from, to) = (to, from);
        }
        *from.first_chunk().expect("the outputs of the last layer")
    }
}

/// Computes a layer panel by panel.
#[inline(always)]
fn layer<S: Simd>(
    simd: S,
    mut weights: &[f32],
    from: &[Row],
    to: &mut [Row],
    activation: Activation,
    is_last: bool,
) {
    for rows in to.chunks_mut(PANEL_ROWS) {
        let (panel, others) = weights.split_at(rows.len() * (from.len() + 1));
        weights = others;
        let mut first = 0;
        if S::MANY_REGISTERS && rows.len() == PANEL_ROWS {
            sums::<S::Wide, PANEL_ROWS>(simd, panel, from, rows, first);
            first = PANEL_ROWS;
        }
        while first + 5 <= rows.len() {
            sums::<S::Wide, 5>(simd, panel, from, rows, first);
            first += 5;
        }
        while first < rows.len() {
            sums::<S::Wide, 1>(simd, panel, from, rows, first);
            first += 1;
        }
        if is_last {
            continue;
        }
        for x in rows.as_flattened_mut() {
            *x = if activation == Activation::Relu {
                if *x > 0.0 { *x } else { 0.0 }
            } else {
                activation.of(*x)
            };
        }
    }
}

/// Computes `R` rows of a panel from row `first` on.
#[inline(always)]
fn sums<V: Vector, const R: usize>(
    token: V::Token,
    panel: &[f32],
    from: &[Row],
    rows: &mut [Row],
    first: usize,
) {
    let height = rows.len();
    for at in (0..LANES).step_by(V::LANES) {
        let mut sums = [V::splat(token, 0.0); R];
        for (r, sum) in sums.iter_mut().enumerate() {
            *sum = V::splat(token, panel[first + r]);
        }
        for (x, column) in from.iter().zip(panel[height..].chunks_exact(height)) {
            let x = V::load(token, &x[at..]);
            let column: &[f32; R] = column[first..].first_chunk().expect("R rows of a panel");
            for (sum, &weight) in sums.iter_mut().zip(column) {
                *sum = sum.add(V::splat(token, weight).mul(x));
            }
        }
        for (row, sum) in rows[first..].iter_mut().zip(sums) {
            sum.store(&mut row[at..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::act_all;
    use crate::evaluate::act_on;
    use crate::policy::PackedActor;
    use crate::world::Shown;
    use leg_control::actor::{
        ActionScaling, Activation, Activations, ObservationScaling, OutputActivation,
    };
    use leg_ddpg::Layer;
    use leg_simd::Isa;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn actor(widths: &[usize], hidden: Activation, rng: &mut Pcg64) -> PackedActor {
        let mut draw = |count: usize| (0..count).map(|_| rng.random_range(-1.0..1.0)).collect();
        let layers: Vec<Layer> = widths
            .windows(2)
            .map(|w| Layer { inputs: w[0], weights: draw(w[0] * w[1]), bias: draw(w[1]) })
            .collect();
        let observation = ObservationScaling { offset: [0.1, 2.0, 0.5], scale: [0.1, 0.2, 1.5] };
        let action = ActionScaling {
            scale: [0.4, 0.6],
            offset: [1.57, 0.3],
            low: [1.0, 0.0],
            high: [2.1, 0.9],
        };
        let activations = Activations { hidden, output: OutputActivation::Tanh };
        PackedActor::new(&layers, activations, observation, action).unwrap()
    }

    #[test]
    fn many_actions_have_the_bits_of_the_controllers_actor() {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut shown: Vec<Shown> = (0..37)
            .map(|_| {
                let (vx_m_s, y_m) = (rng.random_range(-9.0..9.0), rng.random_range(0.9..9.0));
                [vx_m_s, y_m, rng.random_range(0.0..1.0)]
            })
            .collect();
        shown.extend([[f64::NAN, 1.0, 0.0], [1e300, 1.0, 0.0], [-0.0, f64::INFINITY, 1.0]]);
        let shapes: [&[usize]; 5] =
            [&[3, 2], &[3, 50, 50, 2], &[3, 7, 23, 2], &[3, 1, 64, 10, 2], &[3, 100, 2]];
        let hidden = [Activation::Relu, Activation::Elu(1.0), Activation::Tanh];
        for (widths, hidden) in shapes.into_iter().flat_map(|w| hidden.map(|h| (w, h))) {
            let packed = actor(widths, hidden, &mut rng);
            let actor = packed.actor();
            for isa in Isa::ALL.into_iter().filter(|isa| isa.available()) {
                for count in [0, 1, 16, shown.len()] {
                    let found = act_all(isa, &actor, &shown[..count]);
                    let expected = shown[..count].iter().map(|&shown| act_on(&actor, shown, 0.0));
                    assert!(found.into_iter().eq(expected), "{widths:?}, {hidden}, {isa:?}");
                }
            }
        }
    }
}
