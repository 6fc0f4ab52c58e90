//! Random interleavings of everything that can happen, with the invariants checked after each event.

use super::*;
use proptest::prelude::*;
use std::collections::BTreeMap;

const POPULATIONS: [u32; 3] = [1, 5, 13];
const GENERATIONS: u32 = 3;
const WORKERS: u8 = 3;
/// One of them reports on the search's best, the others have an archive and audits.
const NAMES: [&str; 3] = ["bare0", "job1", "job2"];

#[derive(Clone, Debug)]
enum Step {
    Submit(u8),
    Connect {
        worker: u8,
        slots: u32,
    },
    /// Answers some work; `keep` leaves it in the hands of the worker, to be delivered once more later.
    Complete {
        pick: usize,
        keep: bool,
    },
    /// A worker's connection breaks; it may or may not come back.
    Disconnect(u8),
    Reconnect(u8),
    Heartbeat(u8),
    Drain(u8),
    Reject(usize),
    Fail(usize),
    Pass(u64),
    Cancel(u8),
    Restart,
}

fn step() -> impl Strategy<Value = Step> {
    let worker = 0..WORKERS;
    prop_oneof![
        3 => (0u8..3).prop_map(Step::Submit),
        4 => (worker.clone(), 1u32..4).prop_map(|(worker, slots)| Step::Connect { worker, slots }),
        30 => (any::<usize>(), any::<bool>()).prop_map(|(pick, keep)| Step::Complete { pick, keep }),
        2 => worker.clone().prop_map(Step::Disconnect),
        3 => worker.clone().prop_map(Step::Reconnect),
        6 => worker.clone().prop_map(Step::Heartbeat),
        1 => worker.prop_map(Step::Drain),
        1 => any::<usize>().prop_map(Step::Reject),
        1 => any::<usize>().prop_map(Step::Fail),
        4 => (1u64..6).prop_map(Step::Pass),
        1 => (0u8..3).prop_map(Step::Cancel),
        2 => Just(Step::Restart),
    ]
}

/// The test's own view.
struct World {
    rig: Rig,
    sessions: BTreeMap<u8, SessionId>,
    jobs: BTreeMap<u8, JobId>,
    sealed: BTreeMap<JobId, u32>,
}

fn worker_id(worker: u8) -> WorkerId {
    WorkerId(format!("w{worker}").into())
}

impl World {
    fn population(jobs: &BTreeMap<u8, JobId>, id: &JobId) -> u32 {
        let slot = jobs.iter().find(|(_, job)| *job == id).map(|(slot, _)| *slot).expect("a job of ours");
        POPULATIONS[slot as usize]
    }

    fn greeting(&self, worker: u8, slots: u32) -> Greeting {
        let id = worker_id(worker);
        let mine = self.rig.given.iter().filter(|g| g.worker == id);
        let running = mine.map(|g| (g.assignment, g.job.clone(), g.range())).collect();
        Greeting { running, ..greeting(&id.0, slots) }
    }

    fn step(&mut self, step: Step) {
        let now = self.rig.now;
        match step {
            Step::Submit(slot) => {
                if !self.jobs.contains_key(&slot) {
                    let id = self.rig.submit(NAMES[slot as usize], POPULATIONS[slot as usize], GENERATIONS);
                    self.jobs.insert(slot, id);
                }
            }
            Step::Connect { worker, slots } => {
                let greeting = self.greeting(worker, slots);
                let welcome = self.rig.scheduler.connect(now, greeting);
                self.rig.given.retain(|g| !welcome.drop.contains(&g.assignment));
                self.sessions.insert(worker, welcome.session);
            }
            Step::Reconnect(worker) => {
                if self.sessions.contains_key(&worker) {
                    self.step(Step::Connect { worker, slots: 2 });
                }
            }
            Step::Complete { pick, keep } => {
                if self.rig.given.is_empty() {
                    return;
                }
                let at = pick % self.rig.given.len();
                let given = self.rig.given[at].clone();
                if !keep {
                    self.rig.given.remove(at);
                }
                let verdict = self.rig.scheduler.complete(now, given.completed(given.delivery()));
                assert_ne!(verdict, Verdict::Conflict, "all compute the same");
                assert_ne!(verdict, Verdict::Unknown, "all of it was asked for");
            }
            Step::Disconnect(worker) => {
                if let Some(session) = self.sessions.get(&worker) {
                    self.rig.scheduler.disconnect(now, &worker_id(worker), *session);
                }
            }
            Step::Heartbeat(worker) => {
                if let Some(session) = self.sessions.get(&worker) {
                    let id = worker_id(worker);
                    let running: Vec<_> =
                        self.rig.given.iter().filter(|g| g.worker == id).map(|g| g.assignment).collect();
                    self.rig.scheduler.heartbeat(now, &id, *session, &running);
                }
            }
            Step::Drain(worker) => {
                if let Some(session) = self.sessions.get(&worker) {
                    self.rig.scheduler.drain(now, &worker_id(worker), *session);
                }
            }
            Step::Reject(pick) => {
                if self.rig.given.is_empty() {
                    return;
                }
                let given = self.rig.given.remove(pick % self.rig.given.len());
                let worker: u8 = given.worker.0[1..].parse().unwrap();
                if let Some(session) = self.sessions.get(&worker) {
                    self.rig.scheduler.reject(now, &given.worker, *session, given.assignment);
                }
            }
            Step::Fail(pick) => {
                if self.rig.given.is_empty() {
                    return;
                }
                let given = self.rig.given.remove(pick % self.rig.given.len());
                self.rig.scheduler.complete(now, given.completed(Delivery::Failure("by the test".to_owned())));
            }
            Step::Pass(seconds) => {
                self.rig.now.since_start += Duration::from_secs(seconds);
                self.rig.scheduler.tick(self.rig.now);
            }
            Step::Cancel(slot) => {
                if let Some(id) = self.jobs.get(&slot) {
                    self.rig.scheduler.cancel(now, id);
                }
            }
            Step::Restart => {
                self.rig.settle();
                let jobs = &self.jobs;
                self.rig.restart(|id| Self::population(jobs, id));
                self.sessions.clear();
            }
        }
        self.rig.settle();
    }

