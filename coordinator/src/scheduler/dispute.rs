//! Disputes: two results of one task with different bits. Somebody computes wrongly, so another worker is asked; what
//! two of them agree on holds, and whoever stands alone gets no more work. What else that one found is in doubt from then
//! on, and asked again like what is disputed.
//!
//! A round is not sealed before its disputes are decided. Of a sealed one nothing changes: if its value loses, the job
//! ends as tainted.

use super::job::{ActiveJob, event};
use super::lease::{AssignmentId, Kind};
use super::notes::LeaseEnd;
use super::older::{Committed, Contradicted};
use super::round::{Finder, Outcome, Range, Work};
use super::sealed::only_score;
use super::worker::WorkerId;
use super::{Action, Message, Now, Scheduler};
use crate::record::{Claim, Dispute, JobId, JobState, Ruling, Source, Subject};
use crate::store::{Quarantined, Write};
use proto::v1::job_event::Event;
use std::collections::{BTreeMap, BTreeSet};

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
    /// What is said about a task that is or was disputed.
    pub fn dispute(&self, round: u32, index: u32) -> Option<&Dispute> {
        self.record.disputes.get(*self.disputed.get(&(round, index))?)
    }

    /// Takes in a dispute about a task that has none. Answers with its place.
    pub fn open_dispute(&mut self, dispute: Dispute) -> usize {
        let at = self.record.disputes.len();
        self.disputed.insert((dispute.round, dispute.index), at);
        self.record.disputes.push(dispute);
        at
    }

    /// Whether a task's result is in doubt.
    pub fn is_disputed(&self, round: u32, index: u32) -> bool {
        self.dispute(round, index).is_some_and(|d| d.ruling.is_none())
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
        // What was sealed last can come into doubt again.
        let needed = |d: &Dispute| d.ruling.is_none() || d.round + 1 >= round || d.round >= generations;
        let mut spare = self.record.disputes.iter().filter(|d| !needed(d)).count().saturating_sub(KEPT);
        self.record.disputes.retain(|d| {
            let keep = needed(d) || spare == 0;
            spare -= usize::from(!keep);
            keep
        });
        self.disputed = places(&self.record.disputes);
    }

    /// Puts right what the store still has as it was first committed.
    pub fn apply_rulings(&mut self) {
        for dispute in &self.record.disputes {
            let Some(claim) = dispute.holding() else { continue };
            for round in [Some(&mut self.round), self.examined.as_mut()].into_iter().flatten() {
                if round.number == dispute.round {
                    round.correct(dispute.index, &claim.outcome, claim.source.finder());
                }
            }
        }
    }

    /// What holds for a task, who found it, and what the task is. `None` if it can't be disputed (any more).
    pub fn holds(&self, range: &Range, index: u32) -> Option<(Outcome, Finder, Subject)> {
        if let Some(dispute) = self.dispute(range.round, index) {
            let claim = dispute.holding()?;
            let outcome = self.comparable(range.round, claim.outcome.clone());
            return Some((outcome, claim.source.finder(), dispute.subject.clone()));
        }
        if let Some(sealed) = self.last.as_ref().filter(|s| s.contains(range)) {
            let genome = sealed.genomes.as_ref()?.get(index as usize)?.clone();
            return Some((sealed.outcome(index), sealed.finder(index), Subject::Candidate(genome)));
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

    /// Takes in what a worker says about a task that is done, beside what holds.
    fn hear(&mut self, now: Now, (round, index): (u32, u32), subject: Subject, claim: Claim, held: Claim) -> Step {
        let disagrees = claim.outcome != held.outcome;
        let at = self.disputed.get(&(round, index)).copied();
        if let Some((at, dispute)) = at.and_then(|at| Some((at, self.record.disputes.get_mut(at)?))) {
            if dispute.ruling.is_some() {
                return if disagrees { Step::Refuted } else { Step::Nothing };
            }
            let known = |c: &Claim| c.source.worker == claim.source.worker && c.outcome == claim.outcome;
            if dispute.claims.iter().any(known) {
                return Step::Nothing;
            }
            dispute.at_ms = now.unix_ms;
            dispute.claims.push(claim);
            return Step::Told(at);
        }
        if !disagrees {
            return Step::Nothing;
        }
        let at = self.open_dispute(Dispute {
            round,
            index,
            what: describe(round, index, &subject),
            subject,
            claims: vec![held, claim],
            ruling: None,
            at_ms: now.unix_ms,
        });
        Step::Told(at)
    }

    /// Decides a dispute if two agree. Tells who was wrong.
    fn decide(&mut self, at: usize) -> Vec<Source> {
        let dispute = &self.record.disputes[at];
        let Some(agreed) = dispute.agreed().cloned() else { return Vec::new() };
        let wrong = dispute.claims.iter().filter(|c| c.outcome != agreed).map(|c| c.source.clone()).collect();
        let winner = dispute.holding().map(|c| c.source.finder()).unwrap_or_default();
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
    /// differs from what holds now. The job may be over afterwards, or its round ready to be sealed. `older` is what was
    /// sealed of a generation of which nothing is known here.
    pub(super) fn weigh(
        &mut self,
        now: Now,
        id: &JobId,
        range: &Range,
        outcomes: impl IntoIterator<Item = (u32, Outcome)>,
        worker: &WorkerId,
        older: &Contradicted,
    ) -> bool {
        let source = self.source(self.finder(worker));
        let mut touched = BTreeSet::new();
        let mut wrong: Vec<Source> = Vec::new();
        let (mut differs, mut refuted) = (false, false);
        for (index, outcome) in outcomes {
            let Some(job) = self.jobs.get(id) else { return differs };
            let outcome = job.comparable(range.round, outcome);
            let sealed = |c: &Committed| (only_score(c.score), Finder::default(), Subject::Candidate(c.genome.clone()));
            let held = job.holds(range, index).or_else(|| older.get(&index).map(sealed));
            let Some((held, finder, subject)) = held else {
                // Of a generation that an earlier version sealed only the scores are known: nobody can decide.
                differs |= job.last.as_ref().is_some_and(|s| s.contains(range) && !s.agrees(index, &outcome));
                continue;
            };
            let held = self.claim(self.source(finder), held);
            let claim = self.claim(source.clone(), outcome.clone());
            let Some(job) = self.jobs.get_mut(id) else { return differs };
            match job.hear(now, (range.round, index), subject, claim, held) {
                Step::Told(at) => {
                    touched.insert(at);
                    wrong.extend(job.decide(at));
                }
                Step::Refuted => refuted = true,
                Step::Nothing => {}
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

    /// A worker under this id gets no more work, what it says is not believed, and what it said is in doubt.
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
        self.doubt(now, source);
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

    fn claim(&self, source: Source, outcome: Outcome) -> Claim {
        let distrusted = self.quarantined.contains_key(&WorkerId(source.worker.clone()));
        Claim { source, outcome, distrusted }
    }

    /// Whoever has this id, where it is now.
    pub(super) fn finder(&self, id: &WorkerId) -> Finder {
        let host = self.workers.get(id).map(|w| w.host().into()).unwrap_or_default();
        Finder { worker: id.0.clone(), host }
    }

    /// What is known of whoever found something.
    fn source(&self, finder: Finder) -> Source {
        let known = self.workers.get(&WorkerId(finder.worker.clone()));
        let name = known.map(|w| w.name.as_str().into()).unwrap_or_default();
        Source { worker: finder.worker, name, host: finder.host }
    }
}

/// Where the dispute about a task is, by round and index: a whole generation can be in doubt at once.
pub(super) fn places(disputes: &[Dispute]) -> BTreeMap<(u32, u32), usize> {
    disputes.iter().enumerate().map(|(at, d)| ((d.round, d.index), at)).collect()
}

/// A task, for people.
pub(super) fn describe(round: u32, index: u32, subject: &Subject) -> String {
    match subject {
        Subject::Candidate(_) => format!("candidate {index} of generation {round}"),
        Subject::Examination(examination) => examination.to_string(),
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
