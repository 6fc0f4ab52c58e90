//! Jobs that have not ended: round after round of their procedure.

use super::restart::Carried;
use super::round::Round;
use super::{Now, lease::Range};
use crate::record::{Dispute, Event, Finder, JobEvent, JobId, JobRecord, JobState};
use crate::store::{LastRound, RunState, SealedRound, StoredRange, TaskRecord, Write};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::procedure::{BadState, Procedure, Step, Told};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// How far a round is, is published at most this often.
const PUBLISH_EVERY: Duration = Duration::from_millis(100);
/// Decided disputes that are kept of rounds long sealed.
const KEPT_DISPUTES: usize = 8;

/// What the scheduler needs to know of a job to run it. Of robots it knows nothing.
pub struct NewJob {
    /// Its own name.
    pub name: String,
    /// The client's name for the request.
    pub request_id: String,
    /// Digest of the request's body.
    pub request_digest: Digest,
    /// Share of the workers, 1 to 100.
    pub priority: u32,
    /// Digest of everything that makes it the same job as another.
    pub job_digest: Digest,
    /// The engine it needs.
    pub engine_digest: Digest,
    /// The resolved job, for workers.
    pub toml: Arc<str>,
    /// The name of its procedure, such as "evolve".
    pub kind: String,
    /// Its procedure: before round 0, or after the rounds that it takes over.
    pub procedure: Box<dyn Procedure>,
    /// What it takes over, if it does an earlier job again.
    pub carried: Option<Carried>,
}

/// A job from the store.
pub struct Resumed {
    /// As it stood.
    pub record: JobRecord,
    /// The resolved job, for workers.
    pub toml: Arc<str>,
    /// Its procedure as it was saved.
    pub procedure: Box<dyn Procedure>,
    /// The round sealed last.
    pub last: Option<LastRound>,
    /// Results of the round at hand.
    pub results: Vec<StoredRange>,
}

/// All jobs of the store.
pub(super) struct Jobs {
    /// Those that have not ended.
    pub active: BTreeMap<JobId, ActiveJob>,
    /// Those that will never change again.
    pub ended: BTreeSet<JobId>,
    next: u64,
}

impl Jobs {
    pub fn new(next: u64, ended: BTreeSet<JobId>) -> Self {
        Self { active: BTreeMap::new(), ended, next }
    }

    /// The number of the next job.
    pub fn new_number(&mut self) -> u64 {
        self.next += 1;
        self.next - 1
    }
}

pub(super) struct ActiveJob {
    pub record: JobRecord,
    pub toml: Arc<str>,
    pub procedure: Box<dyn Procedure>,
    pub round: Round,
    /// The round sealed last.
    pub last: Option<LastRound>,
    /// Place in the record of the dispute about a task, by round and index.
    pub disputed: BTreeMap<(u32, u32), usize>,
    /// Virtual finish time in the fair queue.
    pub finish_tag: f64,
    /// Measured cost of a task, s.
    pub cost: Option<f64>,
    last_published: Option<Duration>,
}

impl ActiveJob {
    /// A new job and the writes that store it.
    pub fn submitted(now: Now, number: u64, new: NewJob, virtual_time: f64) -> (Self, Vec<Write>) {
        let plan = new.procedure.round();
        let mut record = JobRecord {
            id: JobId::new(number, &new.job_digest),
            number,
            name: new.name,
            request_id: new.request_id,
            request_digest: new.request_digest,
            state: JobState::Queued,
            job_digest: new.job_digest,
            engine_digest: new.engine_digest,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            procedure: new.kind,
            rounds_sealed: plan.number,
            rounds_kept: plan.number,
            priority: new.priority,
            progress: new.procedure.progress(),
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
            results_digest: ResultDigest::start(&new.job_digest).value(),
            result_digest: None,
        };
        let mut last = None;
        let carry = new.carried.map(|Carried { origin, results_digest, last: carried }| {
            let write = Write::Carry { from: origin.job.clone(), to: record.id.clone(), rounds: origin.rounds };
            record.restarted_from = Some(origin);
            record.results_digest = results_digest;
            last = carried;
            write
        });
        let event = record.next_event(now.unix_ms, Event::State(JobState::Queued));
        let round = Round::new(plan);
        let job = Self {
            record,
            toml: new.toml,
            procedure: new.procedure,
            round,
            last,
            disputed: BTreeMap::new(),
            finish_tag: virtual_time,
            cost: None,
            last_published: None,
        };
        let (record, toml, state) = (job.record.clone(), job.toml.clone(), job.state());
        let submit = Write::Submit { record, toml, state, event };
        (job, [submit].into_iter().chain(carry).collect())
    }

    /// A job from the store.
    pub fn resumed(resumed: Resumed, virtual_time: f64) -> Result<Self, BadState> {
        let Resumed { record, toml, procedure, last, results } = resumed;
        let waits = record.state == JobState::Waiting;
        let round = if waits { Round::none(record.rounds_sealed) } else { Round::new(procedure.round()) };
        if round.number() != record.rounds_sealed {
            return Err(BadState(format!("it is at round {} and the job at {}", round.number(), record.rounds_sealed)));
        }
        let disputed = places(&record.disputes);
        let mut job = Self {
            record,
            toml,
            procedure,
            round,
            last,
            disputed,
            finish_tag: virtual_time,
            cost: None,
            last_published: None,
        };
        job.take_up(results)?;
        job.apply_rulings();
        job.round.suspect(&job.record.charges);
        Ok(job)
    }

