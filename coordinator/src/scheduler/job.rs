//! A job while it runs: generation after generation, and then the finish.

use super::dispute::places;
use super::restart::Carried;
use super::round::{Outcome, Range, Round};
use super::sealed::Sealed;
use super::search::{Search, decode_search, encode_search};
use super::statistics::statistics;
use super::{Now, PROGRESS_EVERY};
use crate::record::{JobId, JobRecord, JobState};
use crate::store::{SealedGeneration, StoredRange, Write};
use proto::v1::{self, job_event::Event};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::base::score::Counts;
use sim_core::genotype::Genome;
use sim_core::procedure::evolve::finish::{Done, Found, Plan, Question, total};
use sim_core::procedure::evolve::report::report;
use sim_core::report::Traces;
use sim_core::search::archive::Archive;
use sim_core::search::{BadState, Optimiser, Scored};
use std::collections::BTreeMap;
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
    /// Candidates that take as long together as one alone, at least 1.
    pub at_once: u32,
    /// At generation 0.
    pub optimiser: Box<dyn Optimiser>,
    /// How many generations to score, at least 1.
    pub generations: u32,
    /// What is done once they are.
    pub finish: Plan,
    /// What it takes over, if it does an earlier job again.
    pub carried: Option<Carried>,
}

/// A job from the store.
pub struct Resumed {
    /// As it stood.
    pub record: JobRecord,
    /// The resolved job, for workers.
    pub toml: Arc<str>,
    /// Candidates that take as long together as one alone, at least 1.
    pub at_once: u32,
    /// Fresh: its state is taken from `state`.
    pub optimiser: Box<dyn Optimiser>,
    /// What is done once the search is over.
    pub finish: Plan,
    /// The stored state of the search: optimiser and archive.
    pub search: Vec<u8>,
    /// Results of rounds that are not sealed for good.
    pub results: Vec<StoredRange>,
    /// Scores of the generation sealed last.
    pub last_scores: Option<Vec<Option<f64>>>,
}

pub(super) struct ActiveJob {
    pub record: JobRecord,
    pub toml: Arc<str>,
    /// Candidates that take as long together as one alone.
    pub at_once: u32,
    optimiser: Box<dyn Optimiser>,
    plan: Plan,
    archive: Archive,
    /// What is worked on.
    pub round: Round,
    /// The round of examinations before it, if there was one.
    pub examined: Option<Round>,
    /// The generation sealed last.
    pub last: Option<Sealed>,
    /// Where in the record the dispute about a task is, by round and index.
    pub disputed: BTreeMap<(u32, u32), usize>,
    /// Virtual finish time in the fair queue.
    pub finish_tag: f64,
    /// Measured cost of a task, s.
    pub cost: Option<f64>,
    last_progress: Option<Duration>,
}

/// How a job ends.
pub(super) enum End {
    /// The report is there.
    Succeeded,
    /// For this reason.
    Failed(String),
}

