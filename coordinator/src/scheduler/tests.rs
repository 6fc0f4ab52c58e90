//! Scheduler tests: single rules, and random events with all invariants checked after each event.
//!
//! The jobs' procedure is [`Fake`]. Its results are a pure function of its tasks, so these tests need no physics.

mod batches;
mod builds;
mod costs;
mod crashes;
mod disputes;
mod fake;
mod history;
mod lifecycle;
mod long_tasks;
mod model;
mod permits;
mod quarantine;
mod restarts;
mod sealed;
mod time;

pub use fake::{Fake, result_of};

use super::*;
use crate::permit::Issued;
use crate::record::{JobState, Origin, Ruling};
use crate::store::{MemoryStore, Store, StoredJob};
use sim_core::procedure::{Procedure, Step};
use std::collections::BTreeMap;

pub const ENGINE: Digest = Digest([3; 32]);
pub const LEASE: Duration = Duration::from_secs(10);

/// A job that runs this procedure.
pub fn job_of(name: &str, procedure: Fake) -> NewJob {
    NewJob {
        name: name.to_owned(),
        request_id: format!("request of {name}"),
        request_digest: Digest::of("test", &name),
        priority: 10,
        job_digest: Digest::of("test job", &name),
        engine_digest: ENGINE,
        toml: format!("name = \"{name}\"").into(),
        kind: "fake".to_owned(),
        procedure: Box::new(procedure),
        carried: None,
    }
}

/// A job with this number of tasks in each of its kept rounds. Two rounds of long tasks follow, or one if the job's
/// name begins with "bare".
pub fn new_job(name: &str, tasks: u32, rounds: u32) -> NewJob {
    job_of(name, Fake::of(name, tasks, rounds))
}

/// Result digest of a whole job, computed without the scheduler.
pub fn expected_digest(name: &str, tasks: u32, rounds: u32) -> Digest {
    digest_of(name, Fake::of(name, tasks, rounds)).0
}

/// Result digest and artefacts of a whole job of any procedure.
pub fn digest_of(name: &str, mut fake: Fake) -> (Digest, Vec<sim_core::procedure::Artefact>) {
    let mut digest = sim_core::base::digest::ResultDigest::start(&Digest::of("test job", &name));
    loop {
        let round = fake.round();
        let mut results: Vec<Option<Arc<[u8]>>> =
            (0..round.tasks).map(|i| Some(result_of(&fake.task(i)).into())).collect();
        results.truncate(fake.decided(&results).unwrap_or(round.tasks) as usize);
        let results: Vec<Arc<[u8]>> = results.into_iter().flatten().collect();
        let digests: Vec<Digest> = results.iter().map(|r| sim_core::procedure::result_digest(r)).collect();
        digest.round(round.number, &digests);
        match fake.tell(&results).step {
            Step::Done(artefacts) => return (digest.seal(), artefacts),
            Step::Waiting => fake.offer(b"batch").expect("a waiting procedure accepts a batch"),
            Step::Next => {}
            Step::Failed(reason) => panic!("{reason}"),
        }
    }
}

/// First message of a simulated worker.
pub fn greeting(id: &str, slots: u32) -> Greeting {
    Greeting {
        worker: WorkerId(id.into()),
        name: id.to_owned(),
        version: "0.9.9".to_owned(),
        address: String::new(),
        credential: "".into(),
        slots,
        engines: vec![ENGINE],
        running: Vec::new(),
        time_left: None,
        stuck_after: None,
    }
}

/// An assignment that reached a worker.
#[derive(Clone, Debug)]
pub struct Given {
    pub worker: WorkerId,
    pub assign: Assign,
}

impl Given {
    /// Returns the right results.
    pub fn delivery(&self) -> Delivery {
        Delivery::Results(self.assign.tasks.iter().map(|task| result_of(task).into()).collect())
    }

    /// Returns wrong results, always the same for the same `how`.
    pub fn wrong(&self, how: u64) -> Delivery {
        Delivery::Results(self.assign.tasks.iter().map(|task| fake::wrong_result_of(task, how).into()).collect())
    }

    pub fn completed(&self, delivery: Delivery) -> Completed {
        let Assign { assignment, job, range, permit, .. } = self.assign.clone();
        Completed {
            worker: self.worker.clone(),
            assignment,
            job,
            engine: ENGINE,
            range,
            permit,
            compute: Duration::from_millis(5),
            delivery,
            tasks: Vec::new(),
            caller: Caller::default(),
        }
    }

