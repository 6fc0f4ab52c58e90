//! Laws about tasks that crash workers.

use super::*;

/// Workers with so many slots come and crash whenever they work on a poisoned task, until the job ends. Returns how
/// many crashed.
fn run_until_poisoned(rig: &mut Rig, job: &JobId, slots: u32, poison: u32, restarts: bool) -> u32 {
    for crashes in 0..100 {
        if rig.stored(job).state == JobState::Failed {
            return crashes;
        }
        if restarts {
            rig.given.clear();
            rig.restart();
        }
        let id = format!("w{crashes}");
        let session = rig.connect(&id, slots);
        rig.given.retain(|g| *g.worker.0 == *id);
        loop {
            rig.given.retain(|g| !rig.cancelled.contains(&g.id()));
            if rig.given.iter().any(|g| g.range().indexes().contains(&poison)) {
                rig.disconnect(id.as_str(), session);
                rig.given.clear();
                rig.advance(LEASE);
                break;
            }
            let Some(given) = rig.take() else { break };
            rig.answer(&given);
        }
    }
    panic!("the job does not end");
}

/// Tasks that are worked on alone, and how often each failed so.
fn suspects(rig: &Rig, job: &JobId) -> BTreeMap<u32, u32> {
    rig.scheduler.jobs.active[job].round.suspects()
}

#[test]
fn culprit_of_shared_crash_is_found_alone() {
    for restarts in [false, true] {
        let mut rig = Rig::new();
        let job = rig.submit("a", 20, 1);
        let crashes = run_until_poisoned(&mut rig, &job, 4, 13, restarts);
        assert_eq!(crashes, MAX_ATTEMPTS + 1, "once in company, then alone; restarts: {restarts}");
        let record = rig.stored(&job);
        assert!(record.reason.contains("task 13 of round 0 failed 3 times"), "{}", record.reason);
        let poisoned = record.poisoned.expect("what to look at");
        assert_eq!((poisoned.round, poisoned.index, poisoned.attempts), (0, 13, MAX_ATTEMPTS));
        assert_eq!((poisoned.task, &*poisoned.what), (Fake::new(20, 1).task(13), "task 13 of round 0"));
    }
}

#[test]
fn failed_range_makes_suspects_without_attempts() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2000, 1);
    rig.connect("w", 1);
    // Short work comes in ranges.
    let first = rig.take().unwrap();
    let compute = Duration::from_millis(2) * first.range().count;
    let delivery = first.delivery();
    rig.complete(Completed { compute, ..first.completed(delivery) });
    let range = rig.take().unwrap();
    assert!(range.range().count > 1);
    rig.complete(range.completed(Delivery::Failure("it panicked".to_owned())));
    let expected: BTreeMap<u32, u32> = range.range().indexes().map(|index| (index, 0)).collect();
    assert_eq!(suspects(&rig, &job), expected, "which of them it was is not known");
}

#[test]
fn suspect_runs_alone_while_other_workers_continue() {
    let mut rig = Rig::new();
    let (job, other) = (rig.submit("a", 20, 1), rig.submit("b", 1000, 1));
    let session = rig.connect("dies", 8);
    rig.disconnect("dies", session);
    rig.given.clear();
    rig.advance(LEASE);
    let suspects = suspects(&rig, &job).len() + suspects(&rig, &other).len();
    assert!(suspects > 8, "{suspects}");
    assert!(rig.stored(&job).charges.iter().all(|charge| !charge.attempt), "a crash of several is no attempt");

    rig.connect("x", 4);
    rig.connect("y", 4);
    while let Some(given) = rig.take() {
        for worker in rig.scheduler.fleet.workers.values() {
            let solo = worker.held.iter().any(|a| rig.scheduler.leases.all[a].solo);
            assert!(!solo || worker.held.len() == 1, "a suspect has company");
        }
        rig.answer(&given);
    }
    rig.assert_right(&job, 20, 1);
    rig.assert_right(&other, 1000, 1);
}

