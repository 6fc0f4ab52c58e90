//! Writes scheduler events to the log and the metrics: the same words for the same thing (job, worker, assignment, round,
//! epoch), so that a log can be searched by any of them. Never a token, never a task.

use crate::metrics::Metrics;
use crate::record::{Claim, Dispute, Event, JobId, JobRecord, Ruling};
use crate::scheduler::{LeaseEnd, Note};
use crate::store::{Quarantined, Write};
use std::collections::HashMap;
use std::sync::Arc;
use tokio::time::Instant;

/// Writes scheduler events to the log and the metrics.
pub(crate) struct Journal {
    epoch: u64,
    metrics: Arc<Metrics>,
    /// When the rounds at hand began.
    begun: HashMap<JobId, Instant>,
}

impl Journal {
    pub fn new(epoch: u64, metrics: Arc<Metrics>) -> Self {
        Self { epoch, metrics, begun: HashMap::new() }
    }

    /// Something happened inside the scheduler. Told when it is noticed, which may be before it is committed.
    pub fn note(&self, note: &Note) {
        let (epoch, metrics) = (self.epoch, &self.metrics);
        match note {
            Note::WorkerLost { worker, name, leases, crashed } => {
                metrics.workers_lost.inc();
                tracing::warn!(%worker, name, leases, crashed, epoch, "worker lost");
            }
            Note::LeaseEnded { worker, job, assignment, range, why } => {
                metrics.lease_ended(*why);
                let (assignment, round, why_word) = (assignment.0, range.round, why.word());
                let (first, count) = (range.first, range.count);
                // What is as it should be is no news.
                if matches!(why, LeaseEnd::Needless | LeaseEnd::Drained) {
                    tracing::debug!(
                        %job, %worker, assignment, round, first, count, epoch, why = why_word, "lease ended"
                    );
                } else {
                    tracing::warn!(
                        %job, %worker, assignment, round, first, count, epoch, why = why_word, "lease ended"
                    );
                }
            }
            Note::Taken { worker, job, round, phase, count } => {
                metrics.tasks(phase, *count);
                tracing::debug!(%job, %worker, round, phase, count, epoch, "results recorded");
            }
            Note::Marked { worker, marks, why } => {
                metrics.marks.inc();
                tracing::warn!(%worker, marks, why, epoch, "a result is refused: the worker is marked");
            }
            Note::Attempt { job, range, attempts, why } => {
                metrics.attempts.inc();
                let (round, index) = (range.round, range.first);
                tracing::warn!(%job, round, index, attempts, why, epoch, "task charged with an attempt");
            }
            Note::ChargesWithdrawn { worker, job, charges } => {
                tracing::info!(%job, %worker, charges, epoch, "worker was only cut off: its charges are withdrawn");
            }
            Note::Doubted { worker, job, tasks } => {
                tracing::warn!(%job, %worker, tasks, epoch, "what a quarantined worker found is asked again");
            }
        }
    }

    /// A change was committed.
    pub fn written(&mut self, write: &Write) {
        match write {
            Write::Submit { record, .. } => {
                let JobRecord { id: job, name, procedure, priority, .. } = record;
                tracing::info!(%job, name, procedure, priority, epoch = self.epoch, "job submitted");
            }
            Write::Seal { record, sealed, events, .. } | Write::Finish { record, sealed, events, .. } => {
                self.metrics.rounds.inc();
                let begun = self.begun.insert(record.id.clone(), Instant::now());
                let seconds = begun.map(|begun| begun.elapsed().as_secs_f64());
                if let Some(seconds) = seconds {
                    self.metrics.round_seconds.observe(seconds);
                }
                let (job, round) = (&record.id, sealed.number);
                tracing::debug!(%job, round, seconds, epoch = self.epoch, "round sealed");
                if events.iter().any(|e| matches!(e.event, Event::State(_))) {
                    self.stands(record);
                }
            }
            Write::Change { record, event } => match &event.event {
                Event::Paused(paused) => {
                    let what = if *paused { "job paused" } else { "job resumed" };
                    tracing::info!(job = %record.id, round = record.rounds_sealed, epoch = self.epoch, "{what}");
                }
                Event::Waits(reason) => {
                    tracing::warn!(job = %record.id, reason, epoch = self.epoch, "job of another build");
                }
                Event::Dispute(dispute) => self.disputed(&record.id, dispute),
                _ => self.stands(record),
            },
            Write::Offer { record, .. } => self.stands(record),
            Write::Quarantine { entry: Quarantined { worker, name, host, credential, reason, .. }, .. } => {
                self.metrics.quarantines.inc();
                let (worker, name, host, credential) = (&**worker, &**name, &**host, &**credential);
                tracing::error!(worker, name, host, credential, reason, epoch = self.epoch, "worker quarantined");
            }
            Write::Carry { from, to: job, rounds } => {
                tracing::info!(%job, %from, rounds, epoch = self.epoch, "job does another one again");
            }
            Write::Results { .. } | Write::Note { .. } => {}
        }
    }

    /// Workers disagree about a result, or the dispute was decided or confirmed.
    fn disputed(&self, job: &JobId, dispute: &Dispute) {
        self.metrics.dispute(dispute.ruling);
        let claim = |c: &Claim| format!("{} {} {}", c.source.finder.worker, c.digest.short(), c.what);
        let claims = dispute.claims.iter().map(claim).collect::<Vec<_>>().join("; ");
        let Dispute { round, index, what, ruling, .. } = dispute;
        let (verdict, epoch) = (ruling.map_or("open", Ruling::word), self.epoch);
        if dispute.is_contradicted() {
            tracing::error!(%job, round, index, what, verdict, claims, epoch, "results differ");
        } else {
            tracing::info!(%job, round, index, what, verdict, claims, epoch, "a result in doubt");
        }
    }

    /// A job changed its state.
    fn stands(&mut self, record: &JobRecord) {
        let JobRecord { id: job, rounds_sealed: round, state, reason, .. } = record;
        tracing::info!(%job, state = state.word(), round, reason, epoch = self.epoch, "job changed its state");
        if state.is_end() {
            self.metrics.job_ended(*state);
            self.begun.remove(job);
        } else {
            self.begun.entry(job.clone()).or_insert_with(Instant::now);
        }
    }
}
