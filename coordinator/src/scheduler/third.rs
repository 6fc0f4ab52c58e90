//! Who decides a dispute: a worker that has had no say in it, on another machine where there is one.

use super::job::ActiveJob;
use super::lease::{Kind, Lease, Task};
use super::round::Range;
use super::sizing::longest;
use super::worker::{Worker, WorkerId};
use super::{Now, Scheduler};
use crate::record::{Dispute, JobId, Subject};
use sim_core::score::Genome;

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
            while let Some((worker, range, task)) = self.next_question(now, &id) {
                self.ask(now, &worker, &id, range, task);
            }
        }
    }

    fn ask(&mut self, now: Now, worker: &WorkerId, job: &JobId, range: Range, task: Task) {
        let assignment = self.new_assignment();
        self.assign(now, assignment, Lease::new(now, worker, job, range, Kind::Decides), task);
    }

    /// A dispute that nobody works on, with those that follow it, and who may decide them now.
    fn next_question(&self, now: Now, id: &JobId) -> Option<(WorkerId, Range, Task)> {
        let job = self.jobs.get(id)?;
        let waiting: Vec<&Dispute> = job.open_disputes().filter(|d| !self.is_asked(id, d)).collect();
        let (worker, first) = waiting.iter().find_map(|d| Some((self.arbiter(now, job, d)?, *d)))?;
        let most = match &first.subject {
            Subject::Candidate(_) => longest(job.cost).min(self.time_for(now, self.workers.get(&worker)?, job.cost)),
            Subject::Examination(_) => 1,
        };
        let mut run = vec![first];
        while (run.len() as u32) < most {
            let next = (first.round, first.index + run.len() as u32);
            let Some(dispute) = waiting.iter().find(|d| (d.round, d.index) == next && !d.heard(&worker.0)) else {
                break;
            };
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

    fn is_asked(&self, id: &JobId, dispute: &Dispute) -> bool {
        self.leases.values().any(|l| {
            l.kind == Kind::Decides
                && l.job == *id
                && l.range.round == dispute.round
                && l.range.indexes().contains(&dispute.index)
        })
    }

    /// Who may decide: of those on machines that had no say if there are any, one with a free slot.
    fn arbiter(&self, now: Now, job: &ActiveJob, dispute: &Dispute) -> Option<WorkerId> {
        let candidates = || self.arbiters(job, dispute);
        let elsewhere = candidates().any(|(_, w)| is_elsewhere(w, dispute));
        candidates()
            .filter(|(_, w)| !elsewhere || is_elsewhere(w, dispute))
            .find(|(_, w)| w.is_open() && w.held.len() < w.slots as usize && self.time_for(now, w, job.cost) > 0)
            .map(|(id, _)| id.clone())
    }

    /// All who may decide, busy or not.
    pub(super) fn arbiters<'a>(
        &'a self,
        job: &'a ActiveJob,
        dispute: &'a Dispute,
    ) -> impl Iterator<Item = (&'a WorkerId, &'a Worker)> {
        let engine = &job.record.engine_digest;
        let may = move |id: &WorkerId, w: &Worker| {
            w.takes_work()
                && w.engines.contains(engine)
                && !w.refused.contains_key(&job.record.id)
                && !dispute.heard(&id.0)
        };
        self.workers.iter().filter(move |(id, w)| may(id, w))
    }
}

/// Whether a worker is on a machine that had no say.
fn is_elsewhere(worker: &Worker, dispute: &Dispute) -> bool {
    dispute.claims.iter().all(|c| *c.source.host != *worker.host())
}
