//! Canonical encoding behind every digest: a `serde` serializer that writes tagged little-endian bytes.

use serde::ser::{self, Serialize};

/// Error for a value without a canonical encoding, such as a sequence of unknown length.
#[derive(Debug, thiserror::Error)]
#[error("no canonical encoding: {0}")]
pub struct Unencodable(String);

impl ser::Error for Unencodable {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self(message.to_string())
    }
}

pub(super) fn encode(value: &impl Serialize, out: &mut Vec<u8>) -> Result<(), Unencodable> {
    value.serialize(&mut Writer(out))
}

struct Writer<'a>(&'a mut Vec<u8>);

impl Writer<'_> {
    fn tag(&mut self, tag: u8) {
        self.0.push(tag);
    }

    fn length(&mut self, n: usize) {
        self.0.extend((n as u64).to_le_bytes());
    }

    fn name(&mut self, name: &str) {
        self.length(name.len());
        self.0.extend(name.as_bytes());
    }
}

macro_rules! number {
    ($method:ident, $type:ty, $tag:literal) => {
        fn $method(self, v: $type) -> Result<(), Unencodable> {
            self.tag($tag);
            self.0.extend(v.to_le_bytes());
            Ok(())
        }
    };
}

/// Serializer that widens all integers, so that the width of a field is not part of its identity.
impl<'a, 'b> ser::Serializer for &'b mut Writer<'a> {
    type Ok = ();
    type Error = Unencodable;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Self;
    type SerializeMap = Self;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    number!(serialize_i64, i64, b'i');
    number!(serialize_u64, u64, b'u');
    number!(serialize_f32, f32, b'f');
    number!(serialize_f64, f64, b'd');

    fn serialize_bool(self, v: bool) -> Result<(), Unencodable> {
        self.tag(if v { b'T' } else { b'F' });
        Ok(())
    }
    fn serialize_i8(self, v: i8) -> Result<(), Unencodable> {
        self.serialize_i64(v.into())
    }
    fn serialize_i16(self, v: i16) -> Result<(), Unencodable> {
        self.serialize_i64(v.into())
    }
    fn serialize_i32(self, v: i32) -> Result<(), Unencodable> {
        self.serialize_i64(v.into())
    }
    fn serialize_u8(self, v: u8) -> Result<(), Unencodable> {
        self.serialize_u64(v.into())
    }
    fn serialize_u16(self, v: u16) -> Result<(), Unencodable> {
        self.serialize_u64(v.into())
    }
    fn serialize_u32(self, v: u32) -> Result<(), Unencodable> {
        self.serialize_u64(v.into())
    }
    fn serialize_char(self, v: char) -> Result<(), Unencodable> {
        self.serialize_str(v.encode_utf8(&mut [0; 4]))
    }
    fn serialize_str(self, v: &str) -> Result<(), Unencodable> {
        self.tag(b's');
        self.name(v);
        Ok(())
    }
    fn serialize_bytes(self, v: &[u8]) -> Result<(), Unencodable> {
        self.tag(b'b');
        self.length(v.len());
        self.0.extend(v);
        Ok(())
    }
    fn serialize_none(self) -> Result<(), Unencodable> {
        self.tag(b'0');
        Ok(())
    }
    fn serialize_some<T: Serialize + ?Sized>(self, v: &T) -> Result<(), Unencodable> {
        self.tag(b'1');
        v.serialize(self)
    }
    fn serialize_unit(self) -> Result<(), Unencodable> {
        self.tag(b'0');
        Ok(())
    }
    fn serialize_unit_struct(self, _: &'static str) -> Result<(), Unencodable> {
        self.serialize_unit()
    }
    fn serialize_unit_variant(self, _: &'static str, _: u32, name: &'static str) -> Result<(), Unencodable> {
        self.serialize_str(name)
    }
    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, v: &T) -> Result<(), Unencodable> {
        v.serialize(self)
    }
    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        name: &'static str,
        v: &T,
    ) -> Result<(), Unencodable> {
        self.tag(b'v');
        self.name(name);
        v.serialize(self)
    }
    fn serialize_seq(self, len: Option<usize>) -> Result<Self, Unencodable> {
        let len = len.ok_or_else(|| Unencodable("a sequence of unknown length".to_owned()))?;
        self.tag(b'[');
        self.length(len);
        Ok(self)
    }
    fn serialize_tuple(self, len: usize) -> Result<Self, Unencodable> {
        self.serialize_seq(Some(len))
    }
    fn serialize_tuple_struct(self, _: &'static str, len: usize) -> Result<Self, Unencodable> {
        self.serialize_seq(Some(len))
    }
    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        name: &'static str,
        len: usize,
    ) -> Result<Self, Unencodable> {
        self.tag(b'v');
        self.name(name);
        self.serialize_seq(Some(len))
    }
    fn serialize_map(self, len: Option<usize>) -> Result<Self, Unencodable> {
        let len = len.ok_or_else(|| Unencodable("a map of unknown length".to_owned()))?;
        self.tag(b'{');
        self.length(len);
        Ok(self)
    }
    fn serialize_struct(self, _: &'static str, len: usize) -> Result<Self, Unencodable> {
        self.serialize_map(Some(len))
    }
    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        name: &'static str,
        len: usize,
    ) -> Result<Self, Unencodable> {
        self.tag(b'v');
        self.name(name);
        self.serialize_map(Some(len))
    }
}

