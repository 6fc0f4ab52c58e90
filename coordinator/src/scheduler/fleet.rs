//! The workers that are connected, or whose leases still run.

use super::lease::{AssignmentId, Range};
use super::stuck;
pub use crate::record::WorkerId;
use crate::record::{Finder, JobId, JobRecord, Source};
use sim_core::base::digest::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// The host of a source address with a port, such as `10.0.0.7` of `10.0.0.7:7077`.
pub fn host_of(address: &str) -> &str {
    address.rsplit_once(':').map_or(address, |(host, _)| host)
}

/// Names one connection of a worker: messages of an older connection are ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SessionId(pub u64);

/// The introduction of a worker.
#[derive(Clone, Debug)]
pub struct Greeting {
    /// Its id.
    pub worker: WorkerId,
    /// Its name, for people.
    pub name: String,
    /// Its version of evogait, for people.
    pub version: String,
    /// The address it calls from.
    pub address: String,
    /// The first digits of its token's digest; empty where calls need none.
    pub credential: Arc<str>,
    /// Assignments at once, at least 1.
    pub slots: u32,
    /// Its engines.
    pub engines: Vec<Digest>,
    /// The assignments that it still works on.
    pub running: Vec<Running>,
    /// How long its machine will still be there, if that is known.
    pub time_left: Option<Duration>,
    /// How long a slot of it may stand still before it replaces it by itself, if it says so.
    pub stuck_after: Option<Duration>,
}

/// An assignment that a worker says it works on.
#[derive(Clone, Debug, PartialEq)]
pub struct Running {
    /// Its id.
    pub assignment: AssignmentId,
    /// The job.
    pub job: JobId,
    /// The tasks.
    pub range: Range,
    /// Proof that it was issued.
    pub permit: Vec<u8>,
}

/// The answer to a [`Greeting`].
#[derive(Clone, Debug, PartialEq)]
pub struct Welcome {
    /// The connection's name.
    pub session: SessionId,
    /// Of the assignments it works on: go on with these …
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
    pub credential: Arc<str>,
    pub slots: u32,
    pub engines: Vec<Digest>,
    /// Its leases, in the order they were given.
    pub held: BTreeSet<AssignmentId>,
    /// Without a sign of life until then, it is lost.
    pub expires: Duration,
    pub draining: bool,
    /// Jobs whose text this session has been sent, and the digest of the shared bytes that it was sent last.
    pub known: BTreeMap<JobId, Digest>,
    /// Jobs that it gets no work of for a while, and until when.
    pub refused: BTreeMap<JobId, Duration>,
    /// When its machine goes away, if that is known.
    pub ends: Option<Duration>,
    /// Work that stands still for this long is revoked.
    pub stuck_after: Duration,
    /// It is not quarantined.
    pub trusted: bool,
    /// How often its work was revoked since its last result, because it stood still.
    pub stuck: u32,
    /// The suspect that it works on, with nothing beside it.
    pub suspect: Option<AssignmentId>,
    pub connected_at_ms: i64,
    /// Tasks whose results it delivered first.
    pub tasks: u64,
}

impl Worker {
    pub fn takes_work(&self) -> bool {
        self.session.is_some() && !self.draining && self.trusted && self.stuck < stuck::MOST_TIMES
    }

    /// Whether it gets something now, if it has a free slot: not while it works on a suspect.
    pub fn is_open(&self) -> bool {
        self.takes_work() && self.suspect.is_none()
    }

    pub fn has_free_slot(&self) -> bool {
        self.is_open() && self.held.len() < self.slots as usize
    }

    /// Whether it has the engine of a job and is not spared it.
    pub fn can_do(&self, job: &JobRecord) -> bool {
        self.engines.contains(&job.engine_digest) && !self.refused.contains_key(&job.id)
    }

    /// The machine it calls from: its source address.
    pub fn host(&self) -> &str {
        host_of(&self.address)
    }
}

/// All of them.
#[derive(Default)]
pub(super) struct Fleet {
    pub workers: BTreeMap<WorkerId, Worker>,
    sessions: u64,
}

impl Fleet {
    pub fn new_session(&mut self) -> SessionId {
        self.sessions += 1;
        SessionId(self.sessions)
    }

    /// The worker of a session that still stands.
    pub fn of_session(&self, id: &WorkerId, session: SessionId) -> Option<&Worker> {
        self.workers.get(id).filter(|w| w.session == Some(session))
    }

    /// A worker's lease ended.
    pub fn free(&mut self, id: &WorkerId, lease: AssignmentId) {
        if let Some(worker) = self.workers.get_mut(id) {
            worker.held.remove(&lease);
            if worker.suspect == Some(lease) {
                worker.suspect = None;
            }
        }
    }

    /// The worker with this id and its current host.
    pub fn finder(&self, id: &WorkerId) -> Finder {
        let host = self.workers.get(id).map(|w| w.host().into()).unwrap_or_default();
        Finder { worker: id.0.clone(), host }
    }

    /// The same with its name.
    pub fn source(&self, finder: Finder) -> Source {
        let known = self.workers.get(&WorkerId(finder.worker.clone()));
        Source { name: known.map(|w| w.name.as_str().into()).unwrap_or_default(), finder }
    }
}
