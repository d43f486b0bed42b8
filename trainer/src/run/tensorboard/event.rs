//! Events, and the `TFRecord` frames that hold them in a file.
//!
//! A frame is the length (u64), its masked CRC-32C, the event, and its masked CRC-32C,
//! little-endian. The fields are those of `tensorflow/core/util/event.proto` and
//! `framework/summary.proto` that are used here.

use crc::{CRC_32_ISCSI, Crc, Table};
use prost::Message;
use std::io::{self, Write};

static CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISCSI);
/// `DT_FLOAT`, and `DT_STRING`.
const FLOATS: i32 = 1;
const STRINGS: i32 = 7;

/// An event.
#[derive(Clone, PartialEq, Message)]
pub struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    pub wall_time: f64,
    /// Environment step.
    #[prost(int64, tag = "2")]
    pub step: i64,
    /// Version of the file format, in the first event of a file.
    #[prost(string, optional, tag = "3")]
    pub file_version: Option<String>,
    /// Scalars and texts of this step.
    #[prost(message, optional, tag = "5")]
    pub summary: Option<Summary>,
    /// State of the session.
    #[prost(message, optional, tag = "7")]
    pub session_log: Option<SessionLog>,
}

/// The scalars and texts of one step.
#[derive(Clone, PartialEq, Message)]
pub struct Summary {
    /// Values, each with its tag.
    #[prost(message, repeated, tag = "1")]
    pub value: Vec<Value>,
}

/// A scalar or a text.
#[derive(Clone, PartialEq, Message)]
pub struct Value {
    /// Name of the value.
    #[prost(string, tag = "1")]
    pub tag: String,
    /// The scalar.
    #[prost(float, optional, tag = "2")]
    pub simple_value: Option<f32>,
    /// The text.
    #[prost(message, optional, tag = "8")]
    pub tensor: Option<Tensor>,
    /// Description of the tensor.
    #[prost(message, optional, tag = "9")]
    pub metadata: Option<Metadata>,
}

/// A tensor of strings, or an empty one.
#[derive(Clone, PartialEq, Message)]
pub struct Tensor {
    /// Type of the elements: 1 for floats, 7 for strings.
    #[prost(int32, tag = "1")]
    pub dtype: i32,
    /// Number of elements in each dimension.
    #[prost(message, optional, tag = "2")]
    pub shape: Option<Shape>,
    /// The string.
    #[prost(bytes = "vec", repeated, tag = "8")]
    pub string_val: Vec<Vec<u8>>,
}

/// The shape of a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Shape {
    /// The dimensions.
    #[prost(message, repeated, tag = "2")]
    pub dim: Vec<Dimension>,
}

/// A dimension of a tensor.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct Dimension {
    /// Number of elements.
    #[prost(int64, tag = "1")]
    pub size: i64,
}

/// The description of a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Metadata {
    /// The plugin that displays the tensor.
    #[prost(message, optional, tag = "1")]
    pub plugin_data: Option<Plugin>,
}

/// The plugin that displays a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Plugin {
    /// Name of the plugin, such as `text`.
    #[prost(string, tag = "1")]
    pub plugin_name: String,
    /// Data for the plugin.
    #[prost(bytes = "vec", tag = "2")]
    pub content: Vec<u8>,
}

/// The state of a session.
#[derive(Clone, Copy, PartialEq, Eq, Message)]
pub struct SessionLog {
    /// State: 1 for a start.
    #[prost(int32, tag = "1")]
    pub status: i32,
}

impl Value {
    /// Returns a scalar.
    pub(super) fn scalar(tag: &str, value: f64) -> Self {
        Self { tag: tag.into(), simple_value: Some(value as f32), ..Self::default() }
    }

    /// Returns a text.
    pub(super) fn text(tag: &str, text: &str) -> Self {
        let string_val = vec![text.as_bytes().to_vec()];
        let tensor = Tensor { dtype: STRINGS, shape: None, string_val };
        Self::tensor(format!("{tag}/text_summary"), tensor, "text", Vec::new())
    }

    /// Returns data for a plugin, without a value.
    pub(super) fn data(tag: &str, plugin: &str, content: Vec<u8>) -> Self {
        let shape = Some(Shape { dim: vec![Dimension { size: 0 }] });
        let tensor = Tensor { dtype: FLOATS, shape, string_val: Vec::new() };
        Self::tensor(tag.into(), tensor, plugin, content)
    }

    fn tensor(tag: String, tensor: Tensor, plugin: &str, content: Vec<u8>) -> Self {
        let plugin_data = Some(Plugin { plugin_name: plugin.into(), content });
        let metadata = Some(Metadata { plugin_data });
        Self { tag, tensor: Some(tensor), metadata, ..Self::default() }
    }
}

/// Writes one record of a `TFRecord` file.
pub(super) fn frame(to: &mut impl Write, record: &[u8]) -> io::Result<()> {
    let length = (record.len() as u64).to_le_bytes();
    to.write_all(&length)?;
    to.write_all(&masked(&length).to_le_bytes())?;
    to.write_all(record)?;
    to.write_all(&masked(record).to_le_bytes())
}

/// Returns the CRC-32C, masked so that the checksum of a record that contains records differs
/// from theirs.
#[must_use]
pub fn masked(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// Reads the first frame of `bytes`; returns its event and its length, `None` if it is incomplete
/// or damaged.
#[must_use]
pub fn first_frame(bytes: &[u8]) -> Option<(Event, usize)> {
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    let (check, rest) = rest.split_first_chunk::<4>()?;
    if u32::from_le_bytes(*check) != masked(length) {
        return None;
    }
    let (record, rest) = rest.split_at_checked(u64::from_le_bytes(*length).try_into().ok()?)?;
    let check = rest.first_chunk::<4>()?;
    if u32::from_le_bytes(*check) != masked(record) {
        return None;
    }
    let frame_length = 8 + 4 + record.len() + 4;
    Some((Event::decode(record).ok()?, frame_length))
}
