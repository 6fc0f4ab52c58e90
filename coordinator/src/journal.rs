//! What happens, as lines in the log and as counts: the same words for the same thing (job, worker, assignment,
//! generation, epoch), so that a log can be searched by any of them. Never a token, never a genome.

use crate::metrics::Metrics;
use crate::record::{JobId, JobRecord, ended};
use crate::scheduler::{LeaseEnd, Note};
use crate::store::{Quarantined, Write};
use proto::v1;
use proto::v1::job_event::Event;
use std::collections::HashMap;
use std::sync::Arc;
use tokio::time::Instant;

/// Tells.
pub(crate) struct Journal {
    epoch: u64,
    metrics: Arc<Metrics>,
    /// When the generations at hand began.
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
                let (assignment, generation, why_word) = (assignment.0, range.round, why.word());
                let (first, count) = (range.first, range.count);
                // What is as it should be is no news.
                if matches!(why, LeaseEnd::Needless | LeaseEnd::Drained) {
                    tracing::debug!(
                        %job, %worker, assignment, generation, first, count, epoch, why = why_word, "lease ended"
                    );
                } else {
                    tracing::warn!(
                        %job, %worker, assignment, generation, first, count, epoch, why = why_word, "lease ended"
                    );
                }
            }
            Note::Taken { worker, job, round, evaluations, count } => {
                let counter = if *evaluations { &metrics.evaluations } else { &metrics.examinations };
                counter.inc_by(u64::from(*count));
                tracing::debug!(%job, %worker, generation = round, count, epoch, "results taken in");
            }
            Note::Attempt { job, range, attempts, why } => {
                metrics.attempts.inc();
                let (generation, candidate) = (range.round, range.first);
                tracing::warn!(%job, generation, candidate, attempts, why, epoch, "task charged with an attempt");
            }
            Note::TakenBack { worker, job, charges } => {
                tracing::info!(%job, %worker, charges, epoch, "worker was only cut off: its charges are taken back");
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
                let JobRecord { id: job, name, generations_total, population, priority, .. } = record;
                tracing::info!(
                    %job, name, generations = generations_total, population, priority, epoch = self.epoch, "job submitted"
                );
            }
            Write::Seal { record, sealed, events, .. } => {
                self.metrics.generations.inc();
                let begun = self.begun.insert(record.id.clone(), Instant::now());
                let seconds = begun.map(|begun| begun.elapsed().as_secs_f64());
                if let Some(seconds) = seconds {
                    self.metrics.generation_seconds.observe(seconds);
                }
                let (job, generation) = (&record.id, sealed.statistics.generation);
                let (best, failed) = (sealed.statistics.best_so_far, sealed.statistics.failed);
                tracing::debug!(%job, generation, best, failed, seconds, epoch = self.epoch, "generation sealed");
                if events.iter().any(|e| matches!(e.event, Some(Event::StateChanged(_)))) {
                    self.stands(record);
                }
            }
            Write::Change { record, event } => match &event.event {
                Some(Event::Paused(paused)) => {
                    let what = if *paused { "job paused" } else { "job resumed" };
                    tracing::info!(job = %record.id, generation = record.generations_done, epoch = self.epoch, "{what}");
                }
                Some(Event::Waits(reason)) => {
                    tracing::warn!(job = %record.id, reason, epoch = self.epoch, "job of another build");
                }
                Some(Event::Dispute(dispute)) => self.disputed(&record.id, dispute),
                _ => self.stands(record),
            },
            Write::Report { record, .. } => self.stands(record),
            Write::Quarantine(Quarantined { worker, name, reason, .. }) => {
                self.metrics.quarantines.inc();
                tracing::error!(worker = &**worker, name = &**name, reason, epoch = self.epoch, "worker quarantined");
            }
            Write::Carry { from, to: job, generations } => {
                tracing::info!(%job, %from, generations, epoch = self.epoch, "job does another one again");
            }
            Write::Results { .. } | Write::Note { .. } => {}
        }
    }

    /// Workers disagree about a result, or somebody decided, or confirmed what was only doubted.
    fn disputed(&self, job: &JobId, dispute: &v1::Dispute) {
        self.metrics.dispute(dispute.verdict());
        let claim = |c: &v1::Claim| {
            let bits = |s: &v1::Score| s.score.map_or("failed".to_owned(), |s| format!("{:016x}", s.to_bits()));
            format!("{} {}", c.worker_id, c.scores.iter().map(bits).collect::<Vec<_>>().join(","))
        };
        let claims = dispute.claims.iter().map(claim).collect::<Vec<_>>().join("; ");
        let (generation, candidate) = (dispute.round, dispute.index);
        let verdict = dispute.verdict().as_str_name().trim_start_matches("VERDICT_").to_lowercase();
        let verdict = verdict.replace("unspecified", "open");
        if dispute.claims.windows(2).all(|pair| pair[0].digest == pair[1].digest) {
            tracing::info!(
                %job, generation, candidate, what = dispute.what, verdict, claims, epoch = self.epoch, "a result in doubt"
            );
            return;
        }
        tracing::error!(%job, generation, candidate, what = dispute.what, verdict, claims, epoch = self.epoch, "results differ");
    }

    /// A job changed its state.
    fn stands(&mut self, record: &JobRecord) {
        let JobRecord { id: job, generations_done: generation, state, reason, .. } = record;
        let word = state.as_str_name().trim_start_matches("JOB_STATE_").to_lowercase();
        tracing::info!(%job, state = word, generation, reason, epoch = self.epoch, "job changed its state");
        if ended(*state) {
            self.metrics.job_ended(*state);
            self.begun.remove(job);
        } else {
            self.begun.entry(job.clone()).or_insert_with(Instant::now);
        }
    }
}
