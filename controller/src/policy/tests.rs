//! Every refusal, and the way there and back.

extern crate std;
use super::fixture::{Bytes, blob_of, manifest, weights};
use super::*;
use crate::actor::{Activation, OutputActivation, ShapeError};
use crate::checksum::crc32;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec as StdVec;

fn refusal(bytes: &[u8]) -> ParseError {
    Policy::parse(Bytes::new(bytes).get()).expect_err("must be refused")
}

/// The bytes with their checksum made right again.
fn resealed(mut bytes: StdVec<u8>) -> StdVec<u8> {
    let (body, crc) = bytes.split_last_chunk_mut::<4>().unwrap();
    *crc = crc32(body).to_le_bytes();
    bytes
}

#[test]
fn what_is_written_is_read_back_in_place() {
    for name in ["a", "ab", "abc", "abcd"] {
        let manifest = Manifest { name, ..manifest() };
        let bytes = Bytes::new(&blob_of(&manifest).unwrap());
        let policy = Policy::parse(bytes.get()).unwrap();
        assert_eq!(*policy.manifest(), manifest);
        assert_eq!(policy.actor().weights(), weights(&manifest.widths));
        let inside = bytes.get().as_ptr_range();
        assert!(inside.contains(&policy.actor().weights().as_ptr().cast()));
    }
}

