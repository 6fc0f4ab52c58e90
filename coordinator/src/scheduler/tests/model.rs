//! Random sequences of all events, with the invariants checked after each event.

mod check;

use super::*;
use proptest::prelude::*;

const TASKS: [u32; 3] = [1, 5, 13];
const ROUNDS: u32 = 3;
const WORKERS: u8 = 4;
/// Worker that sometimes computes wrongly.
const FAULTY: u8 = 0;
/// Job names: the first job has one round of long tasks, the others have two.
const NAMES: [&str; 3] = ["bare0", "job1", "job2"];

#[derive(Clone, Debug)]
enum Step {
    Submit(u8),
    /// `left`: seconds until the worker's machine shuts down.
    Connect {
        worker: u8,
        slots: u32,
        left: Option<u64>,
    },
    /// Delivers an assignment's right results; with `keep` the worker can deliver them again later.
    Complete {
        pick: usize,
        keep: bool,
    },
    /// The faulty worker delivers wrong results, in one of two ways.
    CompleteWrong {
        pick: usize,
        keep: bool,
        how: u64,
    },
    /// The right results of an earlier delivery arrive again.
    Late(usize),
    /// A worker delivers results of another worker's assignment, as after a network partition.
    Twice {
        pick: usize,
        worker: u8,
    },
    /// A worker's connection breaks; it may or may not connect again.
    Disconnect(u8),
    Reconnect(u8),
    /// A heartbeat, with progress or without.
    Heartbeat {
        worker: u8,
        moves: bool,
    },
    Drain(u8),
    Expel(u8),
    Reject(usize),
    Fail(usize),
    /// A delivery of an assignment that was not issued.
    Forge {
        pick: usize,
        how: u8,
    },
    /// The faulty worker delivers an invalid result.
    Garble {
        pick: usize,
        how: u8,
    },
    Pass(u64),
    /// The machine slept, or its clock was set.
    Jump {
        seconds: u64,
        unix_ms: i64,
    },
    Pause(u8),
    Resume(u8),
    Cancel(u8),
    Restart,
}

fn step() -> impl Strategy<Value = Step> {
    let worker = 0..WORKERS;
    let left = proptest::option::weighted(0.2, 1u64..60);
    prop_oneof![
        3 => (0u8..3).prop_map(Step::Submit),
        5 => (worker.clone(), 1u32..4, left).prop_map(|(worker, slots, left)| Step::Connect { worker, slots, left }),
        30 => (any::<usize>(), any::<bool>()).prop_map(|(pick, keep)| Step::Complete { pick, keep }),
        2 => (any::<usize>(), any::<bool>(), 0u64..2).prop_map(|(pick, keep, how)| Step::CompleteWrong { pick, keep, how }),
        3 => any::<usize>().prop_map(Step::Late),
        3 => (any::<usize>(), worker.clone()).prop_map(|(pick, worker)| Step::Twice { pick, worker }),
        2 => worker.clone().prop_map(Step::Disconnect),
        3 => worker.clone().prop_map(Step::Reconnect),
        8 => (worker.clone(), any::<bool>()).prop_map(|(worker, moves)| Step::Heartbeat { worker, moves }),
        1 => worker.clone().prop_map(Step::Drain),
        1 => worker.prop_map(Step::Expel),
        1 => any::<usize>().prop_map(Step::Reject),
        1 => any::<usize>().prop_map(Step::Fail),
        2 => (any::<usize>(), 0u8..5).prop_map(|(pick, how)| Step::Forge { pick, how }),
        1 => (any::<usize>(), 0u8..4).prop_map(|(pick, how)| Step::Garble { pick, how }),
        5 => (1u64..6).prop_map(Step::Pass),
        1 => (0u64..100_000, any::<i64>()).prop_map(|(seconds, unix_ms)| Step::Jump { seconds, unix_ms }),
        1 => (0u8..3).prop_map(Step::Pause),
        2 => (0u8..3).prop_map(Step::Resume),
        1 => (0u8..3).prop_map(Step::Cancel),
        2 => Just(Step::Restart),
    ]
}