    /// The assignment as a worker reports it while it still runs.
    pub fn claim(&self) -> Running {
        let Assign { assignment, job, range, permit, .. } = self.assign.clone();
        Running { assignment, job, range, permit }
    }

    pub fn range(&self) -> Range {
        self.assign.range
    }

    pub fn id(&self) -> AssignmentId {
        self.assign.assignment
    }

    pub fn job(&self) -> &JobId {
        &self.assign.job
    }

    /// Returns true if it is one of the long tasks after the kept rounds.
    pub fn is_long(&self) -> bool {
        self.assign.tasks[0][0] > 0
    }
}

/// Scheduler and store together, as in the actor. The store in memory answers at once.
pub struct Rig {
    pub scheduler: Scheduler,
    pub store: MemoryStore,
    pub epoch: u64,
    pub key: PermitKey,
    pub now: Now,
    /// Assignments that were sent to workers and not cancelled.
    pub given: Vec<Given>,
    pub cancelled: Vec<AssignmentId>,
    /// Workers that received a drain message.
    pub drained: Vec<WorkerId>,
    pub seen: history::Seen,
}

fn settings(epoch: u64) -> Settings {
    Settings { stuck_after: 2 * LEASE, ..Settings::new(epoch, LEASE) }
}

/// Returns the answer of the memory store, which never waits.
pub fn at_once<T>(answer: crate::store::Answer<'_, T>) -> T {
    let mut answer = answer;
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    match answer.as_mut().poll(&mut context) {
        std::task::Poll::Ready(result) => result.expect("the memory store does not fail"),
        std::task::Poll::Pending => panic!("the memory store does not wait"),
    }
}

impl Rig {
    pub fn new() -> Self {
        let store = MemoryStore::default();
        let loaded = at_once(store.start());
        let (epoch, key) = (loaded.epoch, loaded.key);
        let scheduler = Scheduler::new(settings(epoch), key.clone(), 1, BTreeSet::new());
        let (given, cancelled, drained) = (Vec::new(), Vec::new(), Vec::new());
        let (now, seen) = (Now::default(), history::Seen::default());
        Self { scheduler, store, epoch, key, now, given, cancelled, drained, seen }
    }

    /// Commits the writes, and collects the messages to workers.
    pub fn commit_and_collect(&mut self) {
        let actions = self.scheduler.take_actions();
        self.seen.writes(&actions);
        history::Seen::sends(&self.scheduler, self.now, &actions);
        let writes = actions.iter().filter_map(|a| if let Action::Write(w) = a { Some((**w).clone()) } else { None });
        at_once(self.store.commit(self.epoch, writes.collect()));
        for action in actions {
            match action {
                Action::Send(worker, _, Message::Assign(assign)) => self.given.push(Given { worker, assign: *assign }),
                Action::Send(_, _, Message::Cancel(ids)) => self.cancelled.extend(ids),
                Action::Send(worker, _, Message::Drain(_)) => self.drained.push(worker),
                Action::Write(_) | Action::Publish(..) => {}
            }
        }
    }

    pub fn submit(&mut self, name: &str, tasks: u32, rounds: u32) -> JobId {
        self.submit_job(new_job(name, tasks, rounds))
    }

    pub fn submit_job(&mut self, new: NewJob) -> JobId {
        let record = on_submit(&mut self.scheduler, self.now, new);
        self.commit_and_collect();
        record.id
    }

    /// Restarts an ended job of [`Rig::submit`] from this round.
    pub fn submit_again(&mut self, id: &JobId, tasks: u32, rounds: u32, from: u32) -> JobId {
        let before = self.stored(id);
        let mut fake = Fake::of(&before.name, tasks, rounds);
        let mut carried = Carried::start(Origin { job: id.clone(), rounds: from }, &before.job_digest);
        for sealed in at_once(self.store.rounds(id, 0, from)) {
            carried.tell(&mut fake, sealed).expect("the round's results were kept");
        }
        let request_id = format!("again {from} {id}");
        self.submit_job(NewJob { request_id, carried: Some(carried), ..job_of(&before.name, fake) })
    }

    pub fn connect(&mut self, id: &str, slots: u32) -> SessionId {
        self.greet(greeting(id, slots)).session
    }

    pub fn greet(&mut self, greeting: Greeting) -> Welcome {
        let welcome = on_connect(&mut self.scheduler, self.now, greeting);
        self.commit_and_collect();
        welcome
    }

