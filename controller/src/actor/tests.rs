//! The kernel against the textbook, and what is refused.

extern crate std;
use super::*;
use proptest::prelude::*;
use std::vec::Vec as StdVec;

const ACTION: ActionScaling =
    ActionScaling { scale: [1.0, 1.5], offset: [1.5, 1.0], low: [0.4, 0.0], high: [2.6, 2.0] };

/// Row by row from the row-major weights, as a textbook writes it.
fn reference(
    layers: &[(StdVec<f32>, StdVec<f32>)],
    hidden: Activation,
    input: [f32; 3],
) -> StdVec<f32> {
    let mut x = input.to_vec();
    for (l, (w, b)) in layers.iter().enumerate() {
        let mut y = StdVec::new();
        for (row, &bias) in w.chunks(x.len()).zip(b) {
            let mut sum = bias;
            for (wi, xi) in row.iter().zip(&x) {
                sum += wi * xi;
            }
            y.push(if l + 1 < layers.len() { hidden.of(sum) } else { sum });
        }
        x = y;
    }
    x
}

fn any_activation() -> impl Strategy<Value = Activation> {
    prop_oneof![
        3 => Just(Activation::Relu),
        1 => (0.0_f32..1.0).prop_map(Activation::LeakyRelu),
        1 => (0.0_f32..2.0).prop_map(Activation::Elu),
        1 => Just(Activation::Tanh),
        1 => Just(Activation::Silu),
        1 => Just(Activation::GeluTanh),
    ]
}

proptest! {
    #[test]
    fn packed_weights_give_the_bits_of_the_textbook_order(
        hidden in prop::collection::vec(1_u16..=128, 0..=3), seed in any::<u32>(),
        activation in any_activation(),
        vx in -12.0_f32..12.0, y in 0.5_f32..12.0, rho in 0.0_f32..1.0,
    ) {
        let mut widths = Widths::from_slice(&[3]).unwrap();
        widths.extend(hidden);
        widths.push(2).unwrap();
        let mut state = seed;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0 - 0.5
        };
        let mut layers = StdVec::new();
        let mut packed = StdVec::new();
        for pair in widths.windows(2) {
            let (i, o) = (usize::from(pair[0]), usize::from(pair[1]));
            let w: StdVec<f32> = (0..i * o).map(|_| random()).collect();
            let b: StdVec<f32> = (0..o).map(|_| random()).collect();
            pack(&w, &b, i, |x| packed.push(x));
            layers.push((w, b));
        }
        let activations = Activations { hidden: activation, ..Default::default() };
        let actor = Actor::new(
            widths, activations, ObservationScaling::IDENTITY, ACTION, &packed,
        ).unwrap();
        let z = actor.sums([vx, y, rho]);
        let expected = reference(&layers, activation, [vx, y, rho]);
        prop_assert_eq!(z[0].to_bits(), expected[0].to_bits());
        prop_assert_eq!(z[1].to_bits(), expected[1].to_bits());
    }
}

#[test]
fn an_observation_that_is_not_finite_still_gives_a_bounded_action() {
    let widths = Widths::from_slice(&[3, 2]).unwrap();
    let weights = [1.0_f32; 8];
    for output in [OutputActivation::Tanh, OutputActivation::Linear] {
        let activations = Activations { output, ..Default::default() };
        let identity = ObservationScaling::IDENTITY;
        let actor = Actor::new(widths.clone(), activations, identity, ACTION, &weights).unwrap();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
            let a = actor.act(Observation { apex_vx_m_s: bad, ..Default::default() });
            assert!((0.4..=2.6).contains(&a.touchdown_angle_rad));
            assert!((0.0..=2.0).contains(&a.elongation_speed_m_s));
        }
    }
}

#[test]
fn shapes_that_are_not_an_actor_are_refused() {
    assert_eq!(packed_len(&[3]), Err(ShapeError::Layers(0)));
    assert_eq!(packed_len(&[3, 9, 9, 9, 9, 2]), Err(ShapeError::Layers(5)));
    let too_wide = MAX_WIDTH as u16 + 1;
    assert_eq!(packed_len(&[3, too_wide, 2]), Err(ShapeError::Width(too_wide)));
    if MAX_WIDTH >= 512 {
        assert_eq!(packed_len(&[3, 512, 512, 2]), Err(ShapeError::TooManyWeights(265_730)));
        assert_eq!(packed_len(&[3, 400, 300, 2]), Ok(1_600 + 120_300 + 602));
    }
    assert_eq!(packed_len(&[3, 0, 2]), Err(ShapeError::Width(0)));
    assert_eq!(packed_len(&[4, 2]), Err(ShapeError::Inputs(4)));
    assert_eq!(packed_len(&[3, 3]), Err(ShapeError::Outputs(3)));
    assert_eq!(packed_len(&[3, 50, 50, 2]), Ok(200 + 2_550 + 102));
}
