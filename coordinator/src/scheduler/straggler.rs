//! Stragglers: at the end of a round, ranges that take far longer than they should are given to a second worker as well.
//! The first result wins; the bits can't differ.

use super::job::ActiveJob;
use super::lease::{AssignmentId, Kind, Lease};
use super::worker::{Worker, WorkerId};
use super::{Now, Scheduler};
use std::time::Duration;

/// A range is a straggler once it has taken so many times what its tasks cost on the average …
const SLOWER: f64 = 2.0;
/// … and at least this long: a copy made sooner would hardly be done sooner.
const LEAST: Duration = Duration::from_secs(1);
/// Where there was none, they are looked for again after this time: looking costs as much as there is work out.
const LOOK_EVERY: Duration = Duration::from_millis(100);

impl Scheduler {
    /// Gives free slots of a worker that nobody else needs to stragglers, the oldest first; each gets one copy.
    pub(super) fn copy_stragglers(&mut self, now: Now, id: &WorkerId) {
        if now.since_start < self.look_again {
            return;
        }
        let has_room = |w: &Worker| w.is_open() && w.held.len() < w.slots as usize;
        while self.workers.get(id).is_some_and(has_room) {
            let stragglers = self.stragglers(now);
            if stragglers.is_empty() {
                self.look_again = now.since_start + LOOK_EVERY;
            }
            let Some(original) = stragglers.into_iter().find(|a| self.may_copy(now, id, *a)) else { return };
            self.copy(now, id, original);
        }
    }

    /// Those that have no copy, the oldest first.
    fn stragglers(&mut self, now: Now) -> Vec<AssignmentId> {
        self.room.count(self.leases.len());
        let lacks_copy = |(original, lease): &(&AssignmentId, &Lease)| {
            lease.kind == Kind::Ordinary
                && !lease.solo
                && !self.copies.contains_key(original)
                && self.jobs.get(&lease.job).is_some_and(|job| is_straggler(now, job, lease))
        };
        let mut found: Vec<_> = self.leases.iter().filter(lacks_copy).map(|(a, lease)| (lease.since, *a)).collect();
        found.sort_unstable();
        found.into_iter().map(|(_, original)| original).collect()
    }

    fn may_copy(&self, now: Now, id: &WorkerId, original: AssignmentId) -> bool {
        let Some((lease, worker)) = self.leases.get(&original).zip(self.workers.get(id)) else { return false };
        let Some(job) = self.jobs.get(&lease.job) else { return false };
        lease.worker != *id && worker.can_do(&job.record) && self.time_for(now, worker, job.cost) >= lease.range.count
    }

    fn copy(&mut self, now: Now, id: &WorkerId, original: AssignmentId) {
        let copy = self.new_assignment();
        let Some(lease) = self.leases.get(&original).cloned() else { return };
        let Some(job) = self.jobs.get(&lease.job) else { return };
        let task = job.round.work.task(lease.range);
        let charged = self.charge(&lease.job, lease.range.count);
        self.copies.insert(original, copy);
        let lease = Lease { charged, ..Lease::new(now, id, &lease.job, lease.range, Kind::Copy(original)) };
        self.assign(now, copy, lease, task);
    }
}

/// Whether nothing is left to hand out beside it and it takes longer than its measured cost says.
pub(super) fn is_straggler(now: Now, job: &ActiveJob, lease: &Lease) -> bool {
    let Some(cost) = job.cost else { return false };
    let expected = Duration::try_from_secs_f64(SLOWER * cost * f64::from(lease.range.count)).unwrap_or(Duration::MAX);
    !job.record.paused
        && job.round.pending() == 0
        && job.round.contains(&lease.range)
        && now.since_start.saturating_sub(lease.since) >= expected.max(LEAST)
}