    pub fn disconnect(&mut self, id: &str, session: SessionId) {
        on_disconnect(&mut self.scheduler, self.now, &WorkerId(id.into()), session);
    }

    /// The worker announces that it will stop, and finishes only these leases.
    pub fn drain(&mut self, id: &str, session: SessionId, finishing: &[AssignmentId]) {
        on_drain(&mut self.scheduler, self.now, &WorkerId(id.into()), session, finishing);
        self.commit_and_collect();
    }

    pub fn pause(&mut self, id: &JobId, paused: bool) -> Option<JobRecord> {
        let record = on_pause(&mut self.scheduler, self.now, id, paused);
        self.commit_and_collect();
        record
    }

    /// Delivers like a worker: sends the tasks too if the coordinator needs them.
    pub fn deliver(&mut self, completed: Completed) -> Result<Verdict, RefusedResult> {
        let verdict = self.deliver_once(completed.clone())?;
        if verdict != Verdict::NeedsTasks {
            return Ok(verdict);
        }
        let tasks = self.seen.tasks(&completed.job, completed.range);
        self.deliver_once(Completed { tasks, ..completed })
    }

    /// Delivers once. Compares with the stored digests if the round was sealed long ago.
    pub fn deliver_once(&mut self, completed: Completed) -> Result<Verdict, RefusedResult> {
        let mut verdict = on_result(&mut self.scheduler, self.now, completed.clone());
        self.commit_and_collect();
        if verdict == Ok(Verdict::Older) {
            verdict = self.compare(completed);
        }
        verdict
    }

    /// Does what the actor does with a result of a round sealed long ago.
    pub fn compare(&mut self, completed: Completed) -> Result<Verdict, RefusedResult> {
        let sealed = at_once(self.store.digests(&completed.job, completed.range.round)).expect("the round is sealed");
        let verdict = on_compare(&mut self.scheduler, self.now, completed, &sealed);
        self.commit_and_collect();
        verdict
    }

    pub fn complete(&mut self, completed: Completed) -> Verdict {
        self.deliver(completed).expect("the delivery is not refused")
    }

    /// Delivers the right results.
    pub fn answer(&mut self, given: &Given) -> Verdict {
        self.complete(given.completed(given.delivery()))
    }

    /// Delivers wrong results.
    pub fn deliver_wrong(&mut self, given: &Given) -> Verdict {
        self.complete(given.completed(given.wrong(0)))
    }

    /// The same tasks, assigned to another worker earlier.
    pub fn given_to(&self, worker: &str, given: &Given) -> Given {
        let mut assign = given.assign.clone();
        assign.assignment = AssignmentId(0);
        let worker = WorkerId(worker.into());
        let issued = Issued { assignment: assign.assignment, worker: &worker, job: &assign.job, range: assign.range };
        assign.permit = self.key.issue(issued, &assign.tasks);
        Given { worker, assign }
    }

    /// Tasks of round 0 of a job of [`Rig::submit`], assigned to this worker earlier.
    pub fn early(&self, worker: &str, job: &JobId, tasks: std::ops::Range<u32>) -> Given {
        let range = Range { round: 0, first: tasks.start, count: tasks.len() as u32 };
        let fake = Fake::new(1, 1);
        let assign = Assign {
            assignment: AssignmentId(0),
            job: job.clone(),
            toml: None,
            range,
            tasks: range.indexes().map(|i| fake.task(i)).collect(),
            shared_digest: Digest([0; 32]),
            shared: None,
            permit: Vec::new(),
        };
        self.given_to(worker, &Given { worker: WorkerId(worker.into()), assign })
    }

    /// Delivers a worker's results of tasks of round 0.
    pub fn deliver_tasks(&mut self, worker: &str, job: &JobId, tasks: std::ops::Range<u32>, wrong: bool) -> Verdict {
        let given = self.early(worker, job, tasks);
        if wrong { self.deliver_wrong(&given) } else { self.answer(&given) }
    }

    /// Delivers a worker's result of the first task of an assignment.
    pub fn deliver_first_task(&mut self, worker: &str, given: &Given, wrong: bool) -> Verdict {
        let mut first = given.clone();
        first.assign.range.count = 1;
        first.assign.tasks.truncate(1);
        let first = self.given_to(worker, &first);
        if wrong { self.deliver_wrong(&first) } else { self.answer(&first) }
    }

