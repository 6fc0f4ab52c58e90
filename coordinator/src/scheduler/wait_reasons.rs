//! Reasons, for display, why a job makes no progress or a worker gets no work.

use super::arbiter::arbiters;
use super::fleet::{Worker, WorkerId};
use super::job::ActiveJob;
use super::lease::LeaseKind;
use super::{Now, Scheduler, stuck};
use crate::record::{Dispute, Event, JobId, JobRecord, JobState};
use std::collections::BTreeSet;

/// Most worker builds that a message lists.
const MOST_OFFERS: usize = 3;

/// Returns the reasons why a job makes no progress, or less than it could; `None` if there are none.
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
        n => format!("nothing new is handed out until `evogait resume {id}`; {} may still finish", ranges(n)),
    })
}

fn about_disputes(core: &Scheduler, id: &JobId, job: &ActiveJob) -> Option<String> {
    let first = job.open_disputes().next()?;
    let asked = core.leases.of(id).any(|(_, l)| l.kind == LeaseKind::Arbitration);
    let (contradicted, alone): (Vec<&Dispute>, Vec<_>) = job.open_disputes().partition(|d| d.is_contradicted());
    let contradicted = contradicted.first().map(|first| match contradicted.len() {
        1 => format!("two results of {} differ", first.what),
        n => format!("results of {n} tasks differ, such as {}", first.what),
    });
    let alone = alone.first().map(|first| match alone.len() {
        1 => format!("only a quarantined worker computed {}", first.what),
        n => format!("only a quarantined worker computed {n} tasks, such as {}", first.what),
    });
    let what = contradicted.into_iter().chain(alone).collect::<Vec<_>>().join(", and ");
    let may_decide = || arbiters(core, job, first).next().is_some();
    Some(if asked {
        format!("{what}: another worker is deciding")
    } else if may_decide() {
        format!("{what}: another worker will decide as soon as it has a free slot")
    } else if let Some(machine) = first.needs_host() {
        format!("waits for a worker on {machine}: {what}, and each machine confirms only its own result")
    } else {
        format!("waits for another worker: {what}; only a worker that delivered no result of the task can decide")
    })
}

/// Returns the reason why no worker computes the pending tasks.
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
        return Some(
            "waits: every worker rejected it or made no progress with it; it is offered to them again soon".to_owned(),
        );
    }
    if willing().all(|w| w.held.len() >= w.slots as usize) {
        return Some(
            "waits for a free slot: other jobs use all slots; this job gets its share as they become free".to_owned(),
        );
    }
    Some("waits: the remaining tasks take longer than the workers have left; start another worker".to_owned())
}

/// Publishes to watching clients that the job was submitted to another build, if so.
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
    let copied = core.leases.of(id).filter(|(_, l)| matches!(l.kind, LeaseKind::Copy(_))).count();
    (copied > 0 && job.round.pending() == 0)
        .then(|| format!("{} of the round take far longer than expected and are computed twice", ranges(copied)))
}

/// Returns the reason why a worker gets no work; empty if it gets work.
pub(super) fn about_worker(core: &Scheduler, id: &WorkerId, worker: &Worker) -> String {
    match core.trust.entry(id) {
        Some(entry) => format!("quarantined: {}; a restarted worker gets a new id", entry.reason),
        None if worker.stuck >= stuck::MOST_TIMES => {
            format!("stuck: its leases made no progress {} times; restart it", worker.stuck)
        }
        None => idle_because(worker).unwrap_or_default().to_owned(),
    }
}

/// Returns the reason why a worker gets no work, in a word or two.
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

/// Describes the worker that a job of another build needs.
fn worker_of(record: &JobRecord) -> String {
    let (engine, version) = (record.engine_digest.short(), &record.version);
    let version = if version.is_empty() { "of an unknown version" } else { version };
    let own = env!("CARGO_PKG_VERSION");
    format!(
        "a worker of the build that the job was submitted to (evogait {version} with engine {engine}), since this one \
         (evogait {own}) computes different bits"
    )
}

/// Describes a worker's build and engines.
fn offer(worker: &Worker) -> String {
    let engines: Vec<String> = worker.engines.iter().map(|digest| digest.short()).collect();
    format!("evogait {} with {}", worker.version, engines.join(", "))
}

fn ranges(n: usize) -> String {
    if n == 1 { "1 range".to_owned() } else { format!("{n} ranges") }
}
