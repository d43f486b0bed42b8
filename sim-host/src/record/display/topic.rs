//! The topics of a recording that are for viewers, with the message types of Foxglove.

use foxglove::messages::{FrameTransform, Log, PointCloud, SceneUpdate};
use foxglove::{Encode, Schema};

/// A topic for viewers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(in crate::record) enum DisplayTopic {
    /// What happens in the run, as text.
    Log,
    /// Frames of body and foot.
    Transforms,
    /// Leg, ground and water, as primitives.
    Scene,
    /// Points along the leg.
    LegPoints,
    /// Points on the ground and on the water.
    GroundPoints,
}

impl DisplayTopic {
    /// All topics, in the order of their numbers.
    pub(in crate::record) const ALL: [Self; 5] =
        [Self::Log, Self::Transforms, Self::Scene, Self::LegPoints, Self::GroundPoints];

    /// Returns the name in the file.
    pub(in crate::record) const fn name(self) -> &'static str {
        match self {
            Self::Log => "/log",
            Self::Transforms => "/tf",
            Self::Scene => "/scene",
            Self::LegPoints => "/points/leg",
            Self::GroundPoints => "/points/ground",
        }
    }

    /// Returns the schema of the messages.
    pub(in crate::record) fn schema(self) -> Schema {
        let schema = match self {
            Self::Log => Log::get_schema(),
            Self::Transforms => FrameTransform::get_schema(),
            Self::Scene => SceneUpdate::get_schema(),
            Self::LegPoints | Self::GroundPoints => PointCloud::get_schema(),
        };
        schema.expect("Foxglove's own messages have a schema")
    }
}
