//! Workers: they come, give signs of life, and go.

use super::lease::{AssignmentId, Kind, Lease};
use super::notes::{LeaseEnd, Note};
use super::round::Range;
use super::{Now, Scheduler, stuck};
use crate::record::{JobId, JobRecord};
use proto::v1;
use sim_core::base::digest::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Names a worker from its start to its end, over reconnects.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct WorkerId(pub Arc<str>);

impl fmt::Display for WorkerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Names one connection of a worker: what an older connection still says is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SessionId(pub u64);

/// A worker introduces itself.
#[derive(Clone, Debug)]
pub struct Greeting {
    /// Its id.
    pub worker: WorkerId,
    /// For people.
    pub name: String,
    /// Of evogait, for people.
    pub version: String,
    /// Where it calls from, for people.
    pub address: String,
    /// Evaluations at once, at least 1.
    pub slots: u32,
    /// Its engines.
    pub engines: Vec<Digest>,
    /// What it still works on.
    pub running: Vec<(AssignmentId, JobId, Range)>,
    /// How long its machine will still be there, if that is known.
    pub time_left: Option<Duration>,
    /// How long a slot of it may stand still before it replaces it by itself, if it says so.
    pub stuck_after: Option<Duration>,
}

/// The answer to a [`Greeting`].
#[derive(Clone, Debug, PartialEq)]
pub struct Welcome {
    /// The connection's name.
    pub session: SessionId,
    /// Of what it works on: go on with these …
    pub keep: Vec<AssignmentId>,
    /// … and drop these.
    pub drop: Vec<AssignmentId>,
}

#[derive(Clone, Debug)]
pub(super) struct Worker {
    /// `None` while its connection is broken.
    pub session: Option<SessionId>,
    pub name: String,
    pub version: String,
    pub address: String,
    pub slots: u32,
    pub engines: Vec<Digest>,
    /// Its leases, in the order they were given.
    pub held: BTreeSet<AssignmentId>,
    /// Without a sign of life until then, it is lost.
    pub expires: Duration,
    pub draining: bool,
    /// Jobs whose text this session has been sent.
    pub known_jobs: BTreeSet<JobId>,
    /// Jobs it rejected, and until when it is spared them.
    pub refused: BTreeMap<JobId, Duration>,
    /// When its machine goes away, if that is known.
    pub ends: Option<Duration>,
    /// Work that stands still for this long is taken back.
    pub stuck_after: Duration,
    /// What it says is believed: it is not quarantined.
    pub trusted: bool,
    /// How often its work was taken back since its last result, because it stood still.
    pub stuck: u32,
    /// The suspect that it works on, with nothing beside it.
    pub suspect: Option<AssignmentId>,
    connected_at_ms: i64,
    pub evaluations: u64,
}

impl Worker {
    pub fn takes_work(&self) -> bool {
        self.session.is_some() && !self.draining && self.trusted && self.stuck < stuck::MOST_TIMES
    }

    /// Whether it gets something now, if it has a free slot: not while it works on a suspect.
    pub fn is_open(&self) -> bool {
        self.takes_work() && self.suspect.is_none()
    }

    /// Whether it has the engine of a job and is not spared it.
    pub fn can_do(&self, job: &JobRecord) -> bool {
        self.engines.contains(&job.engine_digest) && !self.refused.contains_key(&job.id)
    }

    /// The machine it calls from.
    pub fn host(&self) -> &str {
        self.address.rsplit_once(':').map_or(&self.address, |(host, _)| host)
    }

    pub fn give_back(&mut self, id: AssignmentId) {
        self.held.remove(&id);
        if self.suspect == Some(id) {
            self.suspect = None;
        }
    }
}

