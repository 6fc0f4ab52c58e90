//! Report of a job that evolves. Workers do the examinations, the coordinator assembles the report and stores it with
//! the job, and the command line draws it.

use super::finish::{Done, Found, Plan, Question, scores};
use crate::base::score::{Counts, mean};
use crate::report::{GaitTrace, PathTrace, Traces, TreeRecord};
use crate::search::Scored;
use crate::search::archive::Archive;
use serde::{Deserialize, Serialize};

/// Report of a job that evolves. Lengths in mu, angles in rad, times in s. Scores are `null` for failed evaluations;
/// lists of scores are empty if the job's finish does not include them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The published winner.
    pub winner: Scored,
    /// The winner's scores in the finish.
    pub winner_scores: Rescored,
    /// The best of generation 0.
    pub first: Scored,
    /// Scores of the first generation's best in the finish.
    pub first_scores: Rescored,
    /// The best of the search by the search's own score.
    pub best: Scored,
    /// The archive, ordered by score on the reference setting, best first.
    pub archive: Vec<Archived>,
    /// Every global best of the search, scored again without reuse, in the order of generations.
    pub audits: Vec<Audit>,
    /// Each of the winner's gaits, executed at the start.
    pub gaits: Vec<GaitTrace>,
    /// The winner's tree as the search scored it; the first one if a candidate has several trees.
    pub tree: TreeRecord,
    /// The tree's best path, executed in three ways.
    pub paths: Vec<PathTrace>,
    /// Effort of the whole finish.
    pub counts: Counts,
}

/// Scores of one candidate, one per tree.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rescored {
    /// Scores on fresh RRT seeds, on the search's setting.
    pub fresh: Vec<Option<f64>>,
    /// Scores on fresh RRT seeds, on the reference setting.
    pub reference: Vec<Option<f64>>,
    /// Scores of the search's trees with every expansion simulated and none reused.
    pub without_reuse: Vec<Option<f64>>,
    /// Scores as in `reference`, with friction × 0.9.
    pub less_friction: Vec<Option<f64>>,
    /// Scores as in `reference`, with friction × 1.1.
    pub more_friction: Vec<Option<f64>>,
}

/// A genotype of the archive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Archived {
    /// The genotype with its score in the search.
    pub candidate: Scored,
    /// Scores on the reference setting.
    pub reference: Vec<Option<f64>>,
}

/// A global best of the search, scored again without reuse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Audit {
    /// The global best with its score in the search.
    pub candidate: Scored,
    /// Scores of the same trees with every expansion simulated.
    pub without_reuse: Vec<Option<f64>>,
}

impl Audit {
    /// Returns the score with reuse minus the score without; `None` if the latter failed.
    pub fn gap(&self) -> Option<f64> {
        mean(&self.without_reuse).map(|without| self.candidate.score - without)
    }
}

/// Assembles the report from the answers of both rounds. `counts` is the effort of both.
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
    /// Returns the result of the search as far as the report holds it, which is enough to repeat all examinations.
    pub fn found(&self, plan: &Plan) -> Found {
        let entries = self.archive.iter().map(|a| a.candidate.clone()).collect();
        // Restores the order of the search.
        let archive = Archive::restore(plan.direction, plan.archive, entries, Vec::new());
        Found {
            first: self.first.clone(),
            best: self.best.clone(),
            archive: archive.entries().to_vec(),
            bests: self.audits.iter().map(|a| a.candidate.clone()).collect(),
        }
    }
}