/// The scheduler and the test's own record of events.
struct World {
    rig: Rig,
    sessions: BTreeMap<u8, SessionId>,
    jobs: BTreeMap<u8, JobId>,
    /// Assignments with delivered results.
    answered: Vec<Given>,
    /// Jobs that ever received a wrong result.
    got_wrong_results: BTreeSet<JobId>,
    /// Tasks with a wrong result and no decided dispute.
    undecided: BTreeSet<(JobId, u32, u32)>,
    /// Number of crashes and failures: the upper limit on attempts.
    faults: u32,
    /// Progress of each assignment at the last heartbeat that reported it, …
    counts: BTreeMap<AssignmentId, u64>,
    /// … and the time of its last progress.
    still: BTreeMap<AssignmentId, Duration>,
    /// True if a worker ever kept a lease when it connected: that lease may run beside a suspect.
    adopted: bool,
}

fn worker_id(worker: u8) -> WorkerId {
    WorkerId(format!("w{worker}").into())
}

impl World {
    fn new() -> Self {
        Self {
            rig: Rig::new(),
            sessions: BTreeMap::new(),
            jobs: BTreeMap::new(),
            answered: Vec::new(),
            got_wrong_results: BTreeSet::new(),
            undecided: BTreeSet::new(),
            faults: 0,
            counts: BTreeMap::new(),
            still: BTreeMap::new(),
            adopted: false,
        }
    }

    fn greeting(&self, worker: u8, slots: u32) -> Greeting {
        let id = worker_id(worker);
        let mine = self.rig.given.iter().filter(|g| g.worker == id);
        let running = mine.map(Given::claim).collect();
        // Another worker shares the faulty worker's host.
        let address = format!("10.0.0.{}:7", worker.max(1));
        Greeting { running, address, ..greeting(&id.0, slots) }
    }

    /// Returns the index of one of the assignments that match.
    fn pick(&self, pick: usize, of: impl Fn(&Given) -> bool) -> Option<usize> {
        let all: Vec<usize> = (0..self.rig.given.len()).filter(|&i| of(&self.rig.given[i])).collect();
        (!all.is_empty()).then(|| all[pick % all.len()])
    }

    /// Returns one of the assignments that match. Without `keep` its worker does not have it any more.
    fn take(&mut self, pick: usize, keep: bool, of: impl Fn(&Given) -> bool) -> Option<Given> {
        let at = self.pick(pick, of)?;
        Some(if keep { self.rig.given[at].clone() } else { self.rig.given.remove(at) })
    }

    fn deliver(&mut self, given: &Given, worker: WorkerId, delivery: Delivery) {
        let correct = worker != worker_id(FAULTY);
        let wrong = differs(&delivery, &given.delivery());
        let own = if worker == given.worker { given.clone() } else { self.rig.given_to(&worker.0, given) };
        let verdict = self.rig.complete(own.completed(delivery));
        assert_ne!(verdict, Verdict::Unknown, "all delivered assignments were issued");
        assert!(!(correct && verdict == Verdict::Quarantined), "only the faulty worker may be quarantined");
        if wrong && matches!(verdict, Verdict::Accepted | Verdict::Conflict) {
            self.got_wrong_results.insert(given.job().clone());
            let range = given.range();
            self.undecided.extend(range.indexes().map(|index| (given.job().clone(), range.round, index)));
        }
        if !wrong && verdict == Verdict::Conflict {
            assert!(self.got_wrong_results.contains(given.job()), "conflict without a wrong result");
        }
        self.answered.push(given.clone());
    }

    /// Records of the submitted jobs.
    fn records(&self) -> Vec<JobRecord> {
        self.jobs.values().map(|id| self.rig.stored(id)).collect()
    }