impl Scheduler {
    /// A worker connects, for the first time or again. Work it says it still does stays its own, or becomes it (after a
    /// restart the coordinator knows of no leases), unless somebody else has it or it is done.
    pub fn connect(&mut self, now: Now, greeting: Greeting) -> Welcome {
        let session = SessionId(self.next_session);
        self.next_session += 1;
        let before = self.workers.remove(&greeting.worker);
        if before.is_none() {
            self.clear_of_blame(&greeting.worker);
        }
        let held = before.as_ref().map(|w| w.held.clone()).unwrap_or_default();
        let worker = Worker {
            session: Some(session),
            name: greeting.name,
            version: greeting.version,
            address: greeting.address,
            slots: greeting.slots,
            engines: greeting.engines,
            held: held.clone(),
            expires: now.since_start + self.settings.lease,
            draining: false,
            known_jobs: BTreeSet::new(),
            refused: BTreeMap::new(),
            ends: greeting.time_left.map(|left| now.since_start.saturating_add(left)),
            stuck_after: self.settings.patience(greeting.stuck_after),
            trusted: !self.quarantined.contains_key(&greeting.worker),
            stuck: 0,
            suspect: before.as_ref().and_then(|w| w.suspect),
            connected_at_ms: before.as_ref().map_or(now.unix_ms, |w| w.connected_at_ms),
            evaluations: before.as_ref().map_or(0, |w| w.evaluations),
        };
        let trusted = worker.trusted;
        self.workers.insert(greeting.worker.clone(), worker);
        self.room.may_have(&greeting.worker);
        self.room.workers_changed();

        let (mut keep, mut drop) = (Vec::new(), Vec::new());
        for (id, job, range) in greeting.running {
            let kept = held.contains(&id) || trusted && self.adopt(now, &greeting.worker, id, &job, range);
            if kept { keep.push(id) } else { drop.push(id) }
        }
        // Assignments that never reached it.
        for id in held.iter().filter(|id| !keep.contains(id)) {
            self.release(*id, LeaseEnd::Undelivered);
        }
        self.tell_quarantined(&greeting.worker);
        self.drain_leaving(now);
        self.wake_by(now.since_start + self.settings.lease);
        let stops = self.workers.get(&greeting.worker).filter(|w| !w.draining).and_then(|w| self.stops(w));
        if let Some(at) = stops {
            self.wake_by(at);
        }
        self.dispatch(now);
        Welcome { session, keep, drop }
    }

    /// Makes work that a worker claims to do its lease, if all of it is still pending.
    fn adopt(&mut self, now: Now, worker: &WorkerId, id: AssignmentId, job: &JobId, range: Range) -> bool {
        // An id that was never given out would collide with one that will be.
        if id.0 >= self.next_assignment || self.leases.contains_key(&id) {
            return false;
        }
        let Some(active) = self.jobs.get_mut(job) else { return false };
        let able = self.workers.get(worker).is_some_and(|w| w.engines.contains(&active.record.engine_digest));
        if !able || !active.round.take(&range, id) {
            return false;
        }
        self.leases.insert(id, Lease::new(now, worker, job, range, Kind::Ordinary));
        if let Some(worker) = self.workers.get_mut(worker) {
            worker.held.insert(id);
        }
        true
    }

    /// A sign of life, with what is worked on and, from a worker that counts, how far each of it is. `false` if this
    /// session is not known any more: the worker has to connect again.
    pub fn heartbeat(
        &mut self,
        now: Now,
        id: &WorkerId,
        session: SessionId,
        running: &[AssignmentId],
        progress: &[u64],
    ) -> bool {
        let Some(worker) = self.session(id, session) else { return false };
        let held = worker.held.clone();
        if let Some(worker) = self.workers.get_mut(id) {
            worker.expires = now.since_start + self.settings.lease;
        }
        // What the worker was given a while ago and does not know of got lost on the way.
        let given_before = now.since_start.saturating_sub(self.settings.lease / 2);
        for id in held {
            if !running.contains(&id) && self.leases.get(&id).is_some_and(|l| l.since < given_before) {
                self.release(id, LeaseEnd::Undelivered);
            }
        }
        if progress.len() == running.len() {
            let progress: Vec<_> = running.iter().copied().zip(progress.iter().copied()).collect();
            self.watch_progress(now, id, &progress);
        }
        self.dispatch(now);
        self.copy_stragglers(now, id);
        true
    }

