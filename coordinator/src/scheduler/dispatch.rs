//! Which job gets the next free slot: start-time fair queueing (Goyal, Vin and Cheng 1996) by measured cost.
//!
//! A job's tag grows by the slot time of what it is given, divided by its priority; the job with the smallest tag is
//! next. A job that had nothing to hand out for a while may catch up on a bounded part of it: what it misses while the last
//! candidates of a generation are out, but not hours of waiting.

use super::arbiter::ask_arbiters;
use super::fleet::{Fleet, Worker, WorkerId};
use super::job::ActiveJob;
use super::lease::{Kind, Lease, assign};
use super::leaving::time_for;
use super::sizing::{Cut, may_prefetch, range_size};
use super::suspects::isolate_suspects;
use super::{Now, Scheduler};
use crate::record::JobId;
use proto::limits::DEFAULT_PRIORITY;
use sim_core::base::digest::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;

/// Slot time of a task that was not measured yet, s.
pub(super) const UNKNOWN_COST: f64 = 1.0;

/// How much of its missed share a job may catch up on, s of slot time at the priority of most jobs.
const CREDIT: f64 = 60.0 / DEFAULT_PRIORITY as f64;

/// Whether a free slot is filled, or a busy one gets its next work in advance.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fill {
    FreeSlots,
    InAdvance,
}

/// What the order of work depends on.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// Virtual time of the fair queue: the tag of the work handed out last.
    pub virtual_time: f64,
    /// Workers that may have room.
    pub room: Room,
    /// Workers that are kept free for the suspects of a job.
    pub cells: BTreeMap<JobId, WorkerId>,
}

/// Workers that may have room, so that an event costs as much as it changes and not as many workers as there are.
///
/// A worker leaves a set when it is found without room, and comes back when it may have some. So a set may hold workers
/// that have none, but never lacks one that has.
#[derive(Debug, Default)]
pub(super) struct Room {
    free_slots: BTreeSet<WorkerId>,
    in_advance: BTreeSet<WorkerId>,
    /// Slots of the workers that take work, by engine; nothing while it is not known.
    slots: Option<BTreeMap<Digest, u32>>,
    /// Workers and leases looked at, and jobs weighed for them, ever: what dispatching costs.
    #[cfg(test)]
    pub steps: u64,
}

impl Room {
    /// This worker may have room.
    pub fn may_have(&mut self, worker: &WorkerId) {
        self.free_slots.insert(worker.clone());
        self.in_advance.insert(worker.clone());
    }

    /// A worker came, went, or takes work no more.
    pub fn workers_changed(&mut self) {
        self.slots = None;
    }

    /// The first in a set, or the next after one.
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

    /// Workers that may have a free slot.
    pub fn with_free_slots(&self) -> &BTreeSet<WorkerId> {
        &self.free_slots
    }

    fn know_slots(&mut self, fleet: &Fleet) {
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

    /// So many workers or leases were looked at.
    pub fn count(&mut self, _looks: usize) {
        #[cfg(test)]
        {
            self.steps += _looks as u64;
        }
    }
}

/// Hands out what is pending: first to free slots everywhere, then one range a slot in advance where ranges are short.
pub(super) fn dispatch(core: &mut Scheduler, now: Now) {
    ask_arbiters(core, now);
    let kept_free = isolate_suspects(core, now);
    for fill in [Fill::FreeSlots, Fill::InAdvance] {
        core.queue.room.know_slots(&core.fleet);
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

/// Gives a worker what there is for it; `false` if it has no room left.
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

/// The job whose turn it is on this worker, and the size of the range.
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

/// How many tasks this job would give to this worker; `None` if nothing.
fn offer(core: &Scheduler, now: Now, worker: &Worker, job: &ActiveJob, fill: Fill) -> Option<u32> {
    if !worker.can_do(&job.record) {
        return None;
    }
    let fitting = time_for(&core.settings, now, worker, job.cost);
    size_for_any(&core.queue.room, job, fill).map(|size| size.min(fitting)).filter(|size| *size > 0)
}

/// How many tasks this job would give to a worker that can run it; `None` if nothing.
fn size_for_any(room: &Room, job: &ActiveJob, fill: Fill) -> Option<u32> {
    if !job.has_ordinary() {
        return None;
    }
    let round = &job.round;
    let most = round.at_most();
    if most == 1 {
        // Long tasks, of which no two take the same time: none is sent in advance.
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
    let charged = charge(&mut core.queue, job, range.count);
    let lease = Lease { charged, ..Lease::new(now, worker, id, range, Kind::Ordinary) };
    assign(core, now, assignment, lease, tasks);
}

/// Charges a job for what it is given.
pub(super) fn charge(queue: &mut Queue, job: &mut ActiveJob, count: u32) -> f64 {
    let charged = job.cost.unwrap_or(UNKNOWN_COST) * f64::from(count) / f64::from(job.record.priority);
    let tag = job.finish_tag.max(queue.virtual_time - CREDIT);
    queue.virtual_time = queue.virtual_time.max(tag);
    job.finish_tag = tag + charged;
    charged
}