    fn check(&mut self) {
        let scheduler = &self.rig.scheduler;
        let now = self.rig.now.since_start;
        // Leases and workers agree, and none outlives its worker's sign of life.
        for (id, lease) in &scheduler.leases {
            let worker = scheduler.workers.get(&lease.worker).expect("a lease has a worker");
            assert!(worker.held.contains(id) && worker.expires > now);
            assert!(scheduler.jobs.contains_key(&lease.job), "no lease of an ended job");
        }
        let held: usize = scheduler.workers.values().map(|w| w.held.len()).sum();
        assert_eq!(held, scheduler.leases.len());
        for worker in scheduler.workers.values() {
            assert!(!worker.draining || worker.held.is_empty());
        }
        for (id, job) in &scheduler.jobs {
            let stored = self.rig.stored(id);
            assert_eq!(stored, job.record, "the store is where memory is");
            // No task is lost: each is pending, done, or in exactly one lease.
            let (round, leases) = (&job.round, scheduler.leases.values().filter(|l| l.job == *id));
            let open = |l: &lease::Lease| l.range.indexes().filter(|i| !round.is_done(&one(round.number, *i))).count();
            let leased: usize = leases.map(open).sum();
            assert_eq!(round.pending() + round.done() + leased as u32, round.size());
            assert!(round.done() < round.size(), "a complete round is sealed at once");
            // Free slots are used when there is work.
            if job.has_pending() {
                for worker in scheduler.workers.values().filter(|w| w.takes_work() && w.refused.is_empty()) {
                    assert!(worker.held.len() >= worker.slots as usize, "an idle slot beside pending work");
                }
            }
        }
        for id in self.jobs.values() {
            let record = self.rig.stored(id);
            let sealed = self.sealed.entry(id.clone()).or_insert(0);
            assert!(record.generations_done >= *sealed, "a sealed generation stays sealed");
            *sealed = record.generations_done;
            let history = at_once(self.rig.store.result(id)).history;
            let numbers: Vec<u32> = history.iter().map(|g| g.generation).collect();
            assert_eq!(numbers, (0..record.generations_done).collect::<Vec<_>>(), "each sealed exactly once");
            let events = at_once(self.rig.store.events(id, 0, 1000));
            let sequence: Vec<u64> = events.iter().map(|e| e.sequence).collect();
            assert_eq!(sequence, (1..=record.last_event).collect::<Vec<_>>(), "events without a gap");
        }
    }

    /// Whatever happened, undisturbed work ends every job.
    fn finish(&mut self) {
        self.rig.now.since_start += LEASE * 2;
        self.rig.scheduler.tick(self.rig.now);
        self.rig.settle();
        self.step(Step::Connect { worker: 99, slots: 4 });
        self.rig.given.retain(|g| g.worker == worker_id(99));
        self.rig.work_off();
        for (slot, id) in &self.jobs {
            let record = self.rig.stored(id);
            match record.state {
                JobState::Succeeded => {
                    let report = self.rig.report(id);
                    assert_eq!(Some(&report.winner), record.winner.as_ref());
                    assert!(report.winner_scores.fresh.len() == 3 && report.first_scores.fresh.len() == 3);
                    assert_eq!(
                        record.result_digest,
                        Some(expected_digest(NAMES[*slot as usize], POPULATIONS[*slot as usize], GENERATIONS)),
                        "the result does not depend on what happened on the way"
                    )
                }
                JobState::Cancelled => {}
                JobState::Failed => assert!(record.reason.contains("failed 3 times"), "{}", record.reason),
                state => panic!("job{slot} ended as {state:?}"),
            }
        }
    }
}

fn one(round: u32, first: u32) -> Range {
    Range { round, first, count: 1 }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_happens_nothing_is_lost_and_the_bits_are_the_same(steps in prop::collection::vec(step(), 1..150)) {
        let mut world = World {
            rig: Rig::new(),
            sessions: BTreeMap::new(),
            jobs: BTreeMap::new(),
            sealed: BTreeMap::new(),
        };
        world.step(Step::Submit(1));
        for step in steps {
            world.step(step);
            world.check();
        }
        world.finish();
        world.check();
    }
}
