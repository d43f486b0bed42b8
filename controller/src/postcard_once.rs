//! Postcard's encoding with each primitive once in an image.
//!
//! Postcard's own encoder and decoder are made to be inlined: at -O3 every field
//! of every message brings its own loop over the bytes of its varint, some 10 KiB
//! in all. Here the same primitives stand behind calls, and one loop serves all
//! widths of integers. Only the types that messages and blobs consist of are
//! supported. `controller/host/tests/serial/frame.rs` compares both directions
//! with postcard itself.
//!
//! A failure is kept and reported at the end, so no branch follows each field of
//! each message.

use heapless::Vec;
use postcard::{Error, Result};
use serde::de::{self, DeserializeSeed, Visitor};
use serde::{Deserialize, Serialize, ser};

/// Encodes into `buffer`; returns the bytes used.
///
/// # Errors
/// Postcard's error when the buffer is too small.
pub(crate) fn to_slice<'b>(value: &impl Serialize, buffer: &'b mut [u8]) -> Result<&'b mut [u8]> {
    let mut writer = Writer { buffer, len: 0, is_full: false };
    value.serialize(&mut writer)?;
    let Writer { buffer, len, is_full } = writer;
    if is_full {
        return Err(Error::SerializeBufferFull);
    }
    buffer.get_mut(..len).ok_or(Error::SerializeBufferFull)
}

/// Decodes a value, and returns the bytes behind it.
///
/// # Errors
/// Postcard's error when the bytes are not such a value.
pub(crate) fn take_from_bytes<'de, T: Deserialize<'de>>(
    bytes: &'de [u8],
) -> Result<(T, &'de [u8])> {
    let mut reader = Reader::new(bytes);
    let value = T::deserialize(&mut reader)?;
    Ok((value, reader.rest()?))
}

struct Writer<'b> {
    buffer: &'b mut [u8],
    /// Bytes written so far.
    len: usize,
    /// Whether a byte found no room.
    is_full: bool,
}

impl Writer<'_> {
    #[inline(never)]
    fn u8(&mut self, value: u8) {
        match self.buffer.get_mut(self.len) {
            Some(place) => {
                *place = value;
                self.len += 1;
            }
            None => self.is_full = true,
        }
    }

    // A varint does not show how wide the number was.
    #[inline(never)]
    fn u32(&mut self, value: u32) {
        self.u64(value.into());
    }

    #[inline(never)]
    fn u64(&mut self, mut value: u64) {
        while value > 0x7f {
            self.u8(value as u8 | 0x80);
            value >>= 7;
        }
        self.u8(value as u8);
    }

    #[inline(never)]
    fn f32(&mut self, value: f32) {
        self.raw(&value.to_le_bytes());
    }

    #[inline(never)]
    fn bytes(&mut self, value: &[u8]) {
        self.u32(value.len() as u32);
        self.raw(value);
    }

    #[inline(never)]
    fn raw(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.u8(byte);
        }
    }
}

/// Refuses the types that no message has.
macro_rules! not_written {
    ($($method:ident: $type:ty),+) => {
        $(fn $method(self, _: $type) -> Result<()> {
            Err(Error::WontImplement)
        })+
    };
}