impl ActiveJob {
    /// A new job and the write that stores it.
    pub fn submitted(now: Now, number: u64, new: NewJob, virtual_time: f64) -> (Self, Vec<Write>) {
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
            version: env!("CARGO_PKG_VERSION").to_owned(),
            search_revision: sim_core::search::REVISION,
            population: genomes.len() as u32,
            generations_done: 0,
            generations_total: new.generations,
            priority: new.priority,
            best: None,
            first: None,
            winner: None,
            counts: Counts::default(),
            evaluations: 0,
            failed_evaluations: 0,
            reason: String::new(),
            paused: false,
            restarted_from: None,
            disputes: Vec::new(),
            charges: Vec::new(),
            poisoned: None,
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
            at_once: new.at_once,
            optimiser: new.optimiser,
            plan: new.finish,
            archive: new.finish.new_archive(),
            round: Round::generation(0, genomes),
            examined: None,
            last: None,
            disputed: BTreeMap::new(),
            finish_tag: virtual_time,
            cost: None,
            last_progress: None,
        };
        let carry = new.carried.map(|carried| job.take_over(carried));
        let state = job.record.state;
        let event = event(&mut job.record, now, Event::StateChanged(state.into()));
        let submit = Write::Submit { record: job.record.clone(), toml: job.toml.clone(), search: job.search(), event };
        (job, [submit].into_iter().chain(carry).collect())
    }

    /// A job from the store.
    pub fn resumed(resumed: Resumed, virtual_time: f64) -> Result<Self, BadState> {
        let Resumed { record, toml, at_once, mut optimiser, finish: plan, search, mut results, last_scores } = resumed;
        let Search { optimiser: state, archive, genomes_before, finders_before } = decode_search(&plan, &search)?;
        optimiser.restore(&state)?;
        if optimiser.generation() != record.generations_done {
            return Err(BadState(format!(
                "it is at generation {} and the job at {}",
                optimiser.generation(),
                record.generations_done
            )));
        }
        let genomes = optimiser.ask();
        if genomes.len() != record.population as usize {
            return Err(BadState(format!("{} candidates instead of {}", genomes.len(), record.population)));
        }
        let round = Round::generation(record.generations_done, genomes);
        let number = record.generations_done.saturating_sub(1);
        let last =
            last_scores.map(|scores| Sealed { number, scores, genomes: genomes_before, finders: finders_before });
        let disputed = places(&record.disputes);
        let mut job = Self {
            record,
            toml,
            at_once,
            optimiser,
            plan,
            archive,
            round,
            examined: None,
            last,
            disputed,
            finish_tag: virtual_time,
            cost: None,
            last_progress: None,
        };
        if job.record.generations_done >= job.record.generations_total {
            job.resume_finish(&mut results)?;
        }
        take_up(&mut job.round, &mut results)?;
        job.apply_rulings();
        job.round.suspect(&job.record.charges);
        match results.first() {
            None => Ok(job),
            Some(StoredRange { round, first, .. }) => {
                Err(BadState(format!("results of round {round} from {first} on don't fit")))
            }
        }
    }

    /// Takes up the round of examinations that the record says.
    fn resume_finish(&mut self, results: &mut Vec<StoredRange>) -> Result<(), BadState> {
        let found = self.found().ok_or_else(|| BadState("the search is over without a best".to_owned()))?;
        let finishing = self.finishing(&found);
        match (self.record.state, finishing, self.record.winner.clone()) {
            (JobState::Finishing, Some(round), None) => self.round = round,
            (JobState::Reporting, finishing, Some(winner)) => {
                self.examined = finishing;
                if let Some(round) = &mut self.examined {
                    take_up(round, results)?;
                }
                let done = self.examined.as_ref().map_or(Some(Vec::new()), Round::answers);
                let done = done.ok_or_else(|| BadState("there is a winner before all is examined".to_owned()))?;
                self.round = self.reporting(&found, &winner, &done);
            }
            (state, ..) => return Err(BadState(format!("the search is over and the job {}", state.as_str_name()))),
        }
        Ok(())
    }

    /// Whether there is something to hand out.
    pub fn has_pending(&self) -> bool {
        !self.record.paused && self.round.pending() > 0
    }

    /// Whether there is something to hand out that is no suspect.
    pub fn has_ordinary(&self) -> bool {
        self.has_pending() && self.round.pending_unsuspected() > 0
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

    /// Seals the round at hand if all its tasks are done, and goes on to the next. `None` while some are missing.
    ///
    /// The second part of the answer says how the job ends, if so; one that fails is yet to be told so.
    pub fn seal(&mut self, now: Now) -> Option<(Option<Write>, Option<End>)> {
        if self.is_round_disputed(self.round.number) {
            return None;
        }
        let Some(answers) = self.round.answers() else {
            return if self.round.is_generation() { self.seal_generation(now) } else { None };
        };
        let Some(found) = self.found() else {
            return Some((None, Some(End::Failed("the search is over without a best".to_owned()))));
        };
        Some(match self.record.winner.clone() {
            None => (Some(self.choose_winner(now, &found, &answers)), None),
            // What is in doubt further back would taint it.
            Some(_) if self.open_disputes().next().is_some() => return None,
            Some(winner) => match self.make_report(now, found, winner, &answers) {
                Ok(write) => (Some(write), Some(End::Succeeded)),
                Err(reason) => (None, Some(End::Failed(reason))),
            },
        })
    }

    /// Folds a generation's scores, and goes on to the next round.
    fn seal_generation(&mut self, now: Now) -> Option<(Option<Write>, Option<End>)> {
        let outcomes = self.round.outcomes()?;
        let scores: Vec<Option<f64>> = outcomes.iter().map(|o| o.score()).collect();
        let counts = total(outcomes.iter().map(|o| &o.counts));
        let number = self.round.number;
        self.fold_generation(Sealed::of(&self.round, scores.clone()), counts);

        let best_so_far = self.record.best.as_ref().map(|b| b.score);
        let statistics = statistics(number, &scores, counts, best_so_far);
        let mut events = vec![event(&mut self.record, now, Event::GenerationSealed(statistics))];
        let mut end = None;
        let before = self.record.state;
        if self.next_round() {
            let state = self.record.state;
            if state != before {
                events.push(event(&mut self.record, now, Event::StateChanged(state.into())));
            }
        } else {
            end = Some(End::Failed(format!(
                "all {} evaluations failed (the robot was unstable at its start): there is no winner; check the \
                 robot, the start and the [physics] table",
                self.record.evaluations
            )));
        }
        let sealed = SealedGeneration { scores, statistics };
        self.prune_disputes();
        let write = Write::Seal { record: self.record.clone(), sealed, search: self.search(), events };
        Some((Some(write), end))
    }

    /// Folds a generation's scores by index into digest, archive and optimiser.
    pub(super) fn fold_generation(&mut self, sealed: Sealed, counts: Counts) {
        let (number, scores) = (sealed.number, &sealed.scores);
        let failed = scores.iter().filter(|s| s.is_none()).count() as u32;
        let direction = self.optimiser.direction();
        let genomes = sealed.genomes.clone().unwrap_or_else(|| self.optimiser.ask().into());

        let record = &mut self.record;
        record.scores_digest.generation(number, scores);
        record.evaluations += scores.len() as u64;
        record.failed_evaluations += u64::from(failed);
        record.counts += counts;
        let scored = |(i, score): (usize, f64)| Scored {
            generation: number,
            candidate: i as u32,
            score,
            genome: genomes[i].clone(),
        };
        let succeeded = scores.iter().enumerate().filter_map(|(i, s)| s.map(|s| (i, s)));
        self.archive.generation(succeeded.map(scored));
        if let Some((i, score)) = direction.best(scores) {
            let best = scored((i, score));
            if record.first.is_none() {
                record.first = Some(best.clone());
            }
            if direction.better(Some(score), record.best.as_ref().map(|b| b.score)) {
                record.best = Some(best);
            }
        }
        record.generations_done = number + 1;
        record.charges.clear();
        self.optimiser.tell(scores);
        self.last = Some(sealed);
    }

    /// Goes on to the next generation, or to what follows the search. `false` if that can't be: there is no best.
    pub(super) fn next_round(&mut self) -> bool {
        if self.record.generations_done < self.record.generations_total {
            self.round = Round::generation(self.record.generations_done, self.optimiser.ask());
            return true;
        }
        let Some(found) = self.found() else { return false };
        self.cost = None;
        self.record.state = match self.finishing(&found) {
            Some(round) => {
                self.round = round;
                JobState::Finishing
            }
            None => self.report_on(&found, &[]),
        };
        true
    }

    /// The archive is examined: the winner follows, and the questions about it.
    fn choose_winner(&mut self, now: Now, found: &Found, answers: &[Done]) -> Write {
        self.fold(answers);
        self.record.charges.clear();
        let before = self.round.clone();
        let state = self.report_on(found, answers);
        self.examined = Some(before);
        self.record.state = state;
        let event = event(&mut self.record, now, Event::StateChanged(state.into()));
        Write::Change { record: self.record.clone(), event }
    }

    /// All questions are answered.
    fn make_report(&mut self, now: Now, found: Found, winner: Scored, answers: &[Done]) -> Result<Write, String> {
        self.fold(answers);
        let rounds = || self.examined.iter().chain([&self.round]);
        let outcomes: Vec<&Outcome> = rounds().filter_map(Round::outcomes).flatten().collect();
        let counts = total(outcomes.iter().map(|o| &o.counts));
        let done: Vec<Done> = rounds().filter_map(Round::answers).flatten().collect();
        let traces = done.iter().position(|(e, _)| e.is(Question::Traces, &winner)).map(|at| &outcomes[at].traces);
        let unusable = |e: serde_json::Error| format!("the report can't be put together: {e}");
        let traces: Traces = serde_json::from_slice(traces.map_or(&[], Vec::as_slice)).map_err(unusable)?;
        let report = report(&self.plan, found, winner.clone(), &done, traces, counts);
        let report = serde_json::to_vec(&report).map_err(unusable)?;

        self.record.result_digest = Some(self.record.scores_digest.seal(&winner.genome, winner.score));
        self.record.ended_at_ms = now.unix_ms;
        self.record.paused = false;
        self.record.state = JobState::Succeeded;
        let event = event(&mut self.record, now, Event::StateChanged(JobState::Succeeded.into()));
        Ok(Write::Report { record: self.record.clone(), report, event })
    }

    /// Sets the winner and the round of questions about it.
    fn report_on(&mut self, found: &Found, answers: &[Done]) -> JobState {
        let winner = self.plan.winner(found, answers);
        self.round = self.reporting(found, &winner, answers);
        self.record.winner = Some(winner);
        JobState::Reporting
    }

    fn fold(&mut self, answers: &[Done]) {
        let scores: Vec<Vec<Option<f64>>> = answers.iter().map(|(_, scores)| scores.clone()).collect();
        self.record.scores_digest.examinations(self.round.number, &scores);
    }

    /// The candidates of the generation at hand.
    pub(super) fn genomes(&self) -> Vec<Genome> {
        self.optimiser.ask()
    }

    /// What the search found, if any of its evaluations succeeded.
    fn found(&self) -> Option<Found> {
        Some(Found {
            first: self.record.first.clone()?,
            best: self.record.best.clone()?,
            archive: self.archive.entries().to_vec(),
            bests: self.archive.bests().to_vec(),
        })
    }

    /// The first round after the search, numbered on from the generations; `None` if it would be empty.
    fn finishing(&self, found: &Found) -> Option<Round> {
        let examinations = self.plan.finishing(found);
        (!examinations.is_empty()).then(|| Round::examinations(self.record.generations_total, examinations))
    }

    /// The last round.
    fn reporting(&self, found: &Found, winner: &Scored, done: &[Done]) -> Round {
        Round::examinations(self.record.generations_total + 1, self.plan.reporting(found, winner, done))
    }

    /// The state of the search, for the store.
    fn search(&self) -> Vec<u8> {
        encode_search(self.optimiser.save(), &self.archive, self.last.as_ref())
    }

    /// How far the round is, at most every [`PROGRESS_EVERY`].
    pub fn progress(&mut self, now: Now) -> Option<v1::JobEvent> {
        if self.last_progress.is_some_and(|last| now.since_start < last + PROGRESS_EVERY) {
            return None;
        }
        self.last_progress = Some(now.since_start);
        let generation = self.record.generations_done;
        let progress = v1::Progress { generation, done: self.round.done(), total: self.round.size() };
        Some(v1::JobEvent {
            sequence: self.record.last_event,
            at_ms: now.unix_ms,
            event: Some(Event::Progress(progress)),
            job: Some(self.record.to_wire()),
        })
    }
}

