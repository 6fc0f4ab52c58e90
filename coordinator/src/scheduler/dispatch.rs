//! The choice of the job for the next free slot: start-time fair queueing (Goyal, Vin and Cheng 1996) by measured cost.
//!
//! A job's tag grows by the slot time of its leases, divided by its priority. The job with the smallest tag is next. A
//! job without pending tasks may later catch up on a bounded part of its missed share. The bound covers the wait for
//! the last tasks of a round, not hours of waiting.

use super::arbiter::assign_arbiters;
use super::fleet::{Fleet, Worker, WorkerId};
use super::job::ActiveJob;
use super::lease::{Lease, LeaseKind, assign};
use super::leaving::time_for;
use super::sizing::{Cut, may_prefetch, range_size};
use super::suspects::isolate_suspects;
use super::{Now, Scheduler};
use crate::record::JobId;
use proto::limits::DEFAULT_PRIORITY;
use sim_core::base::digest::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;

/// Slot time of a task before the first measurement, s.
pub(super) const UNKNOWN_COST: f64 = 1.0;

/// Missed share that a job may catch up on, s of slot time at the default priority.
const CREDIT: f64 = 60.0 / DEFAULT_PRIORITY as f64;

/// Kind of lease placement: into free slots, or in advance behind a slot's current lease.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fill {
    FreeSlots,
    InAdvance,
}

/// State that decides the order of work.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// Virtual time of the fair queue: the tag of the latest lease.
    pub virtual_time: f64,
    /// Workers that may have room for a lease.
    pub room: Room,
    /// Workers that are reserved for the suspects of a job.
    pub reserved: BTreeMap<JobId, WorkerId>,
}

/// Workers that may have room for a lease. The sets keep the cost of an event independent of the number of workers.
///
/// A worker leaves a set when dispatch finds it without room, and returns when it may have room again. So a set may
/// contain workers without room, but always contains every worker with room.
#[derive(Debug, Default)]
pub(super) struct Room {
    free_slots: BTreeSet<WorkerId>,
    in_advance: BTreeSet<WorkerId>,
    /// Slots of the workers that take work, by engine; `None` until they are counted.
    slots: Option<BTreeMap<Digest, u32>>,
    /// Total number of workers, leases and jobs that dispatch examined: the cost of dispatching.
    #[cfg(test)]
    pub steps: u64,
}

impl Room {
    /// Adds a worker that may have room.
    pub fn may_have(&mut self, worker: &WorkerId) {
        self.free_slots.insert(worker.clone());
        self.in_advance.insert(worker.clone());
    }

    /// Clears the slot counts: a worker connected, left, or stopped or started taking work.
    pub fn workers_changed(&mut self) {
        self.slots = None;
    }

    /// Returns the first worker of a set, or the next one after `last`.
    fn after(&mut self, fill: Fill, last: Option<&WorkerId>) -> Option<WorkerId> {
        let from = last.map_or(Bound::Unbounded, Bound::Excluded);
        self.of(fill).range::<WorkerId, _>((from, Bound::Unbounded)).next().cloned()
    }

    fn of(&mut self, fill: Fill) -> &mut BTreeSet<WorkerId> {
        match fill {
            Fill::FreeSlots => &mut self.free_slots,
            Fill::InAdvance => &mut self.in_advance,
        }
    }

    /// Returns the workers that may have a free slot.
    pub fn with_free_slots(&self) -> &BTreeSet<WorkerId> {
        &self.free_slots
    }

    fn count_slots(&mut self, fleet: &Fleet) {
        if self.slots.is_none() {
            let mut slots = BTreeMap::new();
            for worker in fleet.workers.values().filter(|w| w.takes_work()) {
                for engine in &worker.engines {
                    *slots.entry(*engine).or_default() += worker.slots;
                }
            }
            self.slots = Some(slots);
        }
    }

    fn step(&mut self) {
        self.count(1);
    }

    /// Adds to the number of examined workers and leases.
    pub fn count(&mut self, _looks: usize) {
        #[cfg(test)]
        {
            self.steps += _looks as u64;
        }
    }
}

