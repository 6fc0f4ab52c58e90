//! Checks over the whole test: what was committed or sent must not be repeated or changed.

use super::*;

/// Commits and messages so far.
#[derive(Default)]
pub struct Seen {
    /// Tasks with a committed result.
    committed: BTreeSet<(JobId, u32, u32)>,
    /// Tasks as sent to workers.
    tasks: BTreeMap<(JobId, u32, u32), Vec<u8>>,
    /// Digests of the results of sealed rounds.
    pub sealed: BTreeMap<(JobId, u32), Vec<Digest>>,
    /// Final records of ended jobs.
    pub ended: BTreeMap<JobId, JobRecord>,
}

impl Seen {
    /// Returns tasks as they were sent to workers.
    pub fn tasks(&self, job: &JobId, range: Range) -> Vec<Vec<u8>> {
        range.indexes().map(|index| self.tasks[&(job.clone(), range.round, index)].clone()).collect()
    }

    /// Checks new actions: no result is committed twice or into a sealed round, and a task is always sent with the same
    /// bytes.
    pub fn writes(&mut self, actions: &[Action]) {
        for action in actions {
            match action {
                Action::Write(write) => self.write(write),
                Action::Send(_, _, Message::Assign(assign)) => {
                    for (index, task) in assign.range.indexes().zip(&assign.tasks) {
                        let key = (assign.job.clone(), assign.range.round, index);
                        assert_eq!(
                            self.tasks.entry(key).or_insert_with(|| task.clone()),
                            task,
                            "the task was sent with other bytes before"
                        );
                    }
                }
                _ => {}
            }
        }
    }

    fn write(&mut self, write: &Write) {
        if let Write::Results { job, round, ranges, .. } = write {
            assert!(!self.sealed.contains_key(&(job.clone(), *round)), "result committed into sealed round {round}");
            for index in ranges.iter().flat_map(|(first, results)| *first..*first + results.len() as u32) {
                assert!(self.committed.insert((job.clone(), *round, index)), "second committed result of task {index}");
            }
        }
    }

    /// Checks new assignments: a worker must be allowed to run the tasks.
    pub fn sends(scheduler: &Scheduler, now: Now, actions: &[Action]) {
        for action in actions {
            let Action::Send(worker, _, Message::Assign(assign)) = action else { continue };
            let Some(lease) = scheduler.leases.all.get(&assign.assignment) else { continue };
            let job = scheduler.jobs.active.get(&assign.job);
            let Some((job, worker)) = job.zip(scheduler.fleet.workers.get(worker)) else { continue };
            assert!(!job.record.paused, "assignment of a paused job");
            assert!(
                worker.trusted && !scheduler.trust.is_quarantined(&lease.worker),
                "assignment for a quarantined worker"
            );
            assert!(!worker.draining && worker.session.is_some());
            assert_eq!(assign.tasks.len(), assign.range.count as usize);
            let left = worker.ends.map(|ends| ends.saturating_sub(now.since_start).as_secs_f64());
            let needs = job.cost.unwrap_or(1.0) * f64::from(assign.range.count);
            assert!(
                left.is_none_or(|left| needs <= left),
                "the tasks take {needs} s, but the worker has {left:?} s left"
            );
        }
    }
}
