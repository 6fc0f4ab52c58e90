//! Stuck workers: they send heartbeats but make no progress. Their leases are revoked.

use super::fleet::WorkerId;
use super::lease::{AssignmentId, Stage, record_failure, revoke_leases};
use super::notes::LeaseEnd;
use super::trust::defer_job_on_worker;
use super::{Now, Scheduler};
use std::time::Duration;

/// Number of leases revoked as stuck, without a result in between, after which a worker gets no more until it connects
/// again.
pub(super) const MOST_TIMES: u32 = 3;

/// Records a worker's reported progress, and revokes its stuck leases.
pub(super) fn watch_progress(core: &mut Scheduler, now: Now, id: &WorkerId, progress: &[(AssignmentId, u64)]) {
    for &(assignment, count) in progress {
        if let Some(lease) = core.leases.all.get_mut(&assignment).filter(|l| l.worker == *id) {
            lease.report(now, count);
        }
    }
    for assignment in stuck(core, now, id) {
        revoke_stuck(core, now, id, assignment);
    }
}

/// Clears a worker's stuck count: it delivered a result.
pub(super) fn clear_stuck_count(core: &mut Scheduler, id: &WorkerId) {
    let Some(worker) = core.fleet.workers.get_mut(id) else { return };
    if std::mem::take(&mut worker.stuck) >= MOST_TIMES {
        core.queue.room.may_have(id);
        core.queue.room.workers_changed();
    }
}

/// Returns a worker's leases without progress. A queued lease is not stuck while every slot runs a lease that makes
/// progress.
fn stuck(core: &Scheduler, now: Now, id: &WorkerId) -> Vec<AssignmentId> {
    let Some(worker) = core.fleet.workers.get(id) else { return Vec::new() };
    let still = |since: Duration| now.since_start.saturating_sub(since) >= worker.stuck_after;
    let held = || worker.held.iter().filter_map(|a| Some((*a, core.leases.all.get(a)?)));
    let runs = |stage: Stage| matches!(stage, Stage::Running(_));
    let moving = held().filter(|(_, l)| runs(l.stage) && !still(l.moved)).count();
    let all_busy = moving >= worker.slots as usize;
    let is_stuck = |stage: Stage| match stage {
        Stage::Unknown => false,
        Stage::Queued => !all_busy,
        Stage::Running(_) => true,
    };
    held().filter(|(_, l)| is_stuck(l.stage) && still(l.moved)).map(|(a, _)| a).collect()
}

/// Revokes a stuck lease. Its tasks are charged only if a slot ran them.
fn revoke_stuck(core: &mut Scheduler, now: Now, id: &WorkerId, assignment: AssignmentId) {
    let Some(lease) = core.leases.all.get(&assignment).cloned() else { return };
    revoke_leases(core, &[assignment], LeaseEnd::Stuck);
    let (mut name, mut seconds) = (String::new(), 0.0);
    if let Some(worker) = core.fleet.workers.get_mut(id) {
        seconds = worker.stuck_after.as_secs_f64();
        worker.stuck += 1;
        name.clone_from(&worker.name);
        core.queue.room.workers_changed();
    }
    // Other workers get the tasks first.
    defer_job_on_worker(core, now, id, &lease.job);
    if matches!(lease.stage, Stage::Running(_)) {
        let why = format!("worker {name} made no progress with it for {seconds} s");
        record_failure(core, now, &lease, true, None, &why);
    }
}
