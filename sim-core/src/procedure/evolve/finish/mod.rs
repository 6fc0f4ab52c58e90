//! The work after a search: examinations of the best candidates, and the winner that follows from them.
//!
//! There are two rounds. *Finishing* scores the archive on the reference setting and audits the global bests without
//! reuse; the published winner is the archive's best there. *Reporting* examines the winner and the first generation's
//! best. Without a reference (the paper's bare procedure) there is only the second, of the search's best. Which
//! examinations there are follows from what the search found and from answers alone, so rounds can be stopped and taken
//! up anywhere.

mod examine;

pub use examine::{Answer, Examination, FRICTION_STEP, Question, examine};

use crate::base::score::{Counts, Direction, mean};
use crate::problem::Checked;
use crate::search::Scored;
use crate::search::archive::Archive;

/// The scores that answered an examination, one a tree; `None` where the evaluation failed.
pub type Done = (Examination, Vec<Option<f64>>);

/// The plan of the work, independent of robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Direction: larger or smaller scores are better.
    pub direction: Direction,
    /// Genotypes to be scored on the reference setting; 0: the winner is the search's best.
    pub archive: u32,
    /// True if every global best is scored again without reuse.
    pub audit: bool,
}

/// The candidates that the search found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The best of generation 0, or of the first generation with a success.
    pub first: Scored,
    /// The best of the whole search.
    pub best: Scored,
    /// The best distinct genotypes, best first.
    pub archive: Vec<Scored>,
    /// Every global best, as they came.
    pub bests: Vec<Scored>,
}

impl Plan {
    /// That of a job. Audits are for jobs that reuse transitions.
    pub fn of(job: &Checked) -> Self {
        Self {
            direction: job.direction(),
            archive: job.finish().map_or(0, |f| f.archive),
            audit: job.finish().is_some_and(|f| f.audit) && job.spec().planner.reuse_tolerance > 0.0,
        }
    }

    /// An empty archive for the search to fill.
    pub fn new_archive(&self) -> Archive {
        Archive::new(self.direction, self.archive)
    }

    /// The first round, longest work first; empty without a reference.
    pub fn finishing(&self, found: &Found) -> Vec<Examination> {
        let audits = if self.audit { found.bests.as_slice() } else { &[] };
        let audits = audits.iter().map(|best| Examination::new(Question::WithoutReuse, best));
        let archive = found.archive.iter().map(|entry| Examination::new(Question::Reference, entry));
        audits.chain(archive).collect()
    }

    /// The archive in the order of its scores on the reference setting, ties as in the search. Its first is the winner.
    pub fn ranked<'a>(&self, found: &'a Found, done: &[Done]) -> Vec<(&'a Scored, Vec<Option<f64>>)> {
        let mut ranked: Vec<_> = found.archive.iter().map(|s| (s, scores(done, Question::Reference, s))).collect();
        let worse = |a: &[Option<f64>], b: &[Option<f64>]| self.direction.better(mean(b), mean(a));
        // Stable, and `better` is a strict weak order: a failure is worse than any number.
        ranked.sort_by(|(_, a), (_, b)| worse(a, b).cmp(&worse(b, a)));
        ranked
    }

    /// The published winner.
    pub fn winner(&self, found: &Found, done: &[Done]) -> Scored {
        self.ranked(found, done).first().map_or(&found.best, |(winner, _)| winner).clone()
    }

    /// The second round, longest work first: what the report needs and `done` has not.
    pub fn reporting(&self, found: &Found, winner: &Scored, done: &[Done]) -> Vec<Examination> {
        let first = &found.first;
        let mut wanted = vec![(Question::WithoutReuse, winner)];
        if self.archive > 0 {
            wanted.extend([
                (Question::LessFriction, winner),
                (Question::MoreFriction, winner),
                (Question::Reference, first),
            ]);
        }
        wanted.extend([(Question::Traces, winner), (Question::Fresh, winner), (Question::Fresh, first)]);
        let mut round: Vec<Examination> = Vec::new();
        for (question, candidate) in wanted {
            let known = done.iter().map(|(e, _)| e).chain(&round).any(|e| e.is(question, candidate));
            if !known {
                round.push(Examination::new(question, candidate));
            }
        }
        round
    }
}