#[test]
fn each_fault_has_its_own_refusal() {
    let good = blob_of(&manifest()).unwrap();
    let n = good.len();
    assert_eq!(refusal(&good[..5]), ParseError::TooShort { expected: 18, found: 5 });
    assert_eq!(refusal(&good[..n - 1]), ParseError::TooShort { expected: n, found: n - 1 });
    let long = [&good[..], &[0]].concat();
    assert_eq!(refusal(&long), ParseError::TooLong { expected: n, found: n + 1 });
    assert!(matches!(refusal(b"PK\x03\x04 a zip archive"), ParseError::Magic(_)));
    let mut version = good.clone();
    version[8] = 3;
    assert_eq!(refusal(&version), ParseError::Version(3));
    let mut flipped = good.clone();
    flipped[n / 2] ^= 1;
    assert!(matches!(refusal(&flipped), ParseError::Crc { .. }));
    let mut nan = good.clone();
    nan[n - 8..n - 4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(refusal(&resealed(nan)), ParseError::NonFinite(Field::Weights));
    let mut weight = good.clone();
    weight[n - 8..n - 4].copy_from_slice(&0.5_f32.to_le_bytes());
    assert!(matches!(refusal(&resealed(weight)), ParseError::TestVector { .. }));
    let shifted = [&[0_u8][..], &good].concat();
    let shifted = Bytes::new(&shifted);
    assert_eq!(Policy::parse(&shifted.get()[1..]).unwrap_err(), ParseError::Misaligned);
}

#[test]
fn refuses_to_write_values_that_cannot_be_run() {
    let refused = |change: fn(&mut Manifest<'static>)| {
        let mut manifest = manifest();
        change(&mut manifest);
        match blob_of(&manifest) {
            Err(WriteError::Invalid(e)) => e,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(
        refused(|m| m.observation.scale[1] = f32::INFINITY),
        ParseError::NonFinite(Field::Observation)
    );
    assert_eq!(refused(|m| m.gains[0].ki = f32::NAN), ParseError::NonFinite(Field::Gains));
    assert!(matches!(refused(|m| m.gains.clear()), ParseError::OutOfRange(_)));
    assert!(matches!(refused(|m| m.action.low[0] = 3.0), ParseError::OutOfRange(_)));
    assert!(matches!(refused(|m| m.leg.mass_kg = -1.0), ParseError::OutOfRange(_)));
    assert!(matches!(refused(|m| m.media.gravity_m_s2 = [0.0, 0.0]), ParseError::OutOfRange(_)));
}

#[test]
fn clips_and_gains_beyond_any_leg_are_refused() {
    type Change = fn(&mut Manifest<'static>);
    let changes: [Change; 7] = [
        |m| m.action.low[0] = -9.0,
        |m| m.action.high[0] = 3.2,
        |m| m.action.low[1] = -1.0,
        |m| m.action.high[1] = 1e38,
        |m| m.gains[0].ki = 1e38,
        |m| m.gains[0].limit_m_s = 1e6,
        |m| m.leg.stiffness_n_m = 1e20,
    ];
    for change in changes {
        let mut manifest = manifest();
        change(&mut manifest);
        let refused = blob_of(&manifest);
        assert!(
            matches!(refused, Err(WriteError::Invalid(ParseError::OutOfRange(_)))),
            "{refused:?}"
        );
    }
}

#[test]
fn a_sealed_blob_whose_fields_do_not_fit_is_refused() {
    let change = |change: fn(&mut Blob<'_, ()>)| {
        let bytes = Bytes::new(&blob_of(&manifest()).unwrap());
        let mut blob: Blob<'_, ()> = postcard::from_bytes(bytes.get()).unwrap();
        change(&mut blob);
        let mut buffer = vec![0_u8; 16 * 1024];
        let len = postcard::to_slice(&blob, &mut buffer).unwrap().len();
        blob.length = len as u32;
        refusal(&resealed(postcard::to_slice(&blob, &mut buffer).unwrap().to_vec()))
    };
    let fewer = |blob: &mut Blob<'_, ()>| blob.weights = &blob.weights[4..];
    assert!(matches!(change(fewer), ParseError::Shape(_)));
    let torn = |blob: &mut Blob<'_, ()>| blob.weights = &blob.weights[1..];
    assert!(matches!(change(torn), ParseError::WeightBytes(_)));
    let infinite = |blob: &mut Blob<'_, ()>| {
        blob.test_vectors[3].action.touchdown_angle_rad = f32::INFINITY;
    };
    assert_eq!(change(infinite), ParseError::NonFinite(Field::TestVectors));
    // A checksum that is right over fields that are none.
    let mut garbage = blob_of(&manifest()).unwrap();
    garbage[PREAMBLE_LEN..PREAMBLE_LEN + 8].fill(0xff);
    assert_eq!(refusal(&resealed(garbage)), ParseError::Malformed);
}

#[test]
fn what_is_read_field_by_field_is_what_serde_reads() {
    let blob: Blob<'_, ()> = postcard::from_bytes(SHIPPED).unwrap();
    let policy = Policy::parse(SHIPPED).unwrap();
    assert_eq!(*policy.manifest(), blob.manifest);
    assert_eq!(bytemuck::cast_slice::<f32, u8>(policy.actor().weights()), blob.weights);
    assert_eq!(policy.crc32(), blob.crc32);
    let mut vectors = TestVectors::new();
    read::fields(&SHIPPED[PREAMBLE_LEN..], FIRST_FORMAT_VERSION, &mut vectors).unwrap();
    assert_eq!(vectors, blob.test_vectors);
}

/// Every function between layers.
const HIDDEN: [Activation; 6] = [
    Activation::Relu,
    Activation::LeakyRelu(0.01),
    Activation::Elu(1.0),
    Activation::Tanh,
    Activation::Silu,
    Activation::GeluTanh,
];

#[test]
fn activations_are_written_and_read_back_and_relu_with_tanh_stays_version_1() {
    for hidden in HIDDEN {
        for output in [OutputActivation::Tanh, OutputActivation::Linear] {
            let activations = Activations { hidden, output };
            let manifest = Manifest { activations, ..manifest() };
            let bytes = Bytes::new(&blob_of(&manifest).unwrap());
            let is_first = activations == Activations::default();
            assert_eq!(bytes.get()[8], if is_first { 1 } else { 2 });
            assert_eq!(stated_length(bytes.get()), Some(bytes.get().len()));
            let policy = Policy::parse(bytes.get()).unwrap();
            assert_eq!(*policy.manifest(), manifest);
            assert_eq!(policy.actor().activations(), activations);
            if !is_first {
                let blob: Blob<'_, Activations> = postcard::from_bytes(bytes.get()).unwrap();
                assert_eq!(blob.activations, activations);
            }
        }
    }
}

#[test]
fn unknown_activations_and_their_parameters_out_of_range_are_refused() {
    let with = |activations: &[u8]| {
        let output = OutputActivation::Linear;
        let hidden = Activation::LeakyRelu(0.25);
        let manifest = Manifest { activations: Activations { hidden, output }, ..manifest() };
        let good = blob_of(&manifest).unwrap();
        let mut stored = vec![1];
        stored.extend(0.25_f32.to_le_bytes());
        stored.push(1);
        let at = good.windows(6).position(|bytes| bytes == stored).unwrap();
        let mut bad = good;
        bad[at..at + 6].copy_from_slice(activations);
        refusal(&resealed(bad))
    };
    assert_eq!(with(&[6, 0, 0, 0, 0, 1]), ParseError::Malformed);
    assert_eq!(with(&[1, 0, 0, 0, 0, 2]), ParseError::Malformed);
    let slope = [&[1], &1.5_f32.to_le_bytes()[..], &[1]].concat();
    assert_eq!(with(&slope), ParseError::Shape(ShapeError::Activation));
    let slope = [&[2], &f32::NAN.to_le_bytes()[..], &[1]].concat();
    assert_eq!(with(&slope), ParseError::Shape(ShapeError::Activation));
    let other = [&[1], &0.5_f32.to_le_bytes()[..], &[1]].concat();
    assert!(matches!(with(&other), ParseError::TestVector { .. }));
}

#[test]
fn too_few_test_vectors_are_refused() {
    let bytes = Bytes::new(&blob_of(&manifest()).unwrap());
    let mut blob: Blob<'_, ()> = postcard::from_bytes(bytes.get()).unwrap();
    blob.test_vectors.truncate(MIN_TEST_VECTORS - 1);
    // Of 7 vectors of 20 bytes, the padding stays right.
    let mut buffer = vec![0_u8; 16 * 1024];
    let len = postcard::to_slice(&blob, &mut buffer).unwrap().len();
    blob.length = len as u32;
    let shorter = postcard::to_slice(&blob, &mut buffer).unwrap().to_vec();
    assert_eq!(refusal(&resealed(shorter)), ParseError::TestVectors(7));
}

#[test]
fn reports_a_buffer_that_is_too_small() {
    let mut buffer = [0_u8; 100];
    let manifest = manifest();
    assert_eq!(
        write(&manifest, &weights(&manifest.widths), &mut buffer),
        Err(WriteError::BufferTooSmall(100))
    );
}

proptest! {
    #[test]
    fn any_changed_byte_is_noticed(at in any::<prop::sample::Index>(), bits in 1_u8..) {
        let mut bytes = blob_of(&manifest()).unwrap();
        let at = at.index(bytes.len());
        bytes[at] ^= bits;
        prop_assert!(Policy::parse(Bytes::new(&bytes).get()).is_err());
    }

    #[test]
    fn any_bytes_are_parsed_without_a_panic(tail in prop::collection::vec(any::<u8>(), 0..600)) {
        let mut bytes = StdVec::from(MAGIC);
        bytes.extend(FORMAT_VERSION.to_le_bytes());
        bytes.extend(((PREAMBLE_LEN + tail.len() + CRC_LEN) as u32).to_le_bytes());
        bytes.extend(&tail);
        bytes.extend([0; 4]);
        let sealed = Bytes::new(&resealed(bytes));
        prop_assert!(Policy::parse(sealed.get()).is_err());
    }
}
