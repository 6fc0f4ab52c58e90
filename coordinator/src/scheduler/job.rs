//! Active jobs: they have not ended and work through the rounds of their procedure.

use super::restart::Carried;
use super::round::Round;
use super::{Now, lease::Range};
use crate::record::{Claimant, Dispute, Event, JobEvent, JobId, JobRecord, JobState};
use crate::store::{LastRound, RunState, SealedRound, StoredRange, TaskRecord, Write};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::procedure::{BadState, Procedure, RoundEnd, Step};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// Shortest time between two published events about a round's progress.
const PUBLISH_EVERY: Duration = Duration::from_millis(100);
/// Number of decided disputes kept from rounds before the one sealed last.
const KEPT_DISPUTES: usize = 8;

/// A submitted job, as far as the scheduler needs it. The scheduler has no data about robots.
pub struct NewJob {
    /// The job's name.
    pub name: String,
    /// Id that the client chose for the request.
    pub request_id: String,
    /// Digest of the request's body.
    pub request_digest: Digest,
    /// Share of the workers, 1 to 100.
    pub priority: u32,
    /// Digest of all inputs that decide the job's result.
    pub job_digest: Digest,
    /// Digest of the engine that the job needs.
    pub engine_digest: Digest,
    /// Text of the resolved job, for workers.
    pub toml: Arc<str>,
    /// The name of its procedure, such as "evolve".
    pub kind: String,
    /// Its procedure: before round 0, or after the rounds it takes over.
    pub procedure: Box<dyn Procedure>,
    /// Rounds taken over from an earlier job, if this job repeats one.
    pub carried: Option<Carried>,
}

/// A job loaded from the store.
pub struct Resumed {
    /// The stored record.
    pub record: JobRecord,
    /// Text of the resolved job, for workers.
    pub toml: Arc<str>,
    /// Its procedure in the saved state.
    pub procedure: Box<dyn Procedure>,
    /// The round sealed last.
    pub last: Option<LastRound>,
    /// Results of the current round.
    pub results: Vec<StoredRange>,
}

/// All jobs of the store.
pub(super) struct Jobs {
    /// Jobs that have not ended.
    pub active: BTreeMap<JobId, ActiveJob>,
    /// Jobs that have ended.
    pub ended: BTreeSet<JobId>,
    next: u64,
}

impl Jobs {
    pub fn new(next: u64, ended: BTreeSet<JobId>) -> Self {
        Self { active: BTreeMap::new(), ended, next }
    }

    /// Returns a new job's number.
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
    /// Index in the record of the dispute about a task, by round and task index.
    pub disputed: BTreeMap<(u32, u32), usize>,
    /// Virtual finish time in the fair queue.
    pub finish_tag: f64,
    /// Measured cost of a task, s.
    pub cost: Option<f64>,
    last_published: Option<Duration>,
}

