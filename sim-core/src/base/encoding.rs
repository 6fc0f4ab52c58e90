//! Compact encoding of stored and sent values: tasks, results, settled starts, states of searches.
//!
//! The first byte names format and version. Serde's structures follow as postcard writes them, and numbers keep their
//! bits. A value has exactly one encoding: other bytes that would decode to it are refused.

use serde::de::{DeserializeOwned, Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;

/// Error for bytes that are not a value's encoding.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unreadable {
    /// There are no bytes.
    #[error("it is empty")]
    Empty,
    /// The bytes have another format or version.
    #[error("its format is {found}, not {wanted}: it is another kind of value, or from another build of evogait")]
    Format {
        /// The first byte.
        found: u8,
        /// The byte expected there.
        wanted: u8,
    },
    /// The bytes end too early, or a value in them is not allowed.
    #[error("it can't be decoded: {0}")]
    Broken(String),
    /// The bytes decode, but differ from the value's own encoding: bytes follow it, or a number takes more bytes than
    /// it needs.
    #[error("it is not canonical: it has {found} bytes; exactly the {wanted} bytes that encode its value are needed")]
    NotCanonical {
        /// Number of bytes found.
        found: usize,
        /// Number of bytes in the value's own encoding.
        wanted: usize,
    },
}

/// Encodes a value in a format.
///
/// # Panics
/// If its structure has no encoding, such as a sequence of unknown length.
pub fn encode(format: u8, value: &impl Serialize) -> Vec<u8> {
    postcard::to_extend(value, vec![format]).expect("our own structures have an encoding")
}

/// Decodes a value. Accepts only the bytes that [`encode`] writes for it.
pub fn decode<T: Serialize + DeserializeOwned>(format: u8, bytes: &[u8]) -> Result<T, Unreadable> {
    let (&found, rest) = bytes.split_first().ok_or(Unreadable::Empty)?;
    if found != format {
        return Err(Unreadable::Format { found, wanted: format });
    }
    let value: T = postcard::from_bytes(rest).map_err(|e| Unreadable::Broken(e.to_string()))?;
    let own = encode(format, &value);
    if own != bytes {
        return Err(Unreadable::NotCanonical { found: bytes.len(), wanted: own.len() });
    }
    Ok(value)
}

/// Implements `encode` and `decode` for types, each with its own format.
macro_rules! encoded {
    ($($type:ty = $format:expr),+) => {$(
        impl $type {
            /// Returns the bytes that are stored and sent.
            pub fn encode(&self) -> Vec<u8> {
                $crate::base::encoding::encode($format, self)
            }

            /// Decodes a value from exactly the bytes that `encode` returns.
            pub fn decode(bytes: &[u8]) -> Result<Self, $crate::base::encoding::Unreadable> {
                $crate::base::encoding::decode($format, bytes)
            }
        }
    )+};
}
pub(crate) use encoded;

/// Bytes inside an encoded structure, copied as a whole.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bytes(pub Vec<u8>);

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Copied;
        impl Visitor<'_> for Copied {
            type Value = Bytes;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("bytes")
            }

            fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Bytes, E> {
                Ok(Bytes(bytes.to_vec()))
            }
        }
        deserializer.deserialize_bytes(Copied)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Value = (u32, Option<f64>, Vec<f32>);

    #[test]
    fn values_keep_the_bits_of_their_numbers() {
        let nan = f64::from_bits(f64::NAN.to_bits() + 1);
        for number in [nan, -0.0, f64::MIN_POSITIVE / 2.0, f64::INFINITY] {
            let value: Value = (300, Some(number), vec![-0.0, 1.5]);
            let read: Value = decode(7, &encode(7, &value)).unwrap();
            assert_eq!(read.1.map(f64::to_bits), Some(number.to_bits()));
            assert_eq!(read.2[0].to_bits(), (-0.0f32).to_bits());
        }
    }

    #[test]
    fn non_canonical_bytes_are_refused() {
        let value: Value = (5, None, vec![1.0]);
        let bytes = encode(7, &value);
        assert_eq!(decode::<Value>(7, &[]), Err(Unreadable::Empty));
        assert_eq!(decode::<Value>(8, &bytes), Err(Unreadable::Format { found: 7, wanted: 8 }));
        for cut in 1..bytes.len() {
            assert!(matches!(decode::<Value>(7, &bytes[..cut]), Err(Unreadable::Broken(_))), "{cut}");
        }
        let longer = [bytes.as_slice(), &[0]].concat();
        assert!(matches!(decode::<Value>(7, &longer), Err(Unreadable::NotCanonical { .. })));
        // The number 5 in two bytes.
        let padded = [&[7, 0x85, 0x00], &bytes[2..]].concat();
        assert!(decode::<Value>(7, &padded).is_err());
    }
}