macro_rules! elements {
    ($trait:ident, $method:ident) => {
        impl ser::$trait for &mut Writer<'_> {
            type Ok = ();
            type Error = Unencodable;
            fn $method<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), Unencodable> {
                v.serialize(&mut **self)
            }
            fn end(self) -> Result<(), Unencodable> {
                Ok(())
            }
        }
    };
}
elements!(SerializeSeq, serialize_element);
elements!(SerializeTuple, serialize_element);
elements!(SerializeTupleStruct, serialize_field);
elements!(SerializeTupleVariant, serialize_field);

macro_rules! fields {
    ($trait:ident) => {
        impl ser::$trait for &mut Writer<'_> {
            type Ok = ();
            type Error = Unencodable;
            fn serialize_field<T: Serialize + ?Sized>(&mut self, key: &'static str, v: &T) -> Result<(), Unencodable> {
                self.name(key);
                v.serialize(&mut **self)
            }
            fn end(self) -> Result<(), Unencodable> {
                Ok(())
            }
        }
    };
}
fields!(SerializeStruct);
fields!(SerializeStructVariant);

impl ser::SerializeMap for &mut Writer<'_> {
    type Ok = ();
    type Error = Unencodable;
    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Unencodable> {
        key.serialize(&mut **self)
    }
    fn serialize_value<T: Serialize + ?Sized>(&mut self, v: &T) -> Result<(), Unencodable> {
        v.serialize(&mut **self)
    }
    fn end(self) -> Result<(), Unencodable> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(v: &impl Serialize) -> Vec<u8> {
        let mut out = Vec::new();
        encode(v, &mut out).unwrap();
        out
    }

    #[test]
    fn neighbouring_values_have_distinct_boundaries() {
        assert_ne!(bytes(&("ab", "c")), bytes(&("a", "bc")));
        assert_ne!(bytes(&(vec![1u8, 2], vec![3u8])), bytes(&(vec![1u8], vec![2u8, 3])));
        assert_ne!(bytes(&Some(0u8)), bytes(&None::<u8>));
    }

    #[test]
    fn numbers_are_encoded_by_bits_not_by_width() {
        assert_ne!(bytes(&0.0f64), bytes(&-0.0f64));
        assert_ne!(bytes(&f64::NAN), bytes(&f64::from_bits(f64::NAN.to_bits() + 1)));
        assert_eq!(bytes(&7u8), bytes(&7u64));
    }
}
