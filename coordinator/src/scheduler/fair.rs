//! Which job gets the next free slot: start-time fair queueing (Goyal, Vin and Cheng 1996) by measured cost.
//!
//! A job's tag grows by the slot time of what it is given, divided by its priority; the job with the smallest tag is
//! next. A job that had nothing to hand out for a while may catch up on a bounded part of it: what it misses while the last
//! candidates of a generation are out, but not hours of waiting.

use super::job::ActiveJob;
use super::lease::{AssignmentId, Lease, Task};
use super::round::Work;
use super::sizing::{Cut, may_prefetch, range_size};
use super::worker::{Worker, WorkerId};
use super::{Action, Message, Now, Scheduler};
use crate::record::JobId;
use proto::limits::DEFAULT_PRIORITY;

/// Slot time of an evaluation nobody has measured yet, s.
const UNKNOWN_COST: f64 = 1.0;

/// How much of its missed share a job may catch up on, s of slot time at the priority of most jobs.
const CREDIT: f64 = 60.0 / DEFAULT_PRIORITY as f64;

/// Whether a free slot is filled, or a busy one gets its next work in advance.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fill {
    FreeSlots,
    InAdvance,
}

impl Scheduler {
    /// Hands out what is pending: first to free slots everywhere, then one range a slot in advance where ranges are
    /// short.
    pub(super) fn dispatch(&mut self, now: Now) {
        for fill in [Fill::FreeSlots, Fill::InAdvance] {
            if !self.jobs.values().any(ActiveJob::has_pending) {
                return;
            }
            let ids: Vec<WorkerId> =
                self.workers.iter().filter(|(_, w)| w.takes_work()).map(|(id, _)| id.clone()).collect();
            for id in ids {
                self.fill(now, &id, fill);
            }
        }
    }

    fn fill(&mut self, now: Now, id: &WorkerId, fill: Fill) {
        while let Some(worker) = self.workers.get(id) {
            let room = match fill {
                Fill::FreeSlots => worker.slots as usize,
                Fill::InAdvance => 2 * worker.slots as usize,
            };
            if worker.held.len() >= room {
                return;
            }
            let Some((job, size)) = self.next_job(id, fill) else { return };
            self.hand_out(now, id, &job, size);
        }
    }

    /// The job whose turn it is on this worker, and the size of the range.
    fn next_job(&self, id: &WorkerId, fill: Fill) -> Option<(JobId, u32)> {
        let worker = self.workers.get(id)?;
        let mut next: Option<(f64, u64, &JobId, u32)> = None;
        for (id, job) in &self.jobs {
            let Some(size) = self.offer(worker, id, job, fill) else { continue };
            let tag = job.finish_tag.max(self.virtual_time - CREDIT);
            if next.is_none_or(|(best, number, ..)| (tag, job.record.number) < (best, number)) {
                next = Some((tag, job.record.number, id, size));
            }
        }
        next.map(|(_, _, id, size)| (id.clone(), size))
    }

    /// How many tasks this job would give to this worker; `None` if nothing.
    fn offer(&self, worker: &Worker, id: &JobId, job: &ActiveJob, fill: Fill) -> Option<u32> {
        let engine = &job.record.engine_digest;
        if !job.has_pending() || !worker.engines.contains(engine) || worker.refused.contains_key(id) {
            return None;
        }
        let round = &job.round;
        let most = round.work.most_at_once();
        match round.work {
            Work::Candidates(_) => {
                let (all, pending, slots) = (round.size(), round.pending(), self.slots_for(engine));
                let size = range_size(Cut { all, pending, slots, cost: job.cost, at_once: job.at_once, most });
                (fill == Fill::FreeSlots || may_prefetch(size, job.cost)).then_some(size)
            }
            Work::Examinations(_) => (fill == Fill::FreeSlots).then_some(most),
        }
    }

    fn hand_out(&mut self, now: Now, worker_id: &WorkerId, job_id: &JobId, size: u32) {
        let (Some(worker), Some(job)) = (self.workers.get_mut(worker_id), self.jobs.get_mut(job_id)) else { return };
        let Some(session) = worker.session else { return };
        let assignment = AssignmentId(self.next_assignment);
        let Some(range) = job.round.cut(size, assignment) else { return };
        let task = match &job.round.work {
            Work::Candidates(genomes) => Task::Evaluate { range, genomes: genomes.clone() },
            Work::Examinations(all) => Task::Examine { range, examination: all[range.first as usize].clone() },
        };
        self.next_assignment += 1;

        let charged = job.cost.unwrap_or(UNKNOWN_COST) * f64::from(range.count) / f64::from(job.record.priority);
        let tag = job.finish_tag.max(self.virtual_time - CREDIT);
        self.virtual_time = self.virtual_time.max(tag);
        job.finish_tag = tag + charged;

        let since = now.since_start;
        let lease = Lease { worker: worker_id.clone(), job: job_id.clone(), range, since, charged };
        self.leases.insert(assignment, lease);
        worker.held.insert(assignment);
        let toml = worker.known_jobs.insert(job_id.clone()).then(|| job.toml.clone());
        if let Some(write) = job.start(now) {
            self.actions.push(Action::Write(Box::new(write)));
        }
        let message = Message::Assign { assignment, job: job_id.clone(), toml, task };
        self.actions.push(Action::Send(worker_id.clone(), session, message));
    }
}
