//! Searches with an ask–tell interface: they propose candidates and receive their evaluations.
//!
//! A search's state can be serialised, so a coordinator can stop between two generations and continue later with the
//! same bits. Evaluations are passed for a whole generation at once, ordered by candidate index, never by arrival.

pub mod archive;
mod kind;
mod real;
mod sequence;
mod state;

pub use kind::{GENERATIONS, OptimiserSpec, SearchKind};
pub use real::{Constriction, Ga, Pso};
pub use sequence::SequenceGa;

use crate::base::random::{Purpose, Stream};
use crate::base::score::Direction;
use crate::genotype::{Genotype, NoRules, Rules, Space};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::sync::Arc;

/// A scored candidate and its origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scored {
    /// Generation, from 0.
    pub generation: u32,
    /// Index in its generation, from 0.
    pub candidate: u32,
    /// Score in the search.
    pub score: f64,
    /// Parameters that were scored.
    #[serde(rename = "genome")]
    pub genotype: Genotype,
}

/// Error of a stored state that does not fit its search.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the stored optimiser state can't be used: {0}")]
pub struct BadState(pub String);

/// Kind of evaluation that a search needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// The score of a set of gaits, from the tree that a planner grows with them.
    Set,
    /// The displacement of one motion. No procedure offers such evaluations yet, so [`OptimiserSpec::validate`] rejects
    /// searches that need them.
    Motion,
}

/// Candidates of a generation, and the kind of evaluation that they need.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// Kind of evaluation.
    pub ask: Ask,
    /// The candidates, by index.
    pub genotypes: Vec<Genotype>,
}

impl Batch {
    /// Makes the evaluations of candidates that were scored as they were sent; a score of `None` means a failed
    /// evaluation.
    ///
    /// # Panics
    /// If the numbers of scores and candidates differ.
    pub fn scored(self, scores: &[Option<f64>]) -> Vec<Evaluation> {
        assert_eq!(scores.len(), self.genotypes.len(), "one score per candidate is needed");
        let evaluation = |(genotype, &score)| Evaluation { genotype, score, descriptors: Vec::new() };
        self.genotypes.into_iter().zip(scores).map(evaluation).collect()
    }
}

/// Evaluation of a candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// The genotype that was evaluated. It may differ from the one sent, but lies in the same space.
    pub genotype: Genotype,
    /// The score; `None` if the evaluation failed, which counts as worst.
    pub score: Option<f64>,
    /// Descriptors of the candidate's behaviour, for searches that separate candidates by them.
    pub descriptors: Vec<f64>,
}

/// A population-based search.
pub trait Search: Send {
    /// Returns the candidates of the current generation. They stay the same until the next `tell`.
    fn ask(&self) -> Batch;

    /// Receives the evaluations of the current generation, one per candidate, by index, and moves on to the next. If a
    /// genotype differs from the one sent, it takes the candidate's place.
    ///
    /// # Panics
    /// If the number of evaluations is not that of the candidates.
    fn tell(&mut self, evaluations: &[Evaluation]);

    /// Returns the current generation, from 0: the number of calls of `tell`.
    fn generation(&self) -> u32;

    /// Returns the state, which is stored with the scores.
    fn save(&self) -> Vec<u8>;

    /// Restores a stored state.
    ///
    /// # Errors
    /// If it is not the state of such a search. The search is unchanged then.
    fn restore(&mut self, state: &[u8]) -> Result<(), BadState>;

    /// Returns the number of candidates so far that are copies of a parent, because all candidates that were bred for
    /// their places broke the rules.
    fn copies(&self) -> u64 {
        0
    }

    /// Returns the direction of better scores: larger or smaller.
    fn direction(&self) -> Direction;
}

/// Creates the search of a validated table, at generation 0, for a space without further rules. All random numbers
/// follow from `seed`.
///
/// # Panics
/// As [`build_with`].
pub fn build(spec: &OptimiserSpec, space: Space, direction: Direction, seed: u64) -> Box<dyn Search> {
    build_with(spec, space, Arc::new(NoRules), direction, seed)
}

/// Creates the search of a validated table, at generation 0. Its candidates keep the rules, if its kind
/// [checks](SearchKind::build) them. All random numbers follow from `seed`.
///
/// # Panics
/// If the search does not accept the space, a bound is not finite, or a lower bound exceeds its upper bound.
pub fn build_with(
    spec: &OptimiserSpec,
    space: Space,
    rules: Arc<dyn Rules>,
    direction: Direction,
    seed: u64,
) -> Box<dyn Search> {
    let usable = |(low, high): (f64, f64)| low <= high && (high - low).is_finite();
    assert!(space.bounds().all(usable), "bounds must be finite, the lower one first");
    assert_eq!(spec.takes(&space), Ok(()), "the search must accept the space");
    spec.kind.0.build(&spec.settings, space, rules, direction, seed)
}

/// Draws candidate `i` of generation 0, uniform in the space.
fn random_genotype(space: &Space, seed: u64, i: u32) -> Genotype {
    space.draw(&mut Stream::new(seed, Purpose::InitialPosition, 0, i, 0))
}

/// Returns the indexes from the best to the worst score; ties are ordered by index.
fn ranking(direction: Direction, scores: &[Option<f64>]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|&a, &b| {
        if direction.better(scores[a], scores[b]) {
            Ordering::Less
        } else if direction.better(scores[b], scores[a]) {
            Ordering::Greater
        } else {
            a.cmp(&b)
        }
    });
    order
}
