//! Disputes: two results of one task with different bits. Somebody computes wrongly, so another worker is asked; what
//! two of them agree on holds, and whoever stands alone gets no more work.
//!
//! A round is not sealed before its disputes are decided. Of a sealed one nothing changes: if its value loses, the job
//! ends as tainted.

use super::job::{ActiveJob, event};
use super::lease::{AssignmentId, Kind};
use super::notes::LeaseEnd;
use super::round::{Outcome, Range, Work};
use super::sealed::only_score;
use super::worker::WorkerId;
use super::{Action, Message, Now, Scheduler};
use crate::record::{Claim, Dispute, JobId, JobState, Ruling, Source, Subject};
use crate::store::{Quarantined, Write};
use proto::v1::job_event::Event;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Decided disputes that are kept of sealed generations.
const KEPT: usize = 8;

/// What a claim led to.
enum Step {
    /// It says what was committed, and nobody doubts that.
    Nothing,
    /// Opened, or heard.
    Told(usize),
    /// It contradicts what was decided before.
    Refuted,
}

impl ActiveJob {
    /// Whether a task's result is in doubt.
    pub fn is_disputed(&self, round: u32, index: u32) -> bool {
        self.record.disputes.iter().any(|d| d.ruling.is_none() && (d.round, d.index) == (round, index))
    }

    /// Whether a round waits for somebody to decide.
    pub fn is_round_disputed(&self, round: u32) -> bool {
        self.record.disputes.iter().any(|d| d.ruling.is_none() && d.round == round)
    }

    /// Disputes that nobody has decided.
    pub fn open_disputes(&self) -> impl Iterator<Item = &Dispute> {
        self.record.disputes.iter().filter(|d| d.ruling.is_none())
    }

    /// Forgets decided disputes that nothing depends on any more, but for the newest few.
    pub fn prune_disputes(&mut self) {
        let (round, generations) = (self.round.number, self.record.generations_total);
        let needed = |d: &Dispute| d.ruling.is_none() || d.round == round || d.round >= generations;
        let mut spare = self.record.disputes.iter().filter(|d| !needed(d)).count().saturating_sub(KEPT);
        self.record.disputes.retain(|d| {
            let keep = needed(d) || spare == 0;
            spare -= usize::from(!keep);
            keep
        });
    }

    /// Puts right what the store still has as it was first committed.
    pub fn apply_rulings(&mut self) {
        for dispute in self.record.disputes.iter().filter(|d| d.ruling == Some(Ruling::Corrected)) {
            let Some(claim) = dispute.holding() else { continue };
            for round in [Some(&mut self.round), self.examined.as_mut()].into_iter().flatten() {
                if round.number == dispute.round {
                    round.correct(dispute.index, &claim.outcome, claim.source.worker.clone());
                }
            }
        }
    }

    /// What holds for a task, who found it, and what the task is. `None` if it can't be disputed (any more).
    fn holds(&self, range: &Range, index: u32) -> Option<(Outcome, Arc<str>, Subject)> {
        let known = self.record.disputes.iter().find(|d| (d.round, d.index) == (range.round, index));
        if let Some(dispute) = known {
            let claim = dispute.holding()?;
            let outcome = self.comparable(range.round, claim.outcome.clone());
            return Some((outcome, claim.source.worker.clone(), dispute.subject.clone()));
        }
        if let Some(sealed) = self.last.as_ref().filter(|s| s.contains(range)) {
            let genome = sealed.genomes.as_ref()?.get(index as usize)?.clone();
            return Some((sealed.outcome(index), sealed.worker(index), Subject::Candidate(genome)));
        }
        let round = [Some(&self.round), self.examined.as_ref()].into_iter().flatten().find(|r| r.contains(range))?;
        let subject = match &round.work {
            Work::Candidates(genomes) => Subject::Candidate(genomes.get(index as usize)?.clone()),
            Work::Examinations(all) => Subject::Examination(all.get(index as usize)?.clone()),
        };
        Some((round.outcome(index)?.clone(), round.finder(index), subject))
    }

    /// What of an outcome can be compared: of a sealed generation only the score.
    fn comparable(&self, round: u32, outcome: Outcome) -> Outcome {
        if round < self.record.generations_done { only_score(outcome.score()) } else { outcome }
    }

    /// Whether a round is sealed.
    fn is_sealed(&self, round: u32) -> bool {
        round < self.round.number
    }

