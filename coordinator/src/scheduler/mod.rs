//! Which worker computes what, and what follows from it: plain functions over a state, without sockets or clock.
//!
//! Each event is one function of `events` ([`on_result`], [`on_heartbeat`], …): it is given the time, changes the state and
//! leaves [`Action`]s for the shell, which commits the writes among them *before* it does anything else with the outside.
//! So nothing is acknowledged that the store does not hold. If a commit fails the state in memory is ahead of the store, and
//! the coordinator has to stop and start again from the store.
//!
//! A job is a row of rounds of opaque tasks; what a task is only its procedure knows. The states of tasks and leases are in
//! `lease`. How tasks are cut into ranges, which worker computes them and in which order results arrive never touches a
//! result: results are told by index once all of a round are there.

mod arbiter;
mod arbitration;
mod dispatch;
mod events;
mod explain;
mod fleet;
mod job;
mod lease;
mod leaving;
mod notes;
mod restart;
mod results;
mod round;
mod sizing;
mod straggler;
mod stuck;
mod suspects;
mod trust;
mod views;

pub use arbitration::{Committed, Contradicted};
pub use events::{
    on_cancel, on_compare, on_connect, on_disconnect, on_drain, on_expel, on_heartbeat, on_offer, on_pause, on_reject,
    on_result, on_resume, on_standstill, on_submit, on_tick, on_unusable,
};
pub use explain::waits_for;
pub use fleet::{Greeting, Running, SessionId, Welcome, WorkerId, host_of};
pub use job::{NewJob, Resumed};
pub use lease::{Assign, AssignmentId, Range};
pub use notes::{LeaseEnd, Note};
pub use restart::Carried;
pub use results::{Caller, Completed, Delivery, RefusedResult, Verdict};
pub use trust::MAX_MARKS;
pub use views::{Census, Demand, Detail, Held, WorkerView, census, demand, detail, workers};

use crate::permit::PermitKey;
use crate::record::{JobEvent, JobId, JobRecord};
use crate::store::{Quarantined, Write};
use dispatch::Queue;
use fleet::Fleet;
use job::Jobs;
use lease::Leases;
use sim_core::base::digest::Digest;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;
use trust::Trust;

/// Crashes or failures of a task that was worked on alone after which its job fails.
pub const MAX_ATTEMPTS: u32 = 3;

/// The time, as the shell tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Now {
    /// Since some fixed moment; never goes back.
    pub since_start: Duration,
    /// Unix time in ms, for people.
    pub unix_ms: i64,
}

/// Something that the shell has to do, in this order, once all writes of the same list are committed.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// To be committed; all writes of a list in one transaction.
    Write(Box<Write>),
    /// To be sent to a worker, if this session of it still stands.
    Send(WorkerId, SessionId, Message),
    /// To be published to those who watch the job; not stored.
    Publish(Box<JobRecord>, JobEvent),
}

/// A message for a worker.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Work for one slot.
    Assign(Box<Assign>),
    /// Work that is not needed any more.
    Cancel(Vec<AssignmentId>),
    /// It gets nothing more, for this reason.
    Drain(String),
}

/// Times and identity of a coordinator.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Counts the starts on a store.
    pub epoch: u64,
    /// Without a sign of life for this long a worker's leases expire.
    pub lease: Duration,
    /// Work that makes no progress for this long is revoked, where workers report their progress and not when they would
    /// call it stuck themselves.
    pub stuck_after: Duration,
}

impl Settings {
    /// With the usual patience for work that stands still: four leases.
    pub fn new(epoch: u64, lease: Duration) -> Self {
        Self { epoch, lease, stuck_after: 4 * lease }
    }

    /// How long work may stand still on a worker that replaces its own stuck slots after a time that it reports: longer, so
    /// that it may.
    pub fn patience(&self, told: Option<Duration>) -> Duration {
        told.map_or(self.stuck_after, |told| told.saturating_add(2 * self.lease))
    }

    /// Time before its machine goes away at which a worker is told to stop.
    pub fn farewell(&self) -> Duration {
        2 * self.heartbeat()
    }

