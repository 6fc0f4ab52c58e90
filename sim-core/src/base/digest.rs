//! Digests: what makes two jobs, engines or results the same.
//!
//! A digest is SHA-256 over a canonical encoding of our own: every value is written with a tag and, where its length may
//! vary, its length; floating-point numbers by their bits. Structures go through `serde`, so a field that is added to a
//! job takes part in its identity by itself.

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::fmt;

mod canonical;
pub use canonical::Unencodable;

/// A SHA-256 digest, written as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Digest(pub [u8; 32]);

/// A text that is not a digest.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is not a digest: 64 hexadecimal digits are needed")]
pub struct NotADigest(pub String);

impl Digest {
    /// The digest of a value's canonical encoding. `domain` keeps digests of different kinds of things apart.
    pub fn of(domain: &str, value: &impl Serialize) -> Digest {
        let mut bytes = Vec::new();
        canonical::encode(&domain, &mut bytes).expect("a string has a canonical encoding");
        canonical::encode(value, &mut bytes).expect("our own structures have a canonical encoding");
        Digest(Sha256::digest(&bytes).into())
    }

    /// The digest of bytes, the same as [`Digest::of`] has for a value that `serde` calls bytes.
    pub fn of_bytes(domain: &str, bytes: &[u8]) -> Digest {
        struct Bytes<'a>(&'a [u8]);
        impl Serialize for Bytes<'_> {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_bytes(self.0)
            }
        }
        Self::of(domain, &Bytes(bytes))
    }

    /// The first twelve digits: enough to name a folder.
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
    /// As text where people read it, else as bytes.
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

/// The running digest of the results of a job's tasks, round by round; once sealed, the *result digest*.
///
/// Two runs of jobs with the same job digest must end with the same result digest, on any workers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResultDigest(Digest);

impl ResultDigest {
    /// Before the first round.
    pub fn start(job: &Digest) -> Self {
        Self(Digest::of("evogait result 1", &job.0))
    }

    /// Goes on from a stored value.
    pub fn resume(stored: Digest) -> Self {
        Self(stored)
    }

    /// The value so far, to be stored with the round.
    pub fn value(&self) -> Digest {
        self.0
    }

    /// Folds in a round: the digests of its tasks' results, in the order of the tasks.
    pub fn round(&mut self, round: u32, results: &[Digest]) {
        let results: Vec<&[u8; 32]> = results.iter().map(|digest| &digest.0).collect();
        self.0 = Digest::of("evogait round 1", &(self.0.0, round, results));
    }

    /// Ends with the last round.
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
