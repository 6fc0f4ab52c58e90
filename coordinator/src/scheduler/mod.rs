//! The scheduler: assigns tasks to workers and decides what follows from their results. It consists of functions over a
//! state, without sockets or clock.
//!
//! Each event is one function of `events` ([`on_result`], [`on_heartbeat`], …). It receives the time, changes the state
//! and adds [`Action`]s for the actor. The actor commits the writes among them *before* it sends anything, so nothing
//! is acknowledged that the store does not hold. If a commit fails, the state in memory is ahead of the store, and the
//! coordinator must exit and start again from the store.
//!
//! A job is a sequence of rounds of tasks. Only the job's procedure interprets a task. The states of tasks and leases
//! are in `lease`. A procedure gets the results by index, once all results of a round are there. So the sizes of
//! ranges, the workers that compute them and the order of arrival never change a result.

mod arbiter;
mod arbitration;
mod dispatch;
mod events;
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
mod wait_reasons;

pub use arbitration::{Committed, Contradicted};
pub use events::{
    on_cancel, on_compare, on_connect, on_disconnect, on_drain, on_expel, on_heartbeat, on_offer, on_pause, on_result,
    on_resume, on_return, on_standstill, on_submit, on_tick, on_unusable,
};
pub use fleet::{Greeting, Running, SessionId, Welcome, WorkerId, host_of};
pub use job::{NewJob, Resumed};
pub use lease::{Assign, AssignmentId, Range};
pub use notes::{LeaseEnd, Note};
pub use restart::Carried;
pub use results::{Caller, Completed, Delivery, RefusedResult, Verdict};
pub use trust::MAX_MARKS;
pub use views::{Census, Demand, Detail, Held, WorkerView, census, demand, detail, workers};
pub use wait_reasons::waits_for;

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

/// Attempts of a task after which its job fails. An attempt is a crash or failure while the task ran alone.
pub const MAX_ATTEMPTS: u32 = 3;

/// The current time, as the actor measures it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Now {
    /// Time since a fixed moment; never decreases.
    pub since_start: Duration,
    /// Unix time in ms, for display.
    pub unix_ms: i64,
}

/// An action for the actor. The actor commits all writes of a list first, then runs the other actions in order.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Commits this write; all writes of a list go into one transaction.
    Write(Box<Write>),
    /// Sends a message to a worker, if this session of it is still open.
    Send(WorkerId, SessionId, Message),
    /// Publishes an event to the clients that watch the job; it is not stored.
    Publish(Box<JobRecord>, JobEvent),
}

/// A message for a worker.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// A new lease, for one slot.
    Assign(Box<Assign>),
    /// Leases that were revoked.
    Cancel(Vec<AssignmentId>),
    /// The worker gets no more work; the text is the reason.
    Drain(String),
}

/// Times and identity of a coordinator.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Number of coordinator starts on this store.
    pub epoch: u64,
    /// The leases of a worker expire after this time without a heartbeat.
    pub lease: Duration,
    /// A lease without progress for this time is revoked. Applies to workers that report progress but no stuck timeout
    /// of their own.
    pub stuck_after: Duration,
}

impl Settings {
    /// Settings with the default stuck timeout of four lease times.
    pub fn new(epoch: u64, lease: Duration) -> Self {
        Self { epoch, lease, stuck_after: 4 * lease }
    }

    /// Time without progress after which a worker's lease is revoked. A worker that reports its own stuck timeout
    /// (`told`) restarts its stuck slots itself. It gets two lease times more, so that it can do so first.
    pub fn stuck_timeout(&self, told: Option<Duration>) -> Duration {
        told.map_or(self.stuck_after, |told| told.saturating_add(2 * self.lease))
    }

    /// Time between the drain of a worker and the moment its machine shuts down.
    pub fn drain_lead_time(&self) -> Duration {
        2 * self.heartbeat()
    }

    /// Time between two heartbeats.
    pub fn heartbeat(&self) -> Duration {
        self.lease / 5
    }
}