    /// Time between two signs of life.
    pub fn heartbeat(&self) -> Duration {
        self.lease / 5
    }
}

/// The state, in parts.
pub struct Scheduler {
    settings: Settings,
    /// The engines of this build, by name.
    engines: Arc<[(&'static str, Digest)]>,
    jobs: Jobs,
    fleet: Fleet,
    leases: Leases,
    queue: Queue,
    trust: Trust,
    alarm: Alarm,
    out: Outbox,
}

/// What the shell gets.
#[derive(Default)]
struct Outbox {
    actions: Vec<Action>,
    /// Jobs whose record changed without an event: written once, however many leases were lost at a time.
    to_note: BTreeSet<JobId>,
    notes: Vec<Note>,
}

impl Outbox {
    fn write(&mut self, write: Write) {
        self.actions.push(Action::Write(Box::new(write)));
    }
}

/// When the scheduler wants to be called though nothing happens.
#[derive(Default)]
struct Alarm {
    /// No deadline is before this: looking at all workers after every event would cost as much as there are.
    wake: Option<Duration>,
    /// There was no straggler when they were looked for last, and they are not looked for before this.
    look_again: Duration,
}

impl Alarm {
    /// There is a deadline that may be the next.
    fn wake_by(&mut self, deadline: Duration) {
        self.wake = Some(self.wake.map_or(deadline, |wake| wake.min(deadline)));
    }
}

impl Scheduler {
    /// An empty one. `next_job` is the number of the next job, `ended` are the jobs that will never change again, `key` makes
    /// the permits of assignments.
    pub fn new(settings: Settings, key: PermitKey, next_job: u64, ended: BTreeSet<JobId>) -> Self {
        Self {
            settings,
            engines: Arc::new([]),
            jobs: Jobs::new(next_job, ended),
            fleet: Fleet::default(),
            // Unique over all epochs of a store.
            leases: Leases::starting_at(settings.epoch << 32),
            queue: Queue::default(),
            trust: Trust::new(key),
            alarm: Alarm::default(),
            out: Outbox::default(),
        }
    }

    /// Workers whose results are ignored, from the store.
    pub fn with_quarantined(mut self, quarantined: Vec<Quarantined>) -> Self {
        self.trust.restore(quarantined);
        self
    }

    /// The engines of this build, by name: jobs of others wait for workers of others.
    pub fn with_engines(mut self, engines: Arc<[(&'static str, Digest)]>) -> Self {
        self.engines = engines;
        self
    }

    /// Whether a job that has not ended needs one of these engines.
    pub fn needs(&self, engines: &[Digest]) -> bool {
        self.jobs.active.values().any(|job| engines.contains(&job.record.engine_digest))
    }

    /// Whether workers of this build have an engine; assumed where nothing is known of the build.
    fn is_of_this_build(&self, engine: &Digest) -> bool {
        self.engines.is_empty() || self.engines.iter().any(|(_, own)| own == engine)
    }

    /// The actions since the last call.
    pub fn take_actions(&mut self) -> Vec<Action> {
        for id in std::mem::take(&mut self.out.to_note) {
            if let Some(job) = self.jobs.active.get(&id) {
                self.out.write(Write::Note { record: job.record.clone() });
            }
        }
        std::mem::take(&mut self.out.actions)
    }

    /// The notes since the last call.
    pub fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.out.notes)
    }

    /// A job that has not ended.
    pub fn job(&self, id: &JobId) -> Option<&JobRecord> {
        self.jobs.active.get(id).map(|j| &j.record)
    }

    /// How many jobs have not ended.
    pub fn active_jobs(&self) -> usize {
        self.jobs.active.len()
    }

    /// Tasks of the round at hand that are done, and how many it has; nothing for a job that ended.
    pub fn round(&self, id: &JobId) -> Option<(u32, u32)> {
        self.jobs.active.get(id).map(|job| (job.round.done(), job.round.size()))
    }

    /// When [`on_tick`] has to be called, if nothing happens before; there may be nothing to do then.
    pub fn next_deadline(&self) -> Option<Duration> {
        self.alarm.wake
    }
}

#[cfg(test)]
pub(crate) mod tests;
