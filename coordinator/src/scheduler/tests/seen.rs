//! What was committed and sent so far, and must not happen again or otherwise.

use super::*;

/// What was seen so far, and must not change any more.
#[derive(Default)]
pub struct Seen {
    /// Tasks with a committed result.
    committed: BTreeSet<(JobId, u32, u32)>,
    /// Tasks as they were sent.
    tasks: BTreeMap<(JobId, u32, u32), Vec<u8>>,
    /// Digests of the results of sealed rounds.
    pub sealed: BTreeMap<(JobId, u32), Vec<Digest>>,
    /// Jobs that ended, as they did.
    pub ended: BTreeMap<JobId, JobRecord>,
}

impl Seen {
    /// Tasks as workers once got them.
    pub fn tasks(&self, job: &JobId, range: Range) -> Vec<Vec<u8>> {
        range.indexes().map(|index| self.tasks[&(job.clone(), range.round, index)].clone()).collect()
    }

    /// Checks what is about to be committed and sent: no result twice, none of a sealed round, the same task always.
    pub fn writes(&mut self, actions: &[Action]) {
        for action in actions {
            match action {
                Action::Write(write) => self.write(write),
                Action::Send(_, _, Message::Assign(assign)) => {
                    for (index, task) in assign.range.indexes().zip(&assign.tasks) {
                        let key = (assign.job.clone(), assign.range.round, index);
                        assert_eq!(self.tasks.entry(key).or_insert_with(|| task.clone()), task, "another task");
                    }
                }
                _ => {}
            }
        }
    }

    fn write(&mut self, write: &Write) {
        if let Write::Results { job, round, ranges, .. } = write {
            assert!(!self.sealed.contains_key(&(job.clone(), *round)), "a result for a sealed round");
            for index in ranges.iter().flat_map(|(first, results)| *first..*first + results.len() as u32) {
                assert!(self.committed.insert((job.clone(), *round, index)), "two committed results of {index}");
            }
        }
    }

    /// What is about to be sent: work goes only to workers that may have it.
    pub fn sends(scheduler: &Scheduler, now: Now, actions: &[Action]) {
        for action in actions {
            let Action::Send(worker, _, Message::Assign(assign)) = action else { continue };
            let Some(lease) = scheduler.leases.all.get(&assign.assignment) else { continue };
            let job = scheduler.jobs.active.get(&assign.job);
            let Some((job, worker)) = job.zip(scheduler.fleet.workers.get(worker)) else { continue };
            assert!(!job.record.paused, "work of a paused job");
            assert!(worker.trusted && !scheduler.trust.is_quarantined(&lease.worker), "work for the quarantined");
            assert!(!worker.draining && worker.session.is_some());
            assert_eq!(assign.tasks.len(), assign.range.count as usize);
            let left = worker.ends.map(|ends| ends.saturating_sub(now.since_start).as_secs_f64());
            let needs = job.cost.unwrap_or(1.0) * f64::from(assign.range.count);
            assert!(left.is_none_or(|left| needs <= left), "{needs} s do not fit into {left:?}");
        }
    }
}
