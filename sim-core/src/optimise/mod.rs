//! Optimisers, as ask and tell: they say which candidates they want scored and are told the scores.
//!
//! An optimiser's state serialises, so a coordinator can stop between two generations and go on later with the same
//! bits. Scores are told for a whole generation at once, by candidate index, never by arrival.

mod spec;

pub use spec::OptimiserSpec;

use crate::score::{Direction, Genome};

/// The box that genomes live in: one (low, high) a parameter, low < high.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds(pub Vec<(f64, f64)>);

/// A stored state that does not fit the optimiser it is given to.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the stored optimiser state can't be used: {0}")]
pub struct BadState(pub String);

/// A population-based search over real vectors.
pub trait Optimiser: Send {
    /// The candidates of the current generation, by index. Always the same until the next `tell`.
    fn ask(&self) -> Vec<Genome>;

    /// Takes the scores of the current generation (`None` = failed, worst), one a candidate, and moves on to the next.
    ///
    /// # Panics
    /// If the number of scores is not the population's size.
    fn tell(&mut self, scores: &[Option<f64>]);

    /// The current generation, from 0: how often `tell` was called.
    fn generation(&self) -> u32;

    /// The state, to be stored beside the scores.
    fn save(&self) -> Vec<u8>;

    /// Takes up a stored state.
    fn restore(&mut self, state: &[u8]) -> Result<(), BadState>;

    /// Whether larger or smaller scores are better.
    fn direction(&self) -> Direction;
}
