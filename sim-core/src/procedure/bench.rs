//! A job as a worker runs it.

use super::{Hooks, NotRun, ProcedureKind, kinds, preparing};
use crate::base::digest::Digest;
use crate::base::error::Invalid;
use crate::problem::{Checked, Job, Preparation};
use std::sync::{Mutex, PoisonError};

/// A job as a worker runs it. Its text is read and checked once, without a simulation. It is prepared once, from the
/// bytes that its rounds share.
pub struct Bench {
    problem: Checked,
    kind: &'static dyn ProcedureKind,
    /// The prepared job, with the digest of the bytes that it was prepared from.
    prepared: Mutex<Option<(Digest, Job)>>,
}

impl Bench {
    /// Reads and checks a job. Simulates nothing.
    pub fn open(job_toml: &str) -> Result<Self, Invalid> {
        Self::of(Checked::from_toml(job_toml)?)
    }

    /// Makes the worker's side of a checked job.
    pub fn of(problem: Checked) -> Result<Self, Invalid> {
        let kind = kinds::of(problem.spec())?;
        Ok(Self { problem, kind, prepared: Mutex::new(None) })
    }

    /// Returns the checked job.
    pub fn problem(&self) -> &Checked {
        &self.problem
    }

    /// Returns the digest of the engine or engines that the job needs.
    pub fn engine_digest(&self) -> Digest {
        self.problem.engine_digest()
    }

    /// Carries out tasks of one round, given as (index, bytes), and returns their results in the same order. `shared`
    /// is empty in round 0.
    pub fn run(
        &self,
        round: u32,
        shared: &[u8],
        tasks: &[(u32, Vec<u8>)],
        hooks: &dyn Hooks,
    ) -> Result<Vec<Vec<u8>>, NotRun> {
        if round == 0 {
            return preparing::run(&self.problem, tasks, hooks);
        }
        self.kind.run(&self.prepared(shared)?, tasks, hooks)
    }

    /// Returns the job prepared from these bytes. Concurrent callers wait for the first one's preparation.
    fn prepared(&self, shared: &[u8]) -> Result<Job, NotRun> {
        let digest = Digest::of_bytes("evogait preparation 1", shared);
        let mut prepared = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, job)) = &*prepared
            && *known == digest
        {
            return Ok(job.clone());
        }
        let preparation = Preparation::decode(shared).map_err(|e| NotRun::Task(format!("its preparation: {e}")))?;
        let job = self.problem.clone().with(preparation).map_err(|e| NotRun::Task(e.to_string()))?;
        *prepared = Some((digest, job.clone()));
        Ok(job)
    }
}
