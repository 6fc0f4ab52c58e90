//! A store in memory: what the others must behave like. Forgotten when it is dropped.

use super::{
    Answer, Loaded, Quarantined, SealedGeneration, Store, StoreError, StoredJob, StoredRange, StoredResult, Write,
};
use crate::record::{JobId, JobRecord, JobState, ended};
use crate::scheduler::{Finder, Outcome};
use proto::v1;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// See the module.
#[derive(Default)]
pub struct MemoryStore {
    inner: Mutex<Inner>,
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
    search: Vec<u8>,
    /// By round and index of the first.
    results: BTreeMap<(u32, u32), (Vec<Outcome>, Finder)>,
    generations: Vec<SealedGeneration>,
    events: Vec<v1::JobEvent>,
    report: Vec<u8>,
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

    fn load(&self) -> Loaded {
        let next_job = self.jobs.keys().last().map_or(1, |n| n + 1);
        let quarantined = self.quarantined.values().cloned().collect();
        let mut loaded = Loaded { epoch: self.epoch, next_job, quarantined, ..Loaded::default() };
        for entry in self.jobs.values() {
            if ended(entry.record.state) {
                loaded.ended.push(entry.record.id.clone());
            } else {
                loaded.active.push(StoredJob {
                    record: entry.record.clone(),
                    toml: entry.toml.clone(),
                    search: entry.search.clone(),
                    results: entry
                        .results
                        .iter()
                        .map(|(&(round, first), (outcomes, finder))| StoredRange {
                            round,
                            first,
                            outcomes: outcomes.clone(),
                            finder: finder.clone(),
                        })
                        .collect(),
                    last_scores: entry.generations.last().map(|g| g.scores.clone()),
                });
            }
        }
        loaded
    }

    fn apply(&mut self, write: Write) -> Result<(), StoreError> {
        match write {
            Write::Submit { record, toml, search, event } => {
                self.numbers.insert(record.id.clone(), record.number);
                let entry = Entry {
                    record,
                    toml,
                    search,
                    results: BTreeMap::new(),
                    generations: Vec::new(),
                    events: vec![event],
                    report: Vec::new(),
                };
                self.jobs.insert(entry.record.number, entry);
            }
            Write::Results { job, round, ranges, finder } => {
                let ranges = ranges.into_iter().map(|(first, o)| ((round, first), (o, finder.clone())));
                self.entry_mut(&job)?.results.extend(ranges);
            }
            Write::Seal { record, sealed, search, events } => {
                let entry = self.entry_mut(&record.id)?;
                entry.generations.push(sealed);
                entry.search = search;
                entry.results.clear();
                entry.change(record, events);
            }
            Write::Change { record, event } => self.entry_mut(&record.id)?.change(record, vec![event]),
            Write::Note { record } => self.entry_mut(&record.id)?.change(record, Vec::new()),
            Write::Carry { from, to, generations } => {
                let carried: Vec<_> =
                    self.entry_mut(&from)?.generations.iter().take(generations as usize).cloned().collect();
                self.entry_mut(&to)?.generations = carried;
            }
            Write::Quarantine(entry) => {
                self.quarantined.entry(entry.worker.clone()).or_insert(entry);
            }
            Write::Report { record, report, event } => {
                let entry = self.entry_mut(&record.id)?;
                entry.report = report;
                entry.change(record, vec![event]);
            }
        }
        Ok(())
    }
}

impl Entry {
    fn change(&mut self, record: JobRecord, events: Vec<v1::JobEvent>) {
        self.record = record;
        self.events.extend(events);
        if ended(self.record.state) {
            self.results.clear();
            self.search.clear();
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

/// Whether no two jobs would have the same request id: checked first, since nothing is taken back afterwards.
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
            inner.load()
        }))
    }

    fn commit(&self, epoch: u64, writes: Vec<Write>) -> Answer<'_, ()> {
        answer(self.lock().and_then(|mut inner| {
            if inner.epoch != epoch {
                return Err(StoreError::Superseded { own: epoch, by: inner.epoch });
            }
            if !unique(&inner, &writes) {
                return Err(StoreError::Database("a request id is there twice".to_owned()));
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

    fn events<'a>(&'a self, id: &'a JobId, after: u64, limit: u32) -> Answer<'a, Vec<v1::JobEvent>> {
        self.read(|inner| {
            let events = inner.entry(id).map(|e| e.events.as_slice()).unwrap_or_default();
            events.iter().filter(|e| e.sequence > after).take(limit as usize).cloned().collect()
        })
    }

    fn scores<'a>(&'a self, id: &'a JobId, generation: u32) -> Answer<'a, Option<Vec<Option<f64>>>> {
        self.read(|inner| {
            let sealed = inner.entry(id).and_then(|e| e.generations.get(generation as usize));
            sealed.map(|g| g.scores.clone())
        })
    }

    fn result<'a>(&'a self, id: &'a JobId) -> Answer<'a, StoredResult> {
        self.read(|inner| {
            let result = inner.entry(id).map(|e| StoredResult {
                history: e.generations.iter().map(|g| g.statistics).collect(),
                report: e.report.clone(),
            });
            result.unwrap_or(StoredResult { history: Vec::new(), report: Vec::new() })
        })
    }

    fn close(&self) -> Answer<'_, ()> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).closed = true;
        answer(Ok(()))
    }
}
