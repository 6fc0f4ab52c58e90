//! Arbitration: two results of one task have different digests, so a third worker computes it. The result that two of
//! them agree on holds, and the worker with the other result is quarantined.
//!
//! A round is sealed only after its disputes are decided. A sealed round does not change: if one of its results turns
//! out wrong, the job ends as tainted.

use super::fleet::WorkerId;
use super::job::ActiveJob;
use super::lease::{AssignmentId, LeaseKind, Range, revoke_leases};
use super::notes::LeaseEnd;
use super::trust::{is_distrusted, quarantine};
use super::{Now, Scheduler, events};
use crate::record::{Claim, Claimant, Dispute, Event, JobId, JobState, Ruling, Source};
use sim_core::base::digest::Digest;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Committed results that a late result contradicts, by task index; their round was sealed before the last one.
pub type Contradicted = BTreeMap<u32, Committed>;

/// A committed result of a task in a round sealed before the last one.
#[derive(Clone, Debug, PartialEq)]
pub struct Committed {
    /// Digest of the result.
    pub digest: Digest,
    /// The task, for the arbiter.
    pub task: Vec<u8>,
}

/// The result that currently holds for a task.
pub(super) struct Held {
    pub digest: Digest,
    pub finder: Claimant,
    pub task: Vec<u8>,
    /// Display text of the task.
    pub what: String,
    /// The result; `None` once its round is sealed.
    pub result: Option<Vec<u8>>,
}

/// A delivered result, to compare with the one that holds.
pub(super) struct Delivered {
    pub index: u32,
    pub digest: Digest,
    /// The result; `None` where only digests are compared.
    pub result: Option<Arc<[u8]>>,
}

/// Effect of a claim.
enum ClaimEffect {
    /// It equals the result that holds, or repeats a claim: nothing changes.
    Agrees,
    /// It opened the dispute at this index of the record, or was added to it.
    Added(usize),
    /// It contradicts a decided dispute.
    Refuted,
}

impl ActiveJob {
    /// Returns the result that holds for a task: of the current round, of the round sealed last, or of a dispute.
    pub fn holds(&self, round: u32, index: u32) -> Option<Held> {
        if let Some(dispute) = self.dispute(round, index) {
            let Claim { digest, source, result, .. } = dispute.holding()?.clone();
            let (task, what) = (dispute.task.clone(), dispute.what.clone());
            return Some(Held { digest, finder: source.finder, task, what, result });
        }
        if let Some(last) = self.last.as_ref().filter(|last| last.number == round) {
            let task = last.tasks.get(index as usize)?.clone();
            return Some(Held {
                digest: task.digest,
                finder: task.finder,
                task: task.task,
                what: task.what,
                result: None,
            });
        }
        if round != self.round.number() {
            return None;
        }
        let (digest, finder) = self.round.found(index)?;
        Some(Held {
            digest,
            finder: finder.clone(),
            task: self.procedure.task(index),
            what: self.procedure.describe(index),
            result: self.round.result(index).map(|result| result.to_vec()),
        })
    }

    /// Returns the display text of a result; empty where only its digest is known.
    pub fn show(&self, held: &Held) -> String {
        held.result.as_ref().map_or_else(String::new, |result| self.procedure.show(result))
    }

    /// Returns true if this worker delivered a different result of the task before: the one that holds, or one that is
    /// disputed.
    fn has_other_result_of(&self, worker: &str, held: &Held, digest: Digest, task: (u32, u32)) -> bool {
        let claims = self.dispute(task.0, task.1).into_iter().flat_map(|dispute| &dispute.claims);
        let claimed = claims.map(|claim| (&*claim.source.finder.worker, claim.digest));
        let mut delivered = claimed.chain([(&*held.finder.worker, held.digest)]);
        !worker.is_empty() && delivered.any(|(by, other)| by == worker && other != digest)
    }

    /// Compares a worker's claim with the result that holds for a done task. Adds it to the task's dispute, or opens
    /// one.
    fn add_claim(&mut self, now: Now, round: u32, claim: Claim, index: u32, held: (Held, Claim)) -> ClaimEffect {
        let (held, held_claim) = held;
        let disagrees = claim.digest != held_claim.digest;
        let at = self.disputed.get(&(round, index)).copied();
        if let Some((at, dispute)) = at.and_then(|at| Some((at, self.record.disputes.get_mut(at)?))) {
            if !dispute.is_open() {
                return if disagrees { ClaimEffect::Refuted } else { ClaimEffect::Agrees };
            }
            let known = |c: &Claim| c.source.finder.worker == claim.source.finder.worker && c.digest == claim.digest;
            if dispute.claims.iter().any(known) {
                return ClaimEffect::Agrees;
            }
            dispute.at_ms = now.unix_ms;
            dispute.claims.push(claim);
            return ClaimEffect::Added(at);
        }
        if !disagrees {
            return ClaimEffect::Agrees;
        }
        ClaimEffect::Added(self.open_dispute(Dispute {
            round,
            index,
            what: held.what,
            task: held.task,
            claims: vec![held_claim, claim],
            ruling: None,
            at_ms: now.unix_ms,
        }))
    }

    /// Decides a dispute if two claims agree. Returns the sources of the wrong claims.
    fn decide(&mut self, at: usize) -> Vec<Source> {
        let dispute = &self.record.disputes[at];
        let Some(agreed) = dispute.agreed() else { return Vec::new() };
        let wrong = dispute.claims.iter().filter(|c| c.digest != agreed).map(|c| c.source.clone()).collect();
        let upheld = dispute.claims.first().is_some_and(|c| c.digest == agreed);
        let right = dispute.claims.iter().find(|c| c.digest == agreed && c.result.is_some());
        let right = right.and_then(|c| Some((c.result.clone()?, c.source.finder.clone())));
        let (index, at_hand) = (dispute.index, dispute.round == self.round.number());
        let ruling = match (upheld, right.filter(|_| at_hand)) {
            (true, _) => Ruling::Upheld,
            (false, Some((result, finder))) => {
                self.round.correct(index, result.into(), finder);
                Ruling::Corrected
            }
            (false, None) => Ruling::Tainted,
        };
        self.record.disputes[at].ruling = Some(ruling);
        wrong
    }
}