/// Assigns pending tasks: first to all free slots, then one range per slot in advance where ranges are short.
pub(super) fn dispatch(core: &mut Scheduler, now: Now) {
    assign_arbiters(core, now);
    let kept_free = isolate_suspects(core, now);
    for fill in [Fill::FreeSlots, Fill::InAdvance] {
        core.queue.room.count_slots(&core.fleet);
        let mut last: Option<WorkerId> = None;
        while core.jobs.active.values().any(|job| size_for_any(&core.queue.room, job, fill).is_some())
            && let Some(id) = core.queue.room.after(fill, last.as_ref())
        {
            if !kept_free.contains(&id) && !fill_worker(core, now, &id, fill) {
                core.queue.room.of(fill).remove(&id);
            }
            last = Some(id);
        }
    }
}

/// Assigns tasks to a worker until it has no room or no task fits; returns `false` if it has no room left.
fn fill_worker(core: &mut Scheduler, now: Now, id: &WorkerId, fill: Fill) -> bool {
    loop {
        core.queue.room.step();
        let Some(worker) = core.fleet.workers.get(id).filter(|w| w.takes_work()) else { return false };
        let room = match fill {
            Fill::FreeSlots => worker.slots as usize,
            Fill::InAdvance => 2 * worker.slots as usize,
        };
        if worker.held.len() >= room {
            return false;
        }
        if !worker.is_open() {
            return true;
        }
        let Some((job, size)) = next_job(core, now, worker, fill) else { return true };
        hand_out(core, now, id, &job, size);
    }
}

/// Returns the next job for this worker, and the size of the range.
fn next_job(core: &Scheduler, now: Now, worker: &Worker, fill: Fill) -> Option<(JobId, u32)> {
    let mut next: Option<(f64, u64, &JobId, u32)> = None;
    for (id, job) in &core.jobs.active {
        let Some(size) = offer(core, now, worker, job, fill) else { continue };
        let tag = job.finish_tag.max(core.queue.virtual_time - CREDIT);
        if next.is_none_or(|(best, number, ..)| (tag, job.record.number) < (best, number)) {
            next = Some((tag, job.record.number, id, size));
        }
    }
    next.map(|(_, _, id, size)| (id.clone(), size))
}

/// Returns the number of tasks of this job that fit this worker now; `None` if none.
fn offer(core: &Scheduler, now: Now, worker: &Worker, job: &ActiveJob, fill: Fill) -> Option<u32> {
    if !worker.can_do(&job.record) {
        return None;
    }
    let fitting = time_for(&core.settings, now, worker, job.cost);
    size_for_any(&core.queue.room, job, fill).map(|size| size.min(fitting)).filter(|size| *size > 0)
}

/// Returns the number of tasks of this job for a worker that can run it; `None` if none.
fn size_for_any(room: &Room, job: &ActiveJob, fill: Fill) -> Option<u32> {
    if !job.has_ordinary() {
        return None;
    }
    let round = &job.round;
    let most = round.at_most();
    if most == 1 {
        // Long tasks take very different times, so none is leased in advance.
        return (fill == Fill::FreeSlots).then_some(most);
    }
    let known = room.slots.as_ref().and_then(|slots| slots.get(&job.record.engine_digest));
    let (all, pending, slots) = (round.size(), round.pending_unsuspected(), known.copied().unwrap_or(0));
    let size = range_size(Cut { all, pending, slots, cost: job.cost, at_once: round.lanes(), most });
    (fill == Fill::FreeSlots || may_prefetch(size, job.cost)).then_some(size)
}

fn hand_out(core: &mut Scheduler, now: Now, worker: &WorkerId, id: &JobId, size: u32) {
    let assignment = core.leases.new_id();
    let Some(job) = core.jobs.active.get_mut(id) else { return };
    let Some(range) = job.round.cut(size, assignment) else { return };
    let tasks = job.tasks(&range);
    let charged = charge_job(&mut core.queue, job, range.count);
    let lease = Lease { charged, ..Lease::new(now, worker, id, range, LeaseKind::Ordinary) };
    assign(core, now, assignment, lease, tasks);
}

/// Adds the cost of a lease to the job's tag, and returns it.
pub(super) fn charge_job(queue: &mut Queue, job: &mut ActiveJob, count: u32) -> f64 {
    let charged = job.cost.unwrap_or(UNKNOWN_COST) * f64::from(count) / f64::from(job.record.priority);
    let tag = job.finish_tag.max(queue.virtual_time - CREDIT);
    queue.virtual_time = queue.virtual_time.max(tag);
    job.finish_tag = tag + charged;
    charged
}
