//! A job while it runs: the optimiser, the generation at hand, the report.

use super::generation::{Generation, Outcome, Range};
use super::lease::AssignmentId;
use super::statistics::statistics;
use super::{Now, PROGRESS_EVERY};
use crate::record::{JobId, JobRecord, JobState};
use crate::store::{SealedGeneration, Write};
use proto::v1::{self, job_event::Event};
use sim_core::identity::{Digest, ResultDigest};
use sim_core::optimise::{BadState, Optimiser};
use sim_core::score::{Counts, Scored};
use std::sync::Arc;
use std::time::Duration;

/// What the scheduler needs to know of a job to run it. Of robots it knows nothing.
pub struct NewJob {
    /// Its own name.
    pub name: String,
    /// What the client named the request.
    pub request_id: String,
    /// Digest of the request's body.
    pub request_digest: Digest,
    /// 1 to 100.
    pub priority: u32,
    /// What makes it the same job as another.
    pub job_digest: Digest,
    /// The engine it needs.
    pub engine_digest: Digest,
    /// The resolved job, for workers.
    pub toml: Arc<str>,
    /// At generation 0.
    pub optimiser: Box<dyn Optimiser>,
    /// How many generations to score, at least 1.
    pub generations: u32,
}

/// A job from the store.
pub struct Resumed {
    /// As it stood.
    pub record: JobRecord,
    /// The resolved job, for workers.
    pub toml: Arc<str>,
    /// Fresh: its state is taken from `state`.
    pub optimiser: Box<dyn Optimiser>,
    /// The optimiser's stored state.
    pub state: Vec<u8>,
    /// Results of the current generation: (index of the first, outcomes).
    pub results: Vec<(u32, Vec<Outcome>)>,
    /// Scores of the generation sealed last.
    pub last_scores: Option<Vec<Option<f64>>>,
}

/// Where a report stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Report {
    NotYet,
    Pending,
    Leased(AssignmentId),
}

pub(super) struct ActiveJob {
    pub record: JobRecord,
    pub toml: Arc<str>,
    optimiser: Box<dyn Optimiser>,
    /// `None` once the search is over.
    pub generation: Option<Generation>,
    /// Scores of the generation sealed last, to tell a repeated result from a wrong one.
    pub last_scores: Option<Vec<Option<f64>>>,
    pub report: Report,
    pub report_attempts: u32,
    /// Virtual finish time in the fair queue.
    pub finish_tag: f64,
    /// Measured cost of an evaluation, s.
    pub cost: Option<f64>,
    last_progress: Option<Duration>,
}

impl ActiveJob {
    /// A new job and the write that stores it.
    pub fn submitted(now: Now, number: u64, new: NewJob, virtual_time: f64) -> (Self, Write) {
        let genomes = new.optimiser.ask();
        let record = JobRecord {
            id: JobId::new(number, &new.job_digest),
            number,
            name: new.name,
            request_id: new.request_id,
            request_digest: new.request_digest,
            state: JobState::Queued,
            job_digest: new.job_digest,
            engine_digest: new.engine_digest,
            population: genomes.len() as u32,
            generations_done: 0,
            generations_total: new.generations,
            priority: new.priority,
            best: None,
            first: None,
            counts: Counts::default(),
            evaluations: 0,
            failed_evaluations: 0,
            reason: String::new(),
            submitted_at_ms: now.unix_ms,
            started_at_ms: 0,
            ended_at_ms: 0,
            last_event: 0,
            scores_digest: ResultDigest::start(&new.job_digest),
            result_digest: None,
        };
        let mut job = Self {
            record,
            toml: new.toml,
            optimiser: new.optimiser,
            generation: Some(Generation::new(0, genomes)),
            last_scores: None,
            report: Report::NotYet,
            report_attempts: 0,
            finish_tag: virtual_time,
            cost: None,
            last_progress: None,
        };
        let event = event(&mut job.record, now, Event::StateChanged(JobState::Queued.into()));
        let write = Write::Submit {
            record: job.record.clone(),
            toml: job.toml.clone(),
            optimiser: job.optimiser.save(),
            event,
        };
        (job, write)
    }

    /// A job from the store.
    pub fn resumed(resumed: Resumed, virtual_time: f64) -> Result<Self, BadState> {
        let Resumed { record, toml, mut optimiser, state, results, last_scores } = resumed;
        optimiser.restore(&state)?;
        if optimiser.generation() != record.generations_done {
            return Err(BadState(format!(
                "it is at generation {} and the job at {}",
                optimiser.generation(),
                record.generations_done
            )));
        }
        let generation = if record.generations_done < record.generations_total {
            let genomes = optimiser.ask();
            if genomes.len() != record.population as usize {
                return Err(BadState(format!("{} candidates instead of {}", genomes.len(), record.population)));
            }
            let mut generation = Generation::new(record.generations_done, genomes);
            for (first, outcomes) in results {
                let range = Range { generation: generation.number, first, count: outcomes.len() as u32 };
                if !generation.contains(&range) {
                    return Err(BadState(format!("results of candidates {:?} don't fit", range.candidates())));
                }
                for (candidate, outcome) in range.candidates().zip(outcomes) {
                    generation.record(candidate, outcome);
                }
            }
            Some(generation)
        } else {
            None
        };
        let report = if generation.is_none() { Report::Pending } else { Report::NotYet };
        Ok(Self {
            record,
            toml,
            optimiser,
            generation,
            last_scores,
            report,
            report_attempts: 0,
            finish_tag: virtual_time,
            cost: None,
            last_progress: None,
        })
    }

