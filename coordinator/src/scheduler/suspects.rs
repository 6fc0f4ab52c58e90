//! Suspects: tasks that a worker died with. Which of them it was is not known, so each is worked on with nothing beside it
//! on its worker: only then is the next crash its own, and the innocent are not charged.

use super::lease::{Kind, Lease};
use super::worker::{Worker, WorkerId};
use super::{Now, Scheduler};
use crate::record::JobId;
use std::collections::BTreeSet;

impl Scheduler {
    /// Hands out suspects, each to an idle worker that gets nothing else meanwhile. Answers with the workers that are
    /// kept free for one: at most one a job, so that the others go on.
    pub(super) fn isolate_suspects(&mut self, now: Now) -> BTreeSet<WorkerId> {
        let mut kept_free = BTreeSet::new();
        let waiting = |s: &Self| -> Vec<JobId> {
            let suspected = s.jobs.iter().filter(|(_, job)| !job.record.paused && job.round.has_pending_suspect());
            suspected.map(|(id, _)| id.clone()).collect()
        };
        for id in waiting(self) {
            while let Some(worker) = self.cell(now, &id, true) {
                self.isolate(now, &worker, &id);
            }
        }
        for id in waiting(self) {
            if !self.leases.values().any(|l| l.job == id && l.solo) {
                kept_free.extend(self.cell(now, &id, false));
            }
        }
        kept_free
    }

    /// An idle worker for a suspect, or the one that will be so first.
    fn cell(&self, now: Now, id: &JobId, idle: bool) -> Option<WorkerId> {
        let job = self.jobs.get(id).filter(|job| job.round.has_pending_suspect())?;
        let may = |w: &Worker| {
            w.is_open()
                && w.engines.contains(&job.record.engine_digest)
                && !w.refused.contains_key(id)
                && (!idle || w.held.is_empty())
                && self.time_for(now, w, job.cost) > 0
        };
        let able = self.workers.iter().filter(|(_, w)| may(w));
        able.min_by_key(|(_, w)| w.held.len()).map(|(id, _)| id.clone())
    }

    fn isolate(&mut self, now: Now, worker: &WorkerId, id: &JobId) {
        let assignment = self.new_assignment();
        let Some(job) = self.jobs.get_mut(id) else { return };
        let Some(range) = job.round.cut_suspect(assignment) else { return };
        let task = job.round.work.task(range);
        let charged = self.charge(id, range.count);
        let lease = Lease { charged, solo: true, ..Lease::new(now, worker, id, range, Kind::Ordinary) };
        self.assign(now, assignment, lease, task);
        if let Some(worker) = self.workers.get_mut(worker) {
            worker.suspect = Some(assignment);
        }
    }
}
