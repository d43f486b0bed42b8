//! The safetensors container: the length of the header (u64), the header (JSON), the data.
//!
//! All numbers are little-endian. The header maps the name of each tensor to its dtype, its
//! shape and the range of its bytes in the data, and `__metadata__` to a map of strings
//! (<https://github.com/huggingface/safetensors>). The tensors lie one after the other, in
//! the order of their names where all have the same dtype.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The header is padded with blanks to a multiple of this, so that the data are aligned.
const ALIGNMENT: usize = 8;
/// Longest header that is read, bytes; the same limit as in the reference implementation.
const LONGEST_HEADER: u64 = 100_000_000;

/// The header's entry of a tensor.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Entry {
    pub(super) dtype: String,
    pub(super) shape: Vec<usize>,
    data_offsets: [usize; 2],
}

/// The header of a container.
#[derive(Serialize, Deserialize)]
struct Header {
    #[serde(rename = "__metadata__", default)]
    metadata: BTreeMap<String, String>,
    #[serde(flatten)]
    tensors: BTreeMap<String, Entry>,
}

/// A container as read. Every tensor's bytes are within the data.
pub(super) struct Container<'a> {
    pub(super) tensors: BTreeMap<String, Entry>,
    pub(super) metadata: BTreeMap<String, String>,
    data: &'a [u8],
}

/// Writes f32 tensors (name, shape, numbers) and metadata. The bytes are those of the
/// reference implementation.
pub(super) fn write(
    tensors: BTreeMap<String, (Vec<usize>, Vec<f32>)>,
    metadata: BTreeMap<String, String>,
) -> Vec<u8> {
    let mut data = Vec::new();
    let entries = tensors.into_iter().map(|(name, (shape, numbers))| {
        let begin = data.len();
        data.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        (name, Entry { dtype: "F32".into(), shape, data_offsets: [begin, data.len()] })
    });
    let header = Header { tensors: entries.collect(), metadata };
    let mut header = serde_json::to_vec(&header).expect("strings and numbers");
    header.resize(header.len().next_multiple_of(ALIGNMENT), b' ');
    [&(header.len() as u64).to_le_bytes(), header.as_slice(), &data].concat()
}

/// Reads a container and checks that its tensors fill the data without gap or overlap.
///
/// # Errors
/// States what is wrong.
pub(super) fn read(bytes: &[u8]) -> Result<Container<'_>, String> {
    let (length, rest) = bytes.split_first_chunk().ok_or("shorter than the length of a header")?;
    let length = u64::from_le_bytes(*length);
    if length > LONGEST_HEADER.min(rest.len() as u64) {
        return Err(format!("a header of {length} bytes, but {} follow", rest.len()));
    }
    let (header, data) = rest.split_at(length as usize);
    let Header { metadata, tensors } =
        serde_json::from_slice(header).map_err(|e| format!("its header: {e}"))?;
    let mut by_offset: Vec<(&String, &Entry)> = tensors.iter().collect();
    by_offset.sort_by_key(|(_, entry)| entry.data_offsets);
    let mut end = 0;
    for (name, Entry { dtype, shape, data_offsets: [first, last] }) in by_offset {
        if *first != end || last < first {
            return Err(format!("tensor {name:?} is at {first} to {last}, expected from {end}"));
        }
        let numbers = shape.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
        let size = numbers.and_then(|n| n.checked_mul(number_bytes(dtype)?));
        if number_bytes(dtype).is_some() && size != Some(last - first) {
            let found = last - first;
            return Err(format!("tensor {name:?} of {dtype} {shape:?} has {found} bytes"));
        }
        end = *last;
    }
    if end != data.len() {
        return Err(format!("{} bytes of data, but its tensors have {end}", data.len()));
    }
    Ok(Container { tensors, metadata, data })
}

impl Container<'_> {
    /// Returns the bytes of a tensor of this container.
    pub(super) fn data(&self, entry: &Entry) -> &[u8] {
        let [first, last] = entry.data_offsets;
        self.data.get(first..last).unwrap_or_default()
    }
}

/// Returns the bytes of one number of the dtypes that an actor may have.
fn number_bytes(dtype: &str) -> Option<usize> {
    match dtype {
        "F32" => Some(4),
        "F64" => Some(8),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::{read, write};
    use safetensors::tensor::TensorView;
    use safetensors::{Dtype, serialize};
    use std::collections::{BTreeMap, HashMap};

    const METADATA: [(&str, &str); 1] = [("key", "a \"quoted\" text, \u{e9}")];

    fn tensors() -> BTreeMap<String, (Vec<usize>, Vec<f32>)> {
        let layer = |n: usize| (vec![n, 3], (0..3 * n).map(|i| i as f32 - 1.5).collect());
        [("2.weight", layer(2)), ("0.weight", layer(5)), ("0.bias", (vec![0], vec![]))]
            .map(|(name, tensor)| (name.to_owned(), tensor))
            .into()
    }

    /// The same file by the reference implementation.
    fn reference() -> Vec<u8> {
        let tensors = tensors();
        let views = tensors.iter().map(|(name, (shape, numbers))| {
            let bytes = bytemuck::cast_slice(numbers);
            (name, TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap())
        });
        let metadata: HashMap<_, _> = METADATA.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
        serialize(views, Some(metadata)).unwrap()
    }

    #[test]
    fn writes_the_bytes_of_the_reference_implementation() {
        let metadata = METADATA.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
        assert_eq!(write(tensors(), metadata), reference());
    }

    #[test]
    fn reads_what_the_reference_implementation_writes() {
        let file = reference();
        let container = read(&file).unwrap();
        assert_eq!(container.metadata["key"], METADATA[0].1);
        assert_eq!(container.tensors.len(), 3);
        for (name, (shape, numbers)) in tensors() {
            let entry = &container.tensors[&name];
            assert_eq!(entry.shape, shape);
            assert_eq!(container.data(entry), bytemuck::cast_slice::<f32, u8>(&numbers));
        }
    }

    #[test]
    fn refuses_gaps_overlaps_wrong_sizes_and_cut_files() {
        let file = |header: &str, data: usize| {
            let length = (header.len() as u64).to_le_bytes();
            [length.as_slice(), header.as_bytes(), &vec![0; data]].concat()
        };
        let entry = |shape: &str, from: usize, to: usize| {
            format!(r#"{{"dtype":"F32","shape":{shape},"data_offsets":[{from},{to}]}}"#)
        };
        let refused = |header: &str, data: usize, what: &str| {
            let error = read(&file(header, data)).err().unwrap();
            assert!(error.contains(what), "{header}: {error}");
        };
        let one = |shape, from, to| format!(r#"{{"a":{}}}"#, entry(shape, from, to));
        assert!(read(&file(&one("[2]", 0, 8), 8)).is_ok());
        refused(&one("[2]", 4, 12), 12, "is at 4 to 12, expected from 0");
        refused(&one("[2]", 0, 4), 4, "has 4 bytes");
        refused(&one("[4294967296,4294967296]", 0, 8), 8, "has 8 bytes");
        refused(&one("[2]", 0, 8), 9, "9 bytes of data, but its tensors have 8");
        let overlap = format!(r#"{{"a":{},"b":{}}}"#, entry("[2]", 0, 8), entry("[1]", 4, 8));
        refused(&overlap, 8, "expected from 8");
        refused("{", 0, "its header: EOF");
        assert!(read(&[8, 0, 0]).is_err());
        assert!(read(&u64::MAX.to_le_bytes()).is_err());
    }
}
