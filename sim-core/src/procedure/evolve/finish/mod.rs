//! Finish of a search: examinations of the best candidates, and the winner that follows from them.
//!
//! There are two rounds. *Finishing* scores the archive on the reference setting and audits the global bests without
//! reuse; the published winner is the archive's best on the reference setting. *Reporting* examines the winner and the
//! first generation's best. Without a reference (the paper's procedure) there is only *reporting*, and the winner is
//! the search's best. The examinations follow only from the search's result and from earlier answers, so rounds can be
//! stopped and resumed anywhere.

mod examine;

pub use examine::{Answer, Examination, FRICTION_STEP, Question, examine};

use crate::base::score::{Counts, Direction, mean};
use crate::problem::Checked;
use crate::search::Scored;
use crate::search::archive::Archive;

/// An examination and its scores, one per tree; `None` for a failed evaluation.
pub type Done = (Examination, Vec<Option<f64>>);

/// Rules of a job's finish, independent of its robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Direction of better scores: larger or smaller.
    pub direction: Direction,
    /// Number of genotypes to score on the reference setting; 0: the winner is the search's best.
    pub archive: u32,
    /// True if every global best is scored again without reuse.
    pub audit: bool,
}

/// Result of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The best of generation 0, or of the first generation with a success.
    pub first: Scored,
    /// The best of the whole search.
    pub best: Scored,
    /// The best distinct genotypes, best first.
    pub archive: Vec<Scored>,
    /// Every global best, in the order of generations.
    pub bests: Vec<Scored>,
}

impl Plan {
    /// Returns the rules of a job's finish. Audits apply only to jobs that reuse transitions.
    pub fn of(job: &Checked) -> Self {
        Self {
            direction: job.direction(),
            archive: job.finish().map_or(0, |f| f.archive),
            audit: job.finish().is_some_and(|f| f.audit) && job.spec().planner.reuse_tolerance > 0.0,
        }
    }

    /// Creates an empty archive for the search to fill.
    pub fn new_archive(&self) -> Archive {
        Archive::new(self.direction, self.archive)
    }

    /// Returns the examinations of the first round, longest work first. They are empty without a reference.
    pub fn finishing(&self, found: &Found) -> Vec<Examination> {
        let audits = if self.audit { found.bests.as_slice() } else { &[] };
        let audits = audits.iter().map(|best| Examination::new(Question::WithoutReuse, best));
        let archive = found.archive.iter().map(|entry| Examination::new(Question::Reference, entry));
        audits.chain(archive).collect()
    }

    /// Returns the archive in the order of its scores on the reference setting; ties keep the search's order. The first
    /// entry is the winner.
    pub fn ranked<'a>(&self, found: &'a Found, done: &[Done]) -> Vec<(&'a Scored, Vec<Option<f64>>)> {
        let mut ranked: Vec<_> = found.archive.iter().map(|s| (s, scores(done, Question::Reference, s))).collect();
        let worse = |a: &[Option<f64>], b: &[Option<f64>]| self.direction.better(mean(b), mean(a));
        // The sort is stable, and `better` is a strict weak order: a failure is worse than any number.
        ranked.sort_by(|(_, a), (_, b)| worse(a, b).cmp(&worse(b, a)));
        ranked
    }

    /// Returns the published winner.
    pub fn winner(&self, found: &Found, done: &[Done]) -> Scored {
        self.ranked(found, done).first().map_or(&found.best, |(winner, _)| winner).clone()
    }

    /// Returns the examinations of the second round, longest work first: those that the report needs and `done` lacks.
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

/// Returns the scores that answer a question; empty if it was not examined.
pub(crate) fn scores(done: &[Done], question: Question, candidate: &Scored) -> Vec<Option<f64>> {
    done.iter().find(|(e, _)| e.is(question, candidate)).map(|(_, scores)| scores.clone()).unwrap_or_default()
}

/// Returns the sum of the counts of examinations.
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
    fn examinations_are_not_repeated_in_report_round() {
        let found = found();
        let round = PLAN.finishing(&found);
        assert_eq!(round.len(), 2 + 4);
        let done: Vec<Done> = round.into_iter().map(|e| (e, vec![Some(1.0)])).collect();
        // The search's best is audited as a global best; the first generation's best is not in the archive.
        let asked = PLAN.reporting(&found, &found.best, &done);
        assert!(!asked.iter().any(|e| e.is(Question::WithoutReuse, &found.best)));
        assert!(asked.iter().any(|e| e.is(Question::Reference, &found.first)));
        // A winner that was never a global best is still scored without reuse.
        let asked = PLAN.reporting(&found, &found.archive[1], &done);
        assert!(asked.iter().any(|e| e.is(Question::WithoutReuse, &found.archive[1])));
        // If the winner is the first generation's best, there is one set of examinations.
        let one = Found { first: found.best.clone(), ..found.clone() };
        let asked = PLAN.reporting(&one, &one.best, &done);
        assert_eq!(asked.iter().filter(|e| e.question == Question::Fresh).count(), 1);
    }
}
