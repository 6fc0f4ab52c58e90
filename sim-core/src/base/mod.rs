//! Foundations that every folder shares: maths, random streams, digests, encoding, limits, errors, settings and scores.

pub mod digest;
pub mod encoding;
pub mod error;
pub mod limits;
pub mod math;
pub mod random;
pub mod registry;
pub mod score;
pub mod settings;
pub(crate) mod simd;
pub mod statistics;
pub mod toml_file;
