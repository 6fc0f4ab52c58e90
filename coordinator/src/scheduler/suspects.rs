//! Suspects: tasks that ran on a worker that crashed. The scheduler can't know which of them caused the crash. So each
//! suspect runs on a worker without any other lease. If that worker crashes too, only this task is charged.

use super::dispatch::charge_job;
use super::fleet::{Worker, WorkerId};
use super::job::ActiveJob;
use super::lease::{Lease, LeaseKind, assign};
use super::leaving::time_for;
use super::{Now, Scheduler};
use crate::record::{Charge, JobId};
use std::collections::BTreeSet;

/// Assigns suspects, each to an idle worker that gets no other lease meanwhile. Returns the workers that are reserved
/// for a suspect: at most one per job, so that the other workers continue.
pub(super) fn isolate_suspects(core: &mut Scheduler, now: Now) -> BTreeSet<WorkerId> {
    for id in jobs_with_suspects(core) {
        while let Some(worker) = idle_worker(core, now, &id) {
            isolate(core, now, &worker, &id);
        }
    }
    let mut waiting = jobs_with_suspects(core);
    waiting.retain(|id| !core.leases.solos.values().any(|job| job == id));
    core.queue.reserved.retain(|id, _| waiting.contains(id));
    for id in &waiting {
        reserve_worker(core, now, id);
    }
    core.queue.reserved.values().cloned().collect()
}

fn jobs_with_suspects(core: &Scheduler) -> Vec<JobId> {
    let suspected = |job: &ActiveJob| !job.record.paused && job.round.has_pending_suspect();
    core.jobs.active.iter().filter(|(_, job)| suspected(job)).map(|(id, _)| id.clone()).collect()
}

/// Returns an idle worker for a suspect.
fn idle_worker(core: &mut Scheduler, now: Now, id: &JobId) -> Option<WorkerId> {
    let job = core.jobs.active.get(id).filter(|job| job.round.has_pending_suspect())?;
    let mut looks = 0;
    let idle = |worker: &&WorkerId| {
        looks += 1;
        core.fleet.workers.get(*worker).is_some_and(|w| w.held.is_empty() && may_be_reserved(core, now, job, w))
    };
    let found = core.queue.room.with_free_slots().iter().find(idle).cloned();
    core.queue.room.count(looks);
    found
}

/// Reserves a worker for a job's suspect: the one with the fewest leases. It stays reserved and gets no other lease, so
/// it becomes idle.
fn reserve_worker(core: &mut Scheduler, now: Now, id: &JobId) {
    let Some(job) = core.jobs.active.get(id) else { return };
    let may = |w: &Worker| may_be_reserved(core, now, job, w);
    if core.queue.reserved.get(id).and_then(|cell| core.fleet.workers.get(cell)).is_some_and(may) {
        return;
    }
    let able = core.fleet.workers.iter().filter(|(_, w)| may(w));
    let first = able.min_by_key(|(_, w)| w.held.len()).map(|(worker, _)| worker.clone());
    core.queue.room.count(core.fleet.workers.len());
    match first {
        Some(worker) => core.queue.reserved.insert(id.clone(), worker),
        None => core.queue.reserved.remove(id),
    };
}

fn may_be_reserved(core: &Scheduler, now: Now, job: &ActiveJob, worker: &Worker) -> bool {
    worker.is_open() && worker.can_do(&job.record) && time_for(&core.settings, now, worker, job.cost) > 0
}

fn isolate(core: &mut Scheduler, now: Now, worker: &WorkerId, id: &JobId) {
    let assignment = core.leases.new_id();
    let Some(job) = core.jobs.active.get_mut(id) else { return };
    let Some(range) = job.round.cut_suspect(assignment) else { return };
    let tasks = job.tasks(&range);
    let charged = charge_job(&mut core.queue, job, range.count);
    let lease = Lease { charged, solo: true, ..Lease::new(now, worker, id, range, LeaseKind::Ordinary) };
    assign(core, now, assignment, lease, tasks);
    core.leases.solos.insert(assignment, id.clone());
    if let Some(worker) = core.fleet.workers.get_mut(worker) {
        worker.suspect = Some(assignment);
    }
}

impl ActiveJob {
    /// Adds a charge to tasks of the current round.
    pub(super) fn record_charge(&mut self, charge: Charge) {
        // A repeated suspicion changes nothing.
        if charge.attempt || !self.record.charges.contains(&charge) {
            self.record.charges.push(charge);
            self.round.suspect(&self.record.charges);
        }
    }

    /// Withdraws the charges for this worker's crash. Returns their number.
    pub(super) fn withdraw_charges(&mut self, worker: &WorkerId) -> u32 {
        let before = self.record.charges.len();
        self.record.charges.retain(|charge| charge.lost.as_ref() != Some(&worker.0));
        let withdrawn = before - self.record.charges.len();
        if withdrawn > 0 {
            self.round.suspect(&self.record.charges);
        }
        withdrawn as u32
    }
}