    /// Records the stored results of the round at hand.
    fn take_up(&mut self, ranges: Vec<StoredRange>) -> Result<(), BadState> {
        for StoredRange { round, first, results, finder } in ranges {
            let range = Range { round, first, count: results.len() as u32 };
            let unfit = |why: String| BadState(format!("results of round {round} from {first} on don't fit{why}"));
            if !self.round.contains(&range) {
                return Err(unfit(String::new()));
            }
            for (index, result) in range.indexes().zip(&results) {
                self.procedure.check(index, result).map_err(|e| unfit(format!(": {e}")))?;
                self.round.record(index, result, &finder);
            }
        }
        Ok(())
    }

    /// Puts right what the store still has as it was first committed.
    fn apply_rulings(&mut self) {
        let at_hand = self.round.number();
        for dispute in self.record.disputes.iter().filter(|d| d.round == at_hand) {
            let held = dispute.holding().and_then(|c| Some((c.result.clone()?, c.source.finder.clone())));
            if let Some((result, finder)) = held {
                self.round.correct(dispute.index, result.into(), finder);
            }
        }
    }

    /// Whether there is something to hand out.
    pub fn has_pending(&self) -> bool {
        !self.record.paused && self.round.pending() > 0
    }

    /// Whether there is something to hand out that is no suspect.
    pub fn has_ordinary(&self) -> bool {
        self.has_pending() && self.round.pending_unsuspected() > 0
    }

    /// The tasks of a range of the round at hand.
    pub fn tasks(&self, range: &Range) -> Vec<Vec<u8>> {
        range.indexes().map(|index| self.procedure.task(index)).collect()
    }

    /// The first work is handed out. `None` if that was before.
    pub fn start(&mut self, now: Now) -> Option<Write> {
        (self.record.state == JobState::Queued).then(|| {
            self.record.started_at_ms = now.unix_ms;
            self.change_state(now, JobState::Running)
        })
    }

    fn change_state(&mut self, now: Now, state: JobState) -> Write {
        self.record.state = state;
        self.change(now, Event::State(state))
    }

    /// An event, with the job as it stands now.
    pub fn change(&mut self, now: Now, event: Event) -> Write {
        let event = self.record.next_event(now.unix_ms, event);
        Write::Change { record: self.record.clone(), event }
    }

    /// Seals the round at hand if its results are there and nothing is disputed, and goes on to the next. `None` otherwise.
    /// The job may have ended afterwards.
    pub fn seal(&mut self, now: Now) -> Option<Write> {
        // A disputed result must not be folded, and one that was folded last would taint all that follows.
        if self.open_disputes().next().is_some() {
            return None;
        }
        let results = self.round.settled(&*self.procedure)?;
        let (number, phase, kept) = (self.round.number(), self.round.phase(), self.round.is_kept());
        let last = self.last_round(results.len() as u32);
        let digests: Vec<Digest> = last.tasks.iter().map(|task| task.digest).collect();
        self.last = Some(last);
        let Told { row, step } = self.procedure.tell(&results);

        let record = &mut self.record;
        record.fold(number, &digests);
        record.rounds_sealed = number + 1;
        record.rounds_kept += u32::from(kept && record.rounds_kept == number);
        record.charges.clear();
        record.progress = self.procedure.progress();
        let sealed = SealedRound { number, row: row.clone(), digests, results: kept.then_some(results) };
        let told = Event::Sealed { round: number, phase: phase.to_owned(), row };
        let mut events = vec![record.next_event(now.unix_ms, told)];
        match step {
            Step::Next => {
                self.next_round();
                let (record, state) = (self.record.clone(), self.state());
                Some(Write::Seal { record, sealed, state, events })
            }
            Step::Waiting => {
                self.round = Round::none(number + 1);
                self.prune_disputes();
                record_state(&mut self.record, now, JobState::Waiting, &mut events);
                let (record, state) = (self.record.clone(), self.state());
                Some(Write::Seal { record, sealed, state, events })
            }
            Step::Done(artefacts) => {
                self.record.result_digest = Some(ResultDigest::resume(self.record.results_digest).seal());
                self.end(now, JobState::Succeeded, &mut events);
                Some(Write::Finish { record: self.record.clone(), sealed, artefacts, events })
            }
            Step::Failed(reason) => {
                self.record.reason = reason;
                self.end(now, JobState::Failed, &mut events);
                Some(Write::Finish { record: self.record.clone(), sealed, artefacts: Vec::new(), events })
            }
        }
    }

    fn end(&mut self, now: Now, state: JobState, events: &mut Vec<JobEvent>) {
        self.record.ended_at_ms = now.unix_ms;
        self.record.paused = false;
        record_state(&mut self.record, now, state, events);
    }

