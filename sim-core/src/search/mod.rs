//! Optimisers, as ask and tell: they say which candidates they want scored and are told the scores.
//!
//! An optimiser's state serialises, so a coordinator can stop between two generations and go on later with the same
//! bits. Scores are told for a whole generation at once, by candidate index, never by arrival.

pub mod archive;
mod kind;
mod real;
mod state;

pub use kind::{GENERATIONS, OptimiserSpec, SearchKind};
pub use real::{Constriction, Ga, Pso};

use crate::base::random::{Purpose, Stream};
use crate::base::score::Direction;
use crate::genotype::{Bounds, Genome};
use serde::{Deserialize, Serialize};

/// A candidate with where it came from and what it scored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scored {
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Its score in the search.
    pub score: f64,
    /// Its parameters.
    pub genome: Genome,
}

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

/// Makes the optimiser that a validated spec describes, at generation 0. All its randomness follows from `seed`.
///
/// # Panics
/// If a bound is not finite, or its low end lies above its high end.
pub fn build(spec: &OptimiserSpec, bounds: Bounds, direction: Direction, seed: u64) -> Box<dyn Optimiser> {
    let usable = |&(low, high): &(f64, f64)| low <= high && (high - low).is_finite();
    assert!(bounds.0.iter().all(usable), "bounds must be finite, low end first");
    spec.kind.0.build(&spec.settings, bounds, direction, seed)
}

/// Candidate `i` of generation 0: uniform in the bounds.
fn random_genome(bounds: &Bounds, seed: u64, i: u32) -> Genome {
    let mut random = Stream::new(seed, Purpose::InitialPosition, 0, i, 0);
    // Rounding may lead out of very uneven bounds by a bit.
    bounds.0.iter().map(|&(low, high)| random.uniform(low, high).clamp(low, high)).collect()
}
