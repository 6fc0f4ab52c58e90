//! Counters that all light workers of the process share and the measurement reads.

use super::chains::{Chains, Spell};
use super::usage::Usage;
use serde::Deserialize;
use std::collections::HashMap;
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant};

/// Counters and times of all light workers.
#[derive(Debug)]
pub struct Tally {
    /// Number of sessions opened so far.
    pub sessions: AtomicU64,
    /// Number of evaluated ranges.
    pub ranges: AtomicU64,
    /// Number of crashes.
    pub deaths: AtomicU64,
    usage: Mutex<Usage>,
    chains: Mutex<Chains>,
    /// Seeds of the jobs by job id, so that a job's text is parsed once and not once per worker.
    seeds: RwLock<HashMap<String, u64>>,
}

impl Tally {
    /// Creates counters at zero.
    pub fn new() -> Self {
        Self {
            sessions: AtomicU64::new(0),
            ranges: AtomicU64::new(0),
            deaths: AtomicU64::new(0),
            usage: Mutex::new(Usage::new(Instant::now())),
            chains: Mutex::default(),
            seeds: RwLock::default(),
        }
    }

    /// Returns the slot time.
    pub fn usage(&self) -> MutexGuard<'_, Usage> {
        self.usage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the chains of the generations.
    pub fn chains(&self) -> MutexGuard<'_, Chains> {
        self.chains.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the seed of a job, from `job_toml` if it is not known yet; 0 if that text has no seed.
    pub fn seed(&self, job_id: &str, job_toml: &str) -> u64 {
        #[derive(Deserialize)]
        struct Seeded {
            seed: u64,
        }
        let seeds = self.seeds.read().unwrap_or_else(PoisonError::into_inner);
        if let Some(seed) = seeds.get(job_id) {
            return *seed;
        }
        drop(seeds);
        let seed = toml::from_str(job_toml).map_or(0, |job: Seeded| job.seed);
        self.seeds.write().unwrap_or_else(PoisonError::into_inner).insert(job_id.to_owned(), seed);
        seed
    }
}

/// Busy slot. If it is dropped before [`Busy::done`], its time counts as wasted.
pub struct Busy<'a> {
    tally: &'a Tally,
    begun: Instant,
    done: bool,
}

impl<'a> Busy<'a> {
    /// Creates a busy period that begins now.
    pub fn begin(tally: &'a Tally) -> Self {
        let begun = Instant::now();
        tally.usage().begin(begun);
        Self { tally, begun, done: false }
    }

    /// Returns the time at which it began.
    pub fn begun(&self) -> Instant {
        self.begun
    }

    /// Ends the busy period now. Time beyond the drawn time counts as wasted. Returns the busy period.
    pub fn done(mut self, drawn: Duration, free_since: Instant) -> Spell {
        let ended = Instant::now();
        self.done = true;
        self.tally.usage().end(ended, ended.saturating_duration_since(self.begun + drawn));
        Spell { free_since, begun: self.begun, ended }
    }
}

impl Drop for Busy<'_> {
    fn drop(&mut self) {
        if !self.done {
            let now = Instant::now();
            self.tally.usage().end(now, now - self.begun);
        }
    }
}
