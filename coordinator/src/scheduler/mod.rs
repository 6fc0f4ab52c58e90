//! Who evaluates what, and what follows from it: a pure state machine.
//!
//! No sockets, no clock, no tasks: every function is told the time and what happened, changes the state, and leaves
//! [`Action`]s for the shell, which commits the writes among them *before* it does anything else with the outside. So
//! nothing is acknowledged that the store does not hold. If a commit fails the state in memory is ahead of the store,
//! and the coordinator has to stop and start again from the store.
//!
//! A job is a row of rounds: its generations, and after the search one or two rounds of examinations, from which the
//! published winner and the report follow. The tasks of a round go PENDING → LEASED → DONE; a lease that is lost makes
//! its tasks PENDING again. How they are cut into ranges, who works on them and in which order results arrive never
//! touches a result: scores are folded by index once all of a round are there.

mod census;
mod demand;
mod dispute;
mod doubt;
mod explain;
mod fair;
mod job;
mod lease;
mod leaving;
mod notes;
mod older;
mod pause;
mod restart;
mod results;
mod round;
mod sealed;
mod search;
mod sizing;
mod standing;
mod statistics;
mod straggler;
mod stuck;
mod suspects;
mod third;
mod worker;

pub use census::Census;
pub use demand::Demand;
pub use job::{NewJob, Resumed};
pub use lease::{AssignmentId, Task};
pub use notes::{LeaseEnd, Note};
pub use older::{Committed, Contradicted};
pub use restart::Carried;
pub use results::{Completed, Delivery, Verdict};
pub use round::{Finder, Outcome, Range};
pub use worker::{Greeting, SessionId, Welcome, WorkerId};

use crate::record::{JobId, JobRecord, JobState};
use crate::store::{Quarantined, Write};
use fair::Room;
use job::ActiveJob;
use lease::Lease;
use proto::v1;
use sim_core::base::digest::Digest;
use sim_core::search::BadState;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;
use worker::Worker;

/// After how many crashes or failures of a task that was worked on alone its job fails.
pub const MAX_ATTEMPTS: u32 = 3;
/// Progress of a job is told at most this often.
const PROGRESS_EVERY: Duration = Duration::from_millis(100);

/// The time, as the shell tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Now {
    /// Since some fixed moment; never goes back.
    pub since_start: Duration,
    /// Unix time in ms, for people.
    pub unix_ms: i64,
}

/// What the shell has to do, in this order, once all writes of the same list are committed.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// To be committed; all writes of a list in one transaction.
    Write(Box<Write>),
    /// To be sent to a worker, if this session of it still stands.
    Send(WorkerId, SessionId, Message),
    /// To be told to those who watch; not stored.
    Publish(JobId, Box<v1::JobEvent>),
}

/// What a worker is told.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Work for one slot.
    Assign {
        /// Its id.
        assignment: AssignmentId,
        /// The job.
        job: JobId,
        /// The job's text, where this session has not had it yet.
        toml: Option<Arc<str>>,
        /// What to do.
        task: Task,
    },
    /// Work that nobody needs any more.
    Cancel(Vec<AssignmentId>),
    /// It gets nothing more, for this reason.
    Drain(String),
}

/// Times and identity of a coordinator.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Counts the starts on a store.
    pub epoch: u64,
    /// Without a sign of life for this long a worker's work goes to others.
    pub lease: Duration,
    /// Work that makes no progress for this long is taken back, where workers tell their progress and not when they would
    /// call it stuck themselves.
    pub stuck_after: Duration,
}

impl Settings {
    /// With the usual patience for work that stands still: four leases.
    pub fn new(epoch: u64, lease: Duration) -> Self {
        Self { epoch, lease, stuck_after: 4 * lease }
    }

    /// How long work may stand still on a worker that finds its own stuck slots after a time that it tells: longer, so that
    /// it may.
    pub fn patience(&self, told: Option<Duration>) -> Duration {
        told.map_or(self.stuck_after, |told| told.saturating_add(2 * self.lease))
    }

    /// A worker whose machine goes away is told to stop so long before.
    pub fn farewell(&self) -> Duration {
        2 * self.heartbeat()
    }

    /// How often workers should give a sign of life.
    pub fn heartbeat(&self) -> Duration {
        self.lease / 5
    }
}