impl ActiveJob {
    /// Creates a new job, and the writes that store it.
    pub fn submitted(now: Now, number: u64, new: NewJob, virtual_time: f64) -> (Self, Vec<Write>) {
        let plan = new.procedure.round();
        let mut record = JobRecord {
            name: new.name,
            request_id: new.request_id,
            request_digest: new.request_digest,
            engine_digest: new.engine_digest,
            procedure: new.kind,
            rounds_sealed: plan.number,
            rounds_kept: plan.number,
            priority: new.priority,
            progress: new.procedure.progress(),
            ..JobRecord::new(number, new.job_digest, now.unix_ms)
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

    /// Continues a job loaded from the store.
    pub fn resumed(resumed: Resumed, virtual_time: f64) -> Result<Self, BadState> {
        let Resumed { record, toml, procedure, last, results } = resumed;
        let waits = record.state == JobState::Waiting;
        let round = if waits { Round::none(record.rounds_sealed) } else { Round::new(procedure.round()) };
        if round.number() != record.rounds_sealed {
            return Err(BadState(format!(
                "the saved procedure is at round {}, but the job's record at round {}",
                round.number(),
                record.rounds_sealed
            )));
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

    /// Records the stored results of the current round.
    fn take_up(&mut self, ranges: Vec<StoredRange>) -> Result<(), BadState> {
        for StoredRange { round, first, results, finder } in ranges {
            let range = Range { round, first, count: results.len() as u32 };
            let unfit = |why: String| {
                BadState(format!("the stored results of round {round} from task {first} on are invalid{why}"))
            };
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

    /// Replaces stored results of the current round that a dispute corrected: the store has them as they were first
    /// committed.
    fn apply_rulings(&mut self) {
        let at_hand = self.round.number();
        for dispute in self.record.disputes.iter().filter(|d| d.round == at_hand) {
            let held = dispute.holding().and_then(|c| Some((c.result.clone()?, c.source.finder.clone())));
            if let Some((result, finder)) = held {
                self.round.correct(dispute.index, result.into(), finder);
            }
        }
    }

    /// Returns true if a pending task may be assigned.
    pub fn has_pending(&self) -> bool {
        !self.record.paused && self.round.pending() > 0
    }

    /// Returns true if a pending task that is no suspect may be assigned.
    pub fn has_ordinary(&self) -> bool {
        self.has_pending() && self.round.pending_unsuspected() > 0
    }

    /// Returns the tasks of a range of the current round.
    pub fn tasks(&self, range: &Range) -> Vec<Vec<u8>> {
        range.indexes().map(|index| self.procedure.task(index)).collect()
    }

    /// Sets the job running when it gets its first lease. Returns `None` if it already was running.
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

    /// Records an event; returns the write that stores it with the job's record.
    pub fn change(&mut self, now: Now, event: Event) -> Write {
        let event = self.record.next_event(now.unix_ms, event);
        Write::Change { record: self.record.clone(), event }
    }

    /// Seals the current round if its results are there and no dispute is open, and begins the next round. Returns
    /// `None` otherwise. Afterwards the job may have ended.
    pub fn seal(&mut self, now: Now) -> Option<Write> {
        // A disputed result must not be sealed. Sealing over an open dispute about the previous round could taint all
        // later rounds.
        if self.open_disputes().next().is_some() {
            return None;
        }
        let results = self.round.settled(&*self.procedure)?;
        let (number, phase, kept) = (self.round.number(), self.round.phase(), self.round.is_kept());
        let last = self.last_round(results.len() as u32);
        let digests: Vec<Digest> = last.tasks.iter().map(|task| task.digest).collect();
        self.last = Some(last);
        let RoundEnd { row, step } = self.procedure.tell(&results);

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

    /// Sets a waiting job running after a client offered a batch. Returns the write that stores it.
    pub fn resume_waiting(&mut self, now: Now) -> Write {
        self.record.progress = self.procedure.progress();
        self.record.state = JobState::Running;
        let event = self.record.next_event(now.unix_ms, Event::State(JobState::Running));
        Write::Offer { record: self.record.clone(), state: self.state(), event }
    }

    /// Begins the procedure's next round.
    pub fn next_round(&mut self) {
        let next = Round::new(self.procedure.round());
        if next.phase() != self.round.phase() {
            self.cost = None;
        }
        self.round = next;
        self.prune_disputes();
    }

    /// Builds the record of the current round that is kept once it is sealed.
    fn last_round(&self, tasks: u32) -> LastRound {
        let task = |index: u32| {
            let (digest, finder) = self.round.found(index).expect("all tasks that settle a round are done");
            let (task, what) = (self.procedure.task(index), self.procedure.describe(index));
            TaskRecord { task, what, digest, finder: finder.clone() }
        };
        LastRound { number: self.round.number(), tasks: (0..tasks).map(task).collect() }
    }

    /// Returns the procedure's state before the current round, and the round sealed last, for the store.
    pub fn state(&self) -> RunState {
        RunState { procedure: self.procedure.save(), last: self.last.clone() }
    }

    /// Returns an event about the round's progress, at most every [`PUBLISH_EVERY`].
    pub fn publish(&mut self, now: Now) -> Option<JobEvent> {
        if self.last_published.is_some_and(|last| now.since_start < last + PUBLISH_EVERY) {
            return None;
        }
        self.last_published = Some(now.since_start);
        let (round, done, total) = (self.round.number(), self.round.done(), self.round.size());
        let event = Event::Done { round, done, total };
        Some(JobEvent { sequence: self.record.last_event, at_ms: now.unix_ms, event })
    }

    /// Returns the dispute about a task, open or decided.
    pub fn dispute(&self, round: u32, index: u32) -> Option<&Dispute> {
        self.record.disputes.get(*self.disputed.get(&(round, index))?)
    }

    /// Adds a dispute about a task that has none. Returns its index in the record.
    pub fn open_dispute(&mut self, dispute: Dispute) -> usize {
        let at = self.record.disputes.len();
        self.disputed.insert((dispute.round, dispute.index), at);
        self.record.disputes.push(dispute);
        at
    }

    /// Returns true if the task has an open dispute.
    pub fn is_disputed(&self, round: u32, index: u32) -> bool {
        self.dispute(round, index).is_some_and(Dispute::is_open)
    }

    /// Returns the disputes that are not decided.
    pub fn open_disputes(&self) -> impl Iterator<Item = &Dispute> {
        self.record.disputes.iter().filter(|d| d.is_open())
    }

    /// Removes decided disputes of rounds before the one sealed last, except the newest [`KEPT_DISPUTES`].
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

    /// Returns the tasks of which a worker delivered the result that holds, one range per task: those of the current
    /// round and of the round sealed last.
    pub fn found_by(&self, worker: &str) -> Vec<Range> {
        let of = |finder: &Claimant| &*finder.worker == worker;
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

/// Builds the index of disputes by round and task index: all tasks of a round may be disputed at once.
fn places(disputes: &[Dispute]) -> BTreeMap<(u32, u32), usize> {
    disputes.iter().enumerate().map(|(at, d)| ((d.round, d.index), at)).collect()
}

/// Ends a job in this state. Returns the record, and the write that stores it.
pub(super) fn end(mut record: JobRecord, now: Now, state: JobState, reason: String) -> (JobRecord, Write) {
    record.ended_at_ms = now.unix_ms;
    record.paused = false;
    record.reason = reason;
    record.state = state;
    let event = record.next_event(now.unix_ms, Event::State(state));
    (record.clone(), Write::Change { record, event })
}
