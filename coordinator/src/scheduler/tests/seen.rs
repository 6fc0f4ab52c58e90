//! What was committed and sent so far, and must not happen again or otherwise.

use super::*;

/// What was seen so far, and must not change any more.
#[derive(Default)]
pub struct Seen {
    /// Tasks with a committed result.
    committed: BTreeSet<(JobId, u32, u32)>,
    /// Sealed generations and the bits of their scores.
    pub sealed: BTreeMap<(JobId, u32), Vec<Option<u64>>>,
    /// Jobs that ended, as they did.
    pub ended: BTreeMap<JobId, JobRecord>,
}

impl Seen {
    /// What is about to be committed: no result twice, nothing for what is sealed.
    pub fn writes(&mut self, actions: &[Action]) {
        for action in actions {
            let Action::Write(write) = action else { continue };
            if let Write::Results { job, round, ranges, .. } = &**write {
                assert!(!self.sealed.contains_key(&(job.clone(), *round)), "a result for a sealed generation");
                for index in ranges.iter().flat_map(|(first, outcomes)| *first..*first + outcomes.len() as u32) {
                    assert!(self.committed.insert((job.clone(), *round, index)), "two committed results of {index}");
                }
            }
        }
    }

    /// What is about to be sent: work goes only to those who may have it.
    pub fn sends(scheduler: &Scheduler, now: Now, actions: &[Action]) {
        for action in actions {
            let Action::Send(worker, _, Message::Assign { assignment, job, task, .. }) = action else { continue };
            let Some(lease) = scheduler.leases.get(assignment) else { continue };
            let (Some(job), Some(worker)) = (scheduler.jobs.get(job), scheduler.workers.get(worker)) else { continue };
            assert!(!job.record.paused, "work of a paused job");
            assert!(worker.trusted && !scheduler.quarantined.contains_key(&lease.worker), "work for the quarantined");
            assert!(!worker.draining && worker.session.is_some());
            let left = worker.ends.map(|ends| ends.saturating_sub(now.since_start).as_secs_f64());
            let needs = job.cost.unwrap_or(1.0) * f64::from(task.range().count);
            assert!(left.is_none_or(|left| needs <= left), "{needs} s do not fit into {left:?}");
        }
    }
}