/// The state machine.
pub struct Scheduler {
    settings: Settings,
    jobs: BTreeMap<JobId, ActiveJob>,
    ended: BTreeSet<JobId>,
    workers: BTreeMap<WorkerId, Worker>,
    leases: BTreeMap<AssignmentId, Lease>,
    /// Second copies of leases, by the first.
    copies: BTreeMap<AssignmentId, AssignmentId>,
    quarantined: BTreeMap<WorkerId, Quarantined>,
    /// The engines of this build, by name.
    engines: Arc<[(&'static str, Digest)]>,
    next_job: u64,
    next_assignment: u64,
    next_session: u64,
    /// Virtual time of the fair queue: the tag of the work handed out last.
    virtual_time: f64,
    room: Room,
    /// No deadline is before this: looking at all workers after every event would cost as much as there are.
    wake: Option<Duration>,
    /// There was no straggler when it was looked for last, and it is not looked for before this.
    look_again: Duration,
    /// Suspects that are worked on, and of which jobs.
    solos: BTreeMap<AssignmentId, JobId>,
    /// Workers that are kept free for the suspects of a job.
    cells: BTreeMap<JobId, WorkerId>,
    actions: Vec<Action>,
    /// Jobs whose record changed without an event: written once, however many leases were lost at a time.
    to_note: BTreeSet<JobId>,
    notes: Vec<Note>,
}

impl Scheduler {
    /// An empty one. `next_job` is the number of the next job, `ended` are the jobs that will never change again.
    pub fn new(settings: Settings, next_job: u64, ended: BTreeSet<JobId>) -> Self {
        Self {
            settings,
            jobs: BTreeMap::new(),
            ended,
            workers: BTreeMap::new(),
            leases: BTreeMap::new(),
            copies: BTreeMap::new(),
            quarantined: BTreeMap::new(),
            engines: Arc::new([]),
            next_job,
            // Unique over all epochs of a store.
            next_assignment: settings.epoch << 32,
            next_session: 1,
            virtual_time: 0.0,
            room: Room::default(),
            wake: None,
            look_again: Duration::ZERO,
            solos: BTreeMap::new(),
            cells: BTreeMap::new(),
            actions: Vec::new(),
            to_note: BTreeSet::new(),
            notes: Vec::new(),
        }
    }

    /// Workers that are not trusted, from the store.
    pub fn with_quarantined(mut self, quarantined: Vec<Quarantined>) -> Self {
        self.quarantined = quarantined.into_iter().map(|q| (WorkerId(q.worker.clone()), q)).collect();
        self
    }

    /// The engines of this build, by name: jobs of others wait for workers of others.
    pub fn with_engines(mut self, engines: Arc<[(&'static str, Digest)]>) -> Self {
        self.engines = engines;
        self
    }

    /// Whether a job that has not ended needs one of these engines.
    pub fn needs(&self, engines: &[Digest]) -> bool {
        self.jobs.values().any(|job| engines.contains(&job.record.engine_digest))
    }

    /// Whether workers of this build have an engine; taken for granted where nothing is known of the build.
    fn is_of_this_build(&self, engine: &Digest) -> bool {
        self.engines.is_empty() || self.engines.iter().any(|(_, own)| own == engine)
    }

    /// What is to be done since the last call.
    pub fn take_actions(&mut self) -> Vec<Action> {
        for id in std::mem::take(&mut self.to_note) {
            if let Some(job) = self.jobs.get(&id) {
                self.actions.push(Action::Write(Box::new(Write::Note { record: job.record.clone() })));
            }
        }
        std::mem::take(&mut self.actions)
    }

    /// A job that has not ended.
    pub fn job(&self, id: &JobId) -> Option<&JobRecord> {
        self.jobs.get(id).map(|j| &j.record)
    }

    /// The job that has not ended with this request id.
    pub fn job_of_request(&self, request_id: &str) -> Option<&JobRecord> {
        self.jobs.values().map(|j| &j.record).find(|r| r.request_id == request_id)
    }

    /// How many jobs have not ended.
    pub fn active_jobs(&self) -> usize {
        self.jobs.len()
    }

    /// Tasks of the round at hand that are done, and how many it has; nothing for a job that ended.
    pub fn round(&self, id: &JobId) -> Option<(u32, u32)> {
        self.jobs.get(id).map(|job| (job.round.done(), job.round.size()))
    }

    /// A client submits a job. The caller has checked that its request id is new.
    pub fn submit(&mut self, now: Now, new: NewJob) -> JobRecord {
        let number = self.next_job;
        self.next_job += 1;
        let (job, writes) = ActiveJob::submitted(now, number, new, self.virtual_time);
        let record = job.record.clone();
        self.actions.extend(writes.into_iter().map(|write| Action::Write(Box::new(write))));
        self.jobs.insert(record.id.clone(), job);
        self.dispatch(now);
        record
    }

    /// A job from the store goes on where it stood; nothing is handed out before the next event. If its state can't be
    /// used it fails.
    pub fn resume(&mut self, now: Now, resumed: Resumed) -> Result<(), BadState> {
        let record = resumed.record.clone();
        let id = record.id.clone();
        match ActiveJob::resumed(resumed, self.virtual_time) {
            Ok(job) => {
                self.jobs.insert(id.clone(), job);
                self.tell_other_build(now, &id);
                self.seal(now, &id);
                Ok(())
            }
            Err(problem) => {
                self.give_up(now, record, problem.to_string());
                Err(problem)
            }
        }
    }

    /// A job from the store that can't go on fails.
    pub fn give_up(&mut self, now: Now, record: JobRecord, reason: String) {
        self.ended.insert(record.id.clone());
        let (_, write) = job::end(record, now, JobState::Failed, reason);
        self.actions.push(Action::Write(Box::new(write)));
    }

    /// A client ends a job. `None` if no job that has not ended has this id.
    pub fn cancel(&mut self, now: Now, id: &JobId) -> Option<JobRecord> {
        let record = self.end_job(now, id, JobState::Cancelled, String::new());
        self.dispatch(now);
        record
    }

    /// The coordinator itself stood still for a while: what its workers said meanwhile has not been heard yet, and counts.
    pub fn stood_still(&mut self, time: Duration) {
        self.workers.values_mut().for_each(|worker| worker.expires += time);
        self.leases.values_mut().for_each(|lease| lease.moved += time);
    }

    /// Time passed: leases of silent workers are taken back.
    pub fn tick(&mut self, now: Now) {
        let silent: Vec<WorkerId> =
            self.workers.iter().filter(|(_, w)| w.expires <= now.since_start).map(|(id, _)| id.clone()).collect();
        for id in silent {
            self.lose_worker(now, &id);
        }
        for worker in self.workers.values_mut() {
            worker.refused.retain(|_, until| *until > now.since_start);
        }
        self.drain_leaving(now);
        self.dispatch(now);
        for id in self.workers.keys().cloned().collect::<Vec<_>>() {
            self.copy_stragglers(now, &id);
        }
        self.wake = self.earliest();
    }

    /// When the time has to be told, if nothing happens before; there may be nothing to do then.
    pub fn next_deadline(&self) -> Option<Duration> {
        self.wake
    }

    /// There is a deadline that may be the next. One that moves back needs no telling.
    fn wake_by(&mut self, deadline: Duration) {
        self.wake = Some(self.wake.map_or(deadline, |wake| wake.min(deadline)));
    }

    /// When the next lease ends unless a sign of life comes, or a worker is spared a job no more, or has to be told to stop.
    fn earliest(&self) -> Option<Duration> {
        let expiry = self.workers.values().map(|w| w.expires);
        let refusal = self.workers.values().flat_map(|w| w.refused.values().copied());
        let leaving = self.workers.values().filter(|w| !w.draining).filter_map(|w| self.stops(w));
        expiry.chain(refusal).chain(leaving).min()
    }

    fn end_job(&mut self, now: Now, id: &JobId, state: JobState, reason: String) -> Option<JobRecord> {
        let (record, write) = job::end(self.jobs.remove(id)?.record, now, state, reason);
        self.actions.push(Action::Write(Box::new(write)));
        self.forget(id);
        Some(record)
    }

    /// A job is over: nobody needs to work on it any more.
    fn forget(&mut self, id: &JobId) {
        self.ended.insert(id.clone());
        let running: Vec<AssignmentId> = self.leases.iter().filter(|(_, l)| l.job == *id).map(|(a, _)| *a).collect();
        self.cancel_leases(&running);
        for worker in self.workers.values_mut() {
            worker.known_jobs.remove(id);
            worker.refused.remove(id);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