    pub fn advance(&mut self, by: Duration) {
        self.now.since_start += by;
        on_tick(&mut self.scheduler, self.now);
        self.commit_and_collect();
    }

    /// Sends a heartbeat with the worker's assignments and `progress` for each.
    pub fn heartbeat(&mut self, id: &str, session: SessionId, progress: u64) {
        self.given.retain(|g| !self.cancelled.contains(&g.id()));
        let running: Vec<_> = self.given.iter().filter(|g| *g.worker.0 == *id).map(Given::id).collect();
        let progress = vec![progress; running.len()];
        assert!(self.beat(id, session, &running, &progress), "the session is open");
    }

    /// Sends a heartbeat; returns `false` if the session has ended.
    pub fn beat(&mut self, id: &str, session: SessionId, running: &[AssignmentId], progress: &[u64]) -> bool {
        let known = on_heartbeat(&mut self.scheduler, self.now, &WorkerId(id.into()), session, running, progress);
        self.commit_and_collect();
        known
    }

    /// Removes and returns this worker's next assignment.
    pub fn take_of(&mut self, id: &str) -> Option<Given> {
        self.given.retain(|g| !self.cancelled.contains(&g.id()));
        let at = self.given.iter().position(|g| &*g.worker.0 == id)?;
        Some(self.given.remove(at))
    }

    /// Removes and returns the next assignment of any worker.
    pub fn take(&mut self) -> Option<Given> {
        self.given.retain(|g| !self.cancelled.contains(&g.id()));
        (!self.given.is_empty()).then(|| self.given.remove(0))
    }

    /// Delivers the right results of all assignments until none is left.
    pub fn work_off(&mut self) {
        while let Some(given) = self.take() {
            self.answer(&given);
        }
    }

    /// Delivers the right results until this number of rounds is sealed.
    pub fn work_to(&mut self, job: &JobId, rounds: u32) {
        while self.stored(job).rounds_sealed < rounds {
            let given = self.take().expect("an assignment is left");
            self.answer(&given);
        }
    }

    /// Delivers the right results until the next assignment is a long task; `None` if the job ends before.
    pub fn work_to_long(&mut self) -> Option<Given> {
        loop {
            let given = self.take()?;
            if given.is_long() {
                return Some(given);
            }
            self.answer(&given);
        }
    }

    pub fn stored(&self, id: &JobId) -> JobRecord {
        at_once(self.store.job(id)).expect("the job is stored").0
    }

    pub fn phase(&self, id: &JobId) -> String {
        self.stored(id).progress.phase.into_owned()
    }

    pub fn is_quarantined(&self, id: &str) -> bool {
        self.scheduler.trust.is_quarantined(&WorkerId(id.into()))
    }

    /// Ids of the quarantined workers.
    pub fn quarantined(&self) -> Vec<String> {
        self.scheduler.trust.ids().map(WorkerId::to_string).collect()
    }

    /// Rulings about a job's disputed tasks.
    pub fn rulings(&self, job: &JobId) -> Vec<Option<Ruling>> {
        self.stored(job).disputes.iter().map(|d| d.ruling).collect()
    }

    pub fn waits_for(&self, job: &JobId) -> String {
        waits_for(&self.scheduler, job).unwrap_or_default()
    }

    /// Checks that the job succeeded with the expected result digest.
    pub fn assert_right(&self, job: &JobId, tasks: u32, rounds: u32) {
        let record = self.stored(job);
        let expected = Some(expected_digest(&record.name, tasks, rounds));
        assert_eq!((record.state, record.result_digest), (JobState::Succeeded, expected), "{}", record.reason);
    }

    /// The coordinator exits and starts again on its store.
    pub fn restart(&mut self) {
        let loaded = at_once(self.store.start());
        self.epoch = loaded.epoch;
        let ended = loaded.ended.into_iter().collect();
        self.scheduler = Scheduler::new(settings(loaded.epoch), loaded.key, loaded.next_job, ended)
            .with_quarantined(loaded.quarantined);
        for StoredJob { record, toml, state, results } in loaded.active {
            let procedure = Box::new(Fake::load(&state.procedure).expect("a saved state can be loaded"));
            let resumed = Resumed { record, toml, procedure, last: state.last, results };
            on_resume(&mut self.scheduler, self.now, resumed).expect("a stored job resumes");
        }
        self.commit_and_collect();
    }
}

/// Number of a job's leases.
fn leased(rig: &Rig, job: &JobId) -> usize {
    rig.scheduler.leases.of(job).count()
}
