//! Stragglers: leases that take far longer than expected at the end of a round. A second worker gets a copy of each.
//! The first result counts; both have the same bits.

use super::dispatch::charge_job;
use super::fleet::{Worker, WorkerId};
use super::job::ActiveJob;
use super::lease::{AssignmentId, Lease, LeaseKind, assign};
use super::leaving::time_for;
use super::{Now, Scheduler};
use std::time::Duration;

/// A lease is a straggler once it has taken this many times the average cost of its tasks …
const SLOWER: f64 = 2.0;
/// … and at least this time: an earlier copy would hardly end sooner.
const LEAST: Duration = Duration::from_secs(1);
/// Time between two searches that find no straggler, because a search costs time in proportion to the number of leases.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Gives copies of stragglers to a worker's free slots that no other work needs: oldest first, one copy each.
pub(super) fn copy_stragglers(core: &mut Scheduler, now: Now, id: &WorkerId) {
    if now.since_start < core.alarm.look_again {
        return;
    }
    while core.fleet.workers.get(id).is_some_and(Worker::has_free_slot) {
        let stragglers = stragglers(core, now);
        if stragglers.is_empty() {
            core.alarm.look_again = now.since_start + LOOK_EVERY;
        }
        let Some(original) = stragglers.into_iter().find(|a| may_copy(core, now, id, *a)) else { return };
        copy(core, now, id, original);
    }
}

/// Returns the stragglers without a copy, oldest first.
fn stragglers(core: &mut Scheduler, now: Now) -> Vec<AssignmentId> {
    core.queue.room.count(core.leases.all.len());
    let lacks_copy = |(original, lease): &(&AssignmentId, &Lease)| {
        lease.kind == LeaseKind::Ordinary
            && !lease.solo
            && !core.leases.copies.contains_key(original)
            && core.jobs.active.get(&lease.job).is_some_and(|job| is_straggler(now, job, lease))
    };
    let mut found: Vec<_> = core.leases.all.iter().filter(lacks_copy).map(|(a, lease)| (lease.since, *a)).collect();
    found.sort_unstable();
    found.into_iter().map(|(_, original)| original).collect()
}

fn may_copy(core: &Scheduler, now: Now, id: &WorkerId, original: AssignmentId) -> bool {
    let Some((lease, worker)) = core.leases.all.get(&original).zip(core.fleet.workers.get(id)) else { return false };
    let Some(job) = core.jobs.active.get(&lease.job) else { return false };
    let fits = time_for(&core.settings, now, worker, job.cost) >= lease.range.count;
    lease.worker != *id && worker.can_do(&job.record) && fits
}

fn copy(core: &mut Scheduler, now: Now, id: &WorkerId, original: AssignmentId) {
    let copy = core.leases.new_id();
    let Some(lease) = core.leases.all.get(&original).cloned() else { return };
    let Some(job) = core.jobs.active.get_mut(&lease.job) else { return };
    let tasks = job.tasks(&lease.range);
    let charged = charge_job(&mut core.queue, job, lease.range.count);
    core.leases.copies.insert(original, copy);
    let lease = Lease { charged, ..Lease::new(now, id, &lease.job, lease.range, LeaseKind::Copy(original)) };
    assign(core, now, copy, lease, tasks);
}

/// Returns true if no task of the job is pending and the lease takes far longer than its measured cost.
pub(super) fn is_straggler(now: Now, job: &ActiveJob, lease: &Lease) -> bool {
    let Some(cost) = job.cost else { return false };
    let expected = Duration::try_from_secs_f64(SLOWER * cost * f64::from(lease.range.count)).unwrap_or(Duration::MAX);
    !job.record.paused
        && job.round.pending() == 0
        && job.round.contains(&lease.range)
        && now.since_start.saturating_sub(lease.since) >= expected.max(LEAST)
}
