//! Workers that are connected or still have leases.

use super::lease::{AssignmentId, Range};
use super::stuck;
pub use crate::record::WorkerId;
use crate::record::{Claimant, JobId, JobRecord, Source};
use sim_core::base::digest::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// Returns the host of a source address with port: `10.0.0.7` for `10.0.0.7:7077`.
pub fn host_of(address: &str) -> &str {
    address.rsplit_once(':').map_or(address, |(host, _)| host)
}

/// Id of one connection of a worker. Messages of an older connection are ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SessionId(pub u64);

/// First message of a worker on a connection.
#[derive(Clone, Debug)]
pub struct Greeting {
    /// The worker's id.
    pub worker: WorkerId,
    /// Its display name.
    pub name: String,
    /// Its evogait version, for display.
    pub version: String,
    /// Source address of its connection.
    pub address: String,
    /// First digits of its token's digest; empty where no token is needed.
    pub credential: Arc<str>,
    /// Number of leases it can run at once, at least 1.
    pub slots: u32,
    /// Its engines.
    pub engines: Vec<Digest>,
    /// Leases that it still runs.
    pub running: Vec<Running>,
    /// Time until its machine shuts down, if known.
    pub time_left: Option<Duration>,
    /// Time without progress after which the worker itself restarts a slot, if it reports that.
    pub stuck_after: Option<Duration>,
}

/// A lease that a worker reports as running.
#[derive(Clone, Debug, PartialEq)]
pub struct Running {
    /// The assignment's id.
    pub assignment: AssignmentId,
    /// The job.
    pub job: JobId,
    /// The tasks.
    pub range: Range,
    /// Permit that came with the assignment.
    pub permit: Vec<u8>,
}

/// The answer to a [`Greeting`].
#[derive(Clone, Debug, PartialEq)]
pub struct Welcome {
    /// Id of the connection.
    pub session: SessionId,
    /// Running leases that the worker continues …
    pub keep: Vec<AssignmentId>,
    /// … and those that it must drop.
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
    /// Its leases, oldest first.
    pub held: BTreeSet<AssignmentId>,
    /// Deadline of its next heartbeat; after it the worker counts as lost and its leases expire.
    pub expires: Duration,
    pub draining: bool,
    /// Jobs with a text that this session was sent, and the digest of the shared bytes sent last.
    pub known: BTreeMap<JobId, Digest>,
    /// Jobs that it gets no work of, and until when.
    pub refused: BTreeMap<JobId, Duration>,
    /// Time at which its machine shuts down, if known.
    pub ends: Option<Duration>,
    /// Time without progress after which its lease is revoked.
    pub stuck_after: Duration,
    /// False if it is quarantined.
    pub trusted: bool,
    /// Number of its leases revoked as stuck since its last result.
    pub stuck: u32,
    /// The suspect that it runs, with no other lease beside it.
    pub suspect: Option<AssignmentId>,
    pub connected_at_ms: i64,
    /// Tasks of which it delivered the first result.
    pub tasks: u64,
}

impl Worker {
    pub fn takes_work(&self) -> bool {
        self.session.is_some() && !self.draining && self.trusted && self.stuck < stuck::MOST_TIMES
    }

    /// Returns true if it may get a lease in a free slot: it takes work and runs no suspect.
    pub fn is_open(&self) -> bool {
        self.takes_work() && self.suspect.is_none()
    }

    pub fn has_free_slot(&self) -> bool {
        self.is_open() && self.held.len() < self.slots as usize
    }

    /// Returns true if it has the job's engine and has not recently rejected or failed the job.
    pub fn can_do(&self, job: &JobRecord) -> bool {
        self.engines.contains(&job.engine_digest) && !self.refused.contains_key(&job.id)
    }

    /// Returns the host it connects from: its source address without the port.
    pub fn host(&self) -> &str {
        host_of(&self.address)
    }
}

/// All workers.
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

    /// Returns the worker if this is its current session.
    pub fn of_session(&self, id: &WorkerId, session: SessionId) -> Option<&Worker> {
        self.workers.get(id).filter(|w| w.session == Some(session))
    }

    /// Removes an ended lease from its worker.
    pub fn free(&mut self, id: &WorkerId, lease: AssignmentId) {
        if let Some(worker) = self.workers.get_mut(id) {
            worker.held.remove(&lease);
            if worker.suspect == Some(lease) {
                worker.suspect = None;
            }
        }
    }

    /// Returns the id of this worker with its current host.
    pub fn finder(&self, id: &WorkerId) -> Claimant {
        let host = self.workers.get(id).map(|w| w.host().into()).unwrap_or_default();
        Claimant { worker: id.0.clone(), host }
    }

    /// Adds the worker's name to a finder.
    pub fn source(&self, finder: Claimant) -> Source {
        let known = self.workers.get(&WorkerId(finder.worker.clone()));
        Source { name: known.map(|w| w.name.as_str().into()).unwrap_or_default(), finder }
    }
}
