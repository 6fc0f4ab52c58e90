//! Suspects: tasks that a worker died with. Which of them it was is not known, so each is worked on with nothing beside it
//! on its worker: only then is the next crash its own, and the innocent are not charged.

use super::job::ActiveJob;
use super::lease::{Kind, Lease};
use super::notes::Note;
use super::worker::{Worker, WorkerId};
use super::{Now, Scheduler};
use crate::record::{Charge, JobId};
use std::collections::BTreeSet;

impl Scheduler {
    /// Hands out suspects, each to an idle worker that gets nothing else meanwhile. Answers with the workers that are
    /// kept free for one: at most one a job, so that the others go on.
    pub(super) fn isolate_suspects(&mut self, now: Now) -> BTreeSet<WorkerId> {
        for id in self.jobs_with_suspects() {
            while let Some(worker) = self.idle_cell(now, &id) {
                self.isolate(now, &worker, &id);
            }
        }
        let mut waiting = self.jobs_with_suspects();
        waiting.retain(|id| !self.solos.values().any(|job| job == id));
        self.cells.retain(|id, _| waiting.contains(id));
        for id in &waiting {
            self.keep_a_cell(now, id);
        }
        self.cells.values().cloned().collect()
    }

    /// A worker lives that may have been taken for dead: it was only cut off, and what its death was blamed on is not to
    /// blame. A job that has failed by then stays failed.
    pub(super) fn clear_of_blame(&mut self, worker: &WorkerId) {
        for (id, job) in &mut self.jobs {
            let charges = job.take_back(worker);
            if charges > 0 {
                self.to_note.insert(id.clone());
                self.notes.push(Note::TakenBack { worker: worker.clone(), job: id.clone(), charges });
            }
        }
    }

    fn jobs_with_suspects(&self) -> Vec<JobId> {
        let suspected = self.jobs.iter().filter(|(_, job)| !job.record.paused && job.round.has_pending_suspect());
        suspected.map(|(id, _)| id.clone()).collect()
    }

    /// An idle worker for a suspect.
    fn idle_cell(&mut self, now: Now, id: &JobId) -> Option<WorkerId> {
        let job = self.jobs.get(id).filter(|job| job.round.has_pending_suspect())?;
        let mut looks = 0;
        let idle = |worker: &&WorkerId| {
            looks += 1;
            self.workers.get(*worker).is_some_and(|w| w.held.is_empty() && self.may_be_cell(now, job, w))
        };
        let found = self.room.with_free_slots().iter().find(idle).cloned();
        self.room.count(looks);
        found
    }

    /// Keeps the worker free that will be idle first. Once chosen it stays: it gets nothing more, so it will be.
    fn keep_a_cell(&mut self, now: Now, id: &JobId) {
        let Some(job) = self.jobs.get(id) else { return };
        let may = |w: &Worker| self.may_be_cell(now, job, w);
        if self.cells.get(id).and_then(|cell| self.workers.get(cell)).is_some_and(may) {
            return;
        }
        let able = self.workers.iter().filter(|(_, w)| may(w));
        let first = able.min_by_key(|(_, w)| w.held.len()).map(|(worker, _)| worker.clone());
        self.room.count(self.workers.len());
        match first {
            Some(worker) => self.cells.insert(id.clone(), worker),
            None => self.cells.remove(id),
        };
    }

    fn may_be_cell(&self, now: Now, job: &ActiveJob, worker: &Worker) -> bool {
        worker.is_open() && worker.can_do(&job.record) && self.time_for(now, worker, job.cost) > 0
    }

    fn isolate(&mut self, now: Now, worker: &WorkerId, id: &JobId) {
        let assignment = self.new_assignment();
        let Some(job) = self.jobs.get_mut(id) else { return };
        let Some(range) = job.round.cut_suspect(assignment) else { return };
        let task = job.round.work.task(range);
        let charged = self.charge(id, range.count);
        let lease = Lease { charged, solo: true, ..Lease::new(now, worker, id, range, Kind::Ordinary) };
        self.assign(now, assignment, lease, task);
        self.solos.insert(assignment, id.clone());
        if let Some(worker) = self.workers.get_mut(worker) {
            worker.suspect = Some(assignment);
        }
    }
}

impl ActiveJob {
    /// Holds something against tasks of the round at hand.
    pub(super) fn charge(&mut self, charge: Charge) {
        // A suspicion that is there already adds nothing.
        if charge.attempt || !self.record.charges.contains(&charge) {
            self.record.charges.push(charge);
            self.round.suspect(&self.record.charges);
        }
    }

    /// Takes back what rests on this worker's death, and tells how much that was.
    fn take_back(&mut self, worker: &WorkerId) -> u32 {
        let before = self.record.charges.len();
        self.record.charges.retain(|charge| charge.lost.as_ref() != Some(&worker.0));
        let taken_back = before - self.record.charges.len();
        if taken_back > 0 {
            self.round.suspect(&self.record.charges);
        }
        taken_back as u32
    }
}
