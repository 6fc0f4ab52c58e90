//! Trust in workers: permits, marks and quarantine.
//!
//! A worker that delivers what can't be a result of its task gets a mark; [`MAX_MARKS`] of them, two different results of one
//! task, or a result that two others contradict put its id into quarantine: it gets no more work, its results are ignored, and
//! those that rest on it alone are computed again.

use super::fleet::WorkerId;
use super::job::ActiveJob;
use super::lease::{AssignmentId, revoke_leases};
use super::notes::{LeaseEnd, Note};
use super::{Action, Message, Now, Scheduler};
use crate::limits::MAX_QUARANTINED;
use crate::permit::PermitKey;
use crate::record::{Claim, Dispute, JobId, Source};
use crate::store::{Quarantined, Write};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Marks that put a worker into quarantine.
pub const MAX_MARKS: u32 = 3;

/// Who is trusted.
pub(super) struct Trust {
    /// Makes permits.
    pub key: PermitKey,
    quarantined: BTreeMap<WorkerId, Quarantined>,
    /// By worker, at most [`MAX_QUARANTINED`] of them.
    marks: BTreeMap<WorkerId, u32>,
}

impl Trust {
    pub fn new(key: PermitKey) -> Self {
        Self { key, quarantined: BTreeMap::new(), marks: BTreeMap::new() }
    }

    pub fn restore(&mut self, quarantined: Vec<Quarantined>) {
        self.quarantined = quarantined.into_iter().map(|q| (WorkerId(q.worker.clone()), q)).collect();
    }

    pub fn is_quarantined(&self, worker: &WorkerId) -> bool {
        self.quarantined.contains_key(worker)
    }

    /// The workers in quarantine.
    #[cfg(test)]
    pub fn ids(&self) -> impl Iterator<Item = &WorkerId> {
        self.quarantined.keys()
    }

    pub fn entry(&self, worker: &WorkerId) -> Option<&Quarantined> {
        self.quarantined.get(worker)
    }

    /// Adds a mark, and returns how many there are. Reconnecting clears none.
    fn mark(&mut self, worker: &WorkerId) -> u32 {
        if self.marks.len() >= MAX_QUARANTINED && !self.marks.contains_key(worker) {
            self.marks.pop_first();
        }
        let marks = self.marks.entry(worker.clone()).or_default();
        *marks += 1;
        *marks
    }

    /// Adds an entry. Returns the oldest where there are too many, which is removed.
    fn add(&mut self, entry: Quarantined) -> Option<Arc<str>> {
        let full = self.quarantined.len() >= MAX_QUARANTINED;
        let oldest = self.quarantined.values().min_by_key(|entry| entry.at_ms).filter(|_| full);
        let oldest = oldest.map(|entry| entry.worker.clone());
        if let Some(oldest) = &oldest {
            self.quarantined.remove(&WorkerId(oldest.clone()));
        }
        self.quarantined.insert(WorkerId(entry.worker.clone()), entry);
        oldest
    }
}

/// Marks a worker that delivered what can't be a result. Only one that is known here is marked.
pub(super) fn mark(core: &mut Scheduler, now: Now, worker: &WorkerId, why: &str) {
    if !core.fleet.workers.contains_key(worker) {
        return;
    }
    let marks = core.trust.mark(worker);
    core.out.notes.push(Note::Marked { worker: worker.clone(), marks, why: why.to_owned() });
    if marks >= MAX_MARKS {
        let source = core.fleet.source(core.fleet.finder(worker));
        quarantine(core, now, &source, &format!("{marks} of its results were refused, the last one since {why}"));
    }
}

/// Puts a worker's id into quarantine.
pub(super) fn quarantine(core: &mut Scheduler, now: Now, source: &Source, why: &str) {
    let id = WorkerId(source.finder.worker.clone());
    if id.0.is_empty() || core.trust.is_quarantined(&id) {
        return;
    }
    let known = core.fleet.workers.get(&id);
    let entry = Quarantined {
        worker: id.0.clone(),
        name: source.name.clone(),
        host: source.finder.host.clone(),
        credential: known.map(|w| w.credential.clone()).unwrap_or_default(),
        reason: why.to_owned(),
        at_ms: now.unix_ms,
    };
    let held: Vec<AssignmentId> = known.map(|w| w.held.iter().copied().collect()).unwrap_or_default();
    let instead_of = core.trust.add(entry.clone());
    core.out.write(Write::Quarantine { entry, instead_of });
    revoke_leases(core, &held, LeaseEnd::Drained);
    core.queue.room.workers_changed();
    if let Some(worker) = core.fleet.workers.get_mut(&id) {
        worker.trusted = false;
    }
    tell_quarantined(core, &id);
    doubt(core, now, source);
}

