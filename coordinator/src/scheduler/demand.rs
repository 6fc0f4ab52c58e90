//! How many workers are wanted, for whoever starts and stops them.

use super::Scheduler;
use super::job::ActiveJob;
use super::round::Work;
use sim_core::base::digest::Digest;

/// Slots at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Demand {
    /// That the jobs that have not ended could use side by side; those that are paused use none, nor do those that were
    /// submitted to another build, unless a worker of that one is connected.
    pub wanted: u32,
    /// Of the workers that take work.
    pub slots: u32,
    /// Of these, with work.
    pub busy: u32,
}

impl Scheduler {
    /// Counts; takes time in proportion to jobs and workers.
    pub fn demand(&self) -> Demand {
        // Whoever starts workers starts those of this build.
        let connected = |digest: &Digest| self.workers.values().any(|w| w.takes_work() && w.engines.contains(digest));
        let can_be_done = |job: &&ActiveJob| {
            let engine = &job.record.engine_digest;
            !job.record.paused && (self.is_of_this_build(engine) || connected(engine))
        };
        let wanted = self.jobs.values().filter(can_be_done).map(wanted).fold(0, u32::saturating_add);
        let workers = || self.workers.values().filter(|w| w.takes_work());
        let busy = workers().map(|w| w.slots.min(u32::try_from(w.held.len()).unwrap_or(u32::MAX))).sum();
        Demand { wanted, slots: workers().map(|w| w.slots).sum(), busy }
    }
}

/// Slots that a job can fill: those of its whole round, not of what is left of it. So workers do not come and go with the
/// end of each generation.
fn wanted(job: &ActiveJob) -> u32 {
    match job.round.work {
        // Together they take as long as one alone: more slots would not end sooner.
        Work::Candidates(_) => job.round.size().div_ceil(job.at_once.max(1)),
        Work::Examinations(_) => job.round.size(),
    }
}
