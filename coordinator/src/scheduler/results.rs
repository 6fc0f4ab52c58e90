//! Results come in: on time, late, twice, wrong, or for something long over.

use super::job::End;
use super::lease::{AssignmentId, Kind};
use super::notes::{LeaseEnd, Note};
use super::older::Contradicted;
use super::round::{Finder, Outcome, Range, Recorded};
use super::worker::WorkerId;
use super::{Action, Now, Scheduler, stuck};
use crate::record::{JobId, JobState};
use crate::store::Write;
use sim_core::base::digest::Digest;
use std::collections::BTreeSet;
use std::time::Duration;

/// What a worker delivers.
#[derive(Clone, Debug)]
pub struct Completed {
    /// Who.
    pub worker: WorkerId,
    /// Which assignment it was.
    pub assignment: AssignmentId,
    /// Of which job.
    pub job: JobId,
    /// The engine that ran.
    pub engine: Digest,
    /// How long a slot was busy; zero if unknown.
    pub compute: Duration,
    /// What came of it.
    pub delivery: Delivery,
}

/// What came of an assignment.
#[derive(Clone, Debug)]
pub enum Delivery {
    /// Scores.
    Evaluations {
        /// The generation.
        generation: u32,
        /// Index of the first.
        first: u32,
        /// By index from `first` on.
        outcomes: Vec<Outcome>,
    },
    /// The answer to a question.
    Examination {
        /// The round.
        round: u32,
        /// Its index there.
        index: u32,
        /// The answer.
        outcome: Outcome,
    },
    /// It could not be carried out.
    Failure(String),
}

/// What became of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It counts.
    Accepted,
    /// The same bits were there before.
    Duplicate,
    /// Other bits were there before: somebody computes wrongly.
    Conflict,
    /// The job ended.
    Obsolete,
    /// It is of a generation before the one sealed last: nothing is known of it here, see [`Scheduler::compare`].
    Older,
    /// No such job or range.
    Unknown,
    /// What this worker says is not trusted any more; nothing was stored.
    Quarantined,
}

impl Verdict {
    /// As a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Duplicate => "duplicate",
            Self::Conflict => "conflict",
            Self::Obsolete => "obsolete",
            Self::Older => "older",
            Self::Unknown => "unknown",
            Self::Quarantined => "quarantined",
        }
    }
}

impl Scheduler {
    /// A result. Whoever has the lease: the first right one wins.
    pub fn complete(&mut self, now: Now, completed: Completed) -> Verdict {
        let verdict = self.take_result(now, completed);
        self.dispatch(now);
        verdict
    }

    fn take_result(&mut self, now: Now, completed: Completed) -> Verdict {
        let Completed { worker, assignment, job: id, engine, compute, delivery } = completed;
        if self.quarantined.contains_key(&worker) {
            return Verdict::Quarantined;
        }
        if !self.workers.contains_key(&worker) {
            self.clear_of_blame(&worker);
        }
        let lease = self.leases.get(&assignment).filter(|l| l.worker == worker && l.job == id);
        let (own, decides) = (lease.is_some(), lease.is_some_and(|l| l.kind == Kind::Decides));
        let Some(job) = self.jobs.get(&id) else {
            return if self.ended.contains(&id) { Verdict::Obsolete } else { Verdict::Unknown };
        };
        if job.record.engine_digest != engine {
            return Verdict::Unknown;
        }
        match delivery {
            Delivery::Failure(reason) => {
                if !own {
                    return Verdict::Obsolete;
                }
                let others = decides || self.others_can(&worker, &id);
                if let Some(lease) = self.release(assignment, LeaseEnd::Failed) {
                    if others && let Some(worker) = self.workers.get_mut(&worker) {
                        // It may be the worker: somebody else, for a while.
                        worker.refused.insert(id.clone(), now.since_start + self.settings.lease);
                        self.wake_by(now.since_start + self.settings.lease);
                    }
                    self.blame(now, &lease, true, None, &reason);
                }
                Verdict::Accepted
            }
            Delivery::Evaluations { generation, first, outcomes } => {
                let Ok(count) = u32::try_from(outcomes.len()) else { return Verdict::Unknown };
                let range = Range { round: generation, first, count };
                let fits = first.checked_add(count).is_some_and(|end| count > 0 && end <= job.record.population);
                let job_generation = job.record.generations_done;
                if !fits || generation > job.record.generations_done || generation >= job.record.generations_total {
                    return Verdict::Unknown;
                }
                if own {
                    self.settle(assignment, count, compute);
                }
                if generation < job_generation {
                    return self.take_late(now, &id, range, outcomes, &worker, decides);
                }
                self.take_outcomes(now, &id, range, outcomes, &worker, decides)
            }
            Delivery::Examination { round, index, outcome } => {
                let range = Range { round, first: index, count: 1 };
                let examined = job.examined.iter().any(|r| r.contains(&range));
                if !examined && (job.round.is_generation() || !job.round.contains(&range)) {
                    return Verdict::Unknown;
                }
                if own {
                    self.settle(assignment, 1, compute);
                }
                if examined {
                    return self.take_late(now, &id, range, vec![outcome], &worker, decides);
                }
                self.take_outcomes(now, &id, range, vec![outcome], &worker, decides)
            }
        }
    }

    /// Whether another worker takes this job's work.
    fn others_can(&self, worker: &WorkerId, id: &JobId) -> bool {
        let Some(job) = self.jobs.get(id) else { return false };
        self.workers.iter().any(|(other, w)| other != worker && w.takes_work() && w.can_do(&job.record))
    }

