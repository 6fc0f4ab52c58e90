//! Store in memory: the reference for the behaviour of the others. Its content is lost when it is dropped.

use super::blob::Found;
use super::{
    Answer, Loaded, Quarantined, RunState, SealedRound, Store, StoreError, StoredEvent, StoredJob, StoredRange,
    StoredResult, Write,
};
use crate::permit::PermitKey;
use crate::record::{JobEvent, JobId, JobRecord, JobState};
use sim_core::base::digest::Digest;
use sim_core::procedure::Artefact;
use std::collections::{BTreeMap, BTreeSet};
use std::hash::{BuildHasher as _, RandomState};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Store in memory, for tests.
pub struct MemoryStore {
    inner: Mutex<Inner>,
    key: PermitKey,
}

impl Default for MemoryStore {
    fn default() -> Self {
        let mut key = [0; 32];
        for word in key.as_chunks_mut::<8>().0 {
            *word = RandomState::new().hash_one(0).to_le_bytes();
        }
        Self { inner: Mutex::default(), key: PermitKey::new(key) }
    }
}

#[derive(Default)]
struct Inner {
    epoch: u64,
    closed: bool,
    jobs: BTreeMap<u64, Entry>,
    numbers: BTreeMap<JobId, u64>,
    quarantined: BTreeMap<Arc<str>, Quarantined>,
}

struct Entry {
    record: JobRecord,
    toml: Arc<str>,
    state: RunState,
    /// Results by round and index of the first task.
    results: BTreeMap<(u32, u32), Found>,
    rounds: BTreeMap<u32, SealedRound>,
    events: Vec<StoredEvent>,
    artefacts: Vec<Artefact>,
}

impl Inner {
    fn entry(&self, id: &JobId) -> Option<&Entry> {
        self.jobs.get(self.numbers.get(id)?)
    }

    fn entry_mut(&mut self, id: &JobId) -> Result<&mut Entry, StoreError> {
        let number = self.numbers.get(id);
        let entry = number.and_then(|n| self.jobs.get_mut(n));
        entry.ok_or_else(|| StoreError::Database(format!("there is no job {id}")))
    }

    fn load(&self, key: PermitKey) -> Loaded {
        let next_job = self.jobs.keys().last().map_or(1, |n| n + 1);
        let quarantined = self.quarantined.values().cloned().collect();
        let (mut active, mut ended) = (Vec::new(), Vec::new());
        for entry in self.jobs.values() {
            if entry.record.state.is_end() {
                ended.push(entry.record.id.clone());
                continue;
            }
            let range = |(&(round, first), (results, finder)): (&(u32, u32), &Found)| StoredRange {
                round,
                first,
                results: results.clone(),
                finder: finder.clone(),
            };
            active.push(StoredJob {
                record: entry.record.clone(),
                toml: entry.toml.clone(),
                state: entry.state.clone(),
                results: entry.results.iter().map(range).collect(),
            });
        }
        Loaded { epoch: self.epoch, key, next_job, active, ended, quarantined }
    }

    fn apply(&mut self, write: Write) -> Result<(), StoreError> {
        match write {
            Write::Submit { record, toml, state, event } => {
                self.numbers.insert(record.id.clone(), record.number);
                let mut entry = Entry {
                    record: record.clone(),
                    toml,
                    state,
                    results: BTreeMap::new(),
                    rounds: BTreeMap::new(),
                    events: Vec::new(),
                    artefacts: Vec::new(),
                };
                entry.change(record, &[event]);
                self.jobs.insert(entry.record.number, entry);
            }
            Write::Results { job, round, ranges, finder } => {
                let ranges = ranges.into_iter().map(|(first, o)| ((round, first), (o, finder.clone())));
                self.entry_mut(&job)?.results.extend(ranges);
            }
            Write::Seal { record, sealed, state, events } => {
                let entry = self.entry_mut(&record.id)?;
                entry.rounds.insert(sealed.number, sealed);
                entry.state = state;
                entry.results.clear();
                entry.change(record, &events);
            }
            Write::Change { record, event } => self.entry_mut(&record.id)?.change(record, &[event]),
            Write::Offer { record, state, event } => {
                let entry = self.entry_mut(&record.id)?;
                entry.state = state;
                entry.change(record, &[event]);
            }
            Write::Note { record } => self.entry_mut(&record.id)?.change(record, &[]),
            Write::Carry { from, to, rounds } => {
                let carried = self.entry_mut(&from)?.rounds.range(..rounds).map(|(n, r)| (*n, r.clone())).collect();
                self.entry_mut(&to)?.rounds = carried;
            }
            Write::Quarantine { entry, instead_of } => {
                if let Some(worker) = instead_of {
                    self.quarantined.remove(&worker);
                }
                self.quarantined.entry(entry.worker.clone()).or_insert(entry);
            }
            Write::Finish { record, sealed, artefacts, events } => {
                let entry = self.entry_mut(&record.id)?;
                entry.rounds.insert(sealed.number, sealed);
                entry.artefacts = artefacts;
                entry.change(record, &events);
            }
        }
        Ok(())
    }
}