/// The answer to a question; empty if it was not asked.
pub(crate) fn scores(done: &[Done], question: Question, candidate: &Scored) -> Vec<Option<f64>> {
    done.iter().find(|(e, _)| e.is(question, candidate)).map(|(_, scores)| scores.clone()).unwrap_or_default()
}

/// Sum of what examinations took.
pub fn total<'a>(counts: impl IntoIterator<Item = &'a Counts>) -> Counts {
    counts.into_iter().fold(Counts::default(), |mut sum, &c| {
        sum += c;
        sum
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scored(candidate: u32, score: f64) -> Scored {
        Scored { generation: 0, candidate, score, genotype: vec![f64::from(candidate)].into() }
    }

    fn found() -> Found {
        let archive = vec![scored(3, 9.0), scored(0, 8.0), scored(1, 8.0), scored(2, 7.0)];
        Found { first: scored(5, 1.0), best: scored(3, 9.0), archive, bests: vec![scored(5, 1.0), scored(3, 9.0)] }
    }

    const PLAN: Plan = Plan { direction: Direction::Maximise, archive: 4, audit: true };

    fn answered(reference: [Option<f64>; 4]) -> Vec<Done> {
        let found = found();
        let answer = |s: &Scored, score| (Examination::new(Question::Reference, s), vec![score]);
        found.archive.iter().zip(reference).map(|(s, r)| answer(s, r)).collect()
    }

    #[test]
    fn winner_is_best_on_reference_with_ties_by_search() {
        let winner = |reference| PLAN.winner(&found(), &answered(reference)).candidate;
        assert_eq!(winner([Some(1.0), Some(2.0), Some(3.0), Some(2.5)]), 1);
        assert_eq!(winner([Some(2.0), Some(3.0), Some(3.0), Some(3.0)]), 0);
        assert_eq!(winner([None, Some(-1.0), None, Some(-2.0)]), 0);
        assert_eq!(winner([None; 4]), 3);
        let least = Plan { direction: Direction::Minimise, ..PLAN };
        assert_eq!(least.winner(&found(), &answered([Some(1.0), Some(2.0), Some(0.5), None])).candidate, 1);
    }

    #[test]
    fn search_best_wins_without_reference() {
        let bare = Plan { archive: 0, audit: false, ..PLAN };
        let found = Found { archive: Vec::new(), ..found() };
        assert!(bare.finishing(&found).is_empty());
        let winner = bare.winner(&found, &[]);
        assert_eq!(winner.candidate, 3);
        let asked: Vec<Question> = bare.reporting(&found, &winner, &[]).iter().map(|e| e.question).collect();
        assert_eq!(asked, [Question::WithoutReuse, Question::Traces, Question::Fresh, Question::Fresh]);
    }

    #[test]
    fn nothing_is_examined_twice() {
        let found = found();
        let round = PLAN.finishing(&found);
        assert_eq!(round.len(), 2 + 4);
        let done: Vec<Done> = round.into_iter().map(|e| (e, vec![Some(1.0)])).collect();
        // The search's best is audited as a global best; the first generation's best is not in the archive.
        let asked = PLAN.reporting(&found, &found.best, &done);
        assert!(!asked.iter().any(|e| e.is(Question::WithoutReuse, &found.best)));
        assert!(asked.iter().any(|e| e.is(Question::Reference, &found.first)));
        // A winner that never was a global best is still scored without reuse.
        let asked = PLAN.reporting(&found, &found.archive[1], &done);
        assert!(asked.iter().any(|e| e.is(Question::WithoutReuse, &found.archive[1])));
        // The winner can be the first generation's best: one set of examinations then.
        let one = Found { first: found.best.clone(), ..found.clone() };
        let asked = PLAN.reporting(&one, &one.best, &done);
        assert_eq!(asked.iter().filter(|e| e.question == Question::Fresh).count(), 1);
    }
}