    /// A client's batch came: the write that stores what follows.
    pub fn resume_waiting(&mut self, now: Now) -> Write {
        self.record.progress = self.procedure.progress();
        self.record.state = JobState::Running;
        let event = self.record.next_event(now.unix_ms, Event::State(JobState::Running));
        Write::Offer { record: self.record.clone(), state: self.state(), event }
    }

    /// Goes on to the procedure's next round.
    pub fn next_round(&mut self) {
        let next = Round::new(self.procedure.round());
        if next.phase() != self.round.phase() {
            self.cost = None;
        }
        self.round = next;
        self.prune_disputes();
    }

    /// What is kept of the round at hand once it is sealed.
    fn last_round(&self, tasks: u32) -> LastRound {
        let task = |index: u32| {
            let (digest, finder) = self.round.found(index).expect("every task that settles a round is done");
            let (task, what) = (self.procedure.task(index), self.procedure.describe(index));
            TaskRecord { task, what, digest, finder: finder.clone() }
        };
        LastRound { number: self.round.number(), tasks: (0..tasks).map(task).collect() }
    }

    /// The state before the round at hand, for the store.
    pub fn state(&self) -> RunState {
        RunState { procedure: self.procedure.save(), last: self.last.clone() }
    }

    /// How far the round is, at most every [`PUBLISH_EVERY`].
    pub fn publish(&mut self, now: Now) -> Option<JobEvent> {
        if self.last_published.is_some_and(|last| now.since_start < last + PUBLISH_EVERY) {
            return None;
        }
        self.last_published = Some(now.since_start);
        let (round, done, total) = (self.round.number(), self.round.done(), self.round.size());
        let event = Event::Done { round, done, total };
        Some(JobEvent { sequence: self.record.last_event, at_ms: now.unix_ms, event })
    }

    /// The dispute about a task, if there is or was one.
    pub fn dispute(&self, round: u32, index: u32) -> Option<&Dispute> {
        self.record.disputes.get(*self.disputed.get(&(round, index))?)
    }

    /// Adds a dispute about a task that has none. Returns its place.
    pub fn open_dispute(&mut self, dispute: Dispute) -> usize {
        let at = self.record.disputes.len();
        self.disputed.insert((dispute.round, dispute.index), at);
        self.record.disputes.push(dispute);
        at
    }

    /// Whether the dispute about a task is open.
    pub fn is_disputed(&self, round: u32, index: u32) -> bool {
        self.dispute(round, index).is_some_and(Dispute::is_open)
    }

    /// Disputes that are not decided.
    pub fn open_disputes(&self) -> impl Iterator<Item = &Dispute> {
        self.record.disputes.iter().filter(|d| d.is_open())
    }

    /// Removes decided disputes that nothing depends on any more, but for the newest few.
    fn prune_disputes(&mut self) {
        let round = self.round.number();
        // The round sealed last can be disputed again.
        let needed = |d: &Dispute| d.is_open() || d.round + 1 >= round;
        let mut spare = self.record.disputes.iter().filter(|d| !needed(d)).count().saturating_sub(KEPT_DISPUTES);
        self.record.disputes.retain(|d| {
            let keep = needed(d) || spare == 0;
            spare -= usize::from(!keep);
            keep
        });
        self.record.disputes.iter_mut().filter(|d| d.round < round).for_each(Dispute::seal);
        self.disputed = places(&self.record.disputes);
    }

    /// The tasks, one by one, whose results a worker delivered, as far as they are still known.
    pub fn found_by(&self, worker: &str) -> Vec<Range> {
        let of = |finder: &Finder| &*finder.worker == worker;
        let one = |round: u32, first: u32| Range { round, first, count: 1 };
        let sealed = self.last.iter().flat_map(|last| {
            let found = (0..).zip(last.tasks.iter()).filter(|(_, task)| of(&task.finder));
            found.map(|(index, _)| one(last.number, index))
        });
        let at_hand = (0..self.round.size()).filter(|i| self.round.found(*i).is_some_and(|(_, finder)| of(finder)));
        sealed.chain(at_hand.map(|index| one(self.round.number(), index))).collect()
    }
}

fn record_state(record: &mut JobRecord, now: Now, state: JobState, events: &mut Vec<JobEvent>) {
    record.state = state;
    events.push(record.next_event(now.unix_ms, Event::State(state)));
}

/// Place of the dispute about a task, by round and index: a whole round can be disputed at once.
fn places(disputes: &[Dispute]) -> BTreeMap<(u32, u32), usize> {
    disputes.iter().enumerate().map(|(at, d)| ((d.round, d.index), at)).collect()
}

/// Ends a job without success: how it stands then, and the write that stores it.
pub(super) fn end(mut record: JobRecord, now: Now, state: JobState, reason: String) -> (JobRecord, Write) {
    record.ended_at_ms = now.unix_ms;
    record.paused = false;
    record.reason = reason;
    record.state = state;
    let event = record.next_event(now.unix_ms, Event::State(state));
    (record.clone(), Write::Change { record, event })
}
