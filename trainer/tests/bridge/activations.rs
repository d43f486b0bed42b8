//! The shipped weights with every pair of activations.

use leg_control::actor::{Activation, Activations, OutputActivation};
use leg_control::policy::{Policy, SHIPPED};
use leg_process::policy_file::AlignedBytes;
use trainer::bridge::model_card::ModelCard;
use trainer::policy::{PackedActor, blob_with_manifest};

/// Returns actors with their policy files.
pub(crate) fn actors() -> Vec<(PackedActor, AlignedBytes)> {
    let shipped = Policy::parse(SHIPPED).unwrap();
    let hidden = [
        Activation::Relu,
        Activation::LeakyRelu(0.2),
        Activation::Elu(1.5),
        Activation::Tanh,
        Activation::Silu,
        Activation::GeluTanh,
    ];
    let outputs = [OutputActivation::Tanh, OutputActivation::Linear];
    let pairs = hidden.into_iter().flat_map(|hidden| outputs.map(|output| (hidden, output)));
    pairs
        .map(|(hidden, output)| {
            let activations = Activations { hidden, output };
            let packed = PackedActor { activations, ..PackedActor::from(&shipped) };
            let card = ModelCard::from(&shipped);
            let blob = blob_with_manifest(&card.manifest(&packed), &packed.weights).unwrap();
            (packed, blob)
        })
        .collect()
}
