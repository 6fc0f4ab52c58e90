//! Searches over real vectors.

pub(super) mod ga;
pub(super) mod pso;