    /// Delivers an assignment that was not issued, which must change nothing.
    fn forge(&mut self, pick: usize, how: u8) {
        let Some(at) = self.pick(pick, |_| true) else { return };
        let given = self.rig.given[at].clone();
        let mut forged = given.completed(given.delivery());
        match how {
            0 => forged.permit[pick % 64] ^= 1,
            1 => forged.worker = worker_id(WORKERS + 1),
            2 => forged.range.count += 1,
            3 => forged.assignment.0 += 1,
            _ => forged.permit.clear(),
        }
        let quarantined = self.rig.quarantined();
        let leases = |world: &Self| world.rig.scheduler.leases.all.keys().copied().collect::<Vec<_>>();
        let before = (self.records(), leases(self));
        let refused = self.rig.deliver(forged.clone());
        let ignored = refused == Ok(Verdict::Quarantined) && quarantined.contains(&forged.worker.to_string());
        assert!(ignored || matches!(refused, Err(RefusedResult::Unissued { .. })), "{refused:?}");
        assert!(self.records() == before.0 && leases(self) == before.1, "a forged result changed something");
        assert_eq!(self.rig.quarantined(), quarantined);
    }

    /// The faulty worker delivers an invalid result. Only its lease and its marks may change.
    fn garble(&mut self, pick: usize, how: u8) {
        let Some(at) = self.pick(pick, |g| g.worker == worker_id(FAULTY)) else { return };
        let given = self.rig.given[at].clone();
        let at_hand = self.rig.scheduler.jobs.active.get(given.job()).map(|job| job.round.number());
        let count = given.range().count as usize;
        let bytes = |bytes: &[u8], count| std::iter::repeat_n(Arc::from(bytes), count).collect();
        let results: Vec<Arc<[u8]>> = match how {
            // Results of a sealed round are compared only by digest, so these would count as wrong results.
            0 | 1 if at_hand != Some(given.range().round) => Vec::new(),
            0 => bytes(&[], count),
            1 => bytes(&[2; 9], count),
            2 => bytes(&fake::encode(Some(1)), count - 1),
            _ => Vec::new(),
        };
        let (quarantined, before) = (self.rig.quarantined(), self.records());
        let refused = self.rig.deliver(given.completed(Delivery::Results(results)));
        let over = matches!(refused, Ok(Verdict::Quarantined | Verdict::Obsolete));
        assert!(over || matches!(refused, Err(RefusedResult::Count { .. } | RefusedResult::Result(_))), "{refused:?}");
        // After the third mark all of its results are disputed.
        if self.rig.quarantined() == quarantined {
            for (before, after) in before.iter().zip(self.records()) {
                // The job may get its first lease in the slot that became free.
                assert!(before.state == JobState::Queued || *before == after, "a refused result changed a job");
            }
        }
    }

    fn submit(&mut self, slot: u8) {
        if !self.jobs.contains_key(&slot) {
            let id = self.rig.submit(NAMES[slot as usize], TASKS[slot as usize], ROUNDS);
            self.jobs.insert(slot, id);
        }
    }

    fn connect(&mut self, worker: u8, slots: u32, left: Option<u64>) {
        let greeting = Greeting { time_left: left.map(Duration::from_secs), ..self.greeting(worker, slots) };
        let welcome = on_connect(&mut self.rig.scheduler, self.rig.now, greeting);
        self.adopted |= !welcome.keep.is_empty();
        self.rig.given.retain(|g| !welcome.drop.contains(&g.id()));
        self.sessions.insert(worker, welcome.session);
    }

    fn disconnect(&mut self, worker: u8) {
        if let Some(session) = self.sessions.get(&worker) {
            self.faults += 1;
            on_disconnect(&mut self.rig.scheduler, self.rig.now, &worker_id(worker), *session);
        }
    }