/// Tells a quarantined worker that it gets nothing more, and why.
pub(super) fn tell_quarantined(core: &mut Scheduler, id: &WorkerId) {
    let Some(entry) = core.trust.entry(id) else { return };
    let reason = format!(
        "quarantined: {}; check this machine (memory, overclocking, the build), then start the worker again: it gets a new id",
        entry.reason
    );
    if let Some(session) = core.fleet.workers.get(id).and_then(|w| w.session) {
        core.out.actions.push(Action::Send(id.clone(), session, Message::Drain(reason)));
    }
}

/// Has the results that rest on this worker alone computed again, in all jobs.
fn doubt(core: &mut Scheduler, now: Now, source: &Source) {
    let Scheduler { jobs, out, .. } = core;
    for (id, job) in &mut jobs.active {
        let claimed = job.distrust(now, &source.finder.worker);
        let tasks = job.open_doubts(now, source);
        if claimed || tasks > 0 {
            out.to_note.insert(id.clone());
            let worker = WorkerId(source.finder.worker.clone());
            out.notes.push(Note::Doubted { worker, job: id.clone(), tasks });
        }
    }
}

/// Withdraws what was blamed on the crash of a worker that lives: it was only cut off. A job that has failed by then stays
/// failed.
pub(super) fn clear_of_blame(core: &mut Scheduler, worker: &WorkerId) {
    let Scheduler { jobs, out, .. } = core;
    for (id, job) in &mut jobs.active {
        let charges = job.withdraw_charges(worker);
        if charges > 0 {
            out.to_note.insert(id.clone());
            out.notes.push(Note::ChargesWithdrawn { worker: worker.clone(), job: id.clone(), charges });
        }
    }
}

/// Whether this worker's claims count for nothing by themselves.
pub(super) fn is_distrusted(core: &Scheduler, source: &Source) -> bool {
    core.trust.is_quarantined(&WorkerId(source.finder.worker.clone()))
}

impl ActiveJob {
    /// Distrusts this worker's claims, and opens again what was decided by such claims alone. Returns whether there is any.
    fn distrust(&mut self, now: Now, worker: &str) -> bool {
        let oldest = self.round.number().saturating_sub(1);
        let mut claimed = false;
        for dispute in &mut self.record.disputes {
            // What was decided about an older round stays: there is nothing left to compare it with.
            if !dispute.has_claim_of(worker) || !dispute.is_open() && dispute.round < oldest {
                continue;
            }
            claimed = true;
            let held = dispute.agreed().and_then(|agreed| dispute.claims.iter().position(|c| c.digest == agreed));
            for claim in dispute.claims.iter_mut().filter(|c| &*c.source.finder.worker == worker) {
                claim.distrusted = true;
            }
            if !dispute.is_open() && dispute.agreed().is_none() {
                // The claim that holds comes first, like a committed one.
                let held = dispute.claims.remove(held.unwrap_or(0));
                dispute.claims.insert(0, held);
                dispute.ruling = None;
                dispute.at_ms = now.unix_ms;
            }
        }
        claimed
    }

    /// Opens a dispute about each task whose result rests on this worker alone. Returns how many.
    fn open_doubts(&mut self, now: Now, source: &Source) -> u32 {
        let mut opened = 0;
        for range in self.found_by(&source.finder.worker) {
            let (round, index) = (range.round, range.first);
            if self.dispute(round, index).is_some() {
                continue;
            }
            let Some(held) = self.holds(round, index) else { continue };
            let (digest, what, result) = (held.digest, self.show(&held), held.result);
            let claim = Claim { source: source.clone(), digest, what, result, distrusted: true };
            self.open_dispute(Dispute {
                round,
                index,
                what: held.what,
                task: held.task,
                claims: vec![claim],
                ruling: None,
                at_ms: now.unix_ms,
            });
            opened += 1;
        }
        opened
    }
}

/// A job of which a worker's result is refused is not offered to it for a while.
pub(super) fn spare(core: &mut Scheduler, now: Now, worker: &WorkerId, job: &JobId) {
    let until = now.since_start + core.settings.lease;
    if let Some(worker) = core.fleet.workers.get_mut(worker) {
        worker.refused.insert(job.clone(), until);
        core.alarm.wake_by(until);
    }
}
