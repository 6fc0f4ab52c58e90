//! The choice of the arbiter: a worker that delivered no result of the disputed task, if possible on another host than
//! the workers that did. Of each host, at most two workers get a disputed task once hosts differ.

use super::dispatch::Queue;
use super::fleet::{Worker, WorkerId};
use super::job::ActiveJob;
use super::lease::{Lease, LeaseKind, Range, assign};
use super::leaving::time_for;
use super::sizing::longest;
use super::{Now, Scheduler};
use crate::record::{Dispute, JobId, Source};
use std::collections::BTreeSet;

/// Disputed tasks without an arbiter, by round and index.
type Waiting = BTreeSet<(u32, u32)>;

/// Assigns disputed tasks to arbiters, before any other work.
pub(super) fn assign_arbiters(core: &mut Scheduler, now: Now) {
    let disputed = |job: &ActiveJob| !job.record.paused && job.open_disputes().next().is_some();
    let disputed: Vec<JobId> =
        core.jobs.active.iter().filter(|(_, job)| disputed(job)).map(|(id, _)| id.clone()).collect();
    for id in disputed {
        // This runs after every event, and thousands of tasks may be disputed: without a free slot it stops at once.
        if !is_any_slot_free(core) {
            return;
        }
        let mut waiting = without_arbiter(core, &id);
        core.queue.room.count(waiting.len());
        let mut without = BTreeSet::new();
        while let Some((worker, range, tasks)) = next_arbitration(core, now, &id, &mut waiting, &mut without) {
            let assignment = core.leases.new_id();
            let lease = Lease::new(now, &worker, &id, range, LeaseKind::Arbitration);
            assign(core, now, assignment, lease, tasks);
        }
    }
}

/// Returns the disputed tasks that have no arbitration lease.
fn without_arbiter(core: &Scheduler, id: &JobId) -> Waiting {
    let Some(job) = core.jobs.active.get(id) else { return Waiting::new() };
    let arbitrations = core.leases.of(id).filter(|(_, l)| l.kind == LeaseKind::Arbitration);
    let asked: Waiting =
        arbitrations.flat_map(|(_, l)| l.range.indexes().map(|index| (l.range.round, index))).collect();
    job.open_disputes().map(|d| (d.round, d.index)).filter(|task| !asked.contains(task)).collect()
}

/// Returns the first waiting task that a worker can decide now, with the waiting tasks that follow it. Removes these
/// tasks from `waiting`, and also the tasks that no worker can decide. `without` collects the sources of the latter's
/// claims.
fn next_arbitration(
    core: &Scheduler,
    now: Now,
    id: &JobId,
    waiting: &mut Waiting,
    without: &mut BTreeSet<Vec<Source>>,
) -> Option<(WorkerId, Range, Vec<Vec<u8>>)> {
    let job = core.jobs.active.get(id)?;
    let (worker, first) = loop {
        let (round, index) = waiting.pop_first()?;
        let Some(dispute) = job.dispute(round, index) else { continue };
        let sources: Vec<Source> = dispute.claims.iter().map(|c| c.source.clone()).collect();
        if without.contains(&sources) {
            continue;
        }
        match free_arbiter(core, now, job, dispute) {
            Some(worker) => break (worker, dispute),
            None => without.insert(sources),
        };
    };
    let fitting = time_for(&core.settings, now, core.fleet.workers.get(&worker)?, job.cost);
    let most = longest(job.cost).min(fitting).min(job.round.at_most());
    let mut run = vec![first];
    while (run.len() as u32) < most {
        let next = (first.round, first.index + run.len() as u32);
        let waits = waiting.contains(&next).then(|| job.dispute(next.0, next.1)).flatten();
        let Some(dispute) = waits.filter(|d| !d.has_claim_of(&worker.0)) else { break };
        waiting.remove(&next);
        run.push(dispute);
    }
    let range = Range { round: first.round, first: first.index, count: run.len() as u32 };
    Some((worker, range, run.iter().map(|dispute| dispute.task.clone()).collect()))
}

fn is_any_slot_free(core: &Scheduler) -> bool {
    let Queue { room, .. } = &core.queue;
    room.with_free_slots().iter().filter_map(|id| core.fleet.workers.get(id)).any(Worker::has_free_slot)
}

/// Returns a worker with a free slot that may decide; it is on a host without a claim if any such worker exists.
fn free_arbiter(core: &Scheduler, now: Now, job: &ActiveJob, dispute: &Dispute) -> Option<WorkerId> {
    let candidates = || arbiters(core, job, dispute);
    let elsewhere = candidates().any(|(_, w)| is_elsewhere(w, dispute));
    candidates()
        .filter(|(_, w)| !elsewhere || is_elsewhere(w, dispute))
        .find(|(_, w)| w.has_free_slot() && time_for(&core.settings, now, w, job.cost) > 0)
        .map(|(id, _)| id.clone())
}

/// Returns all workers that may decide, with or without a free slot.
pub(super) fn arbiters<'a>(
    core: &'a Scheduler,
    job: &'a ActiveJob,
    dispute: &'a Dispute,
) -> impl Iterator<Item = (&'a WorkerId, &'a Worker)> {
    let exhausted = dispute.exhausted_hosts();
    let may = move |id: &WorkerId, w: &Worker| {
        w.takes_work() && w.can_do(&job.record) && !dispute.has_claim_of(&id.0) && !exhausted.contains(w.host())
    };
    core.fleet.workers.iter().filter(move |(id, w)| may(id, w))
}

/// Returns true if the worker is on a host without a claim.
fn is_elsewhere(worker: &Worker, dispute: &Dispute) -> bool {
    dispute.claims.iter().all(|c| *c.source.finder.host != *worker.host())
}