    /// A worker rejects an assignment.
    fn reject(&mut self, pick: usize) {
        let Some(given) = self.take(pick, false, |_| true) else { return };
        let worker: u8 = given.worker.0[1..].parse().unwrap();
        if let Some(session) = self.sessions.get(&worker) {
            on_return(&mut self.rig.scheduler, self.rig.now, &given.worker, *session, given.id());
        }
    }

    /// A worker delivers a failure.
    fn fail(&mut self, pick: usize) {
        let Some(given) = self.take(pick, false, |_| true) else { return };
        self.faults += 1;
        let failure = Delivery::Failure("by the test".to_owned());
        self.rig.deliver(given.completed(failure)).expect("the assignment was issued");
    }

    fn restart(&mut self) {
        self.rig.commit_and_collect();
        self.rig.restart();
        self.sessions.clear();
        self.still.clear();
    }

    fn step(&mut self, step: Step) {
        let now = self.rig.now;
        match step {
            Step::Submit(slot) => self.submit(slot),
            Step::Connect { worker, slots, left } => self.connect(worker, slots, left),
            Step::Reconnect(worker) => {
                if self.sessions.contains_key(&worker) {
                    self.step(Step::Connect { worker, slots: 2, left: None });
                }
            }
            Step::Complete { pick, keep } => {
                if let Some(given) = self.take(pick, keep, |_| true) {
                    self.deliver(&given, given.worker.clone(), given.delivery());
                }
            }
            Step::CompleteWrong { pick, keep, how } => {
                if let Some(given) = self.take(pick, keep, |g| g.worker == worker_id(FAULTY)) {
                    self.deliver(&given, given.worker.clone(), given.wrong(how));
                }
            }
            Step::Late(pick) => {
                if !self.answered.is_empty() {
                    let given = self.answered[pick % self.answered.len()].clone();
                    self.deliver(&given, given.worker.clone(), given.delivery());
                }
            }
            Step::Twice { pick, worker } => {
                if let Some(given) = self.take(pick, true, |_| true) {
                    self.deliver(&given, worker_id(worker), given.delivery());
                }
            }
            Step::Disconnect(worker) => self.disconnect(worker),
            Step::Heartbeat { worker, moves } => self.heartbeat(worker, moves),
            Step::Drain(worker) => {
                if let Some(session) = self.sessions.get(&worker) {
                    on_drain(&mut self.rig.scheduler, now, &worker_id(worker), *session, &[]);
                }
            }
            Step::Expel(worker) => {
                if let Some(session) = self.sessions.get(&worker) {
                    on_expel(&mut self.rig.scheduler, now, &worker_id(worker), *session);
                }
            }
            Step::Reject(pick) => self.reject(pick),
            Step::Fail(pick) => self.fail(pick),
            Step::Forge { pick, how } => self.forge(pick, how),
            Step::Garble { pick, how } => self.garble(pick, how),
            Step::Pass(seconds) => {
                self.rig.now.since_start += Duration::from_secs(seconds);
                on_tick(&mut self.rig.scheduler, self.rig.now);
            }
            Step::Jump { seconds, unix_ms } => {
                self.rig.now = Now { since_start: now.since_start + Duration::from_secs(seconds), unix_ms };
                on_tick(&mut self.rig.scheduler, self.rig.now);
            }
            Step::Pause(slot) | Step::Resume(slot) => {
                if let Some(id) = self.jobs.get(&slot) {
                    on_pause(&mut self.rig.scheduler, now, id, matches!(step, Step::Pause(_)));
                }
            }
            Step::Cancel(slot) => {
                if let Some(id) = self.jobs.get(&slot) {
                    on_cancel(&mut self.rig.scheduler, now, id);
                }
            }
            Step::Restart => self.restart(),
        }
        self.rig.commit_and_collect();
        let leases = &self.rig.scheduler.leases.all;
        self.still.retain(|id, _| leases.contains_key(id));
    }

