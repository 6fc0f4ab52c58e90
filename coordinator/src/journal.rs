//! Writes scheduler events to the log and the metrics. The log fields job, worker, assignment, round and epoch have the
//! same names everywhere, so that a log can be searched by them. Tokens and tasks are never logged.

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
    /// Start times of the current rounds.
    begun: HashMap<JobId, Instant>,
}

impl Journal {
    pub fn new(epoch: u64, metrics: Arc<Metrics>) -> Self {
        Self { epoch, metrics, begun: HashMap::new() }
    }

    /// Records an event inside the scheduler, when it is noticed. It may not be committed yet.
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
                // Expected endings are logged at debug level.
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
                tracing::warn!(%worker, marks, why, epoch, "result refused: the worker is marked");
            }
            Note::Attempt { job, range, attempts, why } => {
                metrics.attempts.inc();
                let (round, index) = (range.round, range.first);
                tracing::warn!(%job, round, index, attempts, why, epoch, "task charged with an attempt");
            }
            Note::ChargesWithdrawn { worker, job, charges } => {
                tracing::info!(%job, %worker, charges, epoch, "worker had lost its connection, not crashed: its charges are withdrawn");
            }
            Note::Doubted { worker, job, tasks } => {
                tracing::warn!(%job, %worker, tasks, epoch, "results of a quarantined worker are arbitrated");
            }
        }
    }

    /// Records a committed change.
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
                    tracing::warn!(job = %record.id, reason, epoch = self.epoch, "job waits for workers of another build");
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
                tracing::info!(%job, %from, rounds, epoch = self.epoch, "job restarts another job");
            }
            Write::Results { .. } | Write::Note { .. } => {}
        }
    }

    /// Records a new, decided or confirmed dispute.
    fn disputed(&self, job: &JobId, dispute: &Dispute) {
        self.metrics.dispute(dispute.ruling);
        let claim = |c: &Claim| format!("{} {} {}", c.source.finder.worker, c.digest.short(), c.what);
        let claims = dispute.claims.iter().map(claim).collect::<Vec<_>>().join("; ");
        let Dispute { round, index, what, ruling, .. } = dispute;
        let (verdict, epoch) = (ruling.map_or("open", Ruling::word), self.epoch);
        if dispute.is_contradicted() {
            tracing::error!(%job, round, index, what, verdict, claims, epoch, "results differ");
        } else {
            tracing::info!(%job, round, index, what, verdict, claims, epoch, "result disputed");
        }
    }

    /// Records a change of a job's state.
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
