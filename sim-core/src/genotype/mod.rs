//! Genotypes: what a search varies, and the space that it varies it in.

/// The flat parameter vector of a candidate: its gaits' parameters, gait after gait.
pub type Genome = Vec<f64>;

/// The box that genomes live in: one (low, high) a parameter, low ≤ high. A parameter
/// with low = high keeps that value.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds(pub Vec<(f64, f64)>);
