//! Recordings as columns.

use crate::arrays::{array, flags};
use crate::convert::{bad_value, failed};
use leg_recording::contents::Contents;
use leg_recording::read::ReadError;
use leg_recording::schema::{AnyMessage, Channel, DESCRIPTORS, Recorded};
use prost_reflect::{
    Cardinality, DescriptorPool, DynamicMessage, FieldDescriptor, Kind, MessageDescriptor,
    ReflectMessage, Value,
};
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::{PyOSError, PyUserWarning};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::PathBuf;

/// Messages between two looks for a signal.
const BETWEEN_SIGNALS: u64 = 100_000;

/// The values of one field, a message each.
enum Column {
    Single(Vec<f32>),
    Double(Vec<f64>),
    Signed(Vec<i64>),
    Unsigned(Vec<u64>),
    Flag(Vec<bool>),
    Other(FieldDescriptor, Vec<Value>),
}

impl Column {
    fn of(field: &FieldDescriptor) -> Self {
        match field.kind() {
            _ if field.cardinality() == Cardinality::Repeated => {
                Self::Other(field.clone(), Vec::new())
            }
            Kind::Float => Self::Single(Vec::new()),
            Kind::Double => Self::Double(Vec::new()),
            Kind::Int32
            | Kind::Int64
            | Kind::Sint32
            | Kind::Sint64
            | Kind::Sfixed32
            | Kind::Sfixed64 => Self::Signed(Vec::new()),
            Kind::Uint32 | Kind::Uint64 | Kind::Fixed32 | Kind::Fixed64 => {
                Self::Unsigned(Vec::new())
            }
            Kind::Bool => Self::Flag(Vec::new()),
            Kind::String | Kind::Bytes | Kind::Message(_) | Kind::Enum(_) => {
                Self::Other(field.clone(), Vec::new())
            }
        }
    }

    fn push(&mut self, value: &Value) {
        match self {
            Self::Single(all) => all.push(value.as_f32().unwrap_or(f32::NAN)),
            Self::Double(all) => all.push(value.as_f64().unwrap_or(f64::NAN)),
            Self::Signed(all) => {
                let narrow = value.as_i32().map(i64::from);
                all.push(narrow.or(value.as_i64()).unwrap_or_default());
            }
            Self::Unsigned(all) => {
                let narrow = value.as_u32().map(u64::from);
                all.push(narrow.or(value.as_u64()).unwrap_or_default());
            }
            Self::Flag(all) => all.push(value.as_bool().unwrap_or_default()),
            Self::Other(_, all) => all.push(value.clone()),
        }
    }

    fn into_array(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        match self {
            Self::Single(all) => array(py, &all, &[all.len()]),
            Self::Double(all) => array(py, &all, &[all.len()]),
            Self::Signed(all) => array(py, &all, &[all.len()]),
            Self::Unsigned(all) => array(py, &all, &[all.len()]),
            Self::Flag(all) => flags(py, &all),
            Self::Other(field, all) => objects(py, &field, &all),
        }
    }
}

/// Returns an array of text, or of objects where the values are none.
fn objects<'py>(
    py: Python<'py>,
    field: &FieldDescriptor,
    values: &[Value],
) -> PyResult<Bound<'py, PyAny>> {
    let numpy = py.import("numpy")?;
    let is_repeated = field.cardinality() == Cardinality::Repeated;
    let is_text = !is_repeated && matches!(field.kind(), Kind::String | Kind::Enum(_));
    if is_text {
        let texts: Vec<_> =
            values.iter().map(|value| object(py, &field.kind(), value)).collect::<PyResult<_>>()?;
        return numpy.call_method1("array", (texts, "str"));
    }
    let all = numpy.call_method1("empty", (values.len(), "object"))?;
    for (row, value) in values.iter().enumerate() {
        all.set_item(row, object(py, &field.kind(), value)?)?;
    }
    Ok(all)
}

/// Returns a value of a field of this kind; an enumeration by its name, in small letters.
fn object<'py>(py: Python<'py>, kind: &Kind, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    match (kind, value) {
        (_, Value::Bool(value)) => value.into_bound_py_any(py),
        (_, Value::I32(value)) => value.into_bound_py_any(py),
        (_, Value::I64(value)) => value.into_bound_py_any(py),
        (_, Value::U32(value)) => value.into_bound_py_any(py),
        (_, Value::U64(value)) => value.into_bound_py_any(py),
        (_, Value::F32(value)) => value.into_bound_py_any(py),
        (_, Value::F64(value)) => value.into_bound_py_any(py),
        (_, Value::String(value)) => value.into_bound_py_any(py),
        (_, Value::Bytes(value)) => Ok(PyBytes::new(py, value).into_any()),
        (Kind::Enum(descriptor), Value::EnumNumber(number)) => {
            let name = descriptor.get_value(*number).map(|value| value.name().to_lowercase());
            name.unwrap_or_else(|| number.to_string()).into_bound_py_any(py)
        }
        (_, Value::EnumNumber(number)) => number.into_bound_py_any(py),
        (_, Value::Message(message)) => {
            let all = PyDict::new(py);
            for field in message.descriptor().fields() {
                all.set_item(field.name(), object(py, &field.kind(), &message.get_field(&field))?)?;
            }
            Ok(all.into_any())
        }
        (_, Value::List(values)) => {
            let all: Vec<_> =
                values.iter().map(|value| object(py, kind, value)).collect::<PyResult<_>>()?;
            Ok(PyList::new(py, all)?.into_any())
        }
        (_, Value::Map(_)) => Err(failed("no message of a recording has a map")),
    }
}

