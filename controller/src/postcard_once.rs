//! postcard, each of its primitives once in an image.
//!
//! postcard's encoder and decoder are made to be inlined: at -O3 every field of
//! every message brings its own loop over the bytes of its varint, some 10 KiB
//! of them. Here the same primitives stand behind calls. What is encoded how is
//! still postcard's business; only the types that messages and blobs are made
//! of are let through.
//!
//! A failure is kept to the end, and told there: after each field of each
//! message there is no branch, and none is taken in a tick.

use heapless::Vec;
use postcard::ser_flavors::{Flavor, Slice};
use postcard::{Error, Result};
use serde::de::{self, DeserializeSeed, Visitor};
use serde::{Deserialize, Serialize, ser};

/// Encodes into `buffer`; returns the bytes used.
///
/// # Errors
/// postcard's, when the buffer is too small.
pub(crate) fn to_slice<'b>(value: &impl Serialize, buffer: &'b mut [u8]) -> Result<&'b mut [u8]> {
    let to = postcard::Serializer { output: Slice::new(buffer) };
    let mut writer = Writer { to, result: Ok(()) };
    value.serialize(&mut writer)?;
    writer.result?;
    writer.to.output.finalize()
}

/// Decodes a value, and returns the bytes behind it.
///
/// # Errors
/// postcard's, when the bytes are not such a value.
pub(crate) fn take_from_bytes<'de, T: Deserialize<'de>>(
    bytes: &'de [u8],
) -> Result<(T, &'de [u8])> {
    let mut reader = Reader::new(bytes);
    let value = T::deserialize(&mut reader)?;
    Ok((value, reader.rest()?))
}

struct Writer<'b> {
    to: postcard::Serializer<Slice<'b>>,
    /// The first failure, kept to the end.
    result: Result<()>,
}

impl Writer<'_> {
    /// Writes, unless something has failed before.
    #[inline]
    fn put(&mut self, value: &impl Serialize) {
        if self.result.is_ok() {
            self.result = value.serialize(&mut self.to);
        }
    }

    #[inline(never)]
    fn u8(&mut self, value: u8) {
        self.put(&value);
    }

    #[inline(never)]
    fn u32(&mut self, value: u32) {
        self.put(&value);
    }

    #[inline(never)]
    fn u64(&mut self, value: u64) {
        self.put(&value);
    }

    #[inline(never)]
    fn f32(&mut self, value: f32) {
        self.put(&value);
    }

    #[inline(never)]
    fn bytes(&mut self, value: &[u8]) {
        if self.result.is_ok() {
            self.result = ser::Serializer::serialize_bytes(&mut self.to, value);
        }
    }
}

/// Types that no message has.
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

    // A varint does not tell how wide the number was.
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

/// Parts of a whole, one after the other.
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

/// Reads one value after the other. After a failure every value is 0, or
/// empty: [`Self::rest`] tells that there was one.
pub(crate) struct Reader<'de> {
    from: postcard::Deserializer<'de, postcard::de_flavors::Slice<'de>>,
    /// The first failure.
    result: Result<()>,
}

/// The primitives.
macro_rules! primitives {
    ($($name:ident: $type:ty),+) => {
        impl<'de> Reader<'de> {
            $(#[inline(never)]
            pub(crate) fn $name(&mut self) -> $type {
                self.take()
            })+
        }
    };
}

primitives!(bool: bool, u8: u8, u16: u16, u32: u32, u64: u64, f32: f32,
    bytes: &'de [u8]);

/// For whoever reads field by field, where serde's code would move every part
/// over the stack several times on its way to the whole.
impl<'de> Reader<'de> {
    pub(crate) fn new(bytes: &'de [u8]) -> Self {
        Self { from: postcard::Deserializer::from_bytes(bytes), result: Ok(()) }
    }

    /// The bytes that are left, if all that was read was there.
    pub(crate) fn rest(self) -> Result<&'de [u8]> {
        self.result?;
        self.from.finalize()
    }

    #[inline]
    fn take<T: Deserialize<'de> + Default>(&mut self) -> T {
        if self.result.is_ok() {
            match T::deserialize(&mut self.from) {
                Ok(value) => return value,
                Err(error) => self.result = Err(error),
            }
        }
        T::default()
    }

    /// Not by postcard: `core::str::from_utf8` is made for long texts, and as
    /// much code again as this.
    #[inline(never)]
    pub(crate) fn str(&mut self) -> &'de str {
        match self.bytes().utf8_chunks().next() {
            Some(chunk) if chunk.invalid().is_empty() => chunk.valid(),
            Some(_) => {
                self.result = Err(Error::DeserializeBadUtf8);
                ""
            }
            None => "",
        }
    }

    /// A struct or an array of floats.
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

    /// A list of at most `N` parts, each read by `part`.
    pub(crate) fn list<T, const N: usize>(&mut self, part: impl Fn(&mut Self) -> T) -> Vec<T, N> {
        let mut list = Vec::new();
        self.extend(&mut list, part);
        list
    }

    /// The same, to a list that is there already.
    pub(crate) fn extend<T, const N: usize>(
        &mut self,
        list: &mut Vec<T, N>,
        part: impl Fn(&mut Self) -> T,
    ) {
        for _ in 0..self.u32() {
            if list.push(part(self)).is_err() {
                self.result = Err(Error::SerdeDeCustom);
                break;
            }
        }
    }
}

/// Types that are a primitive.
macro_rules! read {
    ($($method:ident: $visit:ident($name:ident)),+) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
            visitor.$visit(self.$name())
        })+
    };
}

/// Types that no message has.
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
        // An option starts as a bool does.
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

/// Parts of a whole, one after the other.
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
