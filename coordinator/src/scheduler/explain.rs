//! Why a job gets nothing done, or a worker no work: sentences for people.

use super::arbiter::arbiters;
use super::fleet::{Worker, WorkerId};
use super::job::ActiveJob;
use super::lease::Kind;
use super::{Now, Scheduler, stuck};
use crate::record::{Dispute, Event, JobId, JobRecord, JobState};
use std::collections::BTreeSet;

/// Builds of workers that are told one by one.
const MOST_OFFERS: usize = 3;

/// Why a job gets nothing done, or less than it might; `None` if there is nothing to say.
pub fn waits_for(core: &Scheduler, id: &JobId) -> Option<String> {
    let job = core.jobs.active.get(id)?;
    let mut said = Vec::new();
    said.extend(about_pause(core, id, job));
    said.extend(about_disputes(core, id, job));
    if job.record.state == JobState::Waiting {
        said.push("waits for a client's batch".to_owned());
    } else if !job.record.paused {
        said.extend(about_workers(core, id, job));
        said.extend(about_stragglers(core, id, job));
    }
    (!said.is_empty()).then(|| said.join("; "))
}

fn about_pause(core: &Scheduler, id: &JobId, job: &ActiveJob) -> Option<String> {
    let running = core.leases.of(id).count();
    job.record.paused.then(|| match running {
        0 => format!("nothing new is handed out until `evogait resume {id}`"),
        n => format!("nothing new is handed out until `evogait resume {id}`, {} may still finish", ranges(n)),
    })
}

fn about_disputes(core: &Scheduler, id: &JobId, job: &ActiveJob) -> Option<String> {
    let first = job.open_disputes().next()?;
    let asked = core.leases.of(id).any(|(_, l)| l.kind == Kind::Arbitration);
    let (contradicted, alone): (Vec<&Dispute>, Vec<_>) = job.open_disputes().partition(|d| d.is_contradicted());
    let contradicted = contradicted.first().map(|first| match contradicted.len() {
        1 => format!("two results of {} differ", first.what),
        n => format!("results of {n} tasks differ, {} for one", first.what),
    });
    let alone = alone.first().map(|first| match alone.len() {
        1 => format!("{} was computed by a worker that computes wrongly", first.what),
        n => format!("{n} tasks were computed by a worker that computes wrongly, {} for one", first.what),
    });
    let what = contradicted.into_iter().chain(alone).collect::<Vec<_>>().join(", and ");
    let may_decide = || arbiters(core, job, first).next().is_some();
    Some(if asked {
        format!("{what}: another worker is deciding")
    } else if may_decide() {
        format!("{what}: another worker will decide as soon as it has a free slot")
    } else if let Some(machine) = first.needs_host() {
        format!("waits for a worker on {machine}: {what}, and what only one machine says does not hold")
    } else {
        format!("waits for another worker: {what}, and only one that has had no part in it can decide")
    })
}

/// Why no worker computes what is pending.
fn about_workers(core: &Scheduler, id: &JobId, job: &ActiveJob) -> Option<String> {
    if core.leases.of(id).next().is_some() {
        return None;
    }
    let engine = &job.record.engine_digest;
    let connected = || core.fleet.workers.values().filter(|w| w.session.is_some());
    let able = || connected().filter(|w| w.engines.contains(engine));
    let needed = if core.is_of_this_build(engine) { "a worker".to_owned() } else { worker_of(&job.record) };
    if core.fleet.workers.is_empty() {
        return Some(format!("waits for {needed}: none is connected"));
    }
    if connected().next().is_none() {
        return Some(format!("waits for {needed}: all have lost their connection"));
    }
    if able().next().is_none() {
        let offered: BTreeSet<String> = connected().map(offer).collect();
        let offered = offered.into_iter().take(MOST_OFFERS).collect::<Vec<_>>().join("; ");
        let needed = match core.is_of_this_build(engine) {
            true => format!("a worker with engine {}", engine.short()),
            false => needed,
        };
        return Some(format!("waits for {needed}: none of those connected has it (they have {offered})"));
    }
    let willing = || able().filter(|w| w.takes_work());
    if willing().next().is_none() {
        let mut why: Vec<&str> = able().filter_map(idle_because).collect();
        why.sort_unstable();
        why.dedup();
        return Some(format!("waits for a worker: those connected get no work ({})", why.join(", ")));
    }
    if job.round.pending() == 0 {
        return None;
    }
    if willing().all(|w| w.refused.contains_key(id)) {
        return Some("waits: every worker rejected it or got nowhere with it, they are asked again soon".to_owned());
    }
    if willing().all(|w| w.held.len() >= w.slots as usize) {
        return Some("waits for a free slot: other jobs have all of them, it gets its share as they end".to_owned());
    }
    Some("waits: what is left does not fit into the time that the workers have".to_owned())
}

/// Publishes to those who watch a job that it was submitted to another build, if so.
pub(super) fn publish_other_build(core: &mut Scheduler, now: Now, id: &JobId) {
    let Some(job) = core.jobs.active.get(id) else { return };
    if core.is_of_this_build(&job.record.engine_digest) {
        return;
    }
    let waits = Event::Waits(format!("waits for {}", worker_of(&job.record)));
    if let Some(job) = core.jobs.active.get_mut(id) {
        let write = job.change(now, waits);
        core.out.write(write);
    }
}

fn about_stragglers(core: &Scheduler, id: &JobId, job: &ActiveJob) -> Option<String> {
    let copied = core.leases.of(id).filter(|(_, l)| matches!(l.kind, Kind::Copy(_))).count();
    (copied > 0 && job.round.pending() == 0)
        .then(|| format!("{} of the round take far longer than others and are computed twice", ranges(copied)))
}

/// Why a worker gets no work, in a sentence; empty if there is nothing to say.
pub(super) fn about_worker(core: &Scheduler, id: &WorkerId, worker: &Worker) -> String {
    match core.trust.entry(id) {
        Some(entry) => format!("quarantined: {}; started again it gets a new id", entry.reason),
        None if worker.stuck >= stuck::MOST_TIMES => {
            format!("stuck: its work stood still {} times; start it again", worker.stuck)
        }
        None => idle_because(worker).unwrap_or_default().to_owned(),
    }
}

/// Why a worker gets no work, in a word or two.
fn idle_because(worker: &Worker) -> Option<&'static str> {
    if !worker.trusted {
        Some("quarantined")
    } else if worker.draining {
        Some("draining")
    } else if worker.stuck >= stuck::MOST_TIMES {
        Some("stuck")
    } else if worker.session.is_none() {
        Some("connection lost")
    } else {
        None
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