    fn heartbeat(&mut self, worker: u8, moves: bool) {
        let Some(session) = self.sessions.get(&worker) else { return };
        let (id, now) = (worker_id(worker), self.rig.now);
        let running: Vec<_> = self.rig.given.iter().filter(|g| g.worker == id).map(|g| g.id()).collect();
        let known = self.rig.scheduler.fleet.workers.get(&id).is_some_and(|w| w.session == Some(*session));
        for assignment in &running {
            let count = self.counts.entry(*assignment).or_insert(0);
            *count += u64::from(moves);
            if known && (moves || !self.still.contains_key(assignment)) {
                self.still.insert(*assignment, now.since_start);
            }
        }
        let progress: Vec<u64> = running.iter().map(|a| self.counts[a]).collect();
        let leased = self.rig.scheduler.leases.all.len();
        on_heartbeat(&mut self.rig.scheduler, now, &id, *session, &running, &progress);
        // Revoked leases may be charged.
        self.faults += leased.abs_diff(self.rig.scheduler.leases.all.len()) as u32;
        self.faults += u32::from(self.rig.scheduler.fleet.workers.get(&id).is_some_and(|w| w.stuck > 0)) * 4;
    }

    /// Checks that undisturbed work ends every job after these events.
    fn finish(&mut self) {
        self.rig.now.since_start += LEASE * 2;
        on_tick(&mut self.rig.scheduler, self.rig.now);
        self.rig.commit_and_collect();
        for id in self.jobs.values() {
            on_pause(&mut self.rig.scheduler, self.rig.now, id, false);
        }
        // Three correct workers: two to compute, and one to decide.
        for worker in [97, 98, 99] {
            self.step(Step::Connect { worker, slots: 2, left: None });
        }
        let fresh = [97, 98, 99].map(worker_id);
        self.rig.given.retain(|g| fresh.contains(&g.worker));
        self.rig.work_off();
        for (slot, id) in self.jobs.clone() {
            let record = self.rig.stored(&id);
            let expected = expected_digest(NAMES[slot as usize], TASKS[slot as usize], ROUNDS);
            match record.state {
                JobState::Succeeded => {
                    assert_eq!(at_once(self.rig.store.result(&id)).artefacts.len(), 1);
                    assert!(record.disputes.iter().all(|d| d.ruling.is_some()), "a job succeeded with an open dispute");
                    if !self.undecided.iter().any(|(job, ..)| *job == id) {
                        assert_eq!(record.result_digest, Some(expected), "the result must not depend on the events");
                    }
                }
                JobState::Cancelled => {}
                JobState::Failed => assert!(record.reason.contains("failed 3 times"), "{}", record.reason),
                JobState::Tainted => {
                    assert!(self.got_wrong_results.contains(&id), "{}", record.reason);
                    let wrong = |d: &&crate::record::Dispute| d.ruling == Some(Ruling::Tainted);
                    let from = record
                        .disputes
                        .iter()
                        .find(wrong)
                        .expect("a tainted job has a tainted dispute")
                        .round
                        .min(ROUNDS);
                    let again = self.rig.submit_again(&id, TASKS[slot as usize], ROUNDS, from);
                    self.rig.work_off();
                    // Except if an earlier wrong result was never compared.
                    if !self.undecided.iter().any(|(job, round, _)| *job == id && *round < from) {
                        assert_eq!(self.rig.stored(&again).result_digest, Some(expected), "repeated from round {from}");
                    }
                }
                state => panic!("job {slot} is {state:?} after all work: {:?}", self.rig.waits_for(&id)),
            }
        }
    }
}

/// Returns true if two deliveries have different results.
fn differs(a: &Delivery, b: &Delivery) -> bool {
    matches!((a, b), (Delivery::Results(a), Delivery::Results(b)) if a != b)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_events_keep_invariants_and_result_bits(steps in prop::collection::vec(step(), 1..150)) {
        let mut world = World::new();
        world.step(Step::Submit(1));
        for step in steps {
            world.step(step);
            world.check();
        }
        world.finish();
        world.check();
    }
}