/// The messages of one channel.
struct Table {
    descriptor: MessageDescriptor,
    columns: Vec<(String, Vec<FieldDescriptor>, Column)>,
}

impl Table {
    fn new(descriptor: MessageDescriptor) -> Self {
        let mut columns = Vec::new();
        for field in descriptor.fields() {
            match field.kind() {
                // A message in the message: its fields are columns, too.
                Kind::Message(inner) if field.cardinality() != Cardinality::Repeated => {
                    columns.extend(inner.fields().map(|within| {
                        let name = format!("{}.{}", field.name(), within.name());
                        (name, vec![field.clone(), within.clone()], Column::of(&within))
                    }));
                }
                _ => {
                    let column = Column::of(&field);
                    columns.push((field.name().to_owned(), vec![field], column));
                }
            }
        }
        Self { descriptor, columns }
    }

    fn push(&mut self, bytes: &[u8]) -> Result<(), prost_reflect::prost::DecodeError> {
        let message = DynamicMessage::decode(self.descriptor.clone(), bytes)?;
        for (_, path, column) in &mut self.columns {
            match &path[..] {
                [outer, inner] => {
                    let value = message.get_field(outer);
                    let inside = value.as_message().map(|message| message.get_field(inner));
                    let none = || Cow::Owned(Value::default_value_for_field(inner));
                    column.push(&inside.unwrap_or_else(none));
                }
                path => column.push(&message.get_field(&path[0])),
            }
        }
        Ok(())
    }
}

/// Returns the channel and the bytes of a message.
fn encoded(message: &AnyMessage) -> (Channel, Vec<u8>) {
    fn of<M: Recorded>(message: &M) -> (Channel, Vec<u8>) {
        (M::CHANNEL, message.encode_to_vec())
    }
    match message {
        AnyMessage::Sample(message) => of(message),
        AnyMessage::Command(message) => of(message),
        AnyMessage::State(message) => of(message),
        AnyMessage::Apex(message) => of(message),
        AnyMessage::Event(message) => of(message),
        AnyMessage::Policy(message) => of(message),
        AnyMessage::SetPoint(message) => of(message),
        AnyMessage::Config(message) => of(message),
        AnyMessage::Law(message) => of(message),
        AnyMessage::Loop(message) => of(message),
        AnyMessage::End(message) => of(message),
        AnyMessage::Estimate(message) => of(message),
    }
}

fn unreadable(error: &ReadError) -> PyErr {
    match error {
        ReadError::Io { .. } => PyOSError::new_err(error.to_string()),
        _ => bad_value(error),
    }
}

/// Reads a recording of `sim-host`: a dictionary with an entry for each topic that it has, which
/// holds an array for each field of its messages. A file that was cut off is read as far as it
/// goes, with a warning.
#[pyfunction]
pub(crate) fn read_columns(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let contents = py.detach(|| Contents::of(&path)).map_err(|error| unreadable(&error))?;
    let pool = DescriptorPool::decode(DESCRIPTORS).map_err(failed)?;
    let mut tables: BTreeMap<&'static str, Table> = BTreeMap::new();
    let mut messages = contents.messages().map_err(|error| unreadable(&error))?;
    let mut read = 0_u64;
    while let Some(message) = messages.next_message().map_err(|error| unreadable(&error))? {
        let (channel, bytes) = encoded(&message);
        let table = match tables.entry(channel.topic()) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => {
                let descriptor = pool.get_message_by_name(&channel.schema());
                entry.insert(Table::new(descriptor.ok_or_else(|| failed("no such message"))?))
            }
        };
        table.push(&bytes).map_err(failed)?;
        read += 1;
        if read.is_multiple_of(BETWEEN_SIGNALS) {
            py.check_signals()?;
        }
    }
    if let Some(warning) = contents.warning() {
        let text = std::ffi::CString::new(warning).map_err(failed)?;
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 2)?;
    }
    let all = PyDict::new(py);
    for (topic, table) in tables {
        let columns = PyDict::new(py);
        for (name, _, column) in table.columns {
            columns.set_item(name, column.into_array(py)?)?;
        }
        all.set_item(topic, columns)?;
    }
    Ok(all)
}
