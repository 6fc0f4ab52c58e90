//! Where a job stands at this moment: who works on what, what waits, what went wrong.

use super::{MAX_ATTEMPTS, Now, Scheduler};
use crate::limits::MAX_HELD_TOLD;
use crate::record::JobId;
use proto::v1;

impl Scheduler {
    /// Of a job that has not ended. Takes time in proportion to leases, tasks and workers.
    pub fn standing(&self, now: Now, id: &JobId) -> Option<v1::Standing> {
        let job = self.jobs.get(id)?;
        let engine = &job.record.engine_digest;
        let able = || self.workers.values().filter(|w| w.takes_work() && w.engines.contains(engine));
        let mut held: Vec<v1::Held> = self
            .leases
            .values()
            .filter(|lease| lease.job == *id)
            .map(|lease| v1::Held {
                worker_id: lease.worker.to_string(),
                worker_name: self.workers.get(&lease.worker).map(|w| w.name.clone()).unwrap_or_default(),
                first: lease.range.first,
                count: lease.range.count,
                for_ms: now.since_start.saturating_sub(lease.since).as_millis() as u64,
            })
            .collect();
        held.sort_by_key(|held| (std::cmp::Reverse(held.for_ms), held.first));
        let held_total = held.len() as u32;
        held.truncate(MAX_HELD_TOLD);
        Some(v1::Standing {
            held,
            held_total,
            pending: job.round.pending(),
            attempts: job.round.attempts().map(|(index, attempts)| v1::Attempts { index, attempts }).collect(),
            max_attempts: MAX_ATTEMPTS,
            workers: able().count() as u32,
            slots: able().map(|w| w.slots).sum(),
            evaluation_ms: job.cost.map_or(0.0, |seconds| 1e3 * seconds),
            // Only the store knows.
            generation_ms: 0.0,
        })
    }
}