    /// Takes in what a worker says about a task that is done, and `finder` found what holds.
    fn hear(&mut self, now: Now, range: &Range, index: u32, claim: Claim, finder: Source) -> Option<Step> {
        let (outcome, _, subject) = self.holds(range, index)?;
        let disagrees = claim.outcome != outcome;
        let at = self.record.disputes.iter().position(|d| (d.round, d.index) == (range.round, index));
        if let Some((at, dispute)) = at.and_then(|at| Some((at, self.record.disputes.get_mut(at)?))) {
            if dispute.ruling.is_some() {
                return Some(if disagrees { Step::Refuted } else { Step::Nothing });
            }
            let known = |c: &Claim| c.source.worker == claim.source.worker && c.outcome == claim.outcome;
            if dispute.claims.iter().any(known) {
                return Some(Step::Nothing);
            }
            dispute.at_ms = now.unix_ms;
            dispute.claims.push(claim);
            return Some(Step::Told(at));
        }
        if !disagrees {
            return Some(Step::Nothing);
        }
        let what = match &subject {
            Subject::Candidate(_) => format!("candidate {index} of generation {}", range.round),
            Subject::Examination(examination) => examination.to_string(),
        };
        self.record.disputes.push(Dispute {
            round: range.round,
            index,
            what,
            subject,
            claims: vec![Claim { source: finder, outcome }, claim],
            ruling: None,
            at_ms: now.unix_ms,
        });
        Some(Step::Told(self.record.disputes.len() - 1))
    }

    /// Decides a dispute if two agree. Tells who was wrong.
    fn decide(&mut self, at: usize) -> Vec<Source> {
        let dispute = &self.record.disputes[at];
        let Some(agreed) = dispute.agreed().cloned() else { return Vec::new() };
        let wrong = dispute.claims.iter().filter(|c| c.outcome != agreed).map(|c| c.source.clone()).collect();
        let winner = dispute.holding().map_or_else(|| "".into(), |c| c.source.worker.clone());
        let (round, index) = (dispute.round, dispute.index);
        let upheld = dispute.claims.first().is_some_and(|c| c.outcome == agreed);
        let ruling = match (upheld, self.is_sealed(round)) {
            (true, _) => Ruling::Upheld,
            (false, true) => Ruling::Tainted,
            (false, false) => {
                self.round.correct(index, &agreed, winner);
                Ruling::Corrected
            }
        };
        self.record.disputes[at].ruling = Some(ruling);
        wrong
    }
}

impl Scheduler {
    /// Results of tasks that are done, or were sealed: they agree, or open or decide a dispute. Tells whether any of them
    /// differs from what holds now. The job may be over afterwards.
    pub(super) fn weigh(
        &mut self,
        now: Now,
        id: &JobId,
        range: &Range,
        outcomes: impl IntoIterator<Item = (u32, Outcome)>,
        worker: &WorkerId,
    ) -> bool {
        let source = self.source(&worker.0);
        let mut touched = BTreeSet::new();
        let mut wrong: Vec<Source> = Vec::new();
        let (mut differs, mut refuted) = (false, false);
        for (index, outcome) in outcomes {
            let Some(job) = self.jobs.get(id) else { return differs };
            let outcome = job.comparable(range.round, outcome);
            let Some((_, finder, _)) = job.holds(range, index) else {
                // Of a generation that an earlier version sealed only the scores are known: nobody can decide.
                differs |= job.last.as_ref().is_some_and(|s| s.contains(range) && !s.agrees(index, &outcome));
                continue;
            };
            let finder = self.source(&finder);
            let claim = Claim { source: source.clone(), outcome: outcome.clone() };
            let Some(job) = self.jobs.get_mut(id) else { return differs };
            match job.hear(now, range, index, claim, finder) {
                Some(Step::Told(at)) => {
                    touched.insert(at);
                    wrong.extend(job.decide(at));
                }
                Some(Step::Refuted) => refuted = true,
                Some(Step::Nothing) | None => {}
            }
            differs |= job.holds(range, index).is_some_and(|(held, ..)| held != outcome);
        }
        if refuted {
            wrong.push(source);
        }
        self.conclude(now, id, &touched, wrong);
        differs
    }

