//! Searches over sequences of segments.

mod domain;
mod ga;

pub use ga::SequenceGa;
