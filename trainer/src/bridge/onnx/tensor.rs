//! The constants of a graph, in the file or in a file beside it.

use super::proto::{BFLOAT16, BOOL, DOUBLE, EXTERNAL, FLOAT, FLOAT16, INT64, Tensor};
use crate::bridge::half;
use leg_control::actor::MAX_WEIGHTS;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};

/// Largest number of values in a constant of an actor.
const MOST_VALUES: usize = MAX_WEIGHTS;

/// A tensor of values that are numbers; an infinite one is a bound without effect.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Constant {
    pub(super) dims: Vec<usize>,
    pub(super) values: Vec<f64>,
}

impl Constant {
    pub(super) fn scalar(x: f32) -> Result<Self, String> {
        Self::new(vec![], vec![f64::from(x)])
    }

    /// Creates a constant, checking that it has as many values as its dimensions, and that each
    /// is infinite or fits f32.
    fn new(dims: Vec<usize>, values: Vec<f64>) -> Result<Self, String> {
        let expected: usize = dims.iter().product();
        if values.len() != expected {
            return Err(format!("{} values where its shape {dims:?} has {expected}", values.len()));
        }
        let fits = |x: &f64| x.is_infinite() || (*x as f32).is_finite();
        match values.iter().position(|x| !fits(x)) {
            None => Ok(Self { dims, values }),
            Some(i) => Err(format!("value {i} is {}, not a finite number within f32", values[i])),
        }
    }

    /// Returns this constant, unless a value is infinite.
    pub(super) fn finite(&self) -> Result<&Self, String> {
        match self.values.iter().position(|x| x.is_infinite()) {
            None => Ok(self),
            Some(i) => Err(format!("value {i} is {}, not a finite number", self.values[i])),
        }
    }

    /// Applies a function to every value.
    pub(super) fn map(&self, f: impl Fn(f64) -> f64) -> Result<Self, String> {
        Self::new(self.dims.clone(), self.values.iter().map(|&x| f(x)).collect())
    }

