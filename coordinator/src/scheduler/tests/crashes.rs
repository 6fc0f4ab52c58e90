//! Tests of tasks that crash workers.

use super::*;

/// Connects one worker after another. Each crashes when it gets the poisoned task, until the job fails. Returns the
/// number of crashes.
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
    panic!("the job has not failed after 100 crashes");
}

/// Suspects of the current round, with the number of attempts of each.
fn suspects(rig: &Rig, job: &JobId) -> BTreeMap<u32, u32> {
    rig.scheduler.jobs.active[job].round.suspects()
}

#[test]
fn crashing_task_is_found_by_running_alone() {
    for restarts in [false, true] {
        let mut rig = Rig::new();
        let job = rig.submit("a", 20, 1);
        let crashes = run_until_poisoned(&mut rig, &job, 4, 13, restarts);
        assert_eq!(crashes, MAX_ATTEMPTS + 1, "one shared crash, then {MAX_ATTEMPTS} alone; restarts: {restarts}");
        let record = rig.stored(&job);
        assert!(record.reason.contains("task 13 of round 0 failed 3 times"), "{}", record.reason);
        let poisoned = record.poisoned.expect("the record names the poisoned task");
        assert_eq!((poisoned.round, poisoned.index, poisoned.attempts), (0, 13, MAX_ATTEMPTS));
        assert_eq!((poisoned.task, &*poisoned.what), (Fake::new(20, 1).task(13), "task 13 of round 0"));
    }
}

#[test]
fn failed_range_makes_suspects_without_attempts() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 2000, 1);
    rig.connect("w", 1);
    // Short tasks are leased in ranges.
    let first = rig.take().unwrap();
    let compute = Duration::from_millis(2) * first.range().count;
    let delivery = first.delivery();
    rig.complete(Completed { compute, ..first.completed(delivery) });
    let range = rig.take().unwrap();
    assert!(range.range().count > 1);
    rig.complete(range.completed(Delivery::Failure("it panicked".to_owned())));
    let expected: BTreeMap<u32, u32> = range.range().indexes().map(|index| (index, 0)).collect();
    assert_eq!(suspects(&rig, &job), expected, "all tasks of the failed range are suspects");
}

#[test]
fn suspect_runs_alone_while_other_workers_continue() {
    let mut rig = Rig::new();
    let (job, other) = (rig.submit("a", 20, 1), rig.submit("b", 1000, 1));
    let session = rig.connect("crashes", 8);
    rig.disconnect("crashes", session);
    rig.given.clear();
    rig.advance(LEASE);
    let suspects = suspects(&rig, &job).len() + suspects(&rig, &other).len();
    assert!(suspects > 8, "{suspects}");
    assert!(rig.stored(&job).charges.iter().all(|charge| !charge.attempt), "a crash with several leases is no attempt");

    rig.connect("x", 4);
    rig.connect("y", 4);
    while let Some(given) = rig.take() {
        for worker in rig.scheduler.fleet.workers.values() {
            let solo = worker.held.iter().any(|a| rig.scheduler.leases.all[a].solo);
            assert!(!solo || worker.held.len() == 1, "a suspect runs beside another lease");
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

/// Breaks the worker's connection and lets its leases expire.
fn break_connection_and_expire(rig: &mut Rig, id: &str, session: SessionId) {
    rig.disconnect(id, session);
    rig.advance(LEASE);
    assert!(!rig.scheduler.fleet.workers.contains_key(&WorkerId(id.into())), "the worker counts as lost");
}

/// Connects the worker again with the leases that it still runs.
fn reconnect(rig: &mut Rig, id: &str, slots: u32) -> SessionId {
    let mine = rig.given.iter().filter(|g| &*g.worker.0 == id);
    let running = mine.map(Given::claim).collect();
    let welcome = rig.greet(Greeting { running, ..greeting(id, slots) });
    rig.given.retain(|g| !welcome.drop.contains(&g.id()));
    rig.commit_and_collect();
    welcome.session
}

#[test]
fn returning_worker_withdraws_its_charges() {
    for restarts in [false, true] {
        let mut rig = Rig::new();
        let job = rig.submit("a", 1, 2);
        let mut session = rig.connect("w", 1);
        for _ in 0..2 * MAX_ATTEMPTS {
            break_connection_and_expire(&mut rig, "w", session);
            assert_eq!(suspects(&rig, &job), [(0, 1)].into(), "the task is charged for the crash");
            if restarts {
                rig.restart();
                assert_eq!(suspects(&rig, &job), [(0, 1)].into());
            }
            session = reconnect(&mut rig, "w", 1);
            assert_eq!(suspects(&rig, &job), [].into());
            assert!(rig.stored(&job).charges.is_empty(), "the stored charges are withdrawn");
            assert_eq!(leased(&rig, &job), 1, "the worker keeps its lease");
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
    break_connection_and_expire(&mut rig, "w", session);
    assert!(suspects(&rig, &job).len() >= 4, "{:?}", suspects(&rig, &job));
    let late = rig.take().unwrap();
    assert_eq!(rig.answer(&late), Verdict::Accepted);
    assert_eq!(suspects(&rig, &job), [].into(), "the other tasks of that crash are no suspects either");
    rig.given.clear();
    // No task is lost, and none has to run alone.
    rig.connect("v", 4);
    assert!(rig.given.iter().any(|g| g.range().count > 1), "{:?}", rig.given);
    rig.work_off();
    rig.assert_right(&job, 1000, 1);
}

#[test]
fn returning_worker_withdraws_no_other_charges() {
    let mut rig = Rig::new();
    let job = rig.submit("a", 1, 1);
    let session = rig.connect("crashes", 1);
    break_connection_and_expire(&mut rig, "crashes", session);
    rig.given.clear();
    let session = rig.connect("w", 1);
    break_connection_and_expire(&mut rig, "w", session);
    assert_eq!(suspects(&rig, &job), [(0, 2)].into());
    let session = reconnect(&mut rig, "w", 1);
    assert_eq!(suspects(&rig, &job), [(0, 1)].into(), "the charge for the other worker's crash stays");
    // A failure that the worker reported is not withdrawn.
    let given = rig.take_of("w").unwrap();
    rig.complete(given.completed(Delivery::Failure("why".to_owned())));
    assert_eq!(suspects(&rig, &job), [(0, 2)].into());
    rig.disconnect("w", session);
    reconnect(&mut rig, "w", 1);
    assert_eq!(suspects(&rig, &job), [(0, 2)].into());
}
