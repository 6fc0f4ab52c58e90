//! The scheduler under random events, held against its promises after each of them; and its promises one by one.
//!
//! Evaluations are replaced by a pure function of the genome: what is tested here needs no physics.

mod builds;
mod costs;
mod crashes;
mod disputes;
mod doubts;
mod finish;
mod laws;
mod model;
mod restarts;
mod seen;
mod time;

use super::*;
use crate::record::Origin;
use crate::store::{MemoryStore, SealedGeneration, Store};
use sim_core::base::digest::Digest;
use sim_core::base::score::{Counts, Direction};
use sim_core::genotype::Genome;
use sim_core::procedure::evolve::finish::{Done, Examination, Found, Plan, Question};
use sim_core::procedure::evolve::report::Report;
use sim_core::report::Traces;
use sim_core::search::{Optimiser, Scored};

/// Each generation's candidates follow from the scores of the one before: any change of one bit changes all that follows.
#[derive(Clone, Debug)]
pub struct Fake {
    pub population: u32,
    generation: u32,
    memory: u64,
}

impl Fake {
    pub fn new(population: u32) -> Self {
        Self { population, generation: 0, memory: 17 }
    }
}

fn mix(a: u64, b: u64) -> u64 {
    let z = (a ^ b.rotate_left(32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (z ^ (z >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9)
}

impl Optimiser for Fake {
    fn ask(&self) -> Vec<Genome> {
        (0..self.population).map(|i| vec![mix(self.memory, u64::from(i)) as f64, f64::from(i)]).collect()
    }
    fn tell(&mut self, scores: &[Option<f64>]) {
        assert_eq!(scores.len(), self.population as usize);
        for score in scores {
            self.memory = mix(self.memory, score.map_or(1, f64::to_bits));
        }
        self.generation += 1;
    }
    fn generation(&self) -> u32 {
        self.generation
    }
    fn save(&self) -> Vec<u8> {
        [u64::from(self.generation), self.memory].iter().flat_map(|v| v.to_le_bytes()).collect()
    }
    fn restore(&mut self, state: &[u8]) -> Result<(), BadState> {
        let word = |at: usize| state.get(at..at + 8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes);
        let (Some(generation), Some(memory)) = (word(0), word(8)) else {
            return Err(BadState("too short".to_owned()));
        };
        (self.generation, self.memory) = (generation as u32, memory);
        Ok(())
    }
    fn direction(&self) -> Direction {
        Direction::Maximise
    }
}

/// The fake physics: one candidate in seven fails.
pub fn score(genome: &Genome) -> Outcome {
    let bits = mix(genome[0].to_bits(), genome[1].to_bits());
    let score = (!bits.is_multiple_of(7)).then_some((bits % 1000) as f64 / 8.0);
    Outcome::evaluation(score, Counts { rollouts: 1, nodes: bits % 5, ..Counts::default() })
}

/// The fake physics of examinations: three trees each, one of them fails now and then.
pub fn answer(examination: &Examination) -> Outcome {
    let Examination { question, candidate } = examination;
    let seed = mix(candidate.genome[0].to_bits(), candidate.genome[1].to_bits() + *question as u64);
    let tree = |i: u64| (!mix(seed, i).is_multiple_of(5)).then_some((mix(seed, i) % 100) as f64 / 4.0);
    let counts = Counts { rollouts: 2, ..Counts::default() };
    match question {
        Question::Traces => {
            let traces = serde_json::to_vec(&Traces::default()).expect("traces are JSON");
            Outcome { scores: Vec::new(), counts, traces }
        }
        _ => Outcome { scores: (0..3).map(tree).collect(), counts, traces: Vec::new() },
    }
}

/// What a job of this name does once its search is over: bare ones only report.
pub fn finish(name: &str) -> Plan {
    let bare = name.starts_with("bare");
    Plan { direction: Direction::Maximise, archive: if bare { 0 } else { 4 }, audit: !bare }
}

pub const ENGINE: Digest = Digest([3; 32]);

pub fn new_job(name: &str, population: u32, generations: u32) -> NewJob {
    NewJob {
        name: name.to_owned(),
        request_id: format!("request of {name}"),
        request_digest: Digest::of("test", &name),
        priority: 10,
        job_digest: Digest::of("test job", &name),
        engine_digest: ENGINE,
        toml: format!("name = \"{name}\"").into(),
        at_once: 1,
        optimiser: Box::new(Fake::new(population)),
        generations,
        finish: finish(name),
        carried: None,
    }
}

/// The result digest of a whole job, computed straight away.
pub fn expected_digest(name: &str, population: u32, generations: u32) -> Digest {
    let plan = finish(name);
    let mut archive = plan.new_archive();
    let mut first = None;
    let mut fake = Fake::new(population);
    let mut digest = sim_core::base::digest::ResultDigest::start(&Digest::of("test job", &name));
    for generation in 0..generations {
        let genomes = fake.ask();
        let scores: Vec<Option<f64>> = genomes.iter().map(|g| score(g).score()).collect();
        let scored = |(i, genome): (usize, &Genome)| {
            let score = scores[i]?;
            Some(Scored { generation, candidate: i as u32, score, genome: genome.clone() })
        };
        archive.generation(genomes.iter().enumerate().filter_map(scored));
        first = first.or(archive.bests().first().cloned());
        digest.generation(generation, &scores);
        fake.tell(&scores);
    }
    let found = Found {
        first: first.expect("some candidate succeeds"),
        best: archive.bests().last().expect("some candidate succeeds").clone(),
        archive: archive.entries().to_vec(),
        bests: archive.bests().to_vec(),
    };
    let answers =
        |round: Vec<Examination>| -> Vec<Done> { round.into_iter().map(|e| (e.clone(), answer(&e).scores)).collect() };
    let scores = |done: &[Done]| done.iter().map(|(_, scores)| scores.clone()).collect::<Vec<_>>();
    let done = answers(plan.finishing(&found));
    if !done.is_empty() {
        digest.examinations(generations, &scores(&done));
    }
    let winner = plan.winner(&found, &done);
    digest.examinations(generations + 1, &scores(&answers(plan.reporting(&found, &winner, &done))));
    digest.seal(&winner.genome, winner.score)
}

/// A worker as the test plays it.
pub fn greeting(id: &str, slots: u32) -> Greeting {
    Greeting {
        worker: WorkerId(id.into()),
        name: id.to_owned(),
        version: "0.9.9".to_owned(),
        address: String::new(),
        slots,
        engines: vec![ENGINE],
        running: Vec::new(),
        time_left: None,
        stuck_after: None,
    }
}

/// Work as it reached a worker.
#[derive(Clone, Debug)]
pub struct Given {
    pub worker: WorkerId,
    pub assignment: AssignmentId,
    pub job: JobId,
    pub task: Task,
}

impl Given {
    pub fn delivery(&self) -> Delivery {
        match &self.task {
            Task::Evaluate { range, genomes, base } => Delivery::Evaluations {
                generation: range.round,
                first: range.first,
                outcomes: range.indexes().map(|i| score(&genomes[(i - base) as usize])).collect(),
            },
            Task::Examine { range, examination } => {
                Delivery::Examination { round: range.round, index: range.first, outcome: answer(examination) }
            }
        }
    }

    pub fn completed(&self, delivery: Delivery) -> Completed {
        Completed {
            worker: self.worker.clone(),
            assignment: self.assignment,
            job: self.job.clone(),
            engine: ENGINE,
            compute: Duration::from_millis(5),
            delivery,
        }
    }

    /// What a worker delivers that computes wrongly, always in the same way for the same `how`.
    pub fn wrong(&self, how: u64) -> Delivery {
        let spoil = |mut outcome: Outcome| {
            match outcome.scores.first_mut() {
                Some(score) => *score = Some(score.map_or(1.0, |s| f64::from_bits(s.to_bits() ^ (1 + how)))),
                None => outcome.counts.nodes += 1 + how,
            }
            outcome
        };
        match self.delivery() {
            Delivery::Evaluations { generation, first, outcomes } => {
                Delivery::Evaluations { generation, first, outcomes: outcomes.into_iter().map(spoil).collect() }
            }
            Delivery::Examination { round, index, outcome } => {
                Delivery::Examination { round, index, outcome: spoil(outcome) }
            }
            failure => failure,
        }
    }

    /// Only the first task of it.
    pub fn first(&self) -> Self {
        let mut first = self.clone();
        if let Task::Evaluate { range, .. } = &mut first.task {
            range.count = 1;
        }
        first
    }

    pub fn range(&self) -> Range {
        self.task.range()
    }

    pub fn question(&self) -> Option<Question> {
        if let Task::Examine { examination, .. } = &self.task { Some(examination.question) } else { None }
    }
}

/// Scheduler and store together, as the actor holds them; a store in memory answers at once.
pub struct Rig {
    pub scheduler: Scheduler,
    pub store: MemoryStore,
    pub epoch: u64,
    pub now: Now,
    /// Everything that was ever sent to a worker and not cancelled.
    pub given: Vec<Given>,
    pub cancelled: Vec<AssignmentId>,
    /// Who was told to stop.
    pub drained: Vec<WorkerId>,
    pub seen: seen::Seen,
}

pub const LEASE: Duration = Duration::from_secs(10);

fn settings(epoch: u64) -> Settings {
    Settings { stuck_after: 2 * LEASE, ..Settings::new(epoch, LEASE) }
}

/// The memory store never waits.
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
        let epoch = at_once(store.start()).epoch;
        let scheduler = Scheduler::new(settings(epoch), 1, BTreeSet::new());
        let (given, cancelled, drained) = (Vec::new(), Vec::new(), Vec::new());
        Self { scheduler, store, epoch, now: Now::default(), given, cancelled, drained, seen: seen::Seen::default() }
    }

    /// Commits and collects what the scheduler wants done.
    pub fn settle(&mut self) {
        let actions = self.scheduler.take_actions();
        self.seen.writes(&actions);
        seen::Seen::sends(&self.scheduler, self.now, &actions);
        let writes = actions.iter().filter_map(|a| if let Action::Write(w) = a { Some((**w).clone()) } else { None });
        at_once(self.store.commit(self.epoch, writes.collect()));
        for action in actions {
            match action {
                Action::Send(worker, _, Message::Assign { assignment, job, task, .. }) => {
                    self.given.push(Given { worker, assignment, job, task });
                }
                Action::Send(_, _, Message::Cancel(ids)) => self.cancelled.extend(ids),
                Action::Send(worker, _, Message::Drain(_)) => self.drained.push(worker),
                Action::Write(_) | Action::Publish(..) => {}
            }
        }
    }

    pub fn submit(&mut self, name: &str, population: u32, generations: u32) -> JobId {
        let record = self.scheduler.submit(self.now, new_job(name, population, generations));
        self.settle();
        record.id
    }

    /// Has an ended job done again, from this generation on.
    pub fn submit_again(&mut self, id: &JobId, from: u32) -> JobId {
        let before = self.stored(id);
        let history = at_once(self.store.result(id)).history;
        let sealed = |n: u32| SealedGeneration {
            scores: at_once(self.store.scores(id, n)).expect("it was sealed"),
            statistics: history[n as usize],
        };
        let generations = (0..from).map(sealed).collect();
        let origin = Origin { job: id.clone(), generations: from };
        let new = NewJob {
            request_id: format!("again {from} {id}"),
            carried: Some(Carried { origin, generations }),
            ..new_job(&before.name, before.population, before.generations_total)
        };
        let record = self.scheduler.submit(self.now, new);
        self.settle();
        record.id
    }

    pub fn connect(&mut self, id: &str, slots: u32) -> SessionId {
        let welcome = self.scheduler.connect(self.now, greeting(id, slots));
        self.settle();
        welcome.session
    }

    pub fn complete(&mut self, completed: Completed) -> Verdict {
        let mut verdict = self.scheduler.complete(self.now, completed.clone());
        self.settle();
        if verdict == Verdict::Older {
            verdict = self.compare(completed);
        }
        verdict
    }

    /// What the shell does with a result of an older generation.
    fn compare(&mut self, completed: Completed) -> Verdict {
        let Delivery::Evaluations { generation, first, outcomes } = &completed.delivery else { panic!("no scores") };
        let sealed = |number: u32| at_once(self.store.scores(&completed.job, number)).expect("it was sealed");
        let mut search = Fake::new(self.stored(&completed.job).population);
        (0..*generation).for_each(|number| search.tell(&sealed(number)));
        let (scores, genomes) = (sealed(*generation), search.ask());
        let both = (*first as usize..).zip(outcomes).filter(|(i, late)| !round::same_bits(scores[*i], late.score()));
        let committed = |i: usize| Committed { score: scores[i], genome: genomes[i].clone() };
        let contradicted = both.map(|(i, _)| (i as u32, committed(i))).collect();
        let verdict = self.scheduler.compare(self.now, completed, &contradicted);
        self.settle();
        verdict
    }

    pub fn advance(&mut self, by: Duration) {
        self.now.since_start += by;
        self.scheduler.tick(self.now);
        self.settle();
    }

    /// A sign of life, with what the worker was given and `progress` of each.
    pub fn heartbeat(&mut self, id: &str, session: SessionId, progress: u64) {
        let id = WorkerId(id.into());
        self.given.retain(|g| !self.cancelled.contains(&g.assignment));
        let running: Vec<_> = self.given.iter().filter(|g| g.worker == id).map(|g| g.assignment).collect();
        let progress = vec![progress; running.len()];
        assert!(self.scheduler.heartbeat(self.now, &id, session, &running, &progress), "the session stands");
        self.settle();
    }

    /// Takes the next work that this worker has.
    pub fn take_of(&mut self, id: &str) -> Option<Given> {
        self.given.retain(|g| !self.cancelled.contains(&g.assignment));
        let at = self.given.iter().position(|g| &*g.worker.0 == id)?;
        Some(self.given.remove(at))
    }

    /// Takes the next unanswered work.
    pub fn take(&mut self) -> Option<Given> {
        self.given.retain(|g| !self.cancelled.contains(&g.assignment));
        (!self.given.is_empty()).then(|| self.given.remove(0))
    }

    /// Answers all there is until nothing is left.
    pub fn work_off(&mut self) {
        while let Some(given) = self.take() {
            let delivery = given.delivery();
            self.complete(given.completed(delivery));
        }
    }

    pub fn stored(&self, id: &JobId) -> JobRecord {
        at_once(self.store.job(id)).expect("the job is stored").0
    }

    /// The report of a job that succeeded.
    pub fn report(&self, id: &JobId) -> Report {
        let stored = at_once(self.store.result(id)).report;
        serde_json::from_slice(&stored).expect("the report is JSON")
    }

    /// Answers work until the next that is given is an examination; `None` if the job ends before.
    pub fn work_to_finish(&mut self) -> Option<Given> {
        loop {
            let given = self.take()?;
            if given.question().is_some() {
                return Some(given);
            }
            let delivery = given.delivery();
            self.complete(given.completed(delivery));
        }
    }

    /// The coordinator dies and starts again on its store.
    pub fn restart(&mut self, population: impl Fn(&JobId) -> u32) {
        let loaded = at_once(self.store.start());
        self.epoch = loaded.epoch;
        self.scheduler = Scheduler::new(settings(loaded.epoch), loaded.next_job, loaded.ended.into_iter().collect())
            .with_quarantined(loaded.quarantined);
        for stored in loaded.active {
            let optimiser = Box::new(Fake::new(population(&stored.record.id)));
            let crate::store::StoredJob { record, toml, search, results, last_scores } = stored;
            let finish = finish(&record.name);
            let resumed = Resumed { record, toml, at_once: 1, optimiser, finish, search, results, last_scores };
            self.scheduler.resume(self.now, resumed).expect("a stored job resumes");
        }
        self.settle();
    }
}

/// How many of a job's leases are with workers.
fn leased(rig: &Rig, job: &JobId) -> usize {
    rig.scheduler.leases.values().filter(|l| l.job == *job).count()
}