    /// Tells what disputes came to, and draws the conclusions.
    fn conclude(&mut self, now: Now, id: &JobId, touched: &BTreeSet<usize>, mut wrong: Vec<Source>) {
        let Some(job) = self.jobs.get_mut(id) else { return };
        let told: Vec<&Dispute> = touched.iter().filter_map(|&at| job.record.disputes.get(at)).collect();
        let tainted = told.iter().find(|d| d.ruling == Some(Ruling::Tainted)).map(|d| (*d).clone());
        if let Some(first) = tainted.as_ref().or(told.first().copied()) {
            let what = first.what.clone();
            let shown = Event::Dispute(first.to_wire());
            let event = event(&mut job.record, now, shown);
            self.actions.push(Action::Write(Box::new(Write::Change { record: job.record.clone(), event })));
            wrong.sort_by(|a, b| a.worker.cmp(&b.worker));
            wrong.dedup();
            for source in wrong {
                self.quarantine(
                    now,
                    &source,
                    &format!("its result for {what} of job {id} is not what two others found"),
                );
            }
        } else {
            for source in wrong {
                self.quarantine(now, &source, &format!("a result of it for job {id} contradicts what was decided"));
            }
        }
        if let Some(dispute) = tainted {
            let reason = taint(&dispute);
            self.end_job(now, id, JobState::Tainted, reason);
            return;
        }
        self.call_off_decided(id);
        self.seal(now, id);
    }

    /// Whoever still computes what was decided meanwhile may stop.
    fn call_off_decided(&mut self, id: &JobId) {
        let Some(job) = self.jobs.get(id) else { return };
        let needless = |range: &Range| range.indexes().all(|index| !job.is_disputed(range.round, index));
        let ids: Vec<AssignmentId> = self
            .leases
            .iter()
            .filter(|(_, l)| l.job == *id && l.kind == Kind::Decides && needless(&l.range))
            .map(|(id, _)| *id)
            .collect();
        self.cancel_leases(&ids);
    }

    /// A worker under this id gets no more work, and what it says is not believed.
    pub(super) fn quarantine(&mut self, now: Now, source: &Source, why: &str) {
        let id = WorkerId(source.worker.clone());
        if source.worker.is_empty() || self.quarantined.contains_key(&id) {
            return;
        }
        let entry = Quarantined {
            worker: source.worker.clone(),
            name: source.name.clone(),
            reason: why.to_owned(),
            at_ms: now.unix_ms,
        };
        self.actions.push(Action::Write(Box::new(Write::Quarantine(entry.clone()))));
        self.quarantined.insert(id.clone(), entry);
        let held: Vec<AssignmentId> =
            self.workers.get(&id).map(|w| w.held.iter().copied().collect()).unwrap_or_default();
        self.take_away(&held, LeaseEnd::Drained);
        self.room.workers_changed();
        if let Some(worker) = self.workers.get_mut(&id) {
            worker.trusted = false;
        }
        self.tell_quarantined(&id);
    }

    /// Says to a worker that it gets nothing more, and why.
    pub(super) fn tell_quarantined(&mut self, id: &WorkerId) {
        let Some(entry) = self.quarantined.get(id) else { return };
        let reason = format!(
            "quarantined: {}; check this machine (memory, overclocking, the build), then start the worker again: it gets \
             a new id",
            entry.reason
        );
        if let Some(session) = self.workers.get(id).and_then(|w| w.session) {
            self.actions.push(Action::Send(id.clone(), session, Message::Drain(reason)));
        }
    }

    /// What is known of whoever has this id.
    fn source(&self, id: &Arc<str>) -> Source {
        let known = self.workers.get(&WorkerId(id.clone()));
        let (name, host) = known.map_or_else(Default::default, |w| (w.name.as_str().into(), w.host().into()));
        Source { worker: id.clone(), name, host }
    }
}

/// Why a job is tainted, in a sentence.
fn taint(dispute: &Dispute) -> String {
    let told = |claim: &Claim| {
        let bits: Vec<String> = claim
            .outcome
            .scores
            .iter()
            .map(|s| s.map_or_else(|| "failed".to_owned(), |s| format!("{s} ({:016x})", s.to_bits())))
            .collect();
        let who = match (&*claim.source.name, &*claim.source.worker) {
            ("", "") => "a worker that is not known any more",
            ("", id) => id,
            (name, _) => name,
        };
        format!("{who} says {}", if bits.is_empty() { "other traces".to_owned() } else { bits.join(" ") })
    };
    let claims: Vec<String> = dispute.claims.iter().map(told).collect();
    format!(
        "the value of {} that was sealed in round {} is wrong: {}; `evogait restart` does the job again from there",
        dispute.what,
        dispute.round,
        claims.join(", ")
    )
}