/// Records the stored results of a round and takes them out of the list.
fn take_up(round: &mut Round, results: &mut Vec<StoredRange>) -> Result<(), BadState> {
    let number = round.number;
    for StoredRange { first, outcomes, finder, .. } in results.extract_if(.., |range| range.round == number) {
        let range = Range { round: number, first, count: outcomes.len() as u32 };
        if !round.contains(&range) {
            return Err(BadState(format!("results of tasks {:?} of round {number} don't fit", range.indexes())));
        }
        for (index, outcome) in range.indexes().zip(&outcomes) {
            round.record(index, outcome, &finder);
        }
    }
    Ok(())
}

/// A job ends without success: how it stands then, and the write that says so.
pub(super) fn end(mut record: JobRecord, now: Now, state: JobState, reason: String) -> (JobRecord, Write) {
    record.ended_at_ms = now.unix_ms;
    record.paused = false;
    record.reason = reason;
    record.state = state;
    let event = event(&mut record, now, Event::StateChanged(state.into()));
    (record.clone(), Write::Change { record, event })
}

/// The next event, with the job as it stands now.
pub(super) fn event(record: &mut JobRecord, now: Now, event: Event) -> v1::JobEvent {
    record.last_event += 1;
    v1::JobEvent { sequence: record.last_event, at_ms: now.unix_ms, event: Some(event), job: Some(record.to_wire()) }
}
