//! Why a job gets nothing done, or a worker no work: sentences for people.

use super::job::{ActiveJob, event};
use super::lease::Kind;
use super::worker::{Worker, WorkerId};
use super::{Action, Now, Scheduler, stuck};
use crate::record::{JobId, JobRecord};
use crate::store::Write;
use proto::v1::job_event::Event;
use std::collections::BTreeSet;

/// Builds of workers that are told one by one.
const MOST_OFFERS: usize = 3;

impl Scheduler {
    /// Why a job gets nothing done, or less than it might; `None` if there is nothing to say.
    pub fn waits_for(&self, id: &JobId) -> Option<String> {
        let job = self.jobs.get(id)?;
        let mut said = Vec::new();
        said.extend(self.about_pause(id, job));
        said.extend(self.about_disputes(id, job));
        if !job.record.paused {
            said.extend(self.about_workers(id, job));
            said.extend(self.about_stragglers(id, job));
        }
        (!said.is_empty()).then(|| said.join("; "))
    }

    fn about_pause(&self, id: &JobId, job: &ActiveJob) -> Option<String> {
        let running = self.leases.values().filter(|l| l.job == *id).count();
        job.record.paused.then(|| match running {
            0 => format!("nothing new is handed out until `evogait resume {id}`"),
            n => format!("nothing new is handed out until `evogait resume {id}`, {} may still finish", ranges(n)),
        })
    }

    fn about_disputes(&self, id: &JobId, job: &ActiveJob) -> Option<String> {
        let first = job.open_disputes().next()?;
        let asked = self.leases.values().any(|l| l.kind == Kind::Decides && l.job == *id);
        let (contradicted, alone): (Vec<_>, Vec<_>) = job.open_disputes().partition(|d| d.is_contradicted());
        let contradicted = contradicted.first().map(|first| match contradicted.len() {
            1 => format!("two results of {} differ", first.what),
            n => format!("results of {n} tasks differ, {} for one", first.what),
        });
        let alone = alone.first().map(|first| match alone.len() {
            1 => format!("{} was found by a worker that computes wrongly", first.what),
            n => format!("{n} tasks were found by a worker that computes wrongly, {} for one", first.what),
        });
        let what = contradicted.into_iter().chain(alone).collect::<Vec<_>>().join(", and ");
        Some(if asked {
            format!("{what}: another worker is deciding")
        } else if let Some(machine) = first.needs_machine().filter(|_| self.arbiters(job, first).next().is_none()) {
            format!("waits for a worker on {machine}: {what}, and what only one machine says does not hold")
        } else if self.arbiters(job, first).next().is_none() {
            format!("waits for another worker: {what}, and only one that has had no part in it can decide")
        } else {
            format!("{what}: another worker will decide as soon as it has a free slot")
        })
    }

    /// Why nobody works on what is pending.
    fn about_workers(&self, id: &JobId, job: &ActiveJob) -> Option<String> {
        if self.leases.values().any(|l| l.job == *id) {
            return None;
        }
        let engine = &job.record.engine_digest;
        let connected = || self.workers.values().filter(|w| w.session.is_some());
        let able = || connected().filter(|w| w.engines.contains(engine));
        let needed = if self.is_of_this_build(engine) { "a worker".to_owned() } else { worker_of(&job.record) };
        if self.workers.is_empty() {
            return Some(format!("waits for {needed}: none is connected"));
        }
        if connected().next().is_none() {
            return Some(format!("waits for {needed}: all have lost their connection"));
        }
        if able().next().is_none() {
            let offered: BTreeSet<String> = connected().map(offer).collect();
            let offered = offered.into_iter().take(MOST_OFFERS).collect::<Vec<_>>().join("; ");
            let needed = match self.is_of_this_build(engine) {
                true => format!("a worker with engine {}", engine.short()),
                false => needed,
            };
            return Some(format!("waits for {needed}: none of those connected has it (they have {offered})"));
        }
        let willing = || able().filter(|w| w.takes_work());
        if willing().next().is_none() {
            let mut why: Vec<String> = able().filter_map(|w| self.idle_because(w)).collect();
            why.sort();
            why.dedup();
            return Some(format!("waits for a worker: those connected get no work ({})", why.join(", ")));
        }
        if job.round.pending() == 0 {
            return None;
        }
        if willing().all(|w| w.refused.contains_key(id)) {
            return Some(
                "waits: every worker rejected it or got nowhere with it, they are asked again soon".to_owned(),
            );
        }
        if willing().all(|w| w.held.len() >= w.slots as usize) {
            return Some(
                "waits for a free slot: other jobs have all of them, it gets its share as they end".to_owned(),
            );
        }
        Some("waits: what is left does not fit into the time that the workers have".to_owned())
    }

    /// Tells those who watch a job if it was submitted to another build than this one.
    pub(super) fn tell_other_build(&mut self, now: Now, id: &JobId) {
        let Some(record) = self.jobs.get(id).map(|job| &job.record) else { return };
        if self.is_of_this_build(&record.engine_digest) {
            return;
        }
        let waits = Event::Waits(format!("waits for {}", worker_of(record)));
        if let Some(job) = self.jobs.get_mut(id) {
            let event = event(&mut job.record, now, waits);
            self.actions.push(Action::Write(Box::new(Write::Change { record: job.record.clone(), event })));
        }
    }

    fn about_stragglers(&self, id: &JobId, job: &ActiveJob) -> Option<String> {
        let copied = self.leases.values().filter(|l| l.job == *id && matches!(l.kind, Kind::Copy(_))).count();
        (copied > 0 && job.round.pending() == 0)
            .then(|| format!("{} of the round take far longer than others and are computed twice", ranges(copied)))
    }

    /// Why a worker gets no work, in a sentence; empty if there is nothing to say.
    pub(super) fn about_worker(&self, id: &WorkerId, worker: &Worker) -> String {
        match self.quarantined.get(id) {
            Some(entry) => format!("quarantined: {}; started again it gets a new id", entry.reason),
            None if worker.stuck >= stuck::MOST_TIMES => {
                format!("stuck: its work stood still {} times; start it again", worker.stuck)
            }
            None => self.idle_because(worker).unwrap_or_default(),
        }
    }

    /// Why a worker gets no work, if so.
    pub(super) fn idle_because(&self, worker: &Worker) -> Option<String> {
        if !worker.trusted {
            Some("quarantined".to_owned())
        } else if worker.draining {
            Some("draining".to_owned())
        } else if worker.stuck >= stuck::MOST_TIMES {
            Some("stuck".to_owned())
        } else if worker.session.is_none() {
            Some("connection lost".to_owned())
        } else {
            None
        }
    }
}

/// The kind of worker that a job needs that was submitted to another build.
fn worker_of(record: &JobRecord) -> String {
    let (engine, version) = (record.engine_digest.short(), &record.version);
    let version = if version.is_empty() { "of an unknown version" } else { version };
    let own = env!("CARGO_PKG_VERSION");
    format!(
        "a worker of the build that the job was submitted to (evogait {version} with engine {engine}), since this one \
         (evogait {own}) computes other bits"
    )
}

/// What a worker computes on.
fn offer(worker: &Worker) -> String {
    let engines: Vec<String> = worker.engines.iter().map(|digest| digest.short()).collect();
    format!("evogait {} with {}", worker.version, engines.join(", "))
}

fn ranges(n: usize) -> String {
    if n == 1 { "1 range".to_owned() } else { format!("{n} ranges") }
}