    /// Combines the values of two constants of one shape, or of which one is a single number.
    pub(super) fn with(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Result<Self, String> {
        let (a, b) = (&self.values, &other.values);
        let (dims, values) = match (a.len(), b.len()) {
            (n, m) if n == m && (n == 1 || self.row_of() == other.row_of()) => {
                (&self.dims, a.iter().zip(b).map(|(&x, &y)| f(x, y)).collect())
            }
            (_, 1) => (&self.dims, a.iter().map(|&x| f(x, b[0])).collect()),
            (1, _) => (&other.dims, b.iter().map(|&y| f(a[0], y)).collect()),
            _ => {
                let shapes = format!("{:?} and {:?}", self.dims, other.dims);
                return Err(format!("constants of shapes {shapes}, expected the same"));
            }
        };
        Self::new(dims.clone(), values)
    }

    /// Returns the shape without leading ones.
    fn row_of(&self) -> &[usize] {
        let ones = self.dims.iter().take_while(|&&n| n == 1).count();
        &self.dims[ones..]
    }

    /// Returns the number that all values are.
    pub(super) fn uniform(&self) -> Result<f64, String> {
        match self.values.split_first() {
            Some((&first, rest)) if rest.iter().all(|&x| x == first) => Ok(first),
            _ => Err(format!(
                "a constant of shape {:?} whose values differ, where every unit is treated alike",
                self.dims
            )),
        }
    }

    /// Creates a row of numbers.
    pub(super) fn row(numbers: &[f32]) -> Result<Self, String> {
        Self::new(vec![numbers.len()], numbers.iter().map(|&x| f64::from(x)).collect())
    }

    /// Reads a tensor. `folders` may have files with its values.
    pub(super) fn read(tensor: &Tensor, folders: &[PathBuf]) -> Result<Self, String> {
        // Checked before anything is read or allocated.
        let mut count = 1_usize;
        let mut dims = Vec::new();
        for &n in &tensor.dims {
            let n = usize::try_from(n).ok().filter(|&n| n <= MOST_VALUES);
            let larger = n.and_then(|n| count.checked_mul(n)).filter(|&c| c <= MOST_VALUES);
            let (Some(n), Some(larger)) = (n, larger) else {
                let shape = &tensor.dims[..tensor.dims.len().min(8)];
                return Err(format!(
                    "shape {shape:?}, an actor's have at most {MOST_VALUES} values"
                ));
            };
            count = larger;
            dims.push(n);
        }
        let size = match tensor.data_type {
            FLOAT => 4,
            DOUBLE => 8,
            FLOAT16 | BFLOAT16 => 2,
            other => {
                return Err(format!(
                    "data type {other}, readable are 1 (float), 10 (float16), 11 (double) and \
                     16 (bfloat16)"
                ));
            }
        };
        let outside;
        let raw = if tensor.data_location == EXTERNAL {
            outside = external(tensor, count * size, folders)?;
            Some(outside.as_slice())
        } else {
            tensor.raw_data.as_deref()
        };
        let short: fn(u16) -> f32 =
            if tensor.data_type == BFLOAT16 { half::from_bfloat16 } else { half::from_float16 };
        let values = match (raw, size) {
            (Some(raw), _) if raw.len() != count * size => {
                return Err(format!(
                    "{} bytes where its shape {dims:?} has {}",
                    raw.len(),
                    count * size
                ));
            }
            (Some(raw), 4) => {
                raw.as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect()
            }
            (Some(raw), 2) => {
                let numbers = raw.as_chunks().0.iter().map(|&b| short(u16::from_le_bytes(b)));
                numbers.map(f64::from).collect()
            }
            (Some(raw), _) => raw.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect(),
            // Sixteen bits lie in the lower half of an integer.
            (None, 2) => {
                let bits = tensor.int32_data.iter().map(|&n| n as u16);
                bits.map(|bits| f64::from(short(bits))).collect()
            }
            (None, 4) => tensor.float_data.iter().map(|&x| f64::from(x)).collect(),
            (None, _) => tensor.double_data.clone(),
        };
        Self::new(dims, values)
    }

    /// Returns the numbers of rows and columns.
    pub(super) fn matrix(&self) -> Result<[usize; 2], String> {
        match self.dims[..] {
            [rows, columns] if rows > 0 && columns > 0 => Ok([rows, columns]),
            _ => Err(format!("a constant of shape {:?}, expected a matrix", self.dims)),
        }
    }

    pub(super) fn transposed(&self) -> Result<Self, String> {
        let [rows, columns] = self.matrix()?;
        let values = (0..columns)
            .flat_map(|j| (0..rows).map(move |i| (i, j)))
            .map(|(i, j)| self.values[i * columns + j]);
        Ok(Self { dims: vec![columns, rows], values: values.collect() })
    }

    /// Returns the values as a row of this width, for each row of a batch.
    pub(super) fn spread_over(&self, width: usize) -> Result<Vec<f64>, String> {
        let leading = self.dims.split_last().map_or(&[][..], |(_, leading)| leading);
        match (self.values.len(), leading.iter().all(|&n| n == 1)) {
            (1, _) => Ok(vec![self.values[0]; width]),
            (n, true) if n == width => Ok(self.values.clone()),
            _ => Err(format!("a constant of shape {:?} beside rows of {width}", self.dims)),
        }
    }

    pub(super) fn spread<const N: usize>(&self) -> Result<[f64; N], String> {
        let row = self.spread_over(N)?;
        Ok(std::array::from_fn(|i| row[i]))
    }

    pub(super) fn f32s(&self) -> Vec<f32> {
        self.values.iter().map(|&x| x as f32).collect()
    }
}

/// Returns the integers of a tensor of one dimension in the file.
pub(super) fn integers(tensor: &Tensor) -> Result<Vec<i64>, String> {
    let numbers = match tensor.raw_data.as_deref() {
        _ if tensor.data_type != INT64 || tensor.data_location == EXTERNAL => None,
        Some(raw) => match raw.as_chunks() {
            (numbers, []) => Some(numbers.iter().map(|&b| i64::from_le_bytes(b)).collect()),
            _ => None,
        },
        None => Some(tensor.int64_data.clone()),
    };
    let fits = |n: &Vec<i64>| *tensor.dims == [n.len().try_into().unwrap_or(i64::MAX)];
    numbers.filter(fits).ok_or_else(|| format!("tensor {:?}: not a row of integers", tensor.name))
}

/// Returns the truth value of a tensor in the file; `None` where it is not a single one.
pub(super) fn flag(tensor: &Tensor) -> Option<bool> {
    let outside = tensor.data_type != BOOL || tensor.data_location == EXTERNAL;
    match (outside, tensor.raw_data.as_deref(), &tensor.int32_data[..]) {
        (false, Some([value]), []) => Some(*value != 0),
        (false, None | Some([]), [value]) => Some(*value != 0),
        _ => None,
    }
}

/// Reads bytes from a file below one of the folders.
fn external(tensor: &Tensor, bytes: usize, folders: &[PathBuf]) -> Result<Vec<u8>, String> {
    let entry =
        |key: &str| tensor.external_data.iter().find(|e| e.key == key).map(|e| e.value.as_str());
    let location = entry("location").ok_or("external data without a location")?;
    let place = Path::new(location);
    let within = place.components().all(|c| matches!(c, Component::Normal(_)));
    if !within || location.is_empty() {
        return Err(format!("external data in {location:?}, which is not below the file's folder"));
    }
    let number = |key: &str| match entry(key) {
        None => Ok(None),
        Some(text) => match text.parse::<u64>() {
            Ok(n) => Ok(Some(n)),
            Err(_) => Err(format!("external data with {key} {text:?}, expected a number")),
        },
    };
    let offset = number("offset")?.unwrap_or(0);
    if let Some(length) = number("length")?.filter(|&n| n != bytes as u64) {
        return Err(format!("{length} bytes of external data where its shape has {bytes}"));
    }
    let paths = folders.iter().map(|folder| folder.join(place));
    let path = paths.clone().find(|path| path.exists()).or_else(|| paths.clone().next());
    let path = path.ok_or("external data, but no folder to look in")?;
    let unreadable = |why: String| format!("external data in {}: {why}", path.display());
    // A symbolic link must not lead out of the folders either.
    let real = |p: &Path| p.canonicalize().map_err(|e| unreadable(e.to_string()));
    let file = real(&path)?;
    let is_below = |folder: &PathBuf| folder.canonicalize().is_ok_and(|f| file.starts_with(f));
    if !folders.iter().any(is_below) || !path.is_file() {
        return Err(unreadable("not a file below the folder of the ONNX file".into()));
    }
    let mut data = Vec::with_capacity(bytes);
    File::open(&path)
        .and_then(|mut file| {
            file.seek(SeekFrom::Start(offset))?;
            file.take(bytes as u64).read_to_end(&mut data)
        })
        .map_err(|e| unreadable(e.to_string()))?;
    if data.len() < bytes {
        return Err(unreadable(format!("it ends after {} of {bytes} bytes", data.len())));
    }
    Ok(data)
}
