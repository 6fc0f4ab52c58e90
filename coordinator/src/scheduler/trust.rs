//! Trust in workers: permits, marks and quarantine.
//!
//! A worker gets a mark for each invalid result. It is quarantined after [`MAX_MARKS`] marks, after two different
//! results of one task, or after a result that two other workers contradict. A quarantined worker gets no more work and
//! its results are ignored. Results that only it delivered are computed again.

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

/// Marks after which a worker is quarantined.
pub const MAX_MARKS: u32 = 3;

/// State of trust in workers.
pub(super) struct Trust {
    /// Key that issues and checks permits.
    pub key: PermitKey,
    quarantined: BTreeMap<WorkerId, Quarantined>,
    /// Marks by worker, at most [`MAX_QUARANTINED`] entries.
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

    /// Returns the quarantined workers.
    #[cfg(test)]
    pub fn ids(&self) -> impl Iterator<Item = &WorkerId> {
        self.quarantined.keys()
    }

    pub fn entry(&self, worker: &WorkerId) -> Option<&Quarantined> {
        self.quarantined.get(worker)
    }

    /// Adds a mark and returns the worker's number of marks. Reconnecting does not reset it.
    fn mark(&mut self, worker: &WorkerId) -> u32 {
        if self.marks.len() >= MAX_QUARANTINED && !self.marks.contains_key(worker) {
            self.marks.pop_first();
        }
        let marks = self.marks.entry(worker.clone()).or_default();
        *marks += 1;
        *marks
    }

    /// Adds an entry. If there are too many, removes the oldest and returns its worker.
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

/// Marks a worker that delivered an invalid result. Unknown workers are not marked.
pub(super) fn mark(core: &mut Scheduler, now: Now, worker: &WorkerId, why: &str) {
    if !core.fleet.workers.contains_key(worker) {
        return;
    }
    let marks = core.trust.mark(worker);
    core.out.notes.push(Note::Marked { worker: worker.clone(), marks, why: why.to_owned() });
    if marks >= MAX_MARKS {
        let source = core.fleet.source(core.fleet.finder(worker));
        quarantine(core, now, &source, &format!("{marks} of its results were refused; the last error: {why}"));
    }
}

/// Quarantines a worker's id.
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
    send_quarantine_drain(core, &id);
    dispute_results_of(core, now, source);
}

/// Sends a quarantined worker a drain message with the reason.
pub(super) fn send_quarantine_drain(core: &mut Scheduler, id: &WorkerId) {
    let Some(entry) = core.trust.entry(id) else { return };
    let reason = format!(
        "quarantined: {}; check this machine (memory, overclocking, the build), then restart the worker: it gets a new id",
        entry.reason
    );
    if let Some(session) = core.fleet.workers.get(id).and_then(|w| w.session) {
        core.out.actions.push(Action::Send(id.clone(), session, Message::Drain(reason)));
    }
}

/// Disputes, in all jobs, the results that only this worker delivered, so that they are computed again.
fn dispute_results_of(core: &mut Scheduler, now: Now, source: &Source) {
    let Scheduler { jobs, out, .. } = core;
    for (id, job) in &mut jobs.active {
        let claimed = job.distrust(now, &source.finder.worker);
        let tasks = job.open_disputes_of_worker(now, source);
        if claimed || tasks > 0 {
            out.to_note.insert(id.clone());
            let worker = WorkerId(source.finder.worker.clone());
            out.notes.push(Note::Doubted { worker, job: id.clone(), tasks });
        }
    }
}

/// Withdraws all charges for the crash of a worker that turns out to have lost only its connection. A job that has
/// already failed stays failed.
pub(super) fn withdraw_crash_charges(core: &mut Scheduler, worker: &WorkerId) {
    let Scheduler { jobs, out, .. } = core;
    for (id, job) in &mut jobs.active {
        let charges = job.withdraw_charges(worker);
        if charges > 0 {
            out.to_note.insert(id.clone());
            out.notes.push(Note::ChargesWithdrawn { worker: worker.clone(), job: id.clone(), charges });
        }
    }
}

/// Returns true if this worker's claims do not count on their own.
pub(super) fn is_distrusted(core: &Scheduler, source: &Source) -> bool {
    core.trust.is_quarantined(&WorkerId(source.finder.worker.clone()))
}

impl ActiveJob {
    /// Marks this worker's claims as distrusted, and reopens disputes that only distrusted claims decided. Returns true
    /// if the worker has a claim in any dispute that was checked.
    fn distrust(&mut self, now: Now, worker: &str) -> bool {
        let oldest = self.round.number().saturating_sub(1);
        let mut claimed = false;
        for dispute in &mut self.record.disputes {
            // Decisions about older rounds stay: their results are no longer in memory to compare with.
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

    /// Opens a dispute about each task with a result that only this worker delivered. Returns their number.
    fn open_disputes_of_worker(&mut self, now: Now, source: &Source) -> u32 {
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

/// Offers this worker no work of this job for one lease time.
pub(super) fn defer_job_on_worker(core: &mut Scheduler, now: Now, worker: &WorkerId, job: &JobId) {
    let until = now.since_start + core.settings.lease;
    if let Some(worker) = core.fleet.workers.get_mut(worker) {
        worker.refused.insert(job.clone(), until);
        core.alarm.wake_by(until);
    }
}
