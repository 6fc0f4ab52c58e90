//! Who decides a dispute: a worker that has had no say in it, on another machine where there is one. Of a machine that
//! differs from others two workers are asked at most.

use super::job::ActiveJob;
use super::lease::{Kind, Lease, Task};
use super::round::{Range, most_at_once};
use super::sizing::longest;
use super::worker::{Worker, WorkerId};
use super::{Now, Scheduler};
use crate::record::{Dispute, JobId, Source, Subject};
use sim_core::genotype::Genome;
use std::collections::BTreeSet;

impl Scheduler {
    /// Hands out what is disputed, before anything else.
    pub(super) fn ask_others(&mut self, now: Now) {
        let disputed: Vec<JobId> = self
            .jobs
            .iter()
            .filter(|(_, job)| !job.record.paused && job.open_disputes().next().is_some())
            .map(|(id, _)| id.clone())
            .collect();
        for id in disputed {
            // This runs after every event, and thousands of tasks may be in doubt: where nobody is free nothing is looked at.
            if !self.is_anybody_free() {
                return;
            }
            let mut waiting = self.unasked(&id);
            self.room.count(waiting.len());
            let mut nobody = BTreeSet::new();
            while let Some((worker, range, task)) = self.next_question(now, &id, &mut waiting, &mut nobody) {
                self.ask(now, &worker, &id, range, task);
            }
        }
    }

    fn ask(&mut self, now: Now, worker: &WorkerId, job: &JobId, range: Range, task: Task) {
        let assignment = self.new_assignment();
        self.assign(now, assignment, Lease::new(now, worker, job, range, Kind::Decides), task);
    }

    /// Disputed tasks that nobody works on, by round and index.
    fn unasked(&self, id: &JobId) -> BTreeSet<(u32, u32)> {
        let Some(job) = self.jobs.get(id) else { return BTreeSet::new() };
        let decides = self.leases.values().filter(|l| l.kind == Kind::Decides && l.job == *id);
        let asked: BTreeSet<(u32, u32)> =
            decides.flat_map(|l| l.range.indexes().map(|index| (l.range.round, index))).collect();
        job.open_disputes().map(|d| (d.round, d.index)).filter(|task| !asked.contains(task)).collect()
    }

    /// The first that waits and that somebody may decide now, with those that follow it. Neither it nor what nobody can
    /// decide waits any more afterwards; `nobody` are those who had their say about the latter.
    fn next_question(
        &self,
        now: Now,
        id: &JobId,
        waiting: &mut BTreeSet<(u32, u32)>,
        nobody: &mut BTreeSet<Vec<Source>>,
    ) -> Option<(WorkerId, Range, Task)> {
        let job = self.jobs.get(id)?;
        let (worker, first) = loop {
            let (round, index) = waiting.pop_first()?;
            let Some(dispute) = job.dispute(round, index) else { continue };
            let heard: Vec<Source> = dispute.claims.iter().map(|c| c.source.clone()).collect();
            if nobody.contains(&heard) {
                continue;
            }
            match self.arbiter(now, job, dispute) {
                Some(worker) => break (worker, dispute),
                None => nobody.insert(heard),
            };
        };
        let most = match &first.subject {
            Subject::Candidate(genome) => {
                let fitting = self.time_for(now, self.workers.get(&worker)?, job.cost);
                longest(job.cost).min(fitting).min(most_at_once(genome))
            }
            Subject::Examination(_) => 1,
        };
        let mut run = vec![first];
        while (run.len() as u32) < most {
            let next = (first.round, first.index + run.len() as u32);
            let waits = waiting.contains(&next).then(|| job.dispute(next.0, next.1)).flatten();
            let Some(dispute) = waits.filter(|d| !d.heard(&worker.0)) else { break };
            waiting.remove(&next);
            run.push(dispute);
        }
        let range = Range { round: first.round, first: first.index, count: run.len() as u32 };
        let task = match &first.subject {
            Subject::Examination(examination) => Task::Examine { range, examination: examination.clone() },
            Subject::Candidate(_) => {
                let genome = |d: &&Dispute| match &d.subject {
                    Subject::Candidate(genome) => genome.clone(),
                    Subject::Examination(_) => Genome::new(),
                };
                Task::Evaluate { range, genomes: run.iter().map(genome).collect(), base: range.first }
            }
        };
        Some((worker, range, task))
    }

    fn is_anybody_free(&self) -> bool {
        self.room.with_free_slots().iter().filter_map(|id| self.workers.get(id)).any(has_free_slot)
    }

    /// Who may decide: of those on machines that had no say if there are any, one with a free slot.
    fn arbiter(&self, now: Now, job: &ActiveJob, dispute: &Dispute) -> Option<WorkerId> {
        let candidates = || self.arbiters(job, dispute);
        let elsewhere = candidates().any(|(_, w)| is_elsewhere(w, dispute));
        candidates()
            .filter(|(_, w)| !elsewhere || is_elsewhere(w, dispute))
            .find(|(_, w)| has_free_slot(w) && self.time_for(now, w, job.cost) > 0)
            .map(|(id, _)| id.clone())
    }

    /// All who may decide, busy or not.
    pub(super) fn arbiters<'a>(
        &'a self,
        job: &'a ActiveJob,
        dispute: &'a Dispute,
    ) -> impl Iterator<Item = (&'a WorkerId, &'a Worker)> {
        let heard_out = dispute.heard_out();
        let may = move |id: &WorkerId, w: &Worker| {
            w.takes_work() && w.can_do(&job.record) && !dispute.heard(&id.0) && !heard_out.contains(w.host())
        };
        self.workers.iter().filter(move |(id, w)| may(id, w))
    }
}

fn has_free_slot(worker: &Worker) -> bool {
    worker.is_open() && worker.held.len() < worker.slots as usize
}

/// Whether a worker is on a machine that had no say.
fn is_elsewhere(worker: &Worker, dispute: &Dispute) -> bool {
    dispute.claims.iter().all(|c| *c.source.host != *worker.host())
}
