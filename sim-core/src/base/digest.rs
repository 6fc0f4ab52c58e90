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
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// The running digest of a job's scores, generation by generation and then examination by examination, sealed with the
/// published winner: the *result digest*.
///
/// Two runs of jobs with the same job digest must end with the same result digest, whatever workers there were.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResultDigest(Digest);

impl ResultDigest {
    /// Before the first generation.
    pub fn start(job: &Digest) -> Self {
        Self(Digest::of("evogait result 1", &job.0))
    }

    /// Goes on from a stored value.
    pub fn resume(stored: Digest) -> Self {
        Self(stored)
    }

    /// The value so far, to be stored with the generation.
    pub fn value(&self) -> Digest {
        self.0
    }

    /// Folds in the scores of a generation, in the order of the candidates. `None` stands for a failed evaluation.
    pub fn generation(&mut self, generation: u32, scores: &[Option<f64>]) {
        self.0 = Digest::of("evogait generation 1", &(self.0.0, generation, scores));
    }

    /// Folds in the scores of a round of the finish, in the order of its examinations, each with one score a tree.
    pub fn examinations(&mut self, round: u32, scores: &[Vec<Option<f64>>]) {
        self.0 = Digest::of("evogait examinations 1", &(self.0.0, round, scores));
    }

    /// Folds in the published winner with its score in the search, and ends.
    pub fn seal(self, genome: &[f64], score: f64) -> Digest {
        Digest::of("evogait winner 1", &(self.0.0, genome, score))
    }
}