impl Entry {
    fn change(&mut self, record: JobRecord, events: &[JobEvent]) {
        let stored = |event: &JobEvent| StoredEvent { event: event.clone(), job: record.snapshot() };
        self.events.extend(events.iter().map(stored));
        self.record = record;
        if self.record.state.is_end() {
            self.results.clear();
            self.state = RunState::default();
        }
    }
}

impl MemoryStore {
    fn lock(&self) -> Result<MutexGuard<'_, Inner>, StoreError> {
        let inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        if inner.closed { Err(StoreError::Closed) } else { Ok(inner) }
    }

    fn read<'a, T: Send + 'a>(&'a self, read: impl FnOnce(&Inner) -> T) -> Answer<'a, T> {
        answer(self.lock().map(|inner| read(&inner)))
    }
}

/// Returns true if all request ids stay unique. Checked before the writes, since they can't be undone.
fn unique(inner: &Inner, writes: &[Write]) -> bool {
    let request = |w: &Write| if let Write::Submit { record, .. } = w { Some(record.request_id.clone()) } else { None };
    let mut seen: BTreeSet<_> = inner.jobs.values().map(|e| e.record.request_id.clone()).collect();
    writes.iter().filter_map(request).all(|id| seen.insert(id))
}

fn answer<'a, T: Send + 'a>(value: Result<T, StoreError>) -> Answer<'a, T> {
    Box::pin(std::future::ready(value))
}

impl Store for MemoryStore {
    fn start(&self) -> Answer<'_, Loaded> {
        answer(self.lock().map(|mut inner| {
            inner.epoch += 1;
            inner.load(self.key.clone())
        }))
    }

    fn commit(&self, epoch: u64, writes: Vec<Write>) -> Answer<'_, ()> {
        answer(self.lock().and_then(|mut inner| {
            if inner.epoch != epoch {
                return Err(StoreError::Superseded { own: epoch, by: inner.epoch });
            }
            if !unique(&inner, &writes) {
                return Err(StoreError::Database("two jobs have the same request id".to_owned()));
            }
            writes.into_iter().try_for_each(|write| inner.apply(write))
        }))
    }

    fn job<'a>(&'a self, id: &'a JobId) -> Answer<'a, Option<(JobRecord, String)>> {
        self.read(|inner| inner.entry(id).map(|e| (e.record.clone(), e.toml.to_string())))
    }

    fn job_of_request<'a>(&'a self, request_id: &'a str) -> Answer<'a, Option<JobRecord>> {
        self.read(|inner| inner.jobs.values().map(|e| &e.record).find(|r| r.request_id == request_id).cloned())
    }

    fn jobs<'a>(&'a self, below: u64, limit: u32, states: &'a [JobState]) -> Answer<'a, Vec<JobRecord>> {
        self.read(|inner| {
            let records = inner.jobs.range(..below).rev().map(|(_, e)| e.record.clone());
            let wanted = records.filter(|r| states.is_empty() || states.contains(&r.state));
            wanted.take(limit as usize).collect()
        })
    }

    fn events<'a>(&'a self, id: &'a JobId, after: u64, limit: u32) -> Answer<'a, Vec<StoredEvent>> {
        self.read(|inner| {
            let events = inner.entry(id).map(|e| e.events.as_slice()).unwrap_or_default();
            events.iter().filter(|e| e.event.sequence > after).take(limit as usize).cloned().collect()
        })
    }

    fn digests<'a>(&'a self, id: &'a JobId, round: u32) -> Answer<'a, Option<Vec<Digest>>> {
        self.read(|inner| inner.entry(id)?.rounds.get(&round).map(|sealed| sealed.digests.clone()))
    }

    fn rounds<'a>(&'a self, id: &'a JobId, from: u32, limit: u32) -> Answer<'a, Vec<SealedRound>> {
        self.read(|inner| {
            let rounds = inner.entry(id).map(|e| e.rounds.range(from..).map(|(_, sealed)| sealed.clone()));
            rounds.map(|rounds| rounds.take(limit as usize).collect()).unwrap_or_default()
        })
    }

    fn result<'a>(&'a self, id: &'a JobId) -> Answer<'a, StoredResult> {
        self.read(|inner| {
            let result = inner.entry(id).map(|e| StoredResult {
                history: e.rounds.values().filter_map(|sealed| sealed.row.clone()).collect(),
                artefacts: e.artefacts.clone(),
            });
            result.unwrap_or_default()
        })
    }

    fn close(&self) -> Answer<'_, ()> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).closed = true;
        answer(Ok(()))
    }
}