/// Compares delivered results of done tasks with the results that hold. They agree, open a dispute, or decide one.
/// Returns true if any of them differs from the result that holds afterwards. The call may end the job, or make its
/// round ready to be sealed. `older`: committed results of a round that is no longer in memory.
pub(super) fn compare_results(
    core: &mut Scheduler,
    now: Now,
    id: &JobId,
    round: u32,
    delivered: impl IntoIterator<Item = Delivered>,
    worker: &WorkerId,
    older: &Contradicted,
) -> bool {
    let source = core.fleet.source(core.fleet.finder(worker));
    let mut touched = BTreeSet::new();
    let mut wrong: Vec<Source> = Vec::new();
    let mut twice = None;
    let (mut differs, mut refuted) = (false, false);
    for Delivered { index, digest, result } in delivered {
        let Some(job) = core.jobs.active.get(id) else { return differs };
        let long_sealed = |committed: &Committed| Held {
            digest: committed.digest,
            finder: Claimant::default(),
            task: committed.task.clone(),
            what: format!("task {index} of round {round}"),
            result: None,
        };
        let Some(held) = job.holds(round, index).or_else(|| older.get(&index).map(long_sealed)) else { continue };
        if job.has_other_result_of(&source.finder.worker, &held, digest, (round, index)) {
            twice.get_or_insert_with(|| held.what.clone());
        }
        let result = result.filter(|_| round == job.round.number());
        let what = result.as_ref().map_or_else(String::new, |result| job.procedure.show(result));
        let held_claim =
            claim(core, core.fleet.source(held.finder.clone()), held.digest, job.show(&held), held.result.clone());
        let claim = claim(core, source.clone(), digest, what, result.map(|result| result.to_vec()));
        let Some(job) = core.jobs.active.get_mut(id) else { return differs };
        match job.add_claim(now, round, claim, index, (held, held_claim)) {
            ClaimEffect::Added(at) => {
                touched.insert(at);
                wrong.extend(job.decide(at));
            }
            ClaimEffect::Refuted => refuted = true,
            ClaimEffect::Agrees => {}
        }
        differs |= job.holds(round, index).is_some_and(|held| held.digest != digest);
    }
    if refuted {
        wrong.push(source.clone());
    }
    conclude(core, now, id, &touched, wrong);
    if let Some(what) = twice {
        quarantine(core, now, &source, &format!("it delivered two different results of {what} of job {id}"));
    }
    differs
}

fn claim(core: &Scheduler, source: Source, digest: Digest, what: String, result: Option<Vec<u8>>) -> Claim {
    let distrusted = is_distrusted(core, &source);
    Claim { source, digest, what, result, distrusted }
}

/// Publishes one of the disputes that changed, and acts on those that were decided.
fn conclude(core: &mut Scheduler, now: Now, id: &JobId, touched: &BTreeSet<usize>, mut wrong: Vec<Source>) {
    let Some(job) = core.jobs.active.get_mut(id) else { return };
    let told: Vec<&Dispute> = touched.iter().filter_map(|&at| job.record.disputes.get(at)).collect();
    let tainted = told.iter().find(|d| d.ruling == Some(Ruling::Tainted)).map(|d| (*d).clone());
    let first = tainted.as_ref().or(told.first().copied()).cloned();
    let why = match &first {
        Some(first) => format!("its result of {} of job {id} differs from that of two other workers", first.what),
        None => format!("its result of job {id} differs from the one that arbitration confirmed"),
    };
    if let Some(first) = first {
        let write = job.change(now, Event::Dispute(Box::new(first)));
        core.out.write(write);
    }
    wrong.sort();
    wrong.dedup();
    for source in wrong {
        quarantine(core, now, &source, &why);
    }
    if let Some(dispute) = tainted {
        events::end_job(core, now, id, JobState::Tainted, taint(&dispute));
        return;
    }
    revoke_decided(core, id);
}

/// Revokes arbitration leases on tasks without an open dispute.
fn revoke_decided(core: &mut Scheduler, id: &JobId) {
    let Some(job) = core.jobs.active.get(id) else { return };
    let needless = |range: &Range| range.indexes().all(|index| !job.is_disputed(range.round, index));
    let arbitrations = core.leases.of(id).filter(|(_, l)| l.kind == LeaseKind::Arbitration && needless(&l.range));
    let ids: Vec<AssignmentId> = arbitrations.map(|(id, _)| *id).collect();
    revoke_leases(core, &ids, LeaseEnd::Needless);
}

/// Returns the reason why a job is tainted.
fn taint(dispute: &Dispute) -> String {
    let told = |claim: &Claim| {
        let worker = match (&*claim.source.name, &*claim.source.finder.worker) {
            ("", "") => "a worker that is no longer known",
            ("", id) => id,
            (name, _) => name,
        };
        let (digest, what) = (claim.digest.short(), &claim.what);
        if what.is_empty() {
            format!("{worker} delivered {digest}")
        } else {
            format!("{worker} delivered {what} ({digest})")
        }
    };
    let claims: Vec<String> = dispute.claims.iter().map(told).collect();
    format!(
        "the result of {} that was sealed in round {} is wrong: {}; `evogait restart` repeats the job from that round",
        dispute.what,
        dispute.round,
        claims.join(", ")
    )
}
