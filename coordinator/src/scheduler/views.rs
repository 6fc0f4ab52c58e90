//! Snapshots of the scheduler's state, for clients, metrics and programs that start workers.

use super::fleet::WorkerId;
use super::job::ActiveJob;
use super::lease::Range;
use super::wait_reasons::about_worker;
use super::{MAX_ATTEMPTS, Now, Scheduler};
use crate::limits::MAX_HELD_TOLD;
use crate::record::{JobId, JobState};
use sim_core::base::digest::Digest;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::time::Duration;

/// A connected worker.
#[derive(Clone, Debug)]
pub struct WorkerView {
    /// Its id.
    pub id: WorkerId,
    /// Its display name.
    pub name: String,
    /// Number of leases it can run at once.
    pub slots: u32,
    /// Number of slots with a lease.
    pub busy: u32,
    /// Digests of its engines.
    pub engines: Vec<Digest>,
    /// Unix time of its connection, ms.
    pub connected_at_ms: i64,
    /// Number of tasks of which it delivered the first result.
    pub tasks: u64,
    /// Source address of its connection.
    pub address: String,
    /// Reason why it gets no work; empty if it gets work.
    pub reason: String,
    /// True if its results are ignored.
    pub quarantined: bool,
}

/// Returns the connected workers.
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

/// Detailed state of a job: its leases, pending tasks and failed attempts.
#[derive(Clone, Debug)]
pub struct Detail {
    /// Leases, oldest first, up to [`MAX_HELD_TOLD`] …
    pub held: Vec<Held>,
    /// … and the number of all leases.
    pub held_total: u32,
    /// Number of pending tasks of the current round.
    pub pending: u32,
    /// Tasks of the current round that crashed or failed while they ran alone: index and number of attempts.
    pub attempts: Vec<(u32, u32)>,
    /// Number of attempts of a task that fails the job.
    pub max_attempts: u32,
    /// Number of workers that can run its tasks …
    pub workers: u32,
    /// … and the number of their slots.
    pub slots: u32,
    /// Measured time of a task on a slot, s.
    pub task_seconds: Option<f64>,
}

/// A lease of a worker.
#[derive(Clone, Debug)]
pub struct Held {
    /// The worker.
    pub worker: WorkerId,
    /// The worker's display name.
    pub name: String,
    /// The tasks.
    pub range: Range,
    /// Time since the lease began.
    pub since: Duration,
}

/// Returns the detailed state of an active job. Takes time in proportion to leases, tasks and workers.
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

/// Slots wanted, present and busy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Demand {
    /// Number of slots that active jobs could use in parallel. Paused jobs count zero. Jobs of another build count only
    /// while a worker of that build is connected.
    pub wanted: u32,
    /// Number of slots of the workers that take work.
    pub slots: u32,
    /// Number of these slots with a lease.
    pub busy: u32,
}

/// Counts wanted, present and busy slots. Takes time in proportion to jobs and workers.
pub fn demand(core: &Scheduler) -> Demand {
    let workers = || core.fleet.workers.values().filter(|w| w.takes_work());
    // Workers that are started now belong to this build.
    let connected = |digest: &Digest| workers().any(|w| w.engines.contains(digest));
    let can_be_done = |job: &&ActiveJob| {
        let engine = &job.record.engine_digest;
        !job.record.paused && (core.is_of_this_build(engine) || connected(engine))
    };
    let wanted = core.jobs.active.values().filter(can_be_done).map(wanted).fold(0, u32::saturating_add);
    let busy = workers().map(|w| w.slots.min(u32::try_from(w.held.len()).unwrap_or(u32::MAX))).sum();
    Demand { wanted, slots: workers().map(|w| w.slots).sum(), busy }
}

/// Returns the number of slots that a job can fill with its whole round. It does not count only the remaining tasks:
/// otherwise autoscaled workers would stop and start at the end of each round.
fn wanted(job: &ActiveJob) -> u32 {
    // Tasks that fill an engine's lanes together take as long as one alone, so more slots would not help.
    job.round.size().div_ceil(job.round.lanes())
}

/// Counts for metrics.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Active jobs, by state.
    pub jobs: BTreeMap<JobState, u32>,
    /// Pending tasks of the current rounds.
    pub pending: u64,
    /// Leased tasks of the current rounds.
    pub leased: u64,
    /// Number of slots of the workers that take work.
    pub slots: u64,
    /// Slots of all workers with a lease; leases in advance don't count.
    pub busy: u64,
    /// Workers that take work.
    pub ready: u64,
    /// Workers that are connected and draining.
    pub draining: u64,
    /// Workers that are connected and quarantined.
    pub quarantined: u64,
    /// Workers that are connected and stuck.
    pub stuck: u64,
    /// Workers with a broken connection that still have leases.
    pub disconnected: u64,
}

/// Counts jobs, tasks, slots and workers. Takes time in proportion to jobs and workers.
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
