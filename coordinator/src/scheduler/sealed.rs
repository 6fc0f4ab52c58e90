//! The generation sealed last: enough to tell a repeated result from a wrong one, and to have it decided who is right.

use super::round::{Finder, Outcome, Range, Round, Work, same_bits};
use sim_core::base::score::Counts;
use sim_core::genotype::Genome;
use std::sync::Arc;

#[derive(Clone, Debug)]
pub(super) struct Sealed {
    pub number: u32,
    /// By candidate; `None` where the evaluation failed.
    pub scores: Vec<Option<f64>>,
    /// `None` in a store of an earlier version.
    pub genomes: Option<Arc<[Genome]>>,
    /// By candidate, who scored it.
    pub finders: Vec<Finder>,
}

impl Sealed {
    /// That of a round of candidates whose tasks are all done.
    pub fn of(round: &Round, scores: Vec<Option<f64>>) -> Self {
        let genomes = match &round.work {
            Work::Candidates(genomes) => Some(genomes.clone()),
            Work::Examinations(_) => None,
        };
        let finders = (0..round.size()).map(|i| round.finder(i)).collect();
        Self { number: round.number, scores, genomes, finders }
    }

    pub fn contains(&self, range: &Range) -> bool {
        let end = range.first.checked_add(range.count);
        range.round == self.number && end.is_some_and(|end| range.count > 0 && end as usize <= self.scores.len())
    }

    pub fn agrees(&self, index: u32, outcome: &Outcome) -> bool {
        same_bits(self.scores[index as usize], outcome.score())
    }

    /// What was found, as far as it was kept: only scores are compared.
    pub fn outcome(&self, index: u32) -> Outcome {
        only_score(self.scores[index as usize])
    }

    pub fn finder(&self, index: u32) -> Finder {
        self.finders.get(index as usize).cloned().unwrap_or_default()
    }
}

/// An evaluation without what it took, which is not kept of sealed generations.
pub(super) fn only_score(score: Option<f64>) -> Outcome {
    Outcome::evaluation(score, Counts::default())
}
