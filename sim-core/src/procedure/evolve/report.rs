//! The report of a finished job: examined by workers once the search is over, put together by the coordinator, stored
//! with the job, drawn by the command line.

use super::finish::{Done, Found, Plan, Question, scores};
use crate::base::score::{Counts, mean};
use crate::report::{GaitTrace, PathTrace, Traces, TreeRecord};
use crate::search::Scored;
use crate::search::archive::Archive;
use serde::{Deserialize, Serialize};

/// The report. Lengths in mu, angles in rad, times in s. Scores are `null` where an evaluation failed; lists of scores are
/// empty where the job's finish does not ask for them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The published winner.
    pub winner: Scored,
    /// Its scores beside the search's.
    pub winner_scores: Rescored,
    /// The best of generation 0.
    pub first: Scored,
    /// Its scores beside the search's.
    pub first_scores: Rescored,
    /// The best of the search, by the search's own score.
    pub best: Scored,
    /// The archive, best on the reference setting first.
    pub archive: Vec<Archived>,
    /// Every global best of the search, scored again without reuse, as they came.
    pub audits: Vec<Audit>,
    /// Each of the winner's gaits, applied at the start.
    pub gaits: Vec<GaitTrace>,
    /// The winner's tree, as the search scored it (its first, where a candidate has several).
    pub tree: TreeRecord,
    /// The tree's best path, run three ways.
    pub paths: Vec<PathTrace>,
    /// Effort of the whole finish.
    pub counts: Counts,
}

/// Scores of one candidate, one a tree.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rescored {
    /// On fresh RRT seeds, on the search's setting.
    pub fresh: Vec<Option<f64>>,
    /// On fresh RRT seeds, on the reference setting.
    pub reference: Vec<Option<f64>>,
    /// The trees of the search with every expansion simulated, none reused.
    pub without_reuse: Vec<Option<f64>>,
    /// As on the reference setting, with friction × 0.9.
    pub less_friction: Vec<Option<f64>>,
    /// As on the reference setting, with friction × 1.1.
    pub more_friction: Vec<Option<f64>>,
}

/// A genotype of the archive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Archived {
    /// With its score in the search.
    pub candidate: Scored,
    /// Its scores on the reference setting.
    pub reference: Vec<Option<f64>>,
}

/// A global best of the search, scored again without reuse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Audit {
    /// With its score in the search.
    pub candidate: Scored,
    /// The same trees with every expansion simulated.
    pub without_reuse: Vec<Option<f64>>,
}

impl Audit {
    /// Score with reuse minus score without; `None` if that failed.
    pub fn gap(&self) -> Option<f64> {
        mean(&self.without_reuse).map(|without| self.candidate.score - without)
    }
}

/// Puts the report together from the answers of both rounds. `counts`: what they took.
pub fn report(plan: &Plan, found: Found, winner: Scored, done: &[Done], traces: Traces, counts: Counts) -> Report {
    let rescored = |candidate: &Scored| {
        let scores = |question| scores(done, question, candidate);
        Rescored {
            fresh: scores(Question::Fresh),
            reference: scores(Question::Reference),
            without_reuse: scores(Question::WithoutReuse),
            less_friction: scores(Question::LessFriction),
            more_friction: scores(Question::MoreFriction),
        }
    };
    let archived = |(candidate, reference): (&Scored, _)| Archived { candidate: candidate.clone(), reference };
    let archive = plan.ranked(&found, done).into_iter().map(archived).collect();
    let audit =
        |best: &Scored| Audit { candidate: best.clone(), without_reuse: scores(done, Question::WithoutReuse, best) };
    let audits = if plan.audit { found.bests.iter().map(audit).collect() } else { Vec::new() };
    let Traces { gaits, tree, paths } = traces;
    Report {
        winner_scores: rescored(&winner),
        first_scores: rescored(&found.first),
        winner,
        first: found.first,
        best: found.best,
        archive,
        audits,
        gaits,
        tree,
        paths,
        counts,
    }
}

impl Report {
    /// Returns the findings of the search, as far as the report has them: enough to repeat all examinations.
    pub fn found(&self, plan: &Plan) -> Found {
        let entries = self.archive.iter().map(|a| a.candidate.clone()).collect();
        // Back in the order of the search.
        let archive = Archive::restore(plan.direction, plan.archive, entries, Vec::new());
        Found {
            first: self.first.clone(),
            best: self.best.clone(),
            archive: archive.entries().to_vec(),
            bests: self.audits.iter().map(|a| a.candidate.clone()).collect(),
        }
    }
}