impl ser::Serializer for &mut Writer<'_> {
    type Ok = ();
    type Error = Error;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Self;
    type SerializeMap = ser::Impossible<(), Error>;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    not_written!(serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_f64: f64, serialize_char: char);

    fn is_human_readable(&self) -> bool {
        false
    }

    fn serialize_bool(self, v: bool) -> Result<()> {
        self.u8(v.into());
        Ok(())
    }

    fn serialize_u8(self, v: u8) -> Result<()> {
        self.u8(v);
        Ok(())
    }

    fn serialize_u16(self, v: u16) -> Result<()> {
        self.u32(v.into());
        Ok(())
    }

    fn serialize_u32(self, v: u32) -> Result<()> {
        self.u32(v);
        Ok(())
    }

    fn serialize_u64(self, v: u64) -> Result<()> {
        self.u64(v);
        Ok(())
    }

    fn serialize_f32(self, v: f32) -> Result<()> {
        self.f32(v);
        Ok(())
    }

    fn serialize_str(self, v: &str) -> Result<()> {
        self.bytes(v.as_bytes());
        Ok(())
    }

    fn serialize_bytes(self, v: &[u8]) -> Result<()> {
        self.bytes(v);
        Ok(())
    }

    fn serialize_none(self) -> Result<()> {
        self.u8(0);
        Ok(())
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<()> {
        self.u8(1);
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<()> {
        Ok(())
    }

    fn serialize_unit_struct(self, _: &'static str) -> Result<()> {
        Ok(())
    }

    fn serialize_unit_variant(self, _: &'static str, index: u32, _: &'static str) -> Result<()> {
        self.u32(index);
        Ok(())
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        value: &T,
    ) -> Result<()> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        index: u32,
        _: &'static str,
        value: &T,
    ) -> Result<()> {
        self.u32(index);
        value.serialize(self)
    }

    fn serialize_seq(self, len: Option<usize>) -> Result<Self> {
        let len = len.ok_or(Error::SerializeSeqLengthUnknown)?;
        self.u32(len as u32);
        Ok(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Self> {
        Ok(self)
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Self> {
        Ok(self)
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        index: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self> {
        self.u32(index);
        Ok(self)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self::SerializeMap> {
        Err(Error::WontImplement)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self> {
        Ok(self)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        index: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self> {
        self.u32(index);
        Ok(self)
    }

    fn collect_str<T: core::fmt::Display + ?Sized>(self, _: &T) -> Result<()> {
        Err(Error::WontImplement)
    }
}

/// Serializes the parts of a whole in order.
macro_rules! in_order {
    ($($part:ident: $method:ident($($key:ty)?)),+) => {
        $(impl ser::$part for &mut Writer<'_> {
            type Ok = ();
            type Error = Error;

            fn $method<T: Serialize + ?Sized>(&mut self, $(_: $key,)? value: &T) -> Result<()> {
                value.serialize(&mut **self)
            }

            fn end(self) -> Result<()> {
                Ok(())
            }
        })+
    };
}

in_order!(SerializeSeq: serialize_element(), SerializeTuple: serialize_element(),
    SerializeTupleStruct: serialize_field(), SerializeTupleVariant: serialize_field(),
    SerializeStruct: serialize_field(&'static str),
    SerializeStructVariant: serialize_field(&'static str));

/// Reads one value after the other. After a failure every value is 0 or empty,
/// and [`Self::rest`] reports the failure.
pub(crate) struct Reader<'de> {
    from: &'de [u8],
    /// The first failure.
    result: Result<()>,
}

/// Returns the most bytes of a varint of so many bits, and the greatest last
/// byte of one that long.
const fn longest(bits: u32) -> (u32, u8) {
    let bytes = bits.div_ceil(7);
    (bytes, ((1_u32 << (bits - 7 * (bytes - 1))) - 1) as u8)
}

/// For whoever reads field by field, where serde's code would move every part
/// over the stack several times on its way to the whole.
impl<'de> Reader<'de> {
    pub(crate) fn new(bytes: &'de [u8]) -> Self {
        Self { from: bytes, result: Ok(()) }
    }

    /// Returns the bytes that are left, if no read has failed.
    pub(crate) fn rest(self) -> Result<&'de [u8]> {
        self.result.map(|()| self.from)
    }

    #[cold]
    #[inline(never)]
    fn fail(&mut self, error: Error) {
        if self.result.is_ok() {
            self.result = Err(error);
        }
        self.from = &[];
    }

    /// Fails at the number of a variant that is unknown; returns the first variant.
    pub(crate) fn refuse<T: Default>(&mut self) -> T {
        self.fail(Error::DeserializeBadEnum);
        T::default()
    }

    #[inline(never)]
    pub(crate) fn u8(&mut self) -> u8 {
        if let Some((&byte, rest)) = self.from.split_first() {
            self.from = rest;
            byte
        } else {
            self.fail(Error::DeserializeUnexpectedEnd);
            0
        }
    }

    #[inline(never)]
    pub(crate) fn bool(&mut self) -> bool {
        match self.u8() {
            0 => false,
            1 => true,
            _ => {
                self.fail(Error::DeserializeBadBool);
                false
            }
        }
    }

    #[inline(never)]
    fn varint(&mut self, (bytes, last): (u32, u8)) -> u64 {
        let mut value = 0;
        for index in 0..bytes {
            let byte = self.u8();
            value |= u64::from(byte & 0x7f) << (7 * index);
            if byte < 0x80 {
                if index + 1 == bytes && byte > last {
                    break;
                }
                return value;
            }
        }
        self.fail(Error::DeserializeBadVarint);
        0
    }

    #[inline(never)]
    pub(crate) fn u16(&mut self) -> u16 {
        self.varint(const { longest(u16::BITS) }) as u16
    }

    #[inline(never)]
    pub(crate) fn u32(&mut self) -> u32 {
        self.varint(const { longest(u32::BITS) }) as u32
    }

    #[inline(never)]
    pub(crate) fn u64(&mut self) -> u64 {
        self.varint(const { longest(u64::BITS) })
    }

    #[inline(never)]
    pub(crate) fn f32(&mut self) -> f32 {
        let bytes = self.raw(4).first_chunk().copied();
        bytes.map_or(0.0, f32::from_le_bytes)
    }

    #[inline(never)]
    pub(crate) fn bytes(&mut self) -> &'de [u8] {
        let len = self.varint(const { longest(usize::BITS) });
        self.raw(len as usize)
    }

    #[inline(never)]
    fn raw(&mut self, len: usize) -> &'de [u8] {
        if let Some((bytes, rest)) = self.from.split_at_checked(len) {
            self.from = rest;
            bytes
        } else {
            self.fail(Error::DeserializeUnexpectedEnd);
            &[]
        }
    }

    /// Not by `core::str::from_utf8`, which is made for long texts and takes as
    /// much code again as this.
    #[inline(never)]
    pub(crate) fn str(&mut self) -> &'de str {
        match self.bytes().utf8_chunks().next() {
            Some(chunk) if chunk.invalid().is_empty() => chunk.valid(),
            Some(_) => {
                self.fail(Error::DeserializeBadUtf8);
                ""
            }
            None => "",
        }
    }

    /// Reads a struct or an array of floats.
    pub(crate) fn floats<const N: usize>(&mut self) -> [f32; N] {
        let mut floats = [0.0; N];
        self.fill(&mut floats);
        floats
    }

    #[inline(never)]
    fn fill(&mut self, floats: &mut [f32]) {
        for float in floats {
            *float = self.f32();
        }
    }

    /// Reads a list of at most `N` parts, each by `part`.
    pub(crate) fn list<T, const N: usize>(&mut self, part: impl Fn(&mut Self) -> T) -> Vec<T, N> {
        let mut list = Vec::new();
        self.extend(&mut list, part);
        list
    }

    /// Appends a list to one that is there already.
    pub(crate) fn extend<T, const N: usize>(
        &mut self,
        list: &mut Vec<T, N>,
        part: impl Fn(&mut Self) -> T,
    ) {
        for _ in 0..self.u32() {
            if list.push(part(self)).is_err() {
                self.fail(Error::SerdeDeCustom);
                break;
            }
        }
    }
}

/// Reads the types that are a primitive.
macro_rules! read {
    ($($method:ident: $visit:ident($name:ident)),+) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
            visitor.$visit(self.$name())
        })+
    };
}

/// Refuses the types that no message has.
macro_rules! not_read {
    ($($method:ident),+) => {
        $(fn $method<V: Visitor<'de>>(self, _: V) -> Result<V::Value> {
            Err(Error::WontImplement)
        })+
    };
}

