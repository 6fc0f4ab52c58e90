//! Pausing a job: nothing new is handed out; what runs may finish, and the job goes on where it stood.

use super::job::{ActiveJob, event};
use super::{Action, Now, Scheduler};
use crate::record::{JobId, JobRecord};
use crate::store::Write;
use proto::v1::job_event::Event;

impl Scheduler {
    /// A client pauses (`true`) or resumes a job. What was so already stays so. `None` if no job that has not ended has
    /// this id.
    pub fn pause(&mut self, now: Now, id: &JobId, paused: bool) -> Option<JobRecord> {
        let job = self.jobs.get_mut(id)?;
        // Also if nothing changes: a coordinator that was replaced meanwhile must not say that it is so.
        let write = job.pause(now, paused).unwrap_or_else(|| Write::Note { record: job.record.clone() });
        let record = job.record.clone();
        self.actions.push(Action::Write(Box::new(write)));
        self.dispatch(now);
        Some(record)
    }
}

impl ActiveJob {
    fn pause(&mut self, now: Now, paused: bool) -> Option<Write> {
        (self.record.paused != paused).then(|| {
            self.record.paused = paused;
            let event = event(&mut self.record, now, Event::Paused(paused));
            Write::Change { record: self.record.clone(), event }
        })
    }
}
