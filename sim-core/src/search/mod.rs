//! Searches, as ask and tell: they propose candidates and receive the evaluations.
//!
//! A search's state serialises, so a coordinator can stop between two generations and continue later with the same
//! bits. Evaluations are passed for a whole generation at once, by candidate index, never by arrival.

pub mod archive;
mod kind;
mod real;
mod state;

pub use kind::{GENERATIONS, OptimiserSpec, SearchKind};
pub use real::{Constriction, Ga, Pso};

use crate::base::random::{Purpose, Stream};
use crate::base::score::Direction;
use crate::genotype::{Genotype, Space};
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
    #[serde(rename = "genome")]
    pub genotype: Genotype,
}

/// A stored state that does not fit the search it is given to.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the stored optimiser state can't be used: {0}")]
pub struct BadState(pub String);

/// Kind of evaluation that a search asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// The score of a set of gaits: what a planner does with them.
    Set,
    /// The displacement of one motion. No procedure does such evaluations yet, so [`OptimiserSpec::validate`] refuses
    /// searches that need them.
    Motion,
}

/// Candidates of a generation, and the kind of evaluation that each needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// Kind of evaluation.
    pub ask: Ask,
    /// The candidates, by index.
    pub genotypes: Vec<Genotype>,
}

impl Batch {
    /// The evaluations of candidates that were scored as they were sent; `None` = failed.
    ///
    /// # Panics
    /// If the number of scores is not that of candidates.
    pub fn scored(self, scores: &[Option<f64>]) -> Vec<Evaluation> {
        assert_eq!(scores.len(), self.genotypes.len(), "one score a candidate");
        let evaluation = |(genotype, &score)| Evaluation { genotype, score, descriptors: Vec::new() };
        self.genotypes.into_iter().zip(scores).map(evaluation).collect()
    }
}

/// Evaluation of a candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// The genotype that was evaluated. It may be another than the one sent, but lies in the same space.
    pub genotype: Genotype,
    /// The score; `None` if the evaluation failed, which counts as worst.
    pub score: Option<f64>,
    /// Descriptors of the candidate's behaviour, for searches that separate candidates by them.
    pub descriptors: Vec<f64>,
}

/// A population-based search.
pub trait Search: Send {
    /// The candidates of the current generation. Always the same until the next `tell`.
    fn ask(&self) -> Batch;

    /// Takes the evaluations of the current generation, one a candidate, by index, and moves on to the next. A genotype
    /// other than the one sent takes the candidate's place.
    ///
    /// # Panics
    /// If the number of evaluations is not the population's size.
    fn tell(&mut self, evaluations: &[Evaluation]);

    /// The current generation, from 0: how often `tell` was called.
    fn generation(&self) -> u32;

    /// The state, to be stored beside the scores.
    fn save(&self) -> Vec<u8>;

    /// Takes up a stored state.
    ///
    /// # Errors
    /// It is not the state of such a search. The search is unchanged then.
    fn restore(&mut self, state: &[u8]) -> Result<(), BadState>;

    /// Returns the direction: larger or smaller scores are better.
    fn direction(&self) -> Direction;
}

/// Makes the search that a validated spec describes, at generation 0. All its randomness follows from `seed`.
///
/// # Panics
/// If the space is not one that the search takes, a bound is not finite, or its low end lies above its high end.
pub fn build(spec: &OptimiserSpec, space: Space, direction: Direction, seed: u64) -> Box<dyn Search> {
    let usable = |(low, high): (f64, f64)| low <= high && (high - low).is_finite();
    assert!(space.bounds().all(usable), "bounds must be finite, low end first");
    assert_eq!(spec.takes(&space), Ok(()), "the search must take the space");
    spec.kind.0.build(&spec.settings, space, direction, seed)
}

/// Candidate `i` of generation 0: uniform in the space.
fn random_genotype(space: &Space, seed: u64, i: u32) -> Genotype {
    space.draw(&mut Stream::new(seed, Purpose::InitialPosition, 0, i, 0))
}