    /// Whether there is something to hand out.
    pub fn has_pending(&self) -> bool {
        self.report == Report::Pending || self.generation.as_ref().is_some_and(|g| g.pending() > 0)
    }

    /// The first work is handed out. `None` if that was before.
    pub fn start(&mut self, now: Now) -> Option<Write> {
        (self.record.state == JobState::Queued).then(|| {
            self.record.started_at_ms = now.unix_ms;
            self.record.state = JobState::Running;
            let event = event(&mut self.record, now, Event::StateChanged(JobState::Running.into()));
            Write::Change { record: self.record.clone(), event }
        })
    }

    /// Seals the generation if all its candidates are done: folds the scores by index into digest and optimiser, and
    /// goes on to the next generation, or to the report. `None` while candidates are missing.
    ///
    /// The second part of the answer is the reason why the job can't go on, if so.
    pub fn seal(&mut self, now: Now) -> Option<(Write, Option<String>)> {
        let generation = self.generation.as_ref()?;
        let outcomes = generation.outcomes()?;
        let number = generation.number;
        let genomes = generation.genomes.clone();
        let scores: Vec<Option<f64>> = outcomes.iter().map(|o| o.score).collect();
        let failed = scores.iter().filter(|s| s.is_none()).count() as u32;
        let direction = self.optimiser.direction();

        let record = &mut self.record;
        record.scores_digest.generation(number, &scores);
        record.evaluations += scores.len() as u64;
        record.failed_evaluations += u64::from(failed);
        outcomes.iter().for_each(|o| record.counts += o.counts);
        if let Some((i, score)) = direction.best(&scores) {
            let best = Scored { generation: number, candidate: i as u32, score, genome: genomes[i].clone() };
            if record.first.is_none() {
                record.first = Some(best.clone());
            }
            if direction.better(Some(score), record.best.as_ref().map(|b| b.score)) {
                record.best = Some(best);
            }
        }
        record.generations_done = number + 1;
        self.optimiser.tell(&scores);

        let best_so_far = self.record.best.as_ref().map(|b| b.score);
        let statistics = statistics(number, &scores, best_so_far);
        let mut events = vec![event(&mut self.record, now, Event::GenerationSealed(statistics))];
        let mut dead_end = None;
        if self.record.generations_done < self.record.generations_total {
            self.generation = Some(Generation::new(number + 1, self.optimiser.ask()));
        } else {
            self.generation = None;
            match &self.record.best {
                Some(winner) => {
                    self.record.result_digest = Some(self.record.scores_digest.seal(&winner.genome, winner.score));
                    self.report = Report::Pending;
                    self.record.state = JobState::Reporting;
                    events.push(event(&mut self.record, now, Event::StateChanged(JobState::Reporting.into())));
                }
                None => {
                    dead_end = Some(format!(
                        "all {} evaluations failed (the robot was unstable at its start): there is no winner; check the \
                         robot, the start and the [physics] table",
                        self.record.evaluations
                    ));
                }
            }
        }
        let sealed = SealedGeneration { scores: scores.clone(), statistics };
        self.last_scores = Some(scores);
        let write = Write::Seal { record: self.record.clone(), sealed, optimiser: self.optimiser.save(), events };
        Some((write, dead_end))
    }

    /// The report is there: the job succeeded.
    pub fn finish(&mut self, now: Now, report: Vec<u8>) -> Write {
        self.record.ended_at_ms = now.unix_ms;
        self.record.state = JobState::Succeeded;
        let event = event(&mut self.record, now, Event::StateChanged(JobState::Succeeded.into()));
        Write::Report { record: self.record.clone(), report, event }
    }

    /// How far the generation is, at most every [`PROGRESS_EVERY`].
    pub fn progress(&mut self, now: Now) -> Option<v1::JobEvent> {
        let generation = self.generation.as_ref()?;
        if self.last_progress.is_some_and(|last| now.since_start < last + PROGRESS_EVERY) {
            return None;
        }
        self.last_progress = Some(now.since_start);
        let progress =
            v1::Progress { generation: generation.number, done: generation.done(), total: generation.population() };
        Some(v1::JobEvent {
            sequence: self.record.last_event,
            at_ms: now.unix_ms,
            event: Some(Event::Progress(progress)),
            job: Some(self.record.to_wire()),
        })
    }
}

/// A job ends without success: how it stands then, and the write that says so.
pub(super) fn end(mut record: JobRecord, now: Now, state: JobState, reason: String) -> (JobRecord, Write) {
    record.ended_at_ms = now.unix_ms;
    record.reason = reason;
    record.state = state;
    let event = event(&mut record, now, Event::StateChanged(state.into()));
    (record.clone(), Write::Change { record, event })
}

/// The next event, with the job as it stands now.
fn event(record: &mut JobRecord, now: Now, event: Event) -> v1::JobEvent {
    record.last_event += 1;
    v1::JobEvent { sequence: record.last_event, at_ms: now.unix_ms, event: Some(event), job: Some(record.to_wire()) }
}