    /// Results of the round at hand.
    fn take_outcomes(
        &mut self,
        now: Now,
        id: &JobId,
        range: Range,
        outcomes: Vec<Outcome>,
        worker: &WorkerId,
        decides: bool,
    ) -> Verdict {
        let finder = self.finder(worker);
        let Some(job) = self.jobs.get_mut(id).filter(|j| j.round.contains(&range)) else { return Verdict::Unknown };
        // What is new, in ranges without a break; and what may contradict what is there, or decide a dispute.
        let mut ranges: Vec<(u32, Vec<Outcome>)> = Vec::new();
        let mut there: Vec<(u32, Outcome)> = Vec::new();
        // Others that were given some of it.
        let mut holders: BTreeSet<AssignmentId> = BTreeSet::new();
        for (index, outcome) in range.indexes().zip(outcomes) {
            match job.round.record(index, &outcome, &finder) {
                Recorded::New(holder) => {
                    holders.extend(holder);
                    match ranges.last_mut() {
                        Some((first, run)) if *first + run.len() as u32 == index => run.push(outcome),
                        _ => ranges.push((index, vec![outcome])),
                    }
                }
                Recorded::Same if !job.is_disputed(range.round, index) => {}
                Recorded::Same | Recorded::Other => there.push((index, outcome)),
            }
        }
        let accepted: usize = ranges.iter().map(|(_, run)| run.len()).sum();
        if let Some(finder) = self.workers.get_mut(worker) {
            finder.evaluations += accepted as u64;
            if std::mem::take(&mut finder.stuck) >= stuck::MOST_TIMES {
                self.room.may_have(worker);
                self.room.workers_changed();
            }
        }
        if accepted > 0 {
            self.notes.push(Note::Taken {
                worker: worker.clone(),
                job: id.clone(),
                round: range.round,
                evaluations: job.round.is_generation(),
                count: accepted as u32,
            });
            let done = |a: &AssignmentId| self.leases.get(a).is_some_and(|l| job.round.is_done(&l.range));
            let originals = holders.into_iter().filter(done);
            let needless: Vec<AssignmentId> =
                originals.flat_map(|a| [Some(a), self.copies.get(&a).copied()]).flatten().collect();
            self.cancel_leases(&needless);
        }
        // Before anything is sealed: what is in doubt is not.
        let conflict = !there.is_empty() && self.weigh(now, id, &range, there, worker, &Contradicted::new());
        if accepted > 0 {
            self.seal_or_store(now, id, range.round, ranges, finder);
        } else {
            self.seal(now, id);
        }
        match (conflict, accepted) {
            (true, _) => Verdict::Conflict,
            (false, 0) if !decides => Verdict::Duplicate,
            (false, _) => Verdict::Accepted,
        }
    }

    /// Results of a round that is sealed: they can only agree or disagree.
    fn take_late(
        &mut self,
        now: Now,
        id: &JobId,
        range: Range,
        outcomes: Vec<Outcome>,
        worker: &WorkerId,
        decides: bool,
    ) -> Verdict {
        let Some(job) = self.jobs.get(id) else { return Verdict::Unknown };
        let known = job.last.iter().any(|s| s.contains(&range)) || job.examined.iter().any(|r| r.contains(&range));
        let disputed = range.indexes().any(|index| job.is_disputed(range.round, index));
        if !known && !disputed {
            return Verdict::Older;
        }
        let conflict = self.weigh(now, id, &range, range.indexes().zip(outcomes), worker, &Contradicted::new());
        // It may have waited for that.
        self.seal(now, id);
        if conflict {
            Verdict::Conflict
        } else if decides {
            Verdict::Accepted
        } else {
            Verdict::Duplicate
        }
    }

    /// Keeps what came in, and goes on to the next round if this one is complete.
    fn seal_or_store(&mut self, now: Now, id: &JobId, round: u32, ranges: Vec<(u32, Vec<Outcome>)>, finder: Finder) {
        let Some(job) = self.jobs.get(id) else { return };
        let write = Action::Write(Box::new(Write::Results { job: id.clone(), round, ranges, finder }));
        // Of a sealed generation only the scores are kept; answers are needed until the report is made.
        let of_generation = job.round.is_generation();
        if !of_generation {
            self.actions.push(write.clone());
        }
        if self.seal(now, id) {
            return;
        }
        if of_generation {
            self.actions.push(write);
        }
        if let Some(event) = self.jobs.get_mut(id).and_then(|job| job.progress(now)) {
            self.actions.push(Action::Publish(id.clone(), Box::new(event)));
        }
    }

    /// Seals the round at hand if it is complete.
    pub(super) fn seal(&mut self, now: Now, id: &JobId) -> bool {
        let Some((write, end)) = self.jobs.get_mut(id).and_then(|job| job.seal(now)) else { return false };
        self.actions.extend(write.map(|write| Action::Write(Box::new(write))));
        match end {
            None => {}
            Some(End::Succeeded) => {
                self.jobs.remove(id);
                self.forget(id);
            }
            Some(End::Failed(reason)) => {
                self.end_job(now, id, JobState::Failed, reason);
            }
        }
        true
    }

    /// A lease was worked off: its measured cost replaces the estimate.
    fn settle(&mut self, id: AssignmentId, count: u32, compute: Duration) {
        let Some(lease) = self.leases.get_mut(&id) else { return };
        if let Some(job) = self.jobs.get_mut(&lease.job) {
            if compute.is_zero() {
                // Unknown: the estimate stands.
                lease.charged = 0.0;
            } else {
                let each = compute.as_secs_f64() / f64::from(count);
                job.cost = Some(job.cost.map_or(each, |cost| 0.7 * cost + 0.3 * each));
                job.finish_tag += compute.as_secs_f64() / f64::from(job.record.priority);
            }
        }
        // Should a result cover less than was asked for, the rest is still to be done.
        self.drop_lease(id);
    }
}