#[test]
fn charges_survive_restart_and_end_with_round() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2, 2);
    rig.connect("w", 1);
    let given = rig.take().unwrap();
    rig.complete(given.completed(Delivery::Failure("why".to_owned())));
    rig.given.clear();
    rig.restart();
    assert_eq!(suspects(&rig, &job), [(0, 1)].into());
    rig.connect("v", 1);
    rig.work_to(&job, 1);
    assert!(rig.stored(&job).charges.is_empty(), "charges end with their round");
}

/// The worker's connection breaks, and its lease runs out before it is back.
fn cut_off(rig: &mut Rig, id: &str, session: SessionId) {
    rig.disconnect(id, session);
    rig.advance(LEASE);
    assert!(!rig.scheduler.fleet.workers.contains_key(&WorkerId(id.into())), "it is taken for dead");
}

/// The same worker is back, with the leases that it still works on.
fn back(rig: &mut Rig, id: &str, slots: u32) -> SessionId {
    let mine = rig.given.iter().filter(|g| &*g.worker.0 == id);
    let running = mine.map(Given::claim).collect();
    let welcome = rig.greet(Greeting { running, ..greeting(id, slots) });
    rig.given.retain(|g| !welcome.drop.contains(&g.id()));
    rig.settle();
    welcome.session
}

#[test]
fn returning_worker_withdraws_its_charges() {
    for restarts in [false, true] {
        let mut rig = Rig::new();
        let job = rig.submit("a", 1, 2);
        let mut session = rig.connect("w", 1);
        for _ in 0..2 * MAX_ATTEMPTS {
            cut_off(&mut rig, "w", session);
            assert_eq!(suspects(&rig, &job), [(0, 1)].into(), "for all that is known it died with it");
            if restarts {
                rig.restart();
                assert_eq!(suspects(&rig, &job), [(0, 1)].into());
            }
            session = back(&mut rig, "w", 1);
            assert_eq!(suspects(&rig, &job), [].into());
            assert!(rig.stored(&job).charges.is_empty(), "that is stored, too");
            assert_eq!(leased(&rig, &job), 1, "it goes on with what it had");
        }
        rig.work_off();
        rig.assert_right(&job, 1, 2);
    }
}

#[test]
fn late_result_withdraws_its_workers_charges() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 1000, 1);
    let session = rig.connect("w", 4);
    cut_off(&mut rig, "w", session);
    assert!(suspects(&rig, &job).len() >= 4, "{:?}", suspects(&rig, &job));
    let late = rig.take().unwrap();
    assert_eq!(rig.answer(&late), Verdict::Accepted);
    assert_eq!(suspects(&rig, &job), [].into(), "what it had beside is not to blame either");
    rig.given.clear();
    // Nothing is forgotten, nor handed out one by one.
    rig.connect("v", 4);
    assert!(rig.given.iter().any(|g| g.range().count > 1), "{:?}", rig.given);
    rig.work_off();
    rig.assert_right(&job, 1000, 1);
}

#[test]
fn returning_worker_withdraws_no_other_charges() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 1, 1);
    let session = rig.connect("dies", 1);
    cut_off(&mut rig, "dies", session);
    rig.given.clear();
    let session = rig.connect("w", 1);
    cut_off(&mut rig, "w", session);
    assert_eq!(suspects(&rig, &job), [(0, 2)].into());
    let session = back(&mut rig, "w", 1);
    assert_eq!(suspects(&rig, &job), [(0, 1)].into(), "another one did die with it");
    // A failure that the worker reported is not withdrawn.
    let given = rig.take_of("w").unwrap();
    rig.complete(given.completed(Delivery::Failure("why".to_owned())));
    assert_eq!(suspects(&rig, &job), [(0, 2)].into());
    rig.disconnect("w", session);
    back(&mut rig, "w", 1);
    assert_eq!(suspects(&rig, &job), [(0, 2)].into());
}