    /// A connection broke. The worker has a heartbeat's time to come back before its work goes to others.
    pub fn disconnect(&mut self, now: Now, id: &WorkerId, session: SessionId) {
        if self.session(id, session).is_none() {
            return;
        }
        self.room.workers_changed();
        let grace = now.since_start + self.settings.heartbeat();
        if let Some(worker) = self.workers.get_mut(id) {
            worker.session = None;
            worker.expires = worker.expires.min(grace);
            if worker.held.is_empty() {
                self.workers.remove(id);
            }
        }
        self.wake_by(grace);
        self.dispatch(now);
    }

    /// A worker will stop: it gets nothing new, and what it has goes back at once, at no cost, but for what it says it
    /// still finishes.
    pub fn drain(&mut self, now: Now, id: &WorkerId, session: SessionId, finishing: &[AssignmentId]) {
        let Some(worker) = self.session(id, session) else { return };
        let finishing: BTreeSet<_> = finishing.iter().collect();
        for assignment in worker.held.clone() {
            if !finishing.contains(&assignment) {
                self.release(assignment, LeaseEnd::Drained);
            }
        }
        if let Some(worker) = self.workers.get_mut(id) {
            worker.draining = true;
        }
        self.room.workers_changed();
        self.dispatch(now);
    }

    /// A worker can't run an assignment. It costs no attempt; for the time of a lease it is spared that job.
    pub fn reject(&mut self, now: Now, id: &WorkerId, session: SessionId, assignment: AssignmentId) {
        let Some(worker) = self.session(id, session) else { return };
        if worker.held.contains(&assignment)
            && let Some(lease) = self.release(assignment, LeaseEnd::Rejected)
        {
            let until = now.since_start + self.settings.lease;
            if let Some(worker) = self.workers.get_mut(id) {
                worker.refused.insert(lease.job, until);
            }
            self.wake_by(until);
        }
        self.dispatch(now);
    }

    /// The workers that are connected.
    pub fn workers(&self) -> Vec<v1::WorkerInfo> {
        self.workers
            .iter()
            .filter(|(_, w)| w.session.is_some())
            .map(|(id, w)| v1::WorkerInfo {
                id: id.to_string(),
                name: w.name.clone(),
                slots: w.slots,
                busy: w.held.len().min(w.slots as usize) as u32,
                engine_digests: w.engines.iter().map(|d| d.0.to_vec()).collect(),
                connected_at_ms: w.connected_at_ms,
                evaluations: w.evaluations,
                address: w.address.clone(),
                reason: self.about_worker(id, w),
                quarantined: !w.trusted,
            })
            .collect()
    }

    /// A worker is gone. If its connection broke it crashed, and what it did is suspected of having crashed it, until it
    /// should come back; if it only fell silent (a network that swallows everything), nothing is to blame.
    pub(super) fn lose_worker(&mut self, now: Now, id: &WorkerId) {
        let Some(worker) = self.workers.remove(id) else { return };
        self.room.workers_changed();
        let crashed = worker.session.is_none();
        let (leases, name) = (worker.held.len() as u32, worker.name.clone());
        self.notes.push(Note::WorkerLost { worker: id.clone(), name, leases, crashed });
        let alone = leases == 1;
        for assignment in worker.held {
            if let Some(lease) = self.release(assignment, LeaseEnd::Lost)
                && crashed
            {
                self.blame(now, &lease, alone, Some(id), &format!("worker {} died with it", worker.name));
            }
        }
    }

    pub(super) fn session(&self, id: &WorkerId, session: SessionId) -> Option<&Worker> {
        self.workers.get(id).filter(|w| w.session == Some(session))
    }
}
