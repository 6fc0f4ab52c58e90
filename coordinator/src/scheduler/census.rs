//! How many there are of everything, for metrics.

use super::Scheduler;
use crate::record::JobState;
use std::collections::BTreeMap;

/// Counts at one moment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Jobs that have not ended, by state.
    pub jobs: BTreeMap<JobState, u32>,
    /// Tasks of the rounds at hand that nobody has.
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
    /// Workers that are connected and not believed any more.
    pub quarantined: u64,
    /// Workers that are connected and get nowhere with what they are given.
    pub stuck: u64,
    /// Workers whose connection broke and whose leases still run.
    pub disconnected: u64,
}

impl Scheduler {
    /// Counts; takes time in proportion to jobs and workers.
    pub fn census(&self) -> Census {
        let mut census = Census::default();
        for job in self.jobs.values() {
            *census.jobs.entry(job.record.state).or_default() += 1;
            let round = &job.round;
            census.pending += u64::from(round.pending());
            census.leased += u64::from(round.size() - round.pending() - round.done());
        }
        for worker in self.workers.values() {
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
}
