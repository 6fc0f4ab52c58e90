//! Which job gets the next free slot: start-time fair queueing (Goyal, Vin and Cheng 1996) by measured cost.
//!
//! A job's tag grows by the slot time of what it is given, divided by its priority; the job with the smallest tag is
//! next. A job that had nothing to hand out for a while may catch up on a bounded part of it: what it misses while the last
//! candidates of a generation are out, but not hours of waiting.

use super::job::ActiveJob;
use super::lease::{Kind, Lease};
use super::round::Work;
use super::sizing::{Cut, may_prefetch, range_size};
use super::worker::{Worker, WorkerId};
use super::{Now, Scheduler};
use crate::record::JobId;
use proto::limits::DEFAULT_PRIORITY;
use sim_core::base::digest::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;

/// Slot time of an evaluation nobody has measured yet, s.
pub(super) const UNKNOWN_COST: f64 = 1.0;

/// How much of its missed share a job may catch up on, s of slot time at the priority of most jobs.
const CREDIT: f64 = 60.0 / DEFAULT_PRIORITY as f64;

/// Whether a free slot is filled, or a busy one gets its next work in advance.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fill {
    FreeSlots,
    InAdvance,
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

impl Scheduler {
    /// Hands out what is pending: first to free slots everywhere, then one range a slot in advance where ranges are
    /// short.
    pub(super) fn dispatch(&mut self, now: Now) {
        self.ask_others(now);
        let kept_free = self.isolate_suspects(now);
        for fill in [Fill::FreeSlots, Fill::InAdvance] {
            self.know_slots();
            let mut last: Option<WorkerId> = None;
            while self.jobs.values().any(|job| self.size_for_any(job, fill).is_some())
                && let Some(id) = self.room.after(fill, last.as_ref())
            {
                if !kept_free.contains(&id) && !self.fill(now, &id, fill) {
                    self.room.of(fill).remove(&id);
                }
                last = Some(id);
            }
        }
    }

    fn know_slots(&mut self) {
        if self.room.slots.is_none() {
            let mut slots = BTreeMap::new();
            for worker in self.workers.values().filter(|w| w.takes_work()) {
                for engine in &worker.engines {
                    *slots.entry(*engine).or_default() += worker.slots;
                }
            }
            self.room.slots = Some(slots);
        }
    }

    /// Gives a worker what there is for it; `false` if it has no room left.
    fn fill(&mut self, now: Now, id: &WorkerId, fill: Fill) -> bool {
        loop {
            self.room.step();
            let Some(worker) = self.workers.get(id).filter(|w| w.takes_work()) else { return false };
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
            let Some((job, size)) = self.next_job(now, id, fill) else { return true };
            self.hand_out(now, id, &job, size);
        }
    }

    /// The job whose turn it is on this worker, and the size of the range.
    fn next_job(&self, now: Now, id: &WorkerId, fill: Fill) -> Option<(JobId, u32)> {
        let worker = self.workers.get(id)?;
        let mut next: Option<(f64, u64, &JobId, u32)> = None;
        for (id, job) in &self.jobs {
            let Some(size) = self.offer(now, worker, job, fill) else { continue };
            let tag = job.finish_tag.max(self.virtual_time - CREDIT);
            if next.is_none_or(|(best, number, ..)| (tag, job.record.number) < (best, number)) {
                next = Some((tag, job.record.number, id, size));
            }
        }
        next.map(|(_, _, id, size)| (id.clone(), size))
    }

    /// How many tasks this job would give to this worker; `None` if nothing.
    fn offer(&self, now: Now, worker: &Worker, job: &ActiveJob, fill: Fill) -> Option<u32> {
        if !worker.can_do(&job.record) {
            return None;
        }
        let fitting = self.time_for(now, worker, job.cost);
        self.size_for_any(job, fill).map(|size| size.min(fitting)).filter(|size| *size > 0)
    }

    /// How many tasks this job would give to a worker that can run it; `None` if nothing.
    fn size_for_any(&self, job: &ActiveJob, fill: Fill) -> Option<u32> {
        if !job.has_ordinary() {
            return None;
        }
        let round = &job.round;
        let most = round.work.most_at_once();
        match round.work {
            Work::Candidates(_) => {
                let known = self.room.slots.as_ref().and_then(|slots| slots.get(&job.record.engine_digest));
                let (all, pending, slots) = (round.size(), round.pending_unsuspected(), known.copied().unwrap_or(0));
                let size = range_size(Cut { all, pending, slots, cost: job.cost, at_once: job.at_once, most });
                (fill == Fill::FreeSlots || may_prefetch(size, job.cost)).then_some(size)
            }
            Work::Examinations(_) => (fill == Fill::FreeSlots).then_some(most),
        }
    }

    fn hand_out(&mut self, now: Now, worker: &WorkerId, id: &JobId, size: u32) {
        let assignment = self.new_assignment();
        let Some(job) = self.jobs.get_mut(id) else { return };
        let Some(range) = job.round.cut(size, assignment) else { return };
        let task = job.round.work.task(range);
        let charged = self.charge(id, range.count);
        let lease = Lease { charged, ..Lease::new(now, worker, id, range, Kind::Ordinary) };
        self.assign(now, assignment, lease, task);
    }

    /// Charges a job for what it is given.
    pub(super) fn charge(&mut self, id: &JobId, count: u32) -> f64 {
        let Some(job) = self.jobs.get_mut(id) else { return 0.0 };
        let charged = job.cost.unwrap_or(UNKNOWN_COST) * f64::from(count) / f64::from(job.record.priority);
        let tag = job.finish_tag.max(self.virtual_time - CREDIT);
        self.virtual_time = self.virtual_time.max(tag);
        job.finish_tag = tag + charged;
        charged
    }
}