impl<'de> de::Deserializer<'de> for &mut Reader<'de> {
    type Error = Error;

    read!(deserialize_bool: visit_bool(bool), deserialize_u8: visit_u8(u8),
        deserialize_u16: visit_u16(u16), deserialize_u32: visit_u32(u32),
        deserialize_u64: visit_u64(u64), deserialize_f32: visit_f32(f32),
        deserialize_str: visit_borrowed_str(str), deserialize_bytes: visit_borrowed_bytes(bytes));
    not_read!(
        deserialize_any,
        deserialize_i8,
        deserialize_i16,
        deserialize_i32,
        deserialize_i64,
        deserialize_f64,
        deserialize_char,
        deserialize_string,
        deserialize_byte_buf,
        deserialize_map,
        deserialize_identifier,
        deserialize_ignored_any
    );

    fn is_human_readable(&self) -> bool {
        false
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        // The tag of an option is encoded as a bool is.
        if self.bool() { visitor.visit_some(self) } else { visitor.visit_none() }
    }

    fn deserialize_unit<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        visitor.visit_unit()
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value> {
        visitor.visit_unit()
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        let left = self.u32() as usize;
        visitor.visit_seq(Parts { reader: self, left })
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, left: usize, visitor: V) -> Result<V::Value> {
        visitor.visit_seq(Parts { reader: self, left })
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        left: usize,
        visitor: V,
    ) -> Result<V::Value> {
        visitor.visit_seq(Parts { reader: self, left })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value> {
        visitor.visit_seq(Parts { reader: self, left: fields.len() })
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value> {
        visitor.visit_enum(self)
    }
}

/// The parts of a whole that are still to be read.
struct Parts<'r, 'de> {
    reader: &'r mut Reader<'de>,
    left: usize,
}

impl<'de> de::SeqAccess<'de> for Parts<'_, 'de> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>> {
        let Some(left) = self.left.checked_sub(1) else { return Ok(None) };
        self.left = left;
        seed.deserialize(&mut *self.reader).map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left)
    }
}

impl<'de> de::EnumAccess<'de> for &mut Reader<'de> {
    type Error = Error;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self)> {
        let index = de::IntoDeserializer::<Error>::into_deserializer(self.u32());
        Ok((seed.deserialize(index)?, self))
    }
}

impl<'de> de::VariantAccess<'de> for &mut Reader<'de> {
    type Error = Error;

    fn unit_variant(self) -> Result<()> {
        Ok(())
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value> {
        seed.deserialize(self)
    }

    fn tuple_variant<V: Visitor<'de>>(self, left: usize, visitor: V) -> Result<V::Value> {
        visitor.visit_seq(Parts { reader: self, left })
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value> {
        visitor.visit_seq(Parts { reader: self, left: fields.len() })
    }
}