/// The scheduler's state.
pub struct Scheduler {
    settings: Settings,
    /// The engines of this build: name and digest.
    engines: Arc<[(&'static str, Digest)]>,
    jobs: Jobs,
    fleet: Fleet,
    leases: Leases,
    queue: Queue,
    trust: Trust,
    alarm: Alarm,
    out: Outbox,
}

/// Output for the actor.
#[derive(Default)]
struct Outbox {
    actions: Vec<Action>,
    /// Jobs with a record that changed without an event. Each is written once, even if many of its leases ended
    /// together.
    to_note: BTreeSet<JobId>,
    notes: Vec<Note>,
}

impl Outbox {
    fn write(&mut self, write: Write) {
        self.actions.push(Action::Write(Box::new(write)));
    }
}

/// Time of the next call of [`on_tick`], and of the next search for stragglers.
#[derive(Default)]
struct Alarm {
    /// Lower bound on the next deadline. It is kept because a search over all workers after each event would be
    /// expensive.
    wake: Option<Duration>,
    /// The next search for stragglers is not before this time; the last search found none.
    look_again: Duration,
}

impl Alarm {
    /// Makes sure that `wake` is not after this deadline.
    fn wake_by(&mut self, deadline: Duration) {
        self.wake = Some(self.wake.map_or(deadline, |wake| wake.min(deadline)));
    }
}

impl Scheduler {
    /// A scheduler without jobs and workers. `next_job` is the number of the next job, `ended` are the jobs that will
    /// not change any more, and `key` issues the permits of assignments.
    pub fn new(settings: Settings, key: PermitKey, next_job: u64, ended: BTreeSet<JobId>) -> Self {
        Self {
            settings,
            engines: Arc::new([]),
            jobs: Jobs::new(next_job, ended),
            fleet: Fleet::default(),
            // Assignment ids are unique over all epochs of a store.
            leases: Leases::starting_at(settings.epoch << 32),
            queue: Queue::default(),
            trust: Trust::new(key),
            alarm: Alarm::default(),
            out: Outbox::default(),
        }
    }

    /// Sets the quarantined workers, from the store.
    pub fn with_quarantined(mut self, quarantined: Vec<Quarantined>) -> Self {
        self.trust.restore(quarantined);
        self
    }

    /// Sets the engines of this build: name and digest. Jobs of other builds wait for workers of those builds.
    pub fn with_engines(mut self, engines: Arc<[(&'static str, Digest)]>) -> Self {
        self.engines = engines;
        self
    }

    /// Returns true if an active job needs one of these engines.
    pub fn needs(&self, engines: &[Digest]) -> bool {
        self.jobs.active.values().any(|job| engines.contains(&job.record.engine_digest))
    }

    /// Returns true if this build has the engine, or if the engines of this build are not set.
    fn is_of_this_build(&self, engine: &Digest) -> bool {
        self.engines.is_empty() || self.engines.iter().any(|(_, own)| own == engine)
    }

    /// Removes and returns the actions since the last call.
    pub fn take_actions(&mut self) -> Vec<Action> {
        for id in std::mem::take(&mut self.out.to_note) {
            if let Some(job) = self.jobs.active.get(&id) {
                self.out.write(Write::Note { record: job.record.clone() });
            }
        }
        std::mem::take(&mut self.out.actions)
    }

    /// Removes and returns the notes since the last call.
    pub fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.out.notes)
    }

    /// Returns the record of an active job.
    pub fn job(&self, id: &JobId) -> Option<&JobRecord> {
        self.jobs.active.get(id).map(|j| &j.record)
    }

    /// Number of active jobs.
    pub fn active_jobs(&self) -> usize {
        self.jobs.active.len()
    }

    /// Number of done tasks and of all tasks in the current round; `None` for a job that has ended.
    pub fn round(&self, id: &JobId) -> Option<(u32, u32)> {
        self.jobs.active.get(id).map(|job| (job.round.done(), job.round.size()))
    }

    /// Time of the next call of [`on_tick`] if no other event comes before. The call may find nothing to do.
    pub fn next_deadline(&self) -> Option<Duration> {
        self.alarm.wake
    }
}

#[cfg(test)]
pub(crate) mod tests;
