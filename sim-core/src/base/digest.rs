//! Digests: SHA-256 identities of jobs, engines and results.
//!
//! A digest is SHA-256 over a canonical encoding. Every value is written with a tag, and with its length where the
//! length may vary. Floating-point numbers are written by their bits. Structures are encoded through `serde`, so a new
//! field of a job becomes part of its identity without further code.

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::fmt;

mod canonical;
pub use canonical::Unencodable;

/// A SHA-256 digest, written as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Digest(pub [u8; 32]);

/// Error for a text that is not a digest; holds the text.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is not a digest: 64 hexadecimal digits are needed")]
pub struct NotADigest(pub String);

impl Digest {
    /// Returns the digest of a value's canonical encoding. `domain` separates kinds of values: equal values in two
    /// domains have different digests.
    pub fn of(domain: &str, value: &impl Serialize) -> Digest {
        let mut bytes = Vec::new();
        canonical::encode(&domain, &mut bytes).expect("a string has a canonical encoding");
        canonical::encode(value, &mut bytes).expect("our own structures have a canonical encoding");
        Digest(Sha256::digest(&bytes).into())
    }

    /// Returns the digest of bytes. It equals [`Digest::of`] for a value that `serde` serializes as bytes.
    pub fn of_bytes(domain: &str, bytes: &[u8]) -> Digest {
        struct Bytes<'a>(&'a [u8]);
        impl Serialize for Bytes<'_> {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_bytes(self.0)
            }
        }
        Self::of(domain, &Bytes(bytes))
    }

    /// Returns the first twelve digits, enough to name a folder.
    pub fn short(&self) -> String {
        self.to_string()[..12].to_owned()
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl std::str::FromStr for Digest {
    type Err = NotADigest;

    fn from_str(text: &str) -> Result<Self, NotADigest> {
        let mut bytes = [0; 32];
        if text.len() != 64 || !text.is_ascii() {
            return Err(NotADigest(text.to_owned()));
        }
        for (i, byte) in bytes.iter_mut().enumerate() {
            *byte = u8::from_str_radix(&text[2 * i..2 * i + 2], 16).map_err(|_| NotADigest(text.to_owned()))?;
        }
        Ok(Digest(bytes))
    }
}

impl Serialize for Digest {
    /// Writes text in human-readable formats and bytes in all others.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() { serializer.collect_str(self) } else { serializer.serialize_bytes(&self.0) }
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Bytes;
        impl serde::de::Visitor<'_> for Bytes {
            type Value = Digest;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the 32 bytes of a digest")
            }

            fn visit_bytes<E: serde::de::Error>(self, bytes: &[u8]) -> Result<Digest, E> {
                bytes.try_into().map(Digest).map_err(|_| E::invalid_length(bytes.len(), &self))
            }
        }
        if deserializer.is_human_readable() {
            return String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom);
        }
        deserializer.deserialize_bytes(Bytes)
    }
}

/// Running digest of the results of a job's tasks, round by round. Sealed, it is the *result digest*.
///
/// Two runs of jobs with the same job digest must end with the same result digest, on any workers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResultDigest(Digest);

impl ResultDigest {
    /// Returns the digest before the first round.
    pub fn start(job: &Digest) -> Self {
        Self(Digest::of("evogait result 1", &job.0))
    }

    /// Continues from a stored value.
    pub fn resume(stored: Digest) -> Self {
        Self(stored)
    }

    /// Returns the value so far, which is stored with the round.
    pub fn value(&self) -> Digest {
        self.0
    }

    /// Adds a round: the digests of its tasks' results, in the order of the tasks.
    pub fn round(&mut self, round: u32, results: &[Digest]) {
        let results: Vec<&[u8; 32]> = results.iter().map(|digest| &digest.0).collect();
        self.0 = Digest::of("evogait round 1", &(self.0.0, round, results));
    }

    /// Seals the digest after the last round.
    pub fn seal(self) -> Digest {
        Digest::of("evogait sealed result 1", &self.0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn result_digest_depends_on_order_and_number_of_rounds() {
        let [a, b] = [b"a", b"b"].map(|bytes| Digest::of_bytes("test", bytes));
        let sealed = |rounds: &[(u32, &[Digest])]| {
            let mut digest = ResultDigest::start(&a);
            rounds.iter().for_each(|(number, results)| digest.round(*number, results));
            digest.seal()
        };
        let ways: [&[(u32, &[Digest])]; 5] =
            [&[], &[(0, &[a, b])], &[(0, &[b, a])], &[(1, &[a, b])], &[(0, &[a]), (1, &[b])]];
        let distinct: std::collections::BTreeSet<Digest> = ways.map(sealed).into_iter().collect();
        assert_eq!(distinct.len(), ways.len());
    }
}
