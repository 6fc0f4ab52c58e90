//! What light workers tell of each other's doings: shared by all of them, and read by who measures.

use super::chains::{Chains, Spell};
use super::usage::Usage;
use serde::Deserialize;
use std::collections::HashMap;
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant};

/// All of it.
#[derive(Debug)]
pub struct Tally {
    /// Sessions ever opened.
    pub sessions: AtomicU64,
    /// Ranges worked off.
    pub ranges: AtomicU64,
    /// Deaths.
    pub deaths: AtomicU64,
    usage: Mutex<Usage>,
    chains: Mutex<Chains>,
    /// Seeds of the jobs by their ids: read once, not once a worker.
    seeds: RwLock<HashMap<String, u64>>,
}

impl Tally {
    /// Nothing has happened yet.
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

    /// Slot time.
    pub fn usage(&self) -> MutexGuard<'_, Usage> {
        self.usage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Generations.
    pub fn chains(&self) -> MutexGuard<'_, Chains> {
        self.chains.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The seed of a job, whose text came with it if the session had not had it; 0 if nobody ever had it.
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

/// A busy slot. Dropped before it is done, what it did came to nothing.
pub struct Busy<'a> {
    tally: &'a Tally,
    begun: Instant,
    done: bool,
}

impl<'a> Busy<'a> {
    /// Begins now.
    pub fn begin(tally: &'a Tally) -> Self {
        let begun = Instant::now();
        tally.usage().begin(begun);
        Self { tally, begun, done: false }
    }

    /// When it began.
    pub fn begun(&self) -> Instant {
        self.begun
    }

    /// It is done now, and should have taken this long. Answers with the spell.
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
