//! The state at one moment, for clients, metrics and those who start workers.

use super::explain::about_worker;
use super::fleet::WorkerId;
use super::job::ActiveJob;
use super::lease::Range;
use super::{MAX_ATTEMPTS, Now, Scheduler};
use crate::limits::MAX_HELD_TOLD;
use crate::record::{JobId, JobState};
use sim_core::base::digest::Digest;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::time::Duration;

/// A worker that is connected.
#[derive(Clone, Debug)]
pub struct WorkerView {
    /// Its id.
    pub id: WorkerId,
    /// Its name, for people.
    pub name: String,
    /// Assignments at once.
    pub slots: u32,
    /// Slots that have work.
    pub busy: u32,
    /// Its engines.
    pub engines: Vec<Digest>,
    /// Unix time, ms.
    pub connected_at_ms: i64,
    /// Tasks whose results it delivered first.
    pub tasks: u64,
    /// The address it calls from.
    pub address: String,
    /// Why it gets no work; empty if there is nothing to say.
    pub reason: String,
    /// Its results are ignored.
    pub quarantined: bool,
}

/// The workers that are connected.
pub fn workers(core: &Scheduler) -> Vec<WorkerView> {
    let connected = core.fleet.workers.iter().filter(|(_, w)| w.session.is_some());
    connected
        .map(|(id, w)| WorkerView {
            id: id.clone(),
            name: w.name.clone(),
            slots: w.slots,
            busy: w.held.len().min(w.slots as usize) as u32,
            engines: w.engines.clone(),
            connected_at_ms: w.connected_at_ms,
            tasks: w.tasks,
            address: w.address.clone(),
            reason: about_worker(core, id, w),
            quarantined: !w.trusted,
        })
        .collect()
}

/// Where a job stands: who works on what, what waits, what went wrong.
#[derive(Clone, Debug)]
pub struct Detail {
    /// Assignments that workers have, the oldest first, up to a limit …
    pub held: Vec<Held>,
    /// … and how many there are.
    pub held_total: u32,
    /// Tasks of the round at hand that no worker has.
    pub pending: u32,
    /// Tasks of the round at hand that crashed or failed while they were worked on alone, and how often.
    pub attempts: Vec<(u32, u32)>,
    /// A task that failed so often ends the job.
    pub max_attempts: u32,
    /// Workers that could get work of it …
    pub workers: u32,
    /// … and their slots.
    pub slots: u32,
    /// Measured time of a task on a slot, s.
    pub task_seconds: Option<f64>,
}

/// An assignment that a worker has.
#[derive(Clone, Debug)]
pub struct Held {
    /// The worker.
    pub worker: WorkerId,
    /// Its name, for people.
    pub name: String,
    /// The tasks.
    pub range: Range,
    /// Time since it was handed out.
    pub since: Duration,
}

/// Where a job that has not ended stands. Takes time in proportion to leases, tasks and workers.
pub fn detail(core: &Scheduler, now: Now, id: &JobId) -> Option<Detail> {
    let job = core.jobs.active.get(id)?;
    let engine = &job.record.engine_digest;
    let able = || core.fleet.workers.values().filter(|w| w.takes_work() && w.engines.contains(engine));
    let name = |worker: &WorkerId| core.fleet.workers.get(worker).map(|w| w.name.clone()).unwrap_or_default();
    let leases = core.leases.of(id).map(|(_, lease)| Held {
        worker: lease.worker.clone(),
        name: name(&lease.worker),
        range: lease.range,
        since: now.since_start.saturating_sub(lease.since),
    });
    let mut held: Vec<Held> = leases.collect();
    held.sort_by_key(|held| (Reverse(held.since), held.range.first));
    let held_total = held.len() as u32;
    held.truncate(MAX_HELD_TOLD);
    Some(Detail {
        held,
        held_total,
        pending: job.round.pending(),
        attempts: job.round.attempts().collect(),
        max_attempts: MAX_ATTEMPTS,
        workers: able().count() as u32,
        slots: able().map(|w| w.slots).sum(),
        task_seconds: job.cost,
    })
}

/// Slots at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Demand {
    /// Slots that the jobs that have not ended could use side by side; those that are paused use none, nor do those that were
    /// submitted to another build, unless a worker of that one is connected.
    pub wanted: u32,
    /// Slots of the workers that take work.
    pub slots: u32,
    /// Of these, slots with work.
    pub busy: u32,
}

/// Counts slots; takes time in proportion to jobs and workers.
pub fn demand(core: &Scheduler) -> Demand {
    let workers = || core.fleet.workers.values().filter(|w| w.takes_work());
    // Workers that are started now are of this build.
    let connected = |digest: &Digest| workers().any(|w| w.engines.contains(digest));
    let can_be_done = |job: &&ActiveJob| {
        let engine = &job.record.engine_digest;
        !job.record.paused && (core.is_of_this_build(engine) || connected(engine))
    };
    let wanted = core.jobs.active.values().filter(can_be_done).map(wanted).fold(0, u32::saturating_add);
    let busy = workers().map(|w| w.slots.min(u32::try_from(w.held.len()).unwrap_or(u32::MAX))).sum();
    Demand { wanted, slots: workers().map(|w| w.slots).sum(), busy }
}

/// Slots that a job can fill: those of its whole round, not of what is left of it. So workers do not come and go with the end
/// of each round.
fn wanted(job: &ActiveJob) -> u32 {
    // Tasks that fill an engine's lanes take as long together as one alone: more slots would not end sooner.
    job.round.size().div_ceil(job.round.lanes())
}

/// Counts at one moment, for metrics.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Jobs that have not ended, by state.
    pub jobs: BTreeMap<JobState, u32>,
    /// Tasks of the rounds at hand that no worker has.
    pub pending: u64,
    /// Tasks of the rounds at hand that workers have.
    pub leased: u64,
    /// Slots of the workers that take work.
    pub slots: u64,
    /// Slots among all workers that have work, prefetched work aside.
    pub busy: u64,
    /// Workers that take work.
    pub ready: u64,
    /// Workers that are connected and will stop.
    pub draining: u64,
    /// Workers that are connected and quarantined.
    pub quarantined: u64,
    /// Workers that are connected and make no progress.
    pub stuck: u64,
    /// Workers whose connection broke and whose leases still run.
    pub disconnected: u64,
}

/// Counts; takes time in proportion to jobs and workers.
pub fn census(core: &Scheduler) -> Census {
    let mut census = Census::default();
    for job in core.jobs.active.values() {
        *census.jobs.entry(job.record.state).or_default() += 1;
        let round = &job.round;
        census.pending += u64::from(round.pending());
        census.leased += u64::from(round.size() - round.pending() - round.done());
    }
    for worker in core.fleet.workers.values() {
        census.busy += worker.held.len().min(worker.slots as usize) as u64;
        if worker.session.is_none() {
            census.disconnected += 1;
        } else if !worker.trusted {
            census.quarantined += 1;
        } else if worker.draining {
            census.draining += 1;
        } else if !worker.takes_work() {
            census.stuck += 1;
        } else {
            census.ready += 1;
            census.slots += u64::from(worker.slots);
        }
    }
    census
}
